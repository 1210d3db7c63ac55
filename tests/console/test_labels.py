import numpy as np
import pytest

from console.camera import Lens
from console.labels import GLYPH, MAX_LABELS, TEXT, Declutter, Label, Placed, leaders

LENS = Lens.at((0.0, -8.0, 8.0), (0.0, 0.0, 0.0))
SIZE_M = TEXT * LENS.span_m((0.0, 0.0, 0.0))
"""Height of a line of text in the middle of the field."""


def box(placed: Placed) -> tuple[float, float, float, float]:
    """What a label covers of the first camera's picture: left, bottom, right, top."""
    x, y = LENS.seen(placed.position)
    half = 0.5 * GLYPH * TEXT * len(placed.text)
    return x - half, y - 0.5 * TEXT, x + half, y + 0.5 * TEXT


def overlaps(found: dict[str, Placed]) -> list[tuple[str, str]]:
    boxes = [(key, box(placed)) for key, placed in found.items()]
    return [
        (a, b)
        for i, (a, p) in enumerate(boxes)
        for b, q in boxes[i + 1 :]
        if min(p[2], q[2]) - max(p[0], q[0]) > 1e-9 and min(p[3], q[3]) - max(p[1], q[1]) > 1e-9
    ]


def test_a_label_alone_stands_above_its_thing_without_a_line() -> None:
    label = Label("r21", "D21", (1.0, 2.0, 1.5), 1)
    found = Declutter().place([label], LENS)
    assert not found["r21"].led
    assert found["r21"].position[2] > 1.5
    assert leaders([label], found) == []


def test_robots_that_meet_their_targets_keep_readable_names() -> None:
    labels = [
        Label(
            f"{kind}{number}", f"{kind.upper()}{number} blind", (0.05 * number, 0.0, height), rank
        )
        for kind, height, rank in (("d", 1.0, 1), ("t", 0.1, 2))
        for number in range(3)
    ]
    found = Declutter().place(labels, LENS)
    assert found.keys() == {label.key for label in labels}
    assert overlaps(found) == []


def test_the_less_important_one_gives_way() -> None:
    robot, target = Label("r1", "D1", (0.0, 0.0, 0.1), 1), Label("t1", "T1", (0.0, 0.0, 0.1), 2)
    alone = Declutter().place([robot], LENS)
    together = Declutter().place([target, robot], LENS)
    assert together["r1"] == alone["r1"]
    assert overlaps(together) == []


def test_names_that_have_gone_far_are_led_home() -> None:
    crowd = [Label(f"r{i}", "D21 blind", (0.01 * i, 0.0, 1.0), 1) for i in range(12)]
    found = Declutter().place(crowd, LENS)
    lines = leaders(crowd, found)
    assert len(lines) == sum(placed.led for placed in found.values()) > 0
    assert all(start in [label.place for label in crowd] for start, _ in lines)


def test_names_rest_while_things_move_a_little() -> None:
    declutter = Declutter()
    dice = np.random.default_rng(3)
    places = dice.uniform(-2.0, 2.0, size=(8, 2))
    moves = 0
    before: dict[str, tuple[float, ...]] = {}
    for _ in range(100):
        places += dice.normal(0.0, 0.01, size=places.shape)
        labels = [
            Label(f"r{i}", f"D{i}", (x, y, 1.0), 1) for i, (x, y) in enumerate(places.tolist())
        ]
        found = declutter.place(labels, LENS)
        sides = {
            label.key: tuple(
                np.round(
                    np.subtract(LENS.seen(found[label.key].position), LENS.seen(label.place)), 6
                )
            )
            for label in labels
        }
        moves += sum(before.get(key, side) != side for key, side in sides.items())
        before = sides
    assert moves <= 8


def test_of_too_many_the_important_ones_are_shown() -> None:
    robots = [Label(f"r{i}", "D", (float(i), 0.0, 0.0), 1) for i in range(40)]
    targets = [Label(f"t{i}", "T", (float(i), 5.0, 0.0), 2) for i in range(128)]
    found = Declutter().place([*targets, *robots], LENS)
    assert found.keys() == {robot.key for robot in robots}
    assert Declutter().place([*robots, *robots[: MAX_LABELS - 39]], LENS) == {}


def test_a_label_goes_back_only_when_there_is_room_to_spare() -> None:
    declutter = Declutter()
    robot = Label("r1", "D1", (0.0, 0.0, 0.0), 1)

    def target(x: float) -> Label:
        return Label("t1", "T1", (x, 0.0, 0.0), 2)

    home = declutter.place([robot, target(9.0)], LENS)["t1"].position[2]
    assert declutter.place([robot, target(0.0)], LENS)["t1"].position[2] != home
    just_free = GLYPH * SIZE_M * 2 + 0.01
    assert declutter.place([robot, target(just_free)], LENS)["t1"].position[2] != home
    assert declutter.place([robot, target(2.0)], LENS)["t1"].position[2] == pytest.approx(home)


def test_nothing_is_nothing() -> None:
    assert Declutter().place([], LENS) == {}


def test_a_crowd_is_placed_as_if_each_chose_by_itself_from_what_is_left() -> None:
    """One pass over all that have yet to choose must come to what a plain search comes to."""
    dice = np.random.default_rng(5)
    places = dice.uniform(-1.0, 1.0, size=(MAX_LABELS, 2)).tolist()
    crowd = [Label(f"r{i:02}", f"D{i} blind", (x, y, 1.0), 1) for i, (x, y) in enumerate(places)]
    found = Declutter().place(crowd, LENS)
    assert len(found) == MAX_LABELS
    taken: list[tuple[float, float, float, float]] = []
    for label in crowd:
        chosen = covered(box(found[label.key]), taken)
        others = [Declutter().place([label], LENS)[label.key]]
        assert all(chosen <= covered(box(other), taken) + 1e-9 for other in others)
        taken.append(box(found[label.key]))


def covered(
    asked: tuple[float, float, float, float], taken: list[tuple[float, float, float, float]]
) -> float:
    """The area of a box that others take."""
    return sum(
        max(0.0, min(asked[2], b[2]) - max(asked[0], b[0]))
        * max(0.0, min(asked[3], b[3]) - max(asked[1], b[1]))
        for b in taken
    )
