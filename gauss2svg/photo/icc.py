"""Embedded ICC profiles, converted to sRGB by Little CMS with 8 bits per channel."""

from __future__ import annotations

import io
from functools import cache
from typing import Any

import numpy as np
from PIL import Image, ImageCms

_SPACES = {"L": ("GRAY", "RGB"), "RGB": ("RGB",), "CMYK": ("CMYK",)}  # by Pillow's mode
_MODES = {"GRAY": "L", "RGB": "RGB"}
# By default Little CMS samples a grey curve in 33 steps, which is up to 10 levels off; the exact
# transform takes 0.4 s per megapixel.
_EXACT, _FINE = ImageCms.Flags.NOOPTIMIZE, ImageCms.Flags.HIGHRESPRECALC
_SAME = 1  # level of 255, up to which a transform counts as the identity
_STEPS = 9  # per channel, at which a transform is compared with the identity
_CONVERTED_NOTE = "converted from its embedded ICC profile to sRGB"
_UNREADABLE_NOTE = "embedded ICC profile unreadable; sRGB assumed"
_OTHER_NOTE = "embedded ICC profile is for another colour space; sRGB assumed"
_CMYK_NOTE = "CMYK without a usable ICC profile; converted by the naive formula"
_LAB_NOTE = "converted from CIELAB to sRGB"


def converted(image: Image.Image, profile: bytes | None) -> tuple[Image.Image, bool, list[str]]:
    """An image of mode L, RGB, CMYK or LAB in sRGB, L or RGB; whether a profile applied; notes.

    Perceptual intent. A profile that is sRGB in effect changes no pixel; one that is broken or
    for another colour space is ignored, with a note. An unchanged image is returned itself.
    """
    if image.mode == "LAB":
        lab = ImageCms.createProfile("LAB")  # D50, as TIFF has it
        return _applied(image, lab, _EXACT), True, [_LAB_NOTE]
    plain, notes = image, []
    if image.mode == "CMYK":
        plain, notes = image.convert("RGB"), [_CMYK_NOTE]
    if not profile:
        return plain, False, notes
    try:
        parsed = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space = parsed.profile.xcolor_space.strip()  # pyright: ignore[reportAttributeAccessIssue]
        if space not in _SPACES[image.mode]:
            return plain, False, [_OTHER_NOTE, *notes]
        if image.mode == "CMYK":
            return _applied(image, parsed, _FINE), True, [_CONVERTED_NOTE]
        before = _grey_ramp() if image.mode == "L" else _color_cube()
        after = np.asarray(_applied(before.convert(_MODES[space]), parsed, _EXACT))
        if np.abs(np.asarray(before.convert("RGB"), np.int16) - after).max() <= _SAME:
            return plain, True, []
        if image.mode == "L":
            return Image.fromarray(after[0][np.asarray(image)]), True, [_CONVERTED_NOTE]
        return _applied(image, parsed, _FINE), True, [_CONVERTED_NOTE]
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return plain, False, [_UNREADABLE_NOTE, *notes]


def _applied(image: Image.Image, profile: Any, flags: ImageCms.Flags) -> Image.Image:
    """The image in sRGB, mode RGB."""
    srgb = ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(profile, srgb, image.mode, "RGB", flags=flags)
    result = ImageCms.applyTransform(image, transform)
    if result is None:  # by its signature, where it works in place
        raise ValueError("Little CMS returned no image")
    return result


@cache
def _grey_ramp() -> Image.Image:
    return Image.fromarray(np.arange(256, dtype=np.uint8)[None])


@cache
def _color_cube() -> Image.Image:
    steps = np.round(np.linspace(0, 255, _STEPS)).astype(np.uint8)
    return Image.fromarray(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3))
