"""Convert the colours of a file to sRGB.

The file states its colour space by an ICC profile, by a gamma and primaries, or by codes of H.273.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
import pyvips
from numpy.typing import NDArray
from PIL import Image, ImageCms

from gauss2svg import portable
from gauss2svg.photo.libvips import samples
from gauss2svg.photo.pixels import linear_light, unit

CMYK_CHANNELS = 4
# Number of channels for each colour space of an ICC profile.
_SPACES = {b"GRAY": 1, b"RGB ": 3, b"CMYK": CMYK_CHANNELS}
UNUSABLE = "embedded ICC profile unreadable or for another colour space; sRGB assumed"
_SAME = 1 / 255  # a profile that changes no level by more than this counts as sRGB
_GAMMA = 1 / 2.2  # the number in the gAMA chunk of an sRGB image
# The chromaticities of sRGB: x and y of white, red, green and blue.
_SRGB = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
# The chromaticities, in the same order, for each code of primaries in table 2 of ITU-T H.273.
PRIMARIES = {
    1: _SRGB,
    2: _SRGB,  # primaries that are not specified
    5: (*_SRGB[:4], 0.29, 0.6, 0.15, 0.06),  # BT.470 BG
    6: (*_SRGB[:2], 0.63, 0.34, 0.31, 0.595, 0.155, 0.07),  # SMPTE 170M
    9: (*_SRGB[:2], 0.708, 0.292, 0.17, 0.797, 0.131, 0.046),  # BT.2020
    12: (*_SRGB[:2], 0.68, 0.32, 0.265, 0.69, 0.15, 0.06),  # Display P3
}
# The gamma, as in gAMA of PNG, for each code of a transfer curve in table 3 of ITU-T H.273. A curve
# that is not specified (code 2) counts as that of sRGB, as in browsers. So do the curves of video
# cameras (codes 1, 6, 14 and 15), because their pictures are made to be shown on sRGB screens.
TRANSFERS = dict.fromkeys((1, 2, 6, 13, 14, 15), _GAMMA) | {4: 1 / 2.2, 5: 1 / 2.8, 8: 1.0}


@dataclass(frozen=True)
class ColorSpace:
    """The colour space of a file, which is sRGB by default.

    profile       ICC profile. None if the file has none
    gamma         exponent of value = light ^ gamma, as in gAMA of PNG. 1/2.2 stands for the curve
                  of sRGB itself
    chromaticity  x and y of white, red, green and blue
    source        name of the part of the file that states gamma and chromaticity, for notes
    """

    profile: bytes | None = None
    gamma: float = _GAMMA
    chromaticity: tuple[float, ...] = _SRGB
    source: str = ""


def in_srgb(color: NDArray[np.float32], space: ColorSpace) -> tuple[NDArray[np.float32], list[str]]:
    """Convert color in 0..1 to sRGB, and return it with notes on the conversion.

    color (h, w, channels) has 1 channel for grey, 3 for RGB or 4 for CMYK. The result is grey or
    RGB.
    """
    notes: list[str] = []
    if space.profile:
        converted = _by_profile(color, space.profile)
        if converted is not None:
            note = "converted from its embedded ICC profile to sRGB"
            return converted, [] if converted is color else [note]
        notes = [UNUSABLE]
    if color.shape[2] == CMYK_CHANNELS:
        rgb = (1 - color[:, :, :3]) * (1 - color[:, :, 3:])
        formula = "converted by the naive formula, whose colours may be too vivid"
        return rgb, [*notes, f"CMYK without a usable ICC profile; {formula}"]
    color, gamma_notes = _by_gamma(color, space)
    return color, notes + gamma_notes


def _by_profile(color: NDArray[np.float32], profile: bytes) -> NDArray[np.float32] | None:
    """Convert color to sRGB by an ICC profile.

    Return `color` itself if the profile is that of sRGB, and None if the profile is unusable.
    """
    channels = _SPACES.get(profile[16:20])
    try:
        if channels == 1 == color.shape[2]:
            steps, curve = _grey_curve(profile)
            if np.abs(curve - steps).max() <= _SAME:
                return color
            return np.interp(color, steps, curve).astype(np.float32)
        if channels == color.shape[2] == CMYK_CHANNELS:
            return _transformed(color, profile)
        if channels == 3 and color.shape[2] != CMYK_CHANNELS:
            steps = np.linspace(0, 1, 9, dtype=np.float32)
            levels = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)
            if np.abs(_transformed(levels, profile) - levels).max() <= _SAME:
                return color
            return _transformed(color.repeat(3 // color.shape[2], axis=2), profile)
    except (ImageCms.PyCMSError, OSError, pyvips.Error):
        pass
    return None


def _grey_curve(profile: bytes) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return 256 grey levels in 0..1, and the sRGB values that an ICC profile gives to them.

    The flag NOOPTIMIZE makes Little CMS convert each level. By default Little CMS converts only 33
    levels and interpolates between them, and libvips uses this default.
    """
    parsed, srgb = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
    levels = Image.fromarray(np.arange(256, dtype=np.uint8)[None])
    transform = ImageCms.buildTransform(parsed, srgb, "L", "RGB", flags=ImageCms.Flags.NOOPTIMIZE)
    return np.linspace(0, 1, 256), np.asarray(transform.apply(levels))[0, :, 0] / 255


