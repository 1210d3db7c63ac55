"""Looking at pictures without eyes."""

import io

import numpy as np
from matplotlib import image


def inked(picture: bytes) -> float:
    """Return the share of a PNG's pixels that differ from its corner."""
    pixels = image.imread(io.BytesIO(picture), format="png")
    assert min(pixels.shape[:2]) > 200
    return float(np.mean(np.any(np.abs(pixels - pixels[0, 0]) > 0.02, axis=2)))
