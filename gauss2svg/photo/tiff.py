"""TIFFs that Pillow does not decode: floating point, 16 bits with alpha, samples plane by plane.

Of samples in planes Pillow mistakes 16 bits for 8, and grey with alpha for noise. Tags are read by
tifffile, and samples by `strips`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL.ExifTags import Base

from gauss2svg.errors import InputError, brief
from gauss2svg.photo.damage import damage_of_parts
from gauss2svg.photo.open import broken, check_size
from gauss2svg.photo.photo import Header, unit
from gauss2svg.photo.reduce import Reduced, Size, SizeNeeded, pieces, reduced_size
from gauss2svg.photo.strips import NOT_COMPRESSED, SEPARATE, UNPACKED, are_read, bands, part_bytes
from gauss2svg.photo.tags import Tags, dpi_in, tags_from

_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _INKS = 0, 1, 2, 5  # PhotometricInterpretation
_CHANNELS = {_WHITE_IS_ZERO: 1, _BLACK_IS_ZERO: 1, _RGB: 3, _INKS: 4}
_MOST_EXTRA = 4  # samples besides colours: memory for all is allocated before decoding
_PREMULTIPLIED, _STRAIGHT = 1, 2  # ExtraSamples
_TYPES = (np.bool_, np.uint8, np.uint16, np.float16, np.float32, np.float64)
_TILE = 1024  # px of a side, up to which tiles may be larger than their picture
_silent = logging.NullHandler()


@dataclass(frozen=True, eq=False)
class Page:
    """The first page of a TIFF: color (h, w, 1, 3 or 4), of which four are inks; alpha (h, w).

    As stored, or reduced to float32 in 0..1.
    stored  its width and height in px
    bits    of each sample
    pages   how many there are
    sample  some of its pixels, where it is reduced
    """

    color: NDArray[Any]
    alpha: NDArray[Any] | None
    profile: bytes | None
    tags: Tags
    stored: Size
    bits: int
    pages: int
    sample: NDArray[np.float32] | None = None


def in_planes(tags: Any) -> bool:
    """Whether a TIFF of these tags has each of several samples in a plane of its own.

    Not where they are luma and chroma, or JPEGs, which libtiff decodes.
    """
    return (
        tags.get(Base.PlanarConfiguration) == SEPARATE
        and tags.get(Base.SamplesPerPixel, 1) > 1
        and tags.get(Base.Compression, NOT_COMPRESSED) in UNPACKED
        and tags.get(Base.PhotometricInterpretation) in _CHANNELS
    )


def tiff_header(file: BinaryIO, name: str, max_pixels: int) -> Header:
    """What the header of a TIFF says that Pillow does not open; raises InputError as `first_page`.

    Any sample besides colours counts as alpha.
    """
    with _opened(file, name, max_pixels) as (page, _):
        extra = page.samplesperpixel > _CHANNELS[int(page.photometric)]
        # Bytes for each pixel while it is decoded and reduced (benchmarks/memory.py).
        return Header(page.imagewidth, page.imagelength, extra, part_bytes(page), 3)


def first_page(
    file: BinaryIO, name: str, max_pixels: int, needed: SizeNeeded | None = None
) -> Page:
    """The first page of a TIFF, reduced to the size needed while it is read.

    Raises InputError for a broken, unsupported or too large one.
    """
    with _opened(file, name, max_pixels) as (page, pages):
        if missing := damage_of_parts(
            page.dataoffsets, page.databytecounts, math.prod(page.chunked)
        ):
            raise broken(name, OSError(missing))
        stored = page.imagewidth, page.imagelength
        parts = (_color_and_alpha(band, page) for band in bands(file, page))
        sample = None
        if (size := reduced_size(needed, *stored)) is not None:
            reduced = Reduced(stored, size)
            for part, shows in parts:
                alpha = None if shows is None else unit(shows[:, :, None], name)[:, :, 0]
                reduced.add(unit(part, name), alpha)
            (color, alpha), sample = reduced.result(), reduced.sample
        else:
            colors, alphas = zip(*parts, strict=True)
            color = np.concatenate(colors)
            alpha = None if alphas[0] is None else np.concatenate(alphas)
        profile, tags = page.tags.valueof(Base.InterColorProfile), _tags(page)
        profile = profile if isinstance(profile, bytes) else None
        return Page(color, alpha, profile, tags, stored, page.bitspersample, pages, sample)


def _color_and_alpha(samples: NDArray[Any], page: Any) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Straight color and alpha of rows (rows, w, samples); few bits become float32."""
    top = (1 << page.bitspersample) - 1
    if samples.dtype.kind == "u" and top < 256**samples.itemsize - 1:
        samples = samples / np.float32(top)
    channels = _CHANNELS[int(page.photometric)]
    color, alpha = samples[:, :, :channels], None
    if int(page.photometric) == _WHITE_IS_ZERO:
        color = (1 if color.dtype.kind == "f" else np.iinfo(color.dtype).max) - color
    for k, kind in enumerate(page.extrasamples[: samples.shape[2] - channels]):
        if int(kind) in (_PREMULTIPLIED, _STRAIGHT):
            alpha = samples[:, :, channels + k]
            if int(kind) == _PREMULTIPLIED:
                color = _straight(color, alpha)
            break
    return color, alpha


