"""Load a photo from a file, bytes, an array, a tensor or a PIL image."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, brief, quoted
from gauss2svg.files import reading
from gauss2svg.options import Field, file_name
from gauss2svg.photo import by_pillow
from gauss2svg.photo.alpha import has_alpha, over, pixels_of, shrunk
from gauss2svg.photo.decode import check_size, decoded, opened
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS, PREFIX_BYTES, format_of
from gauss2svg.photo.libvips import TYPES
from gauss2svg.photo.photo import Header, Photo, unit
from gauss2svg.photo.reduce import Size, SizeNeeded
from gauss2svg.photo.stored import Stored

ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor
WHITE = (1.0, 1.0, 1.0)  # matte of the background that browsers show


def load_image(
    source: ImageSource,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: Sequence[float] | None = None,
    needed: SizeNeeded | None = None,
) -> Photo:
    """Decode a path, bytes, binary file, PIL image, NumPy array or torch tensor.

    max_pixels  largest number of pixels, 1..MOST_PIXELS, checked before decoding
    matte       sRGB colour in 0..1 over which transparency is composited. None keeps alpha
    needed      longest side in px that is needed, or a function that returns the width and height
                needed for those stored. A larger photo is reduced to that size while it is decoded,
                before its profile and orientation are applied. None keeps all pixels

    A file has one of the formats of gauss2svg.photo.formats. The first of several frames is read.
    Arrays are (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), and torch tensors (c, h, w) or (h, w), of
    uint8, uint16, bool, or floating point in 0..1. EXIF orientation is applied. ICC profiles and
    the gamma of a PNG are converted to sRGB. Colour under alpha 0, which is invisible, becomes 0.
    Raise InputError for anything else.
    """
    Field("max_pixels", int, 1, MOST_PIXELS).checked(max_pixels)
    stored, name = _stored(source, max_pixels)
    return _composited(decoded(stored, name, needed), matte)


def header_of(source: ImageSource, *, max_pixels: int = DEFAULT_MAX_PIXELS) -> Header | None:
    """Return the header of a source of `load_image`, or None for an array or a tensor.

    Raise InputError as `load_image` does. A file that can be read only once must be `rereadable`.
    """
    Field("max_pixels", int, 1, MOST_PIXELS).checked(max_pixels)
    return None if _is_array(source) else _stored(source, max_pixels)[0].header


def reduced(photo: Photo, size: Size) -> Photo:
    """Return a photo reduced by `alpha.shrunk` to a (width, height) in px, which is no larger."""
    if size == (photo.width, photo.height):
        return photo
    pixels = shrunk(pixels_of(photo), size[1], size[0], sharp=True)
    alpha = np.ascontiguousarray(pixels[:, :, 3]) if has_alpha(pixels) else None
    color = np.ascontiguousarray(pixels[:, :, :3])
    return dataclasses.replace(photo, pixels=color, alpha=alpha)


def rereadable(source: ImageSource) -> ImageSource:
    """Return a source that can be read twice: all bytes of an open file, or the source itself."""
    return _file(source)[0] if hasattr(source, "read") else source


def _is_array(source: ImageSource) -> bool:
    torch = sys.modules.get("torch")  # a tensor can only exist once torch is loaded
    return isinstance(source, np.ndarray if torch is None else (np.ndarray, torch.Tensor))


def _stored(source: ImageSource, max_pixels: int) -> tuple[Stored, str]:
    """Return a source as Stored, and its name. Raise InputError above max_pixels."""
    if isinstance(source, np.ndarray):
        return _of_array(source, "array", max_pixels), "array"
    if _is_array(source):
        samples = _tensor_samples(source)
        samples = np.moveaxis(samples, 0, -1) if samples.ndim == 3 else samples
        return _of_array(samples, "tensor", max_pixels), "tensor"
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return by_pillow.of_image(source), "image"
    file, name = _file(source)
    return opened(file, name, max_pixels), name


def _file(source: ImageSource) -> tuple[bytes, str]:
    """Return the bytes of a source that is a file, and its name. Raise InputError for others."""
    if isinstance(source, (bytes, bytearray, memoryview)):
        return bytes(source), f"photo of {len(source)} bytes"
    if isinstance(source, (str, os.PathLike)):
        name = file_name("photo", source)
        with reading(name, "the path of a photo, or - for standard input") as file:
            is_photo = not isinstance(format_of(file.read(PREFIX_BYTES)), str)
            file.seek(0)
            return file.read(-1 if is_photo else PREFIX_BYTES), name
    if not hasattr(source, "read"):
        raise InputError(
            "photo must be a path, bytes, a binary file, a PIL image, a numpy array or a torch "
            f"tensor; got {type(source).__name__}"
        )
    if getattr(source, "closed", False):
        raise InputError(
            "file object must be open; got a closed one. Try the path of the photo, or a file "
            "that is open"
        )
    with suppress(AttributeError, OSError):  # a pipe cannot seek, and is read from where it is
        source.seek(0)
    data = source.read()
    if not isinstance(data, bytes):
        raise InputError(
            f"file object must be binary; got one that reads {type(data).__name__}. Try "
            "open(path, 'rb')"
        )
    return data, "file object"


def _tensor_samples(tensor: Any) -> NDArray[Any]:
    try:
        dense = tensor.detach().cpu().to_dense()
        # NumPy has no bfloat16.
        return (dense.float() if dense.is_floating_point() else dense).numpy()
    except (RuntimeError, TypeError) as error:  # a masked, quantized, nested or meta tensor
        needed, reason = "one that NumPy can hold", str(error).partition("\n")[0].rstrip(".")
        raise InputError(
            f"tensor must be {needed}; got {brief(reason)}. Try a dense tensor of floating point"
        ) from error


def _of_array(array: NDArray[Any], name: str, max_pixels: int) -> Stored:
    if np.ma.is_masked(array):
        raise InputError(f"{name} must be without masked samples; got some. Try .filled(0)")
    array = np.asarray(array)  # a subclass may have other operators
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InputError(
            f"shape of {name} must be (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), of a tensor "
            f"with the channels first; got {array.shape}"
        )
    height, width, channels = array.shape
    check_size((width, height), name, max_pixels)
    samples = array if array.dtype in TYPES.values() else unit(array, name)
    picture = pyvips.Image.new_from_array(np.ascontiguousarray(samples))
    alpha = 3 if channels == 4 else None
    return Stored(width, height, min(channels, 3), alpha, lambda _scale: picture, None)


def _composited(photo: Photo, matte: Sequence[float] | None) -> Photo:
    """Return the photo over the colour `matte`, or unchanged if that is None."""
    if matte is None:
        return photo
    color = np.asarray(matte, np.float32)
    if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
        raise InputError(
            f"matte must be three numbers in 0..1: red, green, blue; got {quoted(matte)}"
        )
    if photo.alpha is None:
        return photo
    name = "".join(f"{round(255 * float(level)):02x}" for level in color)
    notes = (*photo.notes, f"composited over #{name}")
    pixels = over(pixels_of(photo), tuple(color))
    return dataclasses.replace(photo, pixels=pixels, alpha=None, notes=notes)
