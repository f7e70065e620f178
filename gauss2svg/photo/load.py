"""Loading a photo: a file, bytes, array, tensor or PIL image becomes a Photo."""

from __future__ import annotations

import dataclasses
import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, brief, quoted, whole_number
from gauss2svg.files import reading
from gauss2svg.options import file_name
from gauss2svg.photo import by_pillow
from gauss2svg.photo.alpha import has_alpha, nearest, over, pixels_of, shrunk
from gauss2svg.photo.decode import check_size, decoded, opened
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.photo.photo import Header, Photo, unit
from gauss2svg.photo.reduce import Size, SizeNeeded, decoded_size, reduced_size

ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor
WHITE = (1.0, 1.0, 1.0)  # a matte: the background that browsers show


def load_image(
    source: ImageSource,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: Sequence[float] | None = None,
    needed: SizeNeeded | None = None,
) -> Photo:
    """Decode a path, bytes, binary file, PIL image, numpy array or torch tensor.

    max_pixels  largest number of pixels, 1..MOST_PIXELS, checked before decoding
    matte       sRGB colour in 0..1 that transparency is composited over; None: alpha is kept
    needed      the longest side in px that is needed, or a function of the width and height as
                stored that returns those needed: a larger photo is reduced to them by area average
                while it is decoded, before its profile and orientation are applied; None: all

    Files are of one of gauss2svg.photo.formats; of several frames the first is read. Arrays are
    (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), torch tensors (c, h, w) or (h, w): uint8, uint16,
    bool, or floating point in 0..1. EXIF orientation is applied; ICC profiles and the
    gamma of a PNG are converted to sRGB. Colour under alpha 0, which is invisible, becomes 0.
    Raises InputError for anything else.
    """
    whole_number("max_pixels", max_pixels, 1, MOST_PIXELS)
    return _composited(_load(source, max_pixels, needed), matte)


def header_of(source: ImageSource, *, max_pixels: int = DEFAULT_MAX_PIXELS) -> Header | None:
    """Size of a source of `load_image` by its header alone; None for one that is in memory.

    Raises InputError as `load_image` does. A file that cannot be read twice must be `rereadable`.
    """
    whole_number("max_pixels", max_pixels, 1, MOST_PIXELS)
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return by_pillow.of_image(source).header
    with _file(source) as (file, name):
        return None if file is None else opened(file, name, max_pixels).header


def load_reduced(
    source: ImageSource,
    longest_side: int,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: Sequence[float] | None = None,
) -> Photo:
    """A photo by `load_image`, reduced to a longest side in px as a run reduces it.

    Less than twice as large, it is decoded whole and reduced by Lanczos' filter.
    """

    def needed(width: int, height: int) -> Size:
        whole = width, height
        return decoded_size(whole, reduced_size(longest_side, *whole) or whole)

    photo = load_image(source, max_pixels=max_pixels, matte=matte, needed=needed)
    return reduced(photo, reduced_size(longest_side, *photo.full) or photo.full, sharp=True)


def reduced(photo: Photo, size: Size, sharp: bool = False) -> Photo:
    """A photo of that width and height in px, no larger, by `alpha.shrunk`."""
    if size == (photo.width, photo.height):
        return photo
    pixels = shrunk(pixels_of(photo), size[1], size[0], sharp)
    alpha = np.ascontiguousarray(pixels[:, :, 3]) if has_alpha(pixels) else None
    color = np.ascontiguousarray(pixels[:, :, :3])
    sample = nearest(photo.sample, size)
    return dataclasses.replace(photo, pixels=color, alpha=alpha, given_sample=sample)


def rereadable(source: ImageSource) -> ImageSource:
    """The source, or all of its bytes in memory where it is a file that cannot be read twice."""
    return _seekable(source) if hasattr(source, "read") else source


