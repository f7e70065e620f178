"""Decode an image file at its full bit depth, converted to sRGB and turned upright."""

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

_CUT = "premature end of data segment"  # message of libjpeg, which libvips treats as a warning


@contextmanager
def _refusing(name: str) -> Iterator[None]:
    """Raise InputError for any exception of a decoder. Hostile bytes can cause any."""
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

    Raise InputError if it is unsupported, broken, or larger than max_pixels.
    """
    kind = format_of(file[:PREFIX_BYTES])
    if isinstance(kind, str):
        raise InputError(
            f"{name} must be a supported image ({', '.join(FORMATS)}); got {kind}. Try "
            "converting it"
        )
    with _refusing(name):
        stored = resolve_name(f"{kind.decoder}:opened")(file, kind.loader)
    check_size((stored.width, stored.height), name, max_pixels)
    return stored


def decoded(stored: Stored, name: str, needed: SizeNeeded | None = None) -> Photo:
    """Decode an opened image, reduced to the size needed. Raise InputError if it is broken."""
    size = reduced_size(needed, stored.width, stored.height)
    with _refusing(name):
        pixels, warnings = samples(lambda: _picture(stored, size, name))
        if any(_CUT in warning for warning in warnings):
            raise ValueError(_CUT)
    if size is not None and pixels.dtype == np.float32:  # the filter may overshoot 0..1
        pixels = pixels.clip(0, 1)
    pixels = unit(pixels, name)
    notes = [*stored.notes]
    if stored.notes_warnings:
        notes += (f"decoder warns: {brief(warning)}" for warning in warnings[-1:])
    color, color_notes = in_srgb(pixels[:, :, : stored.colors], stored.space)
    dpi, dpi_notes = stored.resolution()
    orientation = stored.orientation
    if orientation != 1:
        notes.insert(0, "EXIF orientation applied")
    color, alpha = upright(color, orientation), None
    color = np.ascontiguousarray(color if color.shape[2] == 3 else color.repeat(3, axis=2))
    if stored.alpha is not None and (pixels[:, :, -1] < 1).any():
        alpha = upright(pixels[:, :, -1], orientation)
        color = np.where(alpha[:, :, None] > 0, color, np.float32(0))
    return Photo(color, stored.upright_size, (*notes, *dpi_notes, *color_notes), dpi, alpha)


def _picture(stored: Stored, size: Size | None, name: str) -> Any:
    """Return a picture of libvips of this size, with samples of colour and alpha only."""
    full = stored.width, stored.height
    scale = max(s for s in stored.scales if s == 1 or (size and _leaves_enough(full, size, s)))
    picture = stored.picture(scale)
    if (picture.width, picture.height) != tuple(-(-side // scale) for side in full):
        raise ValueError(f"its pixels are {picture.width}x{picture.height}")
    bands = [*range(stored.colors), *([] if stored.alpha is None else [stored.alpha])]
    if picture.bands > len(bands):
        picture = picture[bands[0]].bandjoin([picture[band] for band in bands[1:]])
    if size is None:
        return picture
    if picture.format == "float":  # samples may be out of range, which `unit` refuses
        picture = pyvips.Image.new_from_array(unit(samples(lambda: picture)[0], name))
    return resized(picture, size, stored.alpha is not None)


def _leaves_enough(stored: Size, needed: Size, scale: int) -> bool:
    """Return whether decoding at 1 / `scale` leaves DRAFT times the size needed."""
    return all(scale * DRAFT * small <= side for side, small in zip(stored, needed, strict=True))


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return an array (h, w, ...) turned upright by its orientation (EXIF 2.32, 4.6.4, tag 274)."""
    if orientation in SWAPPED:
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):  # the first row belongs at the bottom
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def check_size(size: Size, name: str, max_pixels: int) -> None:
    """Raise InputError if a size (width, height) has no pixels, or more than max_pixels."""
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
