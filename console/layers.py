"""Layers of the 3D scene: many signs of one kind, sent as one message when they change."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from viser import BatchedMeshHandle, LabelHandle, LineSegmentsHandle, SceneApi

from console.shapes import Mesh

Colour = tuple[int, int, int]


def linear(colours: Sequence[Colour]) -> NDArray[np.uint8]:
    """Return sRGB colours (N, 3) as the linear light that viser takes them for."""
    share = np.array(colours, dtype=float).reshape(-1, 3) / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.round(255.0 * light).astype(np.uint8)


class Signs:
    """Instances of one mesh, each with its own pose, size and colour."""

    def __init__(self, scene: SceneApi, name: str, mesh: Mesh, opacity: float = 1.0) -> None:
        self._scene = scene
        self._name = name
        self._mesh = mesh
        self._opacity = opacity
        self._handle: BatchedMeshHandle | None = None
        self._colours: tuple[Colour, ...] = ()

    def show(
        self,
        positions: ArrayLike,
        wxyzs: ArrayLike,
        scales: ArrayLike,
        colours: Sequence[Colour],
        opacities: Sequence[float] | None = None,
    ) -> None:
        """Show N signs at positions (N, 3), turned by wxyzs (N, 4), sized scales (N, 3).

        `opacities` are each sign's own; left out, all have that of the layer.
        """
        places = np.asarray(positions, dtype=np.float32).reshape(-1, 3)
        turns = np.asarray(wxyzs, dtype=np.float32).reshape(-1, 4)
        sizes = np.asarray(scales, dtype=np.float32).reshape(-1, 3)
        wanted = tuple(colours)
        veils = None if opacities is None else np.asarray(opacities, dtype=np.float32)
        if self._handle is not None and len(wanted) != len(self._colours):
            self.clear()
        if not wanted:
            return
        if self._handle is None:
            self._handle = self._scene.add_batched_meshes_simple(
                self._name,
                self._mesh.vertices,
                self._mesh.faces,
                turns,
                places,
                batched_scales=sizes,
                batched_colors=linear(wanted),
                batched_opacities=veils,
                opacity=None if self._opacity >= 1.0 else self._opacity,
                lod="off",
                side="double",
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )
        else:
            self._handle.batched_positions = places
            self._handle.batched_wxyzs = turns
            self._handle.batched_scales = sizes
            if veils is not None:
                self._handle.batched_opacities = veils
            if wanted != self._colours:
                self._handle.batched_colors = linear(wanted)
        self._colours = wanted

    def clear(self) -> None:
        """Show none."""
        if self._handle is not None:
            self._handle.remove()
        self._handle, self._colours = None, ()


class Lines:
    """Line segments of one width in pixels."""

    def __init__(self, scene: SceneApi, name: str, width_px: float) -> None:
        self._scene = scene
        self._name = name
        self._width_px = width_px
        self._handle: LineSegmentsHandle | None = None

    def show(self, points: ArrayLike, colours: Sequence[Colour]) -> None:
        """Show N segments with ends points (N, 2, 3), one colour each."""
        ends = np.asarray(points, dtype=np.float32).reshape(-1, 2, 3)
        if not len(ends):
            self.clear()
            return
        shades = np.repeat(linear(colours)[:, None, :], 2, axis=1)
        if self._handle is None:
            self._handle = self._scene.add_line_segments(
                self._name, ends, shades, thickness=self._width_px, thickness_units="screen"
            )
        elif ends.shape == self._handle.points.shape:
            self._handle.points = ends
            self._handle.colors = shades
        else:
            self.clear()
            self.show(points, colours)

    def clear(self) -> None:
        """Show none."""
        if self._handle is not None:
            self._handle.remove()
        self._handle = None


class Labels:
    """Words beside things, each with a key of its own."""

    def __init__(self, scene: SceneApi, name: str) -> None:
        self._scene = scene
        self._name = name
        self._handles: dict[str, LabelHandle] = {}

    def show(self, labels: dict[str, tuple[str, tuple[float, float, float]]]) -> None:
        """Show exactly these labels: key to text and position."""
        for key in self._handles.keys() - labels.keys():
            self._handles.pop(key).remove()
        for key, (text, position) in labels.items():
            handle = self._handles.get(key)
            if handle is None:
                self._handles[key] = self._scene.add_label(
                    f"{self._name}/{key}",
                    text,
                    position=position,
                    font_screen_scale=0.85,
                    anchor="center-center",
                )
                continue
            handle.position = position
            if handle.text != text:
                handle.text = text

    def clear(self) -> None:
        """Show none."""
        self.show({})
