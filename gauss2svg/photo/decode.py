"""Decoding an image file: all of its bits, colours converted to sRGB, EXIF orientation applied."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import Base

from gauss2svg.errors import InputError
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.photo.open import UnreadTiffError, broken, loaded, opened
from gauss2svg.photo.photo import Header, Photo, unit
from gauss2svg.photo.reduce import Reduced, SizeNeeded, draft, pieces, reduced_size
from gauss2svg.photo.srgb import as_image, by_profile, in_srgb
from gauss2svg.photo.tags import frames_note, tags_of, turned, upright
from gauss2svg.photo.tiff import first_page, in_planes, tiff_header

# Pillow's raw modes of 16-bit samples, of which it keeps the upper bytes.
_SIXTEEN_BITS = re.compile(r"(RGB|RGBA|RGBX);16([BLN])")
# Raw modes that keep the lower ones instead: B takes the first byte of two, L the second, N the
# upper one of this machine.
_OTHER_BYTE = {"B": "L", "L": "B", "N": "B" if sys.byteorder == "little" else "L"}
_GREY_ALPHA_16 = "LA;16B"  # of a PNG; its four bytes per pixel are unpacked as if RGBA
# Greys of a PNG that Pillow scales to 8 bits, but not their transparent level.
_LEVEL_STEP = {"L;2": 85, "L;4": 17}
_INKS = 4  # channels of a TIFF's CMYK
_MOST_12, _MOST_16 = 4095, 65535  # levels of so many bits
_REDUCED_RESOLUTION = 1  # bit of a TIFF's NewSubfileType
_SIGNED = 2  # SampleFormat
# Bytes for each pixel while a photo of a format is decoded and reduced (docs/decisions/memory.md).
_REDUCED = {"JPEG": 4, "MPO": 4, "PNG": 4, "BMP": 4, "TIFF": 4, "WEBP": 16, "AVIF": 10}


# Bytes for each pixel while a photo is decoded and reduced (docs/decisions/memory.md).
OTHERS = 8  # formats that have no number of their own
PALETTE = 8  # least number of a photo with a palette
ALPHA = 10  # added for alpha
TURNED = 8  # added where a tag turns the photo
DEEP = 24  # 16 bits a sample
DEEP_ALPHA = 30  # 16 bits a sample, with alpha
PROGRESSIVE = 10  # progressive JPEG, all of whose coefficients are kept
PROGRESSIVE_INKS = 18  # progressive JPEG in CMYK


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples as stored: color (h, w, 1 or 3) or an image of 8 bits, alpha (h, w)."""

    color: NDArray[Any] | Image.Image
    alpha: NDArray[Any] | None
    notes: tuple[str, ...] = ()


def decode_file(
    file: BinaryIO, name: str, max_pixels: int, needed: SizeNeeded | None = None
) -> Photo:
    """The first frame of a seekable image file, reduced to the size needed.

    Raises InputError for an unsupported or broken file, and for one of more than max_pixels.
    """
    try:
        with opened(file, name, max_pixels) as image:
            _refuse_preview(image, name)
            if not in_planes(getattr(image, "tag_v2", {})):
                return decode_image(image, name, needed, file)
    except UnreadTiffError:
        pass
    return _decoded_tiff(file, name, max_pixels, needed)


def header_of_file(file: BinaryIO, name: str, max_pixels: int) -> Header:
    """What the header of a seekable image file says; raises InputError as `decode_file` does."""
    try:
        with opened(file, name, max_pixels) as image:
            if not in_planes(getattr(image, "tag_v2", {})):
                return header_of_image(image)
    except UnreadTiffError:
        pass
    return tiff_header(file, name, max_pixels)


def header_of_image(image: Image.Image) -> Header:
    """What is known of a Pillow image that may not be loaded yet."""
    has_alpha = "A" in image.getbands() or image.has_transparency_data
    reduced: int | None = _REDUCED.get(image.format or "", OTHERS)
    if image.mode == "P":
        reduced = max(reduced, PALETTE)
    reduced += ALPHA * has_alpha
    reduced += TURNED * (_tiff_number(image, Base.Orientation, 1) != 1)
    if "progressive" in image.info:
        reduced = PROGRESSIVE_INKS if image.mode == "CMYK" else PROGRESSIVE
    elif _SIXTEEN_BITS.fullmatch(rawmode := _rawmode(image)) or rawmode == _GREY_ALPHA_16:
        reduced = DEEP_ALPHA if has_alpha else DEEP
    elif image.mode.startswith("I") or image.mode == "F":
        reduced = None
    return Header(*image.size, has_alpha, reduced_bytes=reduced)


