"""Decoding an image file: all of its bits, colours converted to sRGB, upright."""

from __future__ import annotations

from collections.abc import Iterator
from pkgutil import resolve_name
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, brief
from gauss2svg.photo.formats import FORMATS, MOST_PIXELS, PREFIX_BYTES, format_of
from gauss2svg.photo.photo import Photo, unit
from gauss2svg.photo.reduce import DRAFT, Reduced, Size, SizeNeeded, reduced_size
from gauss2svg.photo.srgb import in_srgb
from gauss2svg.photo.stored import Stored
from gauss2svg.photo.tags import turned, upright


def opened(file: BinaryIO, name: str, max_pixels: int) -> Stored:
    """Read the header of a seekable image file.

    Raise InputError for an unsupported or broken file, and for one of more than max_pixels.
    """
    file.seek(0)
    found = format_of(file.read(PREFIX_BYTES))
    if isinstance(found, str):
        raise InputError(
            f"{name} must be a supported image ({', '.join(FORMATS)}); got {found}. Try "
            "converting it"
        )
    file.seek(0)
    try:
        stored = resolve_name(f"{found.decoder}:opened")(file.read(), found.loader)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # hostile bytes make decoders raise anything
        raise broken(name, error) from error
    check_size((stored.width, stored.height), name, max_pixels)
    return stored


def decoded(stored: Stored, name: str, needed: SizeNeeded | None = None) -> Photo:
    """Decode an opened image, reduced to the size needed; raise InputError if it is broken."""
    whole = stored.width, stored.height
    size = reduced_size(needed, *whole)
    sample = None
    try:
        if size is None:
            color, alpha = _whole(stored, name)
        else:
            scale = max(s for s in stored.scales if s == 1 or _is_fine(whole, size, s))
            reduced = Reduced(whole, size, scale)
            for rows, shows in _bands(stored, name, scale):
                reduced.add(rows, shows)
            (color, alpha), sample = reduced.result(), reduced.sample
    except (InputError, MemoryError):
        raise
    except Exception as error:  # hostile bytes make decoders raise anything
        raise broken(name, error) from error
    color, notes = in_srgb(color, stored.space)
    turn = stored.tags.orientation
    return Photo.from_samples(
        upright(color, turn),
        None if alpha is None else upright(alpha, turn),
        full=turned(whole, turn),
        notes=(*stored.tags.notes, *stored.notes, *notes),
        dpi=stored.tags.dpi,
        given_sample=sample,
    )


def _is_fine(stored: Size, needed: Size, scale: int) -> bool:
    """Whether a decoder may make a picture smaller before it is reduced to the size needed."""
    return all(scale * DRAFT * small <= side for side, small in zip(stored, needed, strict=True))


def _whole(stored: Stored, name: str) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    color = np.empty((stored.height, stored.width, stored.colors), np.float32)
    alpha = None if stored.alpha is None else np.empty(color.shape[:2], np.float32)
    top = 0
    for rows, shows in _bands(stored, name, 1):
        bottom = top + len(rows)
        color[top:bottom] = unit(rows, name)
        if alpha is not None:
            alpha[top:bottom] = shows
        top = bottom
    return color, alpha


def _bands(
    stored: Stored, name: str, scale: int
) -> Iterator[tuple[NDArray[Any], NDArray[np.float32] | None]]:
    """Color (n, w, channels), uint8 or float32 in 0..1, and alpha (n, w), some rows at a time."""
    top, (width, height) = 0, (-(-side // scale) for side in (stored.width, stored.height))
    for rows in stored.rows(scale):
        if rows.shape[1] != width:
            raise ValueError(f"its rows have {rows.shape[1]} and not {width} px")
        color = rows[:, :, : stored.colors]
        if color.dtype != np.uint8:
            color = unit(color, name, top)
        alpha = None
        if stored.alpha is not None:
            alpha = unit(rows[:, :, stored.alpha, None], f"alpha of {name}", top)[:, :, 0]
        yield color, alpha
        top += len(rows)
    if top != height:
        raise ValueError(f"it has {top} and not {height} rows")


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


def broken(name: str, error: Exception) -> InputError:
    """Return the error for an image that its decoder cannot read."""
    reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
    return InputError(
        f"{name} must be a complete image of a supported kind; got one that is broken, truncated "
        f"or unsupported: {brief(reason)}. Try re-saving it as PNG"
    )