def _transformed(color: NDArray[np.float32], profile: bytes) -> NDArray[np.float32]:
    """Convert RGB or CMYK to RGB in sRGB by an ICC profile, with 16 bits per channel."""
    # This call is here to raise an error if the profile is broken. libvips would raise none.
    ImageCms.ImageCmsProfile(io.BytesIO(profile))
    levels = np.round(color * np.float32(65535)).astype(np.uint16)
    kind = "cmyk" if color.shape[2] == CMYK_CHANNELS else "rgb16"
    picture = pyvips.Image.new_from_array(levels).copy(interpretation=kind)
    picture.set_type(pyvips.GValue.blob_type, "icc-profile-data", profile)  # pyright: ignore[reportArgumentType]
    picture = picture.icc_transform("srgb", embedded=True, intent="perceptual", depth=16)
    return unit(samples(lambda: picture)[0], "photo")


def _by_gamma(
    color: NDArray[np.float32], space: ColorSpace
) -> tuple[NDArray[np.float32], list[str]]:
    """Convert color from the gamma and primaries of `space` to sRGB, and return it with notes.

    color is (h, w, 1) or (h, w, 3). Its linear light is value^(1 / gamma) (PNG, third edition,
    11.3.2.2 and 13.13). The light is converted from the primaries of `space` to those of sRGB. Then
    the curve of sRGB turns the light into values. A gamma within 1 % of 1/2.2 stands for the curve
    of sRGB itself.
    """
    is_same = abs(space.gamma / _GAMMA - 1) <= 0.01
    has_primaries = not np.allclose(space.chromaticity, _SRGB, rtol=0, atol=0.005)
    matrix = _to_srgb_primaries(space.chromaticity)
    if matrix is None or not 0.1 <= space.gamma <= 10:
        return color, [f"{space.source} unusable; sRGB assumed"]
    if is_same and (color.shape[2] == 1 or not has_primaries):
        return color, []
    light = linear_light(color) if is_same else portable.power(color, 1 / space.gamma)
    if color.shape[2] == 3 and has_primaries:
        light = np.clip(portable.product(light, matrix.T.astype(np.float32)), 0, 1)
    curve = 1.055 * portable.power(light, 1 / 2.4) - 0.055  # IEC 61966-2-1
    value = np.where(light <= 0.0031308, light * 12.92, curve).astype(np.float32)
    return value, [f"converted from {space.source} to sRGB"]


def _to_srgb_primaries(chromaticity: tuple[float, ...]) -> NDArray[np.floating] | None:
    """Return the matrix (3, 3) that converts linear light of these primaries to light of sRGB.

    Each row is divided by its sum, so that white of these primaries becomes white of sRGB. Return
    None if the primaries are degenerate.
    """
    x, y = np.array(chromaticity, float).reshape(4, 2).T
    area = (x[2] - x[1]) * (y[3] - y[1]) - (x[3] - x[1]) * (y[2] - y[1])
    if not (y > 0).all() or abs(area) < 1e-4:
        return None
    matrix = portable.solve(_to_xyz(_SRGB), _to_xyz(chromaticity))
    white = matrix.sum(axis=1, keepdims=True)
    return matrix / white if (white > 0).all() else None


def _to_xyz(chromaticity: tuple[float, ...]) -> NDArray[np.floating]:
    """Return the matrix (3, 3) that converts linear light of these primaries to CIE XYZ.

    White has Y = 1 (SMPTE RP 177).
    """
    x, y = np.array(chromaticity, float).reshape(4, 2).T
    white, *primaries = np.stack([x / y, np.ones(4), (1 - x - y) / y], axis=1)
    columns = np.stack(primaries, axis=1)
    return columns * portable.solve(columns, white)
