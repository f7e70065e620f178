"""Decoding an image file: all of its bits, colours converted to sRGB, upright."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray

from gauss2svg.errors import InputError, brief
from gauss2svg.photo.formats import FORMATS, MOST_PIXELS, PREFIX_BYTES, format_of
from gauss2svg.photo.libvips import samples
from gauss2svg.photo.photo import Photo, unit
from gauss2svg.photo.reduce import DRAFT, Size, SizeNeeded, reduced_size, resized
from gauss2svg.photo.srgb import in_srgb
from gauss2svg.photo.stored import SWAPPED, Stored

_CUT = "premature end of data segment"  # libjpeg's words, which libvips only warns of


@contextmanager
def _refusing(name: str) -> Iterator[None]:
    """Raise InputError for whatever a decoder raises; hostile bytes make it raise anything."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
        raise InputError(
            f"{name} must be a complete image of a supported kind; got one that is broken, "
            f"truncated or unsupported: {brief(reason)}. Try re-saving it as PNG"
        ) from error


def opened(file: bytes, name: str, max_pixels: int) -> Stored:
    """Read the header of an image file.

    Raise InputError for an unsupported or broken file, and for one of more than max_pixels.
    """
    found = format_of(file[:PREFIX_BYTES])
    if isinstance(found, str):
        raise InputError(
            f"{name} must be a supported image ({', '.join(FORMATS)}); got {found}. Try "
            "converting it"
        )
    with _refusing(name):
        stored = resolve_name(f"{found.decoder}:opened")(file, found.loader)
    check_size((stored.width, stored.height), name, max_pixels)
    return stored


def decoded(stored: Stored, name: str, needed: SizeNeeded | None = None) -> Photo:
    """Decode an opened image, reduced to the size needed; raise InputError if it is broken."""
    size = reduced_size(needed, stored.width, stored.height)
    with _refusing(name):
        pixels, warnings = samples(lambda: _picture(stored, size, name))
        if any(_CUT in warning for warning in warnings):
            raise ValueError(_CUT)
    if size is not None and pixels.dtype == np.float32:  # over which the filter may go
        pixels = pixels.clip(0, 1)
    pixels = unit(pixels, name)
    notes = [*stored.notes]
    if stored.notes_warnings:
        notes += (f"decoder warns: {brief(warning)}" for warning in warnings[-1:])
    color, more = in_srgb(pixels[:, :, : stored.colors], stored.space)
    dpi, of_shape = stored.resolution()
    turn = stored.orientation
    if turn != 1:
        notes.insert(0, "EXIF orientation applied")
    color, alpha = upright(color, turn), None
    color = np.ascontiguousarray(color if color.shape[2] == 3 else color.repeat(3, axis=2))
    if stored.alpha is not None and (pixels[:, :, -1] < 1).any():
        alpha = upright(pixels[:, :, -1], turn)
        color = np.where(alpha[:, :, None] > 0, color, np.float32(0))
    return Photo(color, stored.upright_size, (*notes, *of_shape, *more), dpi, alpha)


def _picture(stored: Stored, size: Size | None, name: str) -> Any:
    """Return the picture of libvips with the samples that are needed."""
    whole = stored.width, stored.height
    scale = max(s for s in stored.scales if s == 1 or (size and _is_fine(whole, size, s)))
    picture = stored.picture(scale)
    if (picture.width, picture.height) != tuple(-(-side // scale) for side in whole):
        raise ValueError(f"its pixels are {picture.width}x{picture.height}")
    bands = [*range(stored.colors), *([] if stored.alpha is None else [stored.alpha])]
    if picture.bands > len(bands):
        picture = picture[bands[0]].bandjoin([picture[band] for band in bands[1:]])
    if size is None:
        return picture
    if picture.format == "float":  # samples of which may be out of range
        picture = pyvips.Image.new_from_array(unit(samples(lambda: picture)[0], name))
    return resized(picture, size, stored.alpha is not None)


def _is_fine(stored: Size, needed: Size, scale: int) -> bool:
    """Whether a decoder may make a picture smaller before it is reduced to the size needed."""
    return all(scale * DRAFT * small <= side for side, small in zip(stored, needed, strict=True))


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """An array (h, w, ..) rotated and mirrored by an orientation (EXIF 2.32, 4.6.4, tag 274)."""
    if orientation in SWAPPED:
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):  # the first row is seen at the bottom
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def check_size(size: Size, name: str, max_pixels: int) -> None:
    """Raise InputError for a size (width, height) of no pixel, or of more than max_pixels."""
    width, height = size
    if width < 1 or height < 1:
        raise InputError(f"{name} must be at least 1x1 px; got {width}x{height} px")
    count = width * height
    if count > max_pixels:
        advice = "shrinking it"
        if count <= MOST_PIXELS:
            advice += f", or raising --max-pixels, up to {MOST_PIXELS}, if you trust the file"
        raise InputError(
            f"{name} must be at most {max_pixels} px (--max-pixels); got {width}x{height} = "
            f"{count} px. Try {advice}"
        )