def decode_image(
    image: Image.Image, name: str, needed: SizeNeeded | None = None, file: BinaryIO | None = None
) -> Photo:
    """A Pillow image, which may not be loaded yet, reduced to the size needed.

    file  of which the image was opened here; None where it is its owner's
    Raises InputError for a broken one.
    """
    stored = image.size
    size, scale = reduced_size(needed, *stored), 1
    # An image that was given is its owner's, who may need all of it.
    if size is not None and file is not None and image.format in ("JPEG", "MPO"):
        scale = draft(image, size)
    before = tags_of(image) if image.format == "TIFF" else None  # loading rotates it
    rawmode, helped = _rawmode(image), []
    if file is not None and rawmode == _GREY_ALPHA_16:
        samples = _sixteen_bit_grey_alpha(image, name)
    elif file is not None and (match := _SIXTEEN_BITS.fullmatch(rawmode)):
        samples = _sixteen_bit_color(image, name, file, match)
    elif loaded(image, name, helped).mode.startswith("I") or image.mode == "F":
        samples = _wide_grey(image, name)
    else:
        try:
            samples = _eight_bits(image, rawmode)
        except (ValueError, OSError) as error:  # such as an index beyond its palette
            raise broken(name, error) from error
    tags = before or tags_of(image)
    sample = None
    if size is not None:
        reduced = Reduced(stored, size, scale)
        samples, sample = _reduced(samples, name, reduced, image), reduced.sample
    color, notes = in_srgb(samples.color, image, name, file)
    turn = tags_of(image).orientation  # Pillow applies that of a TIFF while loading it
    return Photo.from_samples(
        upright(color, turn),
        None if samples.alpha is None else upright(_alpha(samples.alpha, name), turn),
        full=turned(stored, turn),  # Pillow turns that of a TIFF when it opens it
        notes=(*tags.notes, *helped, *samples.notes, *notes, *frames_note(image)),
        dpi=tags.dpi,
        given_sample=sample,
    )


def _reduced(samples: _Samples, name: str, reduced: Reduced, image: Image.Image) -> _Samples:
    """Samples of the size needed, in 0..1; of 8 bits again where a profile is yet to be applied."""
    for rows, color in pieces(samples.color):
        alpha = None if samples.alpha is None else _alpha(samples.alpha[rows], name)
        reduced.add(color if color.dtype == np.uint8 else unit(color, name), alpha)
    color, alpha = reduced.result()
    mode = samples.color.mode if isinstance(samples.color, Image.Image) else ""
    if mode in ("CMYK", "LAB") or (mode and image.info.get("icc_profile")):
        return _Samples(as_image(color, mode, name), alpha, samples.notes)
    return _Samples(color, alpha, samples.notes)


def _decoded_tiff(file: BinaryIO, name: str, max_pixels: int, needed: SizeNeeded | None) -> Photo:
    page = first_page(file, name, max_pixels, needed)
    color: NDArray[Any] | Image.Image = page.color
    if page.color.shape[2] == _INKS:
        color = as_image(page.color, "CMYK", name)
    color, _, notes = by_profile(color, page.profile)
    if page.color.shape[2] == _INKS and page.bits > 8:
        notes.append(f"{page.bits} bits per channel reduced to 8")
    if page.pages > 1:
        notes.append(f"first of {page.pages} pages")
    turn = page.tags.orientation
    alpha = None if page.alpha is None else upright(_alpha(page.alpha, name), turn)
    return Photo.from_samples(
        upright(unit(color, name), turn),
        alpha,
        notes=(*page.tags.notes, *notes),
        dpi=page.tags.dpi,
        full=turned(page.stored, turn),
        given_sample=page.sample,
    )


def _refuse_preview(image: Image.Image, name: str) -> None:
    """Refuse a camera's raw file: a TIFF whose first image is a small preview."""
    kind = _tiff_number(image, Base.NewSubfileType, 0)
    if kind & _REDUCED_RESOLUTION or _tiff_number(image, Base.DNGVersion, 0):
        raise InputError(
            f"{name} must be a developed photo; got a camera's raw file, or one that begins "
            "with a preview. Try developing it, and saving it as TIFF, PNG or JPEG"
        )


def _tiff_number(image: Image.Image, tag: int, default: int) -> int:
    """A numeric tag of a TIFF, its largest value; the default where the tag is missing."""
    value = getattr(image, "tag_v2", {}).get(tag, default)
    values = value if isinstance(value, tuple) else (value,)
    return max((v for v in values if isinstance(v, int)), default=default)