def _load(source: ImageSource, max_pixels: int, needed: SizeNeeded | None) -> Photo:
    torch = sys.modules.get("torch")  # a tensor can only exist once torch is loaded
    if torch is not None and isinstance(source, torch.Tensor):
        array = _tensor_samples(source, torch.bfloat16)
        last = np.moveaxis(array, 0, -1) if array.ndim == 3 else array
        return _as_needed(_from_array(last, "tensor", max_pixels), needed)
    if isinstance(source, np.ndarray):
        return _as_needed(_from_array(_plain_array(source), "array", max_pixels), needed)
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return decoded(by_pillow.of_image(source), "image", needed)
    with _file(source) as (file, name):
        if file is not None:
            return decoded(opened(file, name, max_pixels), name, needed)
    raise InputError(
        "photo must be a path, bytes, a binary file, a PIL image, a numpy array or a torch "
        f"tensor; got {type(source).__name__}"
    )


def _plain_array(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array of any subclass as a plain one, of the same samples.

    np.matrix keeps two dimensions whatever its index, and other subclasses redefine operators.
    Raise InputError for a masked array with masked samples, which have no value.
    """
    if np.ma.is_masked(array):
        count = int(np.ma.getmaskarray(array).sum())
        raise InputError(
            f"array must be without masked samples; got {count} masked of {array.size}. Try "
            ".filled(0), or another value"
        )
    return np.asarray(array)


@contextmanager
def _file(source: ImageSource) -> Iterator[tuple[BinaryIO | None, str]]:
    """A source that is a file, open for reading, and its name; None for any other."""
    if isinstance(source, (bytes, bytearray, memoryview)):
        yield io.BytesIO(source), f"photo of {len(source)} bytes"
    elif isinstance(source, (str, os.PathLike)):
        name = file_name("photo", source)
        with reading(name, "the path of a photo, or - for standard input") as file:
            yield file, name
    elif hasattr(source, "read"):
        yield _seekable(source), "file object"
    else:
        yield None, ""


def _seekable(file: Any) -> BinaryIO:
    """The file itself, or all of its bytes in memory where it cannot be read twice."""
    if getattr(file, "closed", False):
        raise InputError(
            "file object must be open; got a closed one. Try the path of the photo, or a file "
            "that is open"
        )
    try:
        file.seek(0)
        data = file.read(0)
    except (AttributeError, OSError):
        data = file.read()
        file = io.BytesIO(data) if isinstance(data, bytes) else file
    if not isinstance(data, bytes):
        raise InputError(
            f"file object must be binary; got one that reads {type(data).__name__}. Try "
            "open(path, 'rb')"
        )
    return file


def _tensor_samples(tensor: Any, bfloat16: Any) -> NDArray[Any]:
    try:
        dense = tensor.detach().cpu().to_dense()
        return (dense.float() if dense.dtype == bfloat16 else dense).numpy()
    except (RuntimeError, TypeError) as error:  # masked, quantized, nested, without data
        needed, reason = "one that NumPy can hold", str(error).partition("\n")[0].rstrip(".")
        raise InputError(
            f"tensor must be {needed}; got {brief(reason)}. Try a dense tensor of floating point"
        ) from error


def _from_array(array: NDArray[Any], name: str, max_pixels: int) -> Photo:
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InputError(
            f"shape of {name} must be (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), of a tensor "
            f"with the channels first; got {array.shape}"
        )
    check_size((array.shape[1], array.shape[0]), name, max_pixels)
    values = unit(array, name)
    alpha = values[:, :, 3] if array.shape[2] == 4 else None
    return Photo.from_samples(values[:, :, :3], alpha)


def _as_needed(photo: Photo, needed: SizeNeeded | None) -> Photo:
    """A photo that was in memory, of the size needed."""
    return reduced(photo, reduced_size(needed, photo.width, photo.height) or photo.full)


def _composited(photo: Photo, matte: Sequence[float] | None) -> Photo:
    """The photo opaque, over a colour where one is given."""
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
