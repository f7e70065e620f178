"""Load a photo from a file, bytes, an array, a tensor or a PIL image."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, brief, refusal
from gauss2svg.files import reading
from gauss2svg.options import Field, check_color, file_name
from gauss2svg.photo import DEFAULT_MAX_PIXELS, FORMATS, MOST_PIXELS, PREFIX_BYTES, format_of
from gauss2svg.photo.decoders import TURNED, TYPES, StoredImage, in_srgb, of_file, of_image, samples
from gauss2svg.photo.pixels import (
    FOCUS_STRENGTH,
    Focus,
    Header,
    Photo,
    Size,
    SizeNeeded,
    has_alpha,
    over,
    reduced_size,
    unit,
)

# libjpeg can reduce a JPEG while it decodes it, but its filter removes high frequencies
# (docs/decisions/photo.md). So libjpeg may reduce each side only to at least this many times the
# size needed, and `resized` does the rest of the reduction.
OVERSIZE = 3


@contextmanager
def _refusing(name: str) -> Iterator[None]:
    """Raise InputError in place of the exceptions that a hostile file causes in the block.

    MemoryError is raised as it is.
    """
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        # A ValueError says what the file has. Only a decoder's programmers understand the others.
        reason = brief(str(error).partition("\n")[0]) if isinstance(error, ValueError) else ""
        got = f"one that is broken, truncated or unsupported{f' ({reason})' if reason else ''}"
        advice = "another copy of it, or re-saving it as PNG"
        raise refusal(name, "a complete image of a supported kind", got, advice) from error


def opened(file: bytes, name: str, max_pixels: int) -> StoredImage:
    """Read the header of an image file.

    Raise InputError if it is unsupported, broken, or larger than max_pixels.
    """
    kind = format_of(file[:PREFIX_BYTES])
    if isinstance(kind, str):
        needed = f"a supported image ({', '.join(FORMATS)})"
        is_lost = kind in ("an empty file", "a web page")  # nothing in it can be converted
        raise refusal(name, needed, kind, "another copy of it" if is_lost else "converting it")
    with _refusing(name):
        stored = of_file(file, kind.loader)
    check_size((stored.width, stored.height), name, max_pixels)
    return stored


def decoded(stored: StoredImage, name: str, needed: SizeNeeded | None = None) -> Photo:
    """Decode an opened image, and reduce it to the size needed.

    Raise InputError if the image is broken.
    """
    size = reduced_size(needed, stored.width, stored.height)
    with _refusing(name):
        pixels = samples(_picture(stored, size))
        if size not in (None, pixels.shape[1::-1]):
            # Floats outside of 0..1 must be refused by `unit` before a filter mixes them.
            whole = pyvips.Image.new_from_array(unit(pixels, name))
            pixels = samples(resized(whole, size, stored.alpha is not None))
    if size is not None and pixels.dtype == np.float32:
        # The filter that reduces the picture may return samples slightly outside of 0..1.
        pixels = pixels.clip(0, 1)
    pixels = unit(pixels, name)
    color, notes = in_srgb(pixels[:, :, : stored.colors], stored.profile)
    orientation = stored.orientation
    turned = [] if orientation == 1 else ["EXIF orientation applied"]
    dpi = stored.dpi if stored.dpi and min(stored.dpi) > 0 else None
    if dpi and orientation in TURNED:
        dpi = dpi[1], dpi[0]
    color = upright(color, orientation)
    color = np.ascontiguousarray(color if color.shape[2] == 3 else color.repeat(3, axis=2))
    if stored.alpha is not None and (pixels[:, :, -1] < 1).any():
        alpha = upright(pixels[:, :, -1:], orientation)
        color = np.dstack([np.where(alpha > 0, color, np.float32(0)), alpha])
    return Photo(color, stored.upright_size, (*turned, *stored.notes, *notes), dpi)


def _picture(stored: StoredImage, size: Size | None) -> Any:
    """Return a libvips picture with only the channels of colour and alpha.

    The picture is reduced to `size`, unless that is None or the samples are floats.
    """
    full = stored.width, stored.height
    reduction = min(side / small for side, small in zip(full, size or full, strict=True))
    scale = max(s for s in stored.scales if s == 1 or s * OVERSIZE <= reduction)
    picture = stored.picture(scale)
    if (picture.width, picture.height) != tuple(-(-side // scale) for side in full):
        raise ValueError(f"its pixels are {picture.width}x{picture.height}")
    bands = [*range(stored.colors), *([] if stored.alpha is None else [stored.alpha])]
    if picture.bands > len(bands):
        picture = picture[bands[0]].bandjoin([picture[band] for band in bands[1:]])
    if size is None or picture.format == "float":
        return picture
    return resized(picture, size, stored.alpha is not None)


def resized(picture: Any, size: Size, has_alpha: bool) -> Any:
    """Return a libvips picture reduced to `size`.

    An opaque picture is reduced by the cubic filter of Catmull and Rom. A picture with alpha is
    reduced by a triangle filter, because a filter with negative weights would leave faint rings
    around the edges of its alpha (docs/decisions/photo.md). The samples of a picture with alpha
    become floats in 0..1.
    """
    across, down = (
        small / side for small, side in zip(size, (picture.width, picture.height), strict=True)
    )
    if has_alpha:
        opaque = {"uchar": 255, "ushort": 65535, "float": 1}[picture.format]
        picture = (picture / opaque).premultiply(max_alpha=1)
    picture = picture.resize(across, vscale=down, kernel="linear" if has_alpha else "cubic")
    return picture.unpremultiply(max_alpha=1) if has_alpha else picture


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return an image (h, w, ...) turned upright by its orientation (EXIF 2.32, 4.6.4, tag 274)."""
    if orientation in TURNED:
        array = array.swapaxes(0, 1)
    # For these orientations, the first row is the bottom of the upright image.
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def check_size(size: Size, name: str, max_pixels: int) -> None:
    """Raise InputError if a size (width, height) has no pixels, or more than max_pixels pixels."""
    width, height = size
    if width < 1 or height < 1:
        raise refusal(name, "at least 1x1 px", f"{width}x{height} px")
    count = width * height
    if count > max_pixels:
        advice = "shrinking it"
        if count <= MOST_PIXELS:
            advice += f", or raising --max-pixels, up to {MOST_PIXELS}, if you trust the file"
        needed = f"at most {max_pixels} px (--max-pixels)"
        raise refusal(name, needed, f"{width}x{height} = {count} px", advice)


ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor
WHITE_MATTE = "#ffffff"  # background on which browsers show a picture
DARK = 4096 / 65535  # above the brightest sample of a camera's 12 bits in samples of 16