def _rawmode(image: Image.Image) -> str:
    """The raw mode that Pillow will unpack, "" where it does not say."""
    tiles = getattr(image, "tile", None)
    if not tiles:
        return ""
    first = args[0] if isinstance(args := tiles[0][3], tuple) and args else args
    return first if isinstance(first, str) else ""


def _sixteen_bit_grey_alpha(image: Any, name: str) -> _Samples:
    image.tile = [tile._replace(args="RGBA") for tile in image.tile]
    pairs = np.asarray(loaded(image, name)).view(">u2")
    return _Samples(pairs[:, :, :1], pairs[:, :, 1])


def _sixteen_bit_color(image: Any, name: str, file: BinaryIO, match: re.Match[str]) -> _Samples:
    """Decoded twice, for upper and lower bytes: Pillow has no mode of 16 bits per channel."""
    lower = f"{match[1]};16{_OTHER_BYTE[match[2]]}"
    upper = np.asarray(loaded(image, name)).astype(np.uint16) << 8
    with opened(file, name, MOST_PIXELS) as again:
        again.tile = [
            tile._replace(args=(lower, *tile.args[1:]) if isinstance(tile.args, tuple) else lower)
            for tile in again.tile
        ]
        values = upper | np.asarray(loaded(again, name))
    color, alpha = values[:, :, :3], values[:, :, 3] if values.shape[2] == 4 else None
    return _Samples(color, _keyed(color, image, 1) if alpha is None else alpha)


def _wide_grey(image: Image.Image, name: str) -> _Samples:
    array = np.asarray(image)[:, :, None]
    if image.mode == "F":
        top = 1
    else:
        signed = _tiff_number(image, Base.SampleFormat, 1) == _SIGNED
        if array.dtype == np.int32 and image.format == "TIFF" and not signed:
            array = array.view(np.uint32)  # Pillow has no mode of them
        if array.min() < 0 or array.max() > _MOST_16:
            raise InputError(
                f"grey levels of {name} must be in 0..{_MOST_16}; got "
                f"{array.min()}..{array.max()}. Try rescaling them"
            )
        array = array.astype(np.uint16)
        top = _MOST_12 if _tiff_number(image, Base.BitsPerSample, 16) == 12 else _MOST_16
    alpha = _keyed(array, image, 1)
    white_is_zero = _tiff_number(image, Base.PhotometricInterpretation, 1) == 0
    if white_is_zero and image.mode != "I":  # Pillow inverts up to 8 bits
        array = top - array
    return _Samples(array if top in (1, _MOST_16) else array / np.float32(top), alpha)


def _eight_bits(image: Image.Image, rawmode: str) -> _Samples:
    notes = ()
    if _tiff_number(image, Base.BitsPerSample, 8) > 8:
        notes = ("16 bits per channel reduced to 8",)
    if image.mode in ("P", "PA", "La", "RGBa"):
        key = image.info.get("transparency")
        straight = "LA" if image.mode == "La" else "RGBA"
        clear = image.mode != "P" or key is not None or image.has_transparency_data
        image = image.convert(straight if clear else "RGB")
    if image.mode in ("LA", "RGBA"):
        alpha = np.asarray(image.getchannel("A"))
        return _Samples(image.convert(image.mode.removesuffix("A")), alpha, notes)
    if image.mode == "1":
        color = image.convert("L")
    else:
        color = image if image.mode in ("L", "RGB", "CMYK", "LAB") else image.convert("RGB")
    if image.mode not in ("1", "L", "RGB") or image.info.get("transparency") is None:
        return _Samples(color, None, notes)  # whose samples are converted some at a time
    alpha = _keyed(np.atleast_3d(np.asarray(color)), image, _LEVEL_STEP.get(rawmode, 1))
    return _Samples(color, alpha, notes)


def _keyed(color: NDArray[Any], image: Image.Image, step: int) -> NDArray[np.bool_] | None:
    """Alpha (h, w) of a file with one transparent colour, None without one."""
    key = image.info.get("transparency")
    levels = [
        level for level in (key if isinstance(key, tuple) else (key,)) if isinstance(level, int)
    ]
    if len(levels) != color.shape[2]:
        return None
    mask = np.iinfo(color.dtype).max if color.dtype.kind == "u" else 0
    return (color != np.array([(step * level) & mask for level in levels])).any(axis=2)


def _alpha(alpha: NDArray[Any], name: str) -> NDArray[np.float32]:
    return unit(alpha[:, :, None], f"alpha of {name}")[:, :, 0]
