"""Colours of a file in sRGB: by its ICC profile, or by the gAMA, cHRM and cICP chunks of a PNG."""

from __future__ import annotations

import io
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms

from gauss2svg.photo.photo import unit
from gauss2svg.photo.reduce import pieces

_SPACES = {"L": ("GRAY", "RGB"), "RGB": ("RGB",), "CMYK": ("CMYK",)}  # by Pillow's mode
# By default Little CMS samples a grey curve in 33 steps, which is up to 10 levels off; the exact
# transform takes 0.4 s per megapixel.
_EXACT, _FINE = ImageCms.Flags.NOOPTIMIZE, ImageCms.Flags.HIGHRESPRECALC
_SAME = 1  # level of 255, up to which a transform counts as the identity
_CONVERTED_NOTE = "converted from its embedded ICC profile to sRGB"

_SRGB_GAMMA = 1 / 2.2  # the gAMA of an sRGB image
_SAME_GAMMA = 0.01  # relative difference up to which a gamma counts as that
_LEAST_GAMMA, _MOST_GAMMA = 0.1, 10.0
# x and y of white, red, green and blue of sRGB (ITU-R BT.709).
_SRGB_PRIMARIES = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
# Bradford cone responses, for the adaptation of white (ICC.1:2022, annex E).
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)


def in_srgb(
    color: NDArray[Any] | Image.Image, image: Image.Image, name: str, file: BinaryIO | None
) -> tuple[NDArray[np.float32], list[str]]:
    """Color of an image as (h, w, 1 or 3) in sRGB, with notes.

    Of a PNG the chunk that takes precedence is used: cICP, iCCP, sRGB, gAMA and cHRM.
    """
    info, is_png, notes = image.info, image.format == "PNG", []
    cicp = _cicp_of(file) if file is not None and is_png else None
    # Primaries and transfer of sRGB (ITU-T H.273).
    overruled = cicp == (1, 13)
    if cicp is not None and not overruled:
        notes.append(f"cICP with primaries {cicp[0]} and transfer {cicp[1]} not supported; ignored")
    profile = None if overruled else info.get("icc_profile")
    color, used, more = by_profile(color, profile)
    notes += more
    values = unit(color, name)
    stated = info.get("gamma") if is_png else None
    if stated is not None and not (overruled or used or "srgb" in info):
        values, more = _by_gamma(values, stated, info.get("chromaticity"))
        notes += more
    return values, notes


def by_profile(
    color: NDArray[Any] | Image.Image, profile: bytes | None
) -> tuple[NDArray[Any], bool, list[str]]:
    """Color (h, w, 1 or 3) converted by its ICC profile, whether it could be used, and notes."""
    if isinstance(color, Image.Image):
        image, used, notes = _converted(color, profile)
        return np.atleast_3d(np.asarray(image)), used, notes
    if not profile:
        return color, False, []
    given = as_image(color, "L" if color.shape[2] == 1 else "RGB", "photo")
    image, used, notes = _converted(given, profile)
    if image is given:
        return color, used, notes
    notes.insert(0, "reduced to 8 bits per channel to apply its ICC profile")
    return np.atleast_3d(np.asarray(image)), used, notes


def as_image(color: NDArray[Any], mode: str, name: str) -> Image.Image:
    """An image of 8 bits of color (h, w, channels) of any type."""
    levels = np.empty(color.shape, np.uint8)
    for rows, some in pieces(color):
        levels[rows] = np.round(unit(some, name, rows.start) * 255)
    return Image.frombytes(mode, (color.shape[1], color.shape[0]), levels.tobytes())


def _converted(image: Image.Image, profile: bytes | None) -> tuple[Image.Image, bool, list[str]]:
    """An image of mode L, RGB, CMYK or LAB in sRGB, L or RGB; whether a profile applied; notes.

    By Little CMS with 8 bits per channel and perceptual intent. A profile that is sRGB in effect
    changes no pixel; one that is broken or for another colour space is ignored, with a note. An
    unchanged image is returned itself.
    """
    if image.mode == "LAB":
        lab = ImageCms.createProfile("LAB")  # D50, as TIFF has it
        return _applied(image, lab, _EXACT), True, ["converted from CIELAB to sRGB"]
    plain, notes = image, []
    if image.mode == "CMYK":
        plain = image.convert("RGB")
        notes = ["CMYK without a usable ICC profile; converted by the naive formula"]
    if not profile:
        return plain, False, notes
    try:
        parsed = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space = parsed.profile.xcolor_space.strip()  # pyright: ignore[reportAttributeAccessIssue]
        if space not in _SPACES[image.mode]:
            other = "embedded ICC profile is for another colour space; sRGB assumed"
            return plain, False, [other, *notes]
        if image.mode != "CMYK":
            before = _samples_of(image.mode)
            given = before.convert("L" if space == "GRAY" else "RGB")
            after = np.asarray(_applied(given, parsed, _EXACT))
            if np.abs(np.asarray(before.convert("RGB"), np.int16) - after).max() <= _SAME:
                return plain, True, []
            if image.mode == "L":
                return Image.fromarray(after[0][np.asarray(image)]), True, [_CONVERTED_NOTE]
        return _applied(image, parsed, _FINE), True, [_CONVERTED_NOTE]
    except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
        return plain, False, ["embedded ICC profile unreadable; sRGB assumed", *notes]


