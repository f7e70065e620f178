"""Any picture in, one clean array out: sRGB, float32 in 0..1, (height, width, 3), and its alpha."""

from __future__ import annotations

import dataclasses
import io
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, whole_number
from gauss2svg.photo.decode import Decoded, decode_file, decode_picture
from gauss2svg.photo.files import (
    DEFAULT_MAX_PIXELS,
    MOST_PIXELS,
    check_size,
    reading,
    seekable,
)
from gauss2svg.photo.samples import unit

__all__ = [
    "DEFAULT_MAX_PIXELS",
    "MOST_PIXELS",
    "WHITE",
    "ImageSource",
    "Photo",
    "load_image",
    "over_white",
    "shrink",
    "shrink_photo",
]

ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor
WHITE = (1.0, 1.0, 1.0)  # a matte: the page that browsers show


@dataclass(frozen=True, eq=False)
class Photo:
    """A decoded picture.

    pixels  (height, width, 3) float32 sRGB in 0..1, alpha not multiplied in; 0 where it is 0
    notes   what was changed on the way in, for the report
    dpi     px an inch across and down, by the file's resolution tag; None where it has none
    alpha   (height, width) float32 in 0..1; None where every pixel is opaque
    """

    pixels: NDArray[np.float32]
    notes: tuple[str, ...] = ()
    dpi: tuple[float, float] | None = None
    alpha: NDArray[np.float32] | None = None

    @property
    def width(self) -> int:
        """Width in px."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Height in px."""
        return self.pixels.shape[0]


def load_image(
    source: ImageSource,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: Sequence[float] | None = None,
) -> Photo:
    """Decode a path, bytes, binary file, PIL image, numpy array or torch tensor.

    max_pixels  most pixels that are decoded, 1..MOST_PIXELS; asked of the header before
    matte       sRGB colour in 0..1 over which transparency is shown; None: alpha is kept

    Files are JPEG, PNG, WebP, TIFF, GIF, BMP or AVIF, of which the first frame is read. Arrays
    are (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), torch tensors (c, h, w) or (h, w): uint8,
    uint16, bool, or floating point in 0..1. EXIF orientation is applied; ICC profiles and the
    gamma of a PNG are converted to sRGB. Colour under alpha 0, which nobody sees, is 0.
    Raises InputError for anything that cannot be read as a picture.
    """
    whole_number("max_pixels", max_pixels, 1, MOST_PIXELS)
    return _shown_over(_photo(_decode(source, max_pixels)), matte)


def _decode(source: ImageSource, max_pixels: int) -> Decoded:
    torch = sys.modules.get("torch")  # a tensor can only exist once torch is loaded
    if torch is not None and isinstance(source, torch.Tensor):
        dense = source.detach().cpu().to_dense()
        array = (dense.float() if dense.dtype == torch.bfloat16 else dense).numpy()
        last = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
        return _from_array(last, "tensor", max_pixels)
    if isinstance(source, np.ndarray):
        return _from_array(source, "array", max_pixels)
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return decode_picture(source, "image")
    if isinstance(source, (bytes, bytearray, memoryview)):
        return decode_file(io.BytesIO(source), f"photo of {len(source)} bytes", max_pixels)
    if isinstance(source, (str, os.PathLike)):
        with reading(source, "give the path of a photo") as file:
            return decode_file(file, os.fsdecode(source), max_pixels)
    if hasattr(source, "read"):
        return decode_file(seekable(source, "file object"), "file object", max_pixels)
    raise InputError(
        f"got {type(source).__name__}; needed is a path, bytes, a binary file, a PIL image, "
        "a numpy array or a torch tensor"
    )


def _from_array(array: NDArray[Any], name: str, max_pixels: int) -> Decoded:
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InputError(
            f"{name} has shape {array.shape}; needed is (h, w), (h, w, 1), (h, w, 3) or "
            "(h, w, 4), for a torch tensor the channels first"
        )
    check_size((array.shape[1], array.shape[0]), name, max_pixels)
    values = unit(array, name)
    alpha = values[:, :, 3] if array.shape[2] == 4 else None
    return Decoded(values[:, :, :3], alpha, (), None)


def _photo(decoded: Decoded) -> Photo:
    color, alpha = decoded.color, decoded.alpha
    if color.shape[2] == 1:
        color = np.repeat(color, 3, axis=2)
    if alpha is not None and not (alpha < 1).any():
        alpha = None
    if alpha is not None:
        color = np.where(alpha[:, :, None] > 0, color, np.float32(0))
        alpha = np.ascontiguousarray(alpha)
    return Photo(np.ascontiguousarray(color), decoded.notes, decoded.dpi, alpha)


def _shown_over(photo: Photo, matte: Sequence[float] | None) -> Photo:
    """The photo opaque, over a colour where one is given."""
    if matte is None:
        return photo
    color = np.asarray(matte, np.float32)
    if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
        raise InputError(f"matte is {matte!r}; needed are three numbers in 0..1: red, green, blue")
    if photo.alpha is None:
        return photo
    alpha = photo.alpha[:, :, None]
    pixels = np.asarray(photo.pixels * alpha + color * (1 - alpha), np.float32)
    shown = "".join(f"{round(255 * float(level)):02x}" for level in color)
    notes = (*photo.notes, f"transparency shown over #{shown}")
    return dataclasses.replace(photo, pixels=pixels, alpha=None, notes=notes)


def over_white(color: NDArray[np.float32], alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """Transparent pixels (h, w, 3) as a page shows them; alpha (h, w, 1) in 0..1."""
    return np.asarray(color * alpha + (1 - alpha), np.float32)


def shrink(pixels: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Area average of (h, w, channels) float32 pixels on a smaller grid; the mean is kept."""
    if (height, width) == pixels.shape[:2]:
        return pixels
    planes = [
        Image.fromarray(np.ascontiguousarray(pixels[:, :, c])).resize(
            (width, height), Image.Resampling.BOX
        )
        for c in range(pixels.shape[2])
    ]
    return np.clip(np.stack([np.asarray(p) for p in planes], axis=2), 0, 1, dtype=np.float32)


def shrink_photo(photo: Photo, height: int, width: int) -> Photo:
    """A photo on a smaller grid: area averages of alpha, and of colour in proportion to alpha.

    Its dpi shrink with it, so that its size on paper stays.
    """
    if (height, width) == (photo.height, photo.width):
        return photo
    dpi = photo.dpi
    if dpi is not None:
        dpi = dpi[0] * width / photo.width, dpi[1] * height / photo.height
    if photo.alpha is None:
        pixels = shrink(photo.pixels, height, width)
        return dataclasses.replace(photo, pixels=pixels, dpi=dpi)
    weight = photo.alpha[:, :, None]
    alpha = shrink(weight, height, width)
    premultiplied = shrink(photo.pixels * weight, height, width)
    pixels = np.divide(premultiplied, alpha, out=np.zeros_like(premultiplied), where=alpha > 0)
    return dataclasses.replace(
        photo, pixels=np.clip(pixels, 0, 1), alpha=np.ascontiguousarray(alpha[:, :, 0]), dpi=dpi
    )