def load_image(
    source: ImageSource,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: str | None = None,
    needed: SizeNeeded | None = None,
) -> Photo:
    """Decode a path, bytes, binary file, PIL image, NumPy array or torch tensor.

    max_pixels  largest number of pixels, 1..MOST_PIXELS, checked before decoding
    matte       "#rrggbb" of the colour over which a transparent photo is composited. None keeps
                alpha
    needed      longest side in px that is needed, or a function that takes the stored width and
                height and returns the needed width and height. A larger photo is reduced to that
                size while it is decoded, before its profile and orientation are applied. None
                keeps all pixels

    A file must have one of the formats in gauss2svg.photo.FORMATS. If it has several frames, the
    first is read. An array has the shape (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), and a torch
    tensor has the shape (c, h, w) or (h, w). Their samples are uint8, uint16, bool, or floating
    point in 0..1. The EXIF orientation is applied. Colours are converted to sRGB from the ICC
    profile of a file. Where alpha is 0, the colour is invisible and becomes 0. Raise InputError for
    anything else.
    """
    Field("max_pixels", int, 1, MOST_PIXELS).checked(max_pixels)
    stored, name = _stored(source, max_pixels)
    photo = decoded(stored, name, needed)
    brightest = float(photo.pixels[:, :, :3].max())
    if 0 < brightest <= DARK:
        note = f"brightest sample is {brightest:.3f} of white; scale samples of 12 bits by 16 first"
        photo = dataclasses.replace(photo, notes=(*photo.notes, note))
    matte = None if matte is None else check_color("matte", matte)
    if matte is None or not has_alpha(photo.pixels):
        return photo
    red, green, blue = (level / 255 for level in bytes.fromhex(matte[1:]))
    notes = (*photo.notes, f"composited over {matte}")
    pixels = over(photo.pixels, (red, green, blue))
    return dataclasses.replace(photo, pixels=pixels, notes=notes)


def load_focus(source: ImageSource, strength: float | None, photo: Photo, max_pixels: int) -> Focus:
    """Return the focus whose mask is the picture `source`.

    The picture is read like a photo. Its transparent parts become black, and its colours grey. If
    it is larger than the photo, it is reduced to the size of the photo. Raise InputError if it
    cannot be read, if it does not have the proportions of the photo, or if all of its pixels are
    light or all of them are dark.
    """
    try:
        needed = max(photo.width, photo.height)
        mask = load_image(source, max_pixels=max_pixels, matte="#000000", needed=needed)
    except InputError as error:
        raise InputError(f"focus must be a picture, but {error}") from error
    (width, height), (across, down) = mask.original_size, photo.original_size
    # The shorter side of the mask may differ by 1 px from the side that has the exact proportions.
    if abs(width * down - height * across) > max(across, down):
        needed = f"a mask of the photo's proportions, {across}x{down}"
        raise refusal("focus", needed, f"{width}x{height} px", "the photo's size")
    grey = mask.pixels.mean(axis=2, keepdims=True)
    if not grey.min() < 0.5 <= grey.max():
        needed = "a mask with white where detail matters, and black elsewhere"
        greys = f"greys from {255 * grey.min():.0f} to {255 * grey.max():.0f} of 255"
        raise refusal("focus", needed, greys, "painting on black with white")
    return Focus(grey, strength or FOCUS_STRENGTH)


