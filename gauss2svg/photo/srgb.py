"""Convert the colours of a file to sRGB by its ICC profile."""

from __future__ import annotations

import io

import numpy as np
import pyvips
from numpy.typing import NDArray
from PIL import ImageCms

from gauss2svg.photo.decoders import samples
from gauss2svg.photo.pixels import unit

_SAME = 1 / 255  # a profile that changes no level by more than this counts as sRGB


def in_srgb(
    color: NDArray[np.float32], profile: bytes | None
) -> tuple[NDArray[np.float32], list[str]]:
    """Convert color in 0..1 to sRGB, and return it with notes on the conversion.

    color (h, w, channels) has 1 channel for grey, 3 for RGB or 4 for CMYK. The result is grey or
    RGB.
    """
    notes: list[str] = []
    if profile:
        converted = _by_profile(color, profile)
        if converted is not None:
            note = "converted from its embedded ICC profile to sRGB"
            return converted, [] if converted is color else [note]
        notes = ["embedded ICC profile unreadable or for another colour space; sRGB assumed"]
    if color.shape[2] == 4:
        color = (1 - color[:, :, :3]) * (1 - color[:, :, 3:])
        formula = "converted by the naive formula, whose colours may be too vivid"
        notes.append(f"CMYK without a usable ICC profile; {formula}")
    return color, notes


def _by_profile(color: NDArray[np.float32], profile: bytes) -> NDArray[np.float32] | None:
    """Convert color to sRGB by an ICC profile.

    Return `color` itself if the profile is that of sRGB, and None if the profile is unusable.
    """
    channels, stored = {b"GRAY": 1, b"RGB ": 3, b"CMYK": 4}.get(profile[16:20]), color.shape[2]
    if channels is None or (stored == 4) != (channels == 4) or channels < stored:
        return None
    steps = np.linspace(0, 1, 9, dtype=np.float32)
    levels = np.stack(np.meshgrid(*[steps] * channels), axis=-1).reshape(1, -1, channels)
    try:
        if channels < 4 and np.abs(_transformed(levels, profile) - levels).max() <= _SAME:
            return color
        return _transformed(color.repeat(channels // stored, axis=2), profile)
    except (ImageCms.PyCMSError, OSError, pyvips.Error):
        return None


def _transformed(color: NDArray[np.float32], profile: bytes) -> NDArray[np.float32]:
    """Convert grey, RGB or CMYK to RGB in sRGB by an ICC profile, with 16 bits per channel."""
    # This call is here to raise an error if the profile is broken. libvips would raise none.
    ImageCms.ImageCmsProfile(io.BytesIO(profile))
    levels = np.round(color * np.float32(65535)).astype(np.uint16)
    kind = {1: "grey16", 3: "rgb16", 4: "cmyk"}[color.shape[2]]
    picture = pyvips.Image.new_from_array(levels).copy(interpretation=kind)
    picture.set_type(pyvips.GValue.blob_type, "icc-profile-data", profile)  # pyright: ignore[reportArgumentType]
    picture = picture.icc_transform("srgb", embedded=True, intent="perceptual", depth=16)
    return unit(samples(picture), "photo")
