"""Embedded ICC profiles, by Little CMS: to sRGB, of 8 bits a channel."""

from __future__ import annotations

import io
from functools import cache
from typing import Any

import numpy as np
from PIL import Image, ImageCms

_SPACES = {"L": ("GRAY", "RGB"), "RGB": ("RGB",), "CMYK": ("CMYK",)}  # by Pillow's mode
_MODES = {"GRAY": "L", "RGB": "RGB"}
# By default Little CMS puts a table of 33 steps in the place of a grey curve, which is up to 10
# levels off; without one it takes 0.4 s for a million pixels.
_EXACT, _FINE = ImageCms.Flags.NOOPTIMIZE, ImageCms.Flags.HIGHRESPRECALC
_SAME = 1  # level of 255 by which a transform may miss and still be none
_STEPS = 9  # of each channel, at which a transform is looked at
_CONVERTED_NOTE = "converted from its embedded colour profile to sRGB"
_UNREADABLE_NOTE = "embedded colour profile unreadable, taken as sRGB"
_OTHER_NOTE = "embedded colour profile is of another kind of colours, taken as sRGB"
_CMYK_NOTE = "CMYK without a usable colour profile, converted by the plain formula"
_LAB_NOTE = "converted from CIELAB to sRGB"


def converted(picture: Image.Image, profile: bytes | None) -> tuple[Image.Image, bool, list[str]]:
    """A picture of mode L, RGB, CMYK or LAB in sRGB, L or RGB; whether a profile told; notes.

    Perceptual intent. A profile that is sRGB in effect changes no pixel; one that is broken
    or of another kind of colours is left out, with a note. An unchanged picture is returned
    itself.
    """
    if picture.mode == "LAB":
        lab = ImageCms.createProfile("LAB")  # D50, as TIFF has it
        return _applied(picture, lab, _EXACT), True, [_LAB_NOTE]
    plain, notes = picture, []
    if picture.mode == "CMYK":
        plain, notes = picture.convert("RGB"), [_CMYK_NOTE]
    if not profile:
        return plain, False, notes
    try:
        parsed = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space = parsed.profile.xcolor_space.strip()  # pyright: ignore[reportAttributeAccessIssue]
        if space not in _SPACES[picture.mode]:
            return plain, False, [_OTHER_NOTE, *notes]
        if picture.mode == "CMYK":
            return _applied(picture, parsed, _FINE), True, [_CONVERTED_NOTE]
        before = _grey_ramp() if picture.mode == "L" else _color_cube()
        after = np.asarray(_applied(before.convert(_MODES[space]), parsed, _EXACT))
        if np.abs(np.asarray(before.convert("RGB"), np.int16) - after).max() <= _SAME:
            return plain, True, []
        if picture.mode == "L":
            return Image.fromarray(after[0][np.asarray(picture)]), True, [_CONVERTED_NOTE]
        return _applied(picture, parsed, _FINE), True, [_CONVERTED_NOTE]
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return plain, False, [_UNREADABLE_NOTE, *notes]


def _applied(picture: Image.Image, profile: Any, flags: ImageCms.Flags) -> Image.Image:
    """The picture in sRGB, mode RGB."""
    srgb = ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(profile, srgb, picture.mode, "RGB", flags=flags)
    result = ImageCms.applyTransform(picture, transform)
    if result is None:  # by its signature, where it works in place
        raise ValueError("Little CMS gave no picture")
    return result


@cache
def _grey_ramp() -> Image.Image:
    return Image.fromarray(np.arange(256, dtype=np.uint8)[None])


@cache
def _color_cube() -> Image.Image:
    steps = np.round(np.linspace(0, 255, _STEPS)).astype(np.uint8)
    return Image.fromarray(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3))
