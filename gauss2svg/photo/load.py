"""Loading a photo: a file, bytes, array, tensor or PIL image becomes a Photo."""

from __future__ import annotations

import dataclasses
import io
import os
import sys
from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, must_be, shown, whole_number
from gauss2svg.files import reading
from gauss2svg.options import file_name
from gauss2svg.photo.alpha import over, pixels_of
from gauss2svg.photo.decode import decode_file, decode_image
from gauss2svg.photo.formats import check_size
from gauss2svg.photo.limits import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.photo.photo import Photo
from gauss2svg.photo.samples import plain_array, unit

ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor
WHITE = (1.0, 1.0, 1.0)  # a matte: the background that browsers show


def load_image(
    source: ImageSource,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: Sequence[float] | None = None,
) -> Photo:
    """Decode a path, bytes, binary file, PIL image, numpy array or torch tensor.

    max_pixels  largest number of pixels, 1..MOST_PIXELS, checked before decoding
    matte       sRGB colour in 0..1 that transparency is composited over; None: alpha is kept

    Files are JPEG, PNG, WebP, TIFF, GIF, BMP or AVIF, of which the first frame is read. Arrays
    are (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), torch tensors (c, h, w) or (h, w): uint8,
    uint16, bool, or floating point in 0..1. EXIF orientation is applied; ICC profiles and the
    gamma of a PNG are converted to sRGB. Colour under alpha 0, which is invisible, becomes 0.
    Raises InputError for anything else.
    """
    whole_number("max_pixels", max_pixels, 1, MOST_PIXELS)
    return _composited(_load(source, max_pixels), matte)


def _load(source: ImageSource, max_pixels: int) -> Photo:
    torch = sys.modules.get("torch")  # a tensor can only exist once torch is loaded
    if torch is not None and isinstance(source, torch.Tensor):
        array = _tensor_samples(source, torch.bfloat16)
        last = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
        return _from_array(last, "tensor", max_pixels)
    if isinstance(source, np.ndarray):
        return _from_array(plain_array(source, "array"), "array", max_pixels)
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return decode_image(source, "image")
    if isinstance(source, (bytes, bytearray, memoryview)):
        return decode_file(io.BytesIO(source), f"photo of {len(source)} bytes", max_pixels)
    if isinstance(source, (str, os.PathLike)):
        name = file_name("photo", source)
        with reading(name, "the path of a photo, or - for standard input") as file:
            return decode_file(file, name, max_pixels)
    if hasattr(source, "read"):
        if getattr(source, "closed", False):
            got, advice = shown("a closed one"), "the path of the photo, or a file that is open"
            raise InputError(must_be("file object", "open", got, advice))
        return decode_file(_seekable(source), "file object", max_pixels)
    raise InputError(
        must_be(
            "photo",
            "a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor",
            shown(type(source).__name__),
        )
    )


def _seekable(file: Any) -> BinaryIO:
    """The file itself, or all of its bytes in memory where it cannot be read twice."""
    try:
        file.seek(0)
        data = file.read(0)
    except (AttributeError, OSError):
        data = file.read()
        file = io.BytesIO(data) if isinstance(data, bytes) else file
    if not isinstance(data, bytes):
        got = shown(f"one that reads {type(data).__name__}")
        raise InputError(must_be("file object", "binary", got, "open(path, 'rb')"))
    return file


def _tensor_samples(tensor: Any, bfloat16: Any) -> NDArray[Any]:
    try:
        dense = tensor.detach().cpu().to_dense()
        return (dense.float() if dense.dtype == bfloat16 else dense).numpy()
    except (RuntimeError, TypeError) as error:  # masked, quantized, nested, without data
        needed, reason = "one that NumPy can hold", str(error).partition("\n")[0].rstrip(".")
        advice = "a dense tensor of floating point"
        raise InputError(must_be("tensor", needed, shown(reason), advice)) from error


def _from_array(array: NDArray[Any], name: str, max_pixels: int) -> Photo:
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InputError(
            must_be(
                f"shape of {name}",
                "(h, w), (h, w, 1), (h, w, 3) or (h, w, 4), of a tensor with the channels first",
                array.shape,
            )
        )
    check_size((array.shape[1], array.shape[0]), name, max_pixels)
    values = unit(array, name)
    alpha = values[:, :, 3] if array.shape[2] == 4 else None
    return Photo.from_samples(values[:, :, :3], alpha)


def _composited(photo: Photo, matte: Sequence[float] | None) -> Photo:
    """The photo opaque, over a colour where one is given."""
    if matte is None:
        return photo
    color = np.asarray(matte, np.float32)
    if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
        raise InputError(must_be("matte", "three numbers in 0..1: red, green, blue", matte))
    if photo.alpha is None:
        return photo
    name = "".join(f"{round(255 * float(level)):02x}" for level in color)
    notes = (*photo.notes, f"composited over #{name}")
    pixels = over(pixels_of(photo), tuple(color))
    return dataclasses.replace(photo, pixels=pixels, alpha=None, notes=notes)