def header_of(source: ImageSource, *, max_pixels: int = DEFAULT_MAX_PIXELS) -> Header | None:
    """Return the header of a source of `load_image`, or None for an array or a tensor.

    Raise InputError as `load_image` does. If the source is an open file that will also be loaded,
    pass it through `rereadable` first.
    """
    if _is_array(source):
        return None
    stored, _ = _stored(source, max_pixels)
    return Header(stored.width, stored.height, stored.alpha is not None, stored.reduced_bytes)


def rereadable(source: ImageSource) -> ImageSource:
    """Return a source that can be read twice.

    For an open file, return its content as bytes. Return any other source as it is.
    """
    return _file(source)[0] if hasattr(source, "read") else source


def _is_array(source: ImageSource) -> bool:
    torch = sys.modules.get("torch")  # if torch is not imported, no source can be a tensor
    return isinstance(source, np.ndarray if torch is None else (np.ndarray, torch.Tensor))


def _stored(source: ImageSource, max_pixels: int) -> tuple[StoredImage, str]:
    """Return the image of a source, and the name of the source in error messages.

    Raise InputError if the image has more than max_pixels pixels.
    """
    if isinstance(source, np.ndarray):
        return _of_array(source, "array", max_pixels), "array"
    if _is_array(source):
        return _of_array(_tensor_samples(source), "tensor", max_pixels, 0), "tensor"
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return of_image(source), "image"
    file, name = _file(source)
    return opened(file, name, max_pixels), name


def _file(source: ImageSource) -> tuple[bytes, str]:
    """Return the content of a file, and the name that errors give to it.

    The source is a path, bytes or an open file. Raise InputError for any other source. If the file
    at a path is not a supported photo, return only its first PREFIX_BYTES bytes.
    """
    if isinstance(source, (bytes, bytearray, memoryview)):
        return bytes(source), f"photo of {len(source)} bytes"
    if isinstance(source, (str, os.PathLike)):
        name = file_name("photo", source)
        advice = "the path of a photo, or - for standard input"
        if "://" in name:
            advice = "the path of a saved photo, or gauss2svg batch for URLs"
        with reading(name, advice) as file:
            is_photo = not isinstance(format_of(file.read(PREFIX_BYTES)), str)
            file.seek(0)
            return file.read(-1 if is_photo else PREFIX_BYTES), name
    if not hasattr(source, "read"):
        needed = "a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor"
        raise refusal("photo", needed, type(source).__name__)
    with suppress(AttributeError, OSError):  # raised if the file is a pipe, which cannot seek
        source.seek(0)
    data = source.read()
    if not isinstance(data, bytes):
        got = f"one that reads {type(data).__name__}"
        raise refusal("file object", "binary", got, "open(path, 'rb')")
    return data, "file object"


def _tensor_samples(tensor: Any) -> NDArray[Any]:
    try:
        dense = tensor.detach().cpu().to_dense()
        # Floats are converted to float32, because NumPy has no bfloat16.
        return (dense.float() if dense.is_floating_point() else dense).numpy()
    except (RuntimeError, TypeError) as error:  # raised for masked, quantized, nested, meta tensors
        needed, reason = "one that NumPy can hold", str(error).partition("\n")[0].rstrip(".")
        advice = "a dense tensor of floating point"
        raise refusal("tensor", needed, brief(reason), advice) from error


def _of_array(
    array: NDArray[Any], name: str, max_pixels: int, channel_axis: int = -1
) -> StoredImage:
    """Return an array as StoredImage.

    channel_axis  axis of the channels: the last one of an array, and the first one of a tensor
    """
    array = np.asarray(array)  # a subclass may redefine operators
    shape = array.shape
    if array.ndim == 2:
        array = array[:, :, None]
    elif array.ndim == 3:
        array = np.moveaxis(array, channel_axis, -1)
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        needed, advice = "(h, w), (h, w, 1), (h, w, 3) or (h, w, 4)", "array.transpose(1, 2, 0)"
        if channel_axis == 0:
            needed, advice = "(h, w), (1, h, w), (3, h, w) or (4, h, w)", "tensor.permute(2, 0, 1)"
        raise refusal(f"shape of {name}", needed, str(shape), f"{advice} or one picture of many")
    height, width, channels = array.shape
    check_size((width, height), name, max_pixels)
    array = array if array.dtype in TYPES.values() else unit(array, name)
    picture = pyvips.Image.new_from_array(np.ascontiguousarray(array))
    alpha = 3 if channels == 4 else None
    return StoredImage(width, height, min(channels, 3), alpha, lambda _scale: picture, None)