@contextmanager
def _opened(file: BinaryIO, name: str, max_pixels: int) -> Iterator[tuple[Any, int]]:
    """The first page of a TIFF by tifffile, of a kind that is read here, and how many there are.

    Raises InputError for any other, and for what is raised inside.
    """
    import tifffile  # 0.1 s, for few files

    # What it has to say of a broken file is not printed where the program has no log.
    logging.getLogger(tifffile.__name__).addHandler(_silent)
    file.seek(0)
    page: Any = None
    try:
        with tifffile.TiffFile(file, name=name) as tiff:  # the name of the file may be a number
            if not len(tiff.pages):
                raise broken(name, ValueError("it has no page"))
            page = tiff.pages[0]
            check_size((page.imagewidth, page.imagelength), name, max_pixels)
            channels = _CHANNELS.get(int(page.photometric))
            extra = page.samplesperpixel - (channels or 0)
            if (
                channels is None
                or not 0 <= extra <= _MOST_EXTRA
                or page.imagedepth != 1
                or page.dtype not in map(np.dtype, _TYPES)
                or page.compression not in UNPACKED
                or not are_read(page)
            ):
                raise InputError(
                    f"{name} must be a TIFF of grey, RGB or CMYK, up to 16 bits or floating "
                    f"point; got {page.dtype} samples, {page.samplesperpixel} per pixel, of "
                    f"{page.bitspersample} bits, photometric {int(page.photometric)}, "
                    f"compression {int(page.compression)}, predictor {int(page.predictor)}. Try "
                    "saving it as such, or as PNG"
                )
            _check_tiles(page, name)
            yield page, len(tiff.pages)
    except (InputError, MemoryError):
        raise
    except OSError as error:  # of data that end early
        raise broken(name, error) from error
    except Exception as error:  # hostile bytes make decoders raise anything
        packed = page is not None and page.compression != NOT_COMPRESSED
        advice = "saving it without compression, or as PNG" if packed else "saving it as PNG"
        raise InputError(
            f"{name} must be readable; got one that is not: {brief(error)}. Try {advice}"
        ) from error


def _check_tiles(page: Any, name: str) -> None:
    """Raise InputError for tiles by which a picture takes far more memory than its size says."""
    if not page.is_tiled:
        return
    tile = page.tilewidth, page.tilelength
    stored = page.imagewidth, page.imagelength
    most = [-(-side // _TILE) * _TILE for side in stored]
    if any(side > limit for side, limit in zip(tile, most, strict=True)):
        raise InputError(
            f"tiles of {name} must be at most {most[0]}x{most[1]} px, of a picture of "
            f"{stored[0]}x{stored[1]} px; got {tile[0]}x{tile[1]} px. Try saving it without "
            "tiles"
        )


def _tags(page: Any) -> Tags:
    """Orientation and resolution, whose numbers are fractions."""
    pairs = [page.tags.valueof(tag) for tag in (Base.XResolution, Base.YResolution)]
    valid = all(isinstance(p, tuple) and len(p) == 2 and min(p) > 0 for p in pairs)
    density = (pairs[0][0] / pairs[0][1], pairs[1][0] / pairs[1][1]) if valid else None
    dpi = dpi_in(density, page.tags.valueof(Base.ResolutionUnit, default=2))
    return tags_from(page.tags.valueof(Base.Orientation), dpi, density)


def _straight(color: NDArray[Any], alpha: NDArray[Any]) -> NDArray[Any]:
    """Colour with alpha divided out, of the same type; 0 where alpha is 0."""
    is_float = color.dtype.kind == "f"
    top = 1.0 if is_float else float(np.iinfo(color.dtype).max)
    result = np.empty_like(color)
    for rows, some in pieces(color):  # of float64
        below, zeros = alpha[rows, :, None], np.zeros(some.shape)
        divided = np.divide(some.astype(np.float64) * top, below, where=below > 0, out=zeros)
        result[rows] = divided if is_float else np.clip(np.round(divided), 0, top)
    return result