def _applied(image: Image.Image, profile: Any, flags: ImageCms.Flags) -> Image.Image:
    """The image in sRGB, mode RGB."""
    srgb = ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(profile, srgb, image.mode, "RGB", flags=flags)
    result = ImageCms.applyTransform(image, transform)
    if result is None:  # by its signature, where it works in place
        raise ValueError("Little CMS returned no image")
    return result


def _samples_of(mode: str) -> Image.Image:
    """A row of all greys, or of colours throughout the cube."""
    if mode == "L":
        return Image.fromarray(np.arange(256, dtype=np.uint8)[None])
    # In nine steps per channel.
    steps = np.round(np.linspace(0, 255, 9)).astype(np.uint8)
    return Image.fromarray(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3))


def _cicp_of(file: BinaryIO) -> tuple[int, int] | None:
    """Primaries and transfer of a PNG's cICP chunk, which Pillow does not read; None without."""
    # The chunks of a PNG follow its signature of 8 bytes.
    file.seek(8)
    while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
        if head[4:] == b"cICP":
            data = file.read(4)
            return (data[0], data[1]) if len(data) == 4 else None
        file.seek(int.from_bytes(head[:4], "big") + 4, 1)  # with its checksum
    return None


def _by_gamma(
    color: NDArray[np.float32], gamma: float, chromaticity: tuple[float, ...] | None
) -> tuple[NDArray[np.float32], list[str]]:
    """Colours (h, w, 1 or 3) in 0..1 of a PNG with a gAMA chunk, converted to sRGB; and notes.

    light = value^(1 / gamma) (PNG, third edition, 11.3.2.2 and 13.13), from the primaries of cHRM
    to those of sRGB with Bradford adaptation, then the sRGB curve. A gamma within 1 % of 1/2.2
    stands for the sRGB curve itself.
    """
    if not _LEAST_GAMMA <= gamma <= _MOST_GAMMA:
        return color, [f"gAMA of {gamma:g} unusable; sRGB assumed"]
    matrix, notes = None, []
    if (
        chromaticity is not None
        and color.shape[2] == 3
        and not np.allclose(chromaticity, _SRGB_PRIMARIES, rtol=0, atol=0.005)
    ):
        matrix = _to_srgb_primaries(chromaticity)
        if matrix is None:
            notes.append("cHRM unusable; sRGB primaries assumed")
    same = abs(gamma / _SRGB_GAMMA - 1) <= _SAME_GAMMA
    if same and matrix is None:
        return color, notes
    light = _srgb_light(color) if same else color ** np.float32(1 / gamma)
    if matrix is not None:
        light = np.clip(light @ matrix.T.astype(np.float32), 0, 1)
    what = f"gAMA of {gamma:g}" if matrix is None else f"gAMA of {gamma:g} and cHRM"
    return _srgb_value(light), [f"converted from {what} to sRGB", *notes]


def _srgb_light(value: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear light of sRGB values (IEC 61966-2-1)."""
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return light.astype(np.float32)


def _srgb_value(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """SRGB values of linear light (IEC 61966-2-1)."""
    value = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    return value.astype(np.float32)


def _to_srgb_primaries(chromaticity: tuple[float, ...]) -> NDArray[np.floating] | None:
    """Matrix (3, 3) from linear light of these primaries to that of sRGB; None if degenerate."""
    x, y = np.array(chromaticity, float).reshape(4, 2).T
    if not (y > 0).all():
        return None
    # Such primaries span no triangle.
    if abs(np.linalg.det(np.stack([x[1:], y[1:], np.ones(3)]))) < 1e-4:
        return None
    theirs, srgb = _to_xyz(chromaticity), _to_xyz(_SRGB_PRIMARIES)
    whites = _BRADFORD @ srgb.sum(axis=1), _BRADFORD @ theirs.sum(axis=1)
    if not (whites[1] > 0).all():
        return None
    adapted = np.linalg.inv(_BRADFORD) @ np.diag(whites[0] / whites[1]) @ _BRADFORD
    return np.linalg.inv(srgb) @ adapted @ theirs


def _to_xyz(chromaticity: tuple[float, ...]) -> NDArray[np.floating]:
    """Matrix (3, 3) from linear light to CIE XYZ, whose white has Y = 1 (SMPTE RP 177)."""
    x, y = np.array(chromaticity, float).reshape(4, 2).T
    white, *primaries = np.stack([x / y, np.ones(4), (1 - x - y) / y], axis=1)
    columns = np.stack(primaries, axis=1)
    return columns * np.linalg.solve(columns, white)
