"""Maps of the error between two images. All have the same scale, so that they can be compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.files import saved

# Error at the bright end of the scale, in levels of 255. Larger errors have the same colour.
MOST = 64
# Every sixteenth colour of matplotlib's inferno, by Nathaniel J. Smith and Stefan van der Walt
# (CC0). This scale is perceptually uniform. It runs from black for no error to pale yellow for the
# largest errors.
_COLORS = np.array(
    [
        0x000004, 0x0B0724, 0x210C4A, 0x3D0965, 0x57106E, 0x71196E, 0x8A226A, 0xA32C61, 0xBC3754,
        0xD04545, 0xE35933, 0xF1711F, 0xF98C0A, 0xFCAA0F, 0xF9C932, 0xF2E865, 0xFCFFA4,
    ]
)[:, None] >> (16, 8, 0) & 0xFF  # fmt: skip


def errors(image: NDArray[np.floating], other: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the error (h, w) of each pixel in levels of 255.

    This is the largest absolute difference among the pixel's channels.
    """
    return np.abs(np.subtract(image, other, dtype=np.float64)).max(axis=2) * 255


def colors_of(levels: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return the colours (..., 3) of errors (...) in levels of 255.

    Errors above MOST have the colour of MOST.
    """
    places = np.linspace(0, MOST, len(_COLORS))
    channels = [np.interp(levels, places, channel) for channel in _COLORS.T]
    return np.round(np.stack(channels, axis=-1)).astype(np.uint8)


def legend() -> list[str]:
    """Return nine colours of the scale as #rrggbb, for errors at even steps from 0 to MOST."""
    return ["#" + bytes(color).hex() for color in colors_of(np.linspace(0, MOST, 9))]


def heatmap(image: NDArray[np.floating], other: NDArray[np.floating]) -> bytes:
    """Return a PNG in which the colour of each pixel shows the error there.

    Errors are rounded to whole levels, and each of the levels 0..MOST has a colour. Larger errors
    have the colour of MOST. Both images are (h, w, c) in 0..1.
    """
    levels = np.minimum(np.round(errors(image, other)), MOST).astype(np.uint8)
    picture = Image.fromarray(levels, "P")
    picture.putpalette(colors_of(np.arange(MOST + 1.0)).tobytes())
    return saved(lambda stream: picture.save(stream, "PNG", optimize=True))
