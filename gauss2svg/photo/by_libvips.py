"""Open JPEG, PNG, WebP, TIFF and AVIF photos by libvips, and HEIC photos by libheif.

Each loader is called by its name. So libvips does not choose a loader by the content of a file.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pyvips
from PIL.ExifTags import Base
from PIL.TiffImagePlugin import COMPRESSION_INFO, ImageFileDirectory_v2

from gauss2svg.photo import libvips
from gauss2svg.photo.load import StoredImage
from gauss2svg.photo.srgb import CMYK_CHANNELS, UNUSABLE, ColorSpace

# Number of colour channels for each `interpretation` of a libvips image. Interpretations that are
# not listed have 3.
_COLORS = {"b-w": 1, "grey16": 1, "cmyk": CMYK_CHANNELS}
# Largest number of samples that a pixel may have in addition to its colour channels. Without this
# limit, a hostile file could have thousands.
_MAX_EXTRA = 4
_END_OF_IMAGE = b"\xff\xd9"
_INKS, _YCBCR, _LAB = 5, 6, 8  # values of the TIFF tag PhotometricInterpretation
_SEPARATE, _FLOAT = 2, 3  # values of the TIFF tags PlanarConfiguration and SampleFormat


def opened(file: bytes, loader: str) -> StoredImage:
    """Read the header of a file by a loader of libvips."""
    tags = _tiff_tags(file) if loader == "tiffload" else {}
    if problem := _misread(tags):
        raise ValueError(problem)
    # Grey AVIFs are read by Pillow. Their grey levels may range over 16..235, which libheif (called
    # by libvips) does not expand to 0..255.
    av1 = re.search(rb"av1C..(.)", file, re.DOTALL) if loader == "heifload" else None
    is_grey_avif = av1 and av1[1][0] & 0x10
    if is_grey_avif or _needs_pillow(tags):
        from gauss2svg.photo import by_pillow  # imported here because few files need it

        return by_pillow.opened(file, "Avif" if is_grey_avif else "Tiff")
    faxes = "tiff_ccitt", "group3", "group4"
    # If tiles or a fax are broken, libtiff only warns. So in files with tiles
    # and in faxes, a warning counts as an error. Files with a strip of length 0 are an exception,
    # because libtiff warns of such a strip although the file can be read.
    is_strict = (Base.TileWidth in tags or _compression(tags) in faxes) and (
        0 not in _numbers(tags, Base.StripByteCounts)
    )

    def image(**options: int) -> Any:
        load = getattr(pyvips.Image, f"{loader}_buffer")
        # Without this option, libtiff refuses to allocate more than 50 MB at once.
        if loader == "tiffload":
            options["unlimited"] = True
        picture = load(
            file, access="sequential", fail_on="warning" if is_strict else "error", **options
        )
        if loader == "heifload" and picture.format == "ushort":
            # libvips returns numbers of 16 bits. A sample is in the upper part of such a number.
            # This part has `bits` bits, and the bits below it are 0.
            bits = picture.get("bits-per-sample")
            return picture / ((1 << bits) - 1 << 16 - bits)
        if tags.get(Base.PhotometricInterpretation) == 0 and picture.format == "float":
            return picture.linear([-1, 1][: picture.bands], [1, 0][: picture.bands])
        return picture

    def picture(scale: int) -> Any:
        if scale == 1:
            return image()
        # libvips rounds the reduced size down. To get the size rounded up, the last row and the
        # last column are repeated.
        size = -(-header.width // scale), -(-header.height // scale)
        return image(shrink=scale).embed(0, 0, *size, extend="copy")

    header = image()
    colors = min(_COLORS.get(header.interpretation, 3), header.bands)
    if header.format not in libvips.TYPES or header.bands > colors + _MAX_EXTRA or colors == 2:
        raise ValueError(f"samples of type {header.format}, {header.bands} for each pixel")
    # Only these fields are read, because reading a field fails if its text is not valid Unicode.
    names = ("resolution-unit", "orientation", "icc-profile-data", "n-pages")
    fields = {name: header.get(name) for name in names if header.get_typeof(name)}
    alpha = colors if header.hasalpha() else None
    size = header.width, header.height
    stored = StoredImage(*size, colors, alpha, picture, _reduced_bytes(loader, header))
    stored.density = header.xres * 25.4, header.yres * 25.4
    # libvips does not read the resolution of a WebP, and reports 1 px per mm in its place.
    stored.is_per_inch = "resolution-unit" in fields and header.xres != 1.0
    stored.orientation = fields.get("orientation", 1)
    stored.space = ColorSpace(fields.get("icc-profile-data"))
    stored.note_frames(fields.get("n-pages", 1), "pages" if loader == "tiffload" else "frames")
    # Warnings about a PNG are not reported, because they concern chunks that `_add_chunks` reads
    # in place of libvips.
    stored.reports_warning = loader in ("jpegload", "tiffload")
    if loader == "jpegload":
        stored.scales = (1, 2, 4, 8)
        sides = re.escape(struct.pack(">HH", *size[::-1]))
        # Look for the end marker only after the last frame header that has the size of the image.
        # An earlier end marker may be that of a preview in the EXIF data, which is itself a JPEG.
        frame = re.match(rb".*\xff[\xc0-\xcf].{3}" + sides, file, re.DOTALL)
        if frame and file.find(_END_OF_IMAGE, frame.end()) == -1:
            file += _END_OF_IMAGE
            stored.notes.append("its end marker is missing")
    elif loader == "pngload":
        _add_chunks(stored, file)
    elif loader == "tiffload":
        if stored.alpha is not None and (extra := _numbers(tags, Base.ExtraSamples)):
            # The kind 1 is premultiplied alpha, and the kind 2 is straight alpha.
            is_alpha = [kind in (1, 2) for kind in extra]
            stored.alpha = colors + is_alpha.index(True) if True in is_alpha else None
    elif loader == "heifload":
        if file[8:12] == b"avis":
            stored.notes.append("first of several frames")
        if not stored.space.profile and (match := re.search(rb"colrnclx(..)(..)", file, re.DOTALL)):
            stored.set_codes("nclx", [int.from_bytes(code, "big") for code in match.groups()])
    return stored


def opened_heic(file: bytes, _loader: str) -> StoredImage:
    """Read the header of the primary image of a HEIC file, by libheif in the package pi-heif.

    libheif itself rotates and crops the image as the file says, so the image is upright.
    """
    import pi_heif  # imported here because few photos need it

    pi_heif.options.DECODE_THREADS = 1  # more threads could exceed the limit of --threads
    # References to metadata are removed, because pi-heif 1.4 may crash when it reads metadata.
    file = re.sub(rb"(\0\0..)cdsc", rb"\1free", file, flags=re.DOTALL)
    heif = pi_heif.open_heif(io.BytesIO(file), convert_hdr_to_8bit=False, hdr_to_16bit=False)
    if not len(heif):
        raise ValueError("it has no picture of HEVC")
    kind, _, bits = heif.mode.partition(";")
    depth = int(bits or 8)

    def picture(_scale: int) -> Any:
        array, max_level = np.asarray(heif), (1 << depth) - 1
        picture = pyvips.Image.new_from_array(array)
        if heif.premultiplied_alpha:
            # A premultiplied colour cannot be larger than its alpha. Lossy compression may make it
            # larger, so it is clipped here.
            array = np.minimum(array, array[..., -1:])
            picture = pyvips.Image.new_from_array(array).unpremultiply(max_alpha=max_level)
        return picture if picture.format == "uchar" else picture / max_level

    colors = 3 if kind.upper().startswith("RGB") else 1
    alpha = colors if heif.has_alpha else None
    # Decoding and reducing a photo takes 10 bytes of memory per pixel for samples of one byte, and
    # twice as many for samples of two bytes.
    stored = StoredImage(*heif.size, colors, alpha, picture, 10 * -(-depth // 8))
    if profile := heif.info.get("icc_profile"):
        stored.space = ColorSpace(profile)
    elif nclx := heif.info.get("nclx_profile"):
        codes = nclx["color_primaries"], nclx["transfer_characteristics"]
        stored.set_codes("nclx", codes)
    if len(heif) > 1:
        stored.notes.append(f"primary image of {len(heif)}")
    return stored


def _reduced_bytes(loader: str, image: Any) -> int:
    """Return the number of bytes per pixel that are needed to decode and reduce an image.

    docs/decisions/memory.md has the measurements.
    """
    size = image.bands * np.dtype(libvips.TYPES[image.format]).itemsize
    if loader == "jpegload":
        return 3 * size if image.get("jpeg-multiscan") else 3
    return {"pngload": size + 2, "webpload": 14, "tiffload": 3 * size}.get(loader, 5 * size + 1)


def _add_chunks(stored: StoredImage, file: bytes) -> None:
    """Read the chunks before a PNG's pixels, and add to `stored` what libvips does not report."""
    chunks: dict[bytes, bytes] = {}
    offset = 8
    while (kind := file[offset + 4 : offset + 8]) not in (b"", b"IDAT"):
        end = offset + 8 + int.from_bytes(file[offset : offset + 4], "big")
        chunks.setdefault(kind, file[offset + 8 : end])
        offset = end + 4
    gama, chrm = (chunks.get(kind, b"") for kind in (b"gAMA", b"cHRM"))
    if b"sRGB" not in chunks and len(gama) == 4:
        numbers = struct.iter_unpack(">I", gama + chrm * (len(chrm) == 32))
        gamma, *primaries = (number / 100_000 for (number,) in numbers)
        stored.set_gamma(gamma, primaries)
    # The profile is read here, because libpng drops some profiles that are usable.
    if iccp := chunks.get(b"iCCP"):
        packed = iccp.partition(b"\0")[2][1:]
        try:
            profile = zlib.decompressobj().decompress(packed, 1 << 24)  # its size limit is 16 MiB
            stored.space = replace(stored.space, profile=profile)
        except zlib.error:
            stored.notes.append(UNUSABLE)
    if len(codes := chunks.get(b"cICP", b"")) == 4:
        stored.set_codes("cICP", codes[:2])
    stored.is_per_inch |= chunks.get(b"pHYs", b"")[8:] == b"\1"
    stored.note_frames(int.from_bytes(chunks.get(b"acTL", b"")[:4], "big"))


def _tiff_tags(file: bytes) -> dict[int, Any]:
    """Return the tags of a TIFF's first page.

    Return {} if the tags are broken. libtiff then reports an error when it reads the file.
    """
    try:
        directory = ImageFileDirectory_v2(file[: 16 if b"+" in file[2:4] else 8])
        stream = io.BytesIO(file)
        stream.seek(directory.next)
        directory.load(stream)
        return dict(directory)
    except Exception:  # hostile bytes may make Pillow's reader raise an exception of any class
        return {}


def _numbers(tags: dict[int, Any], tag: int) -> tuple[int, ...]:
    value = tags.get(tag, ())
    return value if isinstance(value, tuple) else (value,)


def _compression(tags: dict[int, Any]) -> str:
    """Return Pillow's name of the compression of a TIFF, "raw" if it has none."""
    return COMPRESSION_INFO.get(tags.get(Base.Compression, 1), "")


def _needs_pillow(tags: dict[int, Any]) -> bool:
    """Return whether a TIFF with these tags is read by Pillow in place of libvips.

    This holds for the TIFFs that libvips does not decode. Pillow can read them only if their
    samples have at most 8 bits.
    """
    return max(_numbers(tags, Base.BitsPerSample), default=1) <= 8 and (
        tags.get(Base.PhotometricInterpretation) == _LAB
        or _compression(tags) in ("tiff_jpeg", "lzma", "zstd")
        or (tags.get(Base.PlanarConfiguration) == _SEPARATE and Base.TileWidth in tags)
    )


def _misread(tags: dict[int, Any]) -> str:
    """Return the reason why libvips would read a wrong picture from a TIFF with these tags.

    Return "" if libvips reads the TIFF correctly.
    """
    if tags.get(Base.NewSubfileType) == 1 or Base.DNGVersion in tags:
        return "it is a camera's raw file, or begins with a preview"
    if 0 in _numbers(tags, Base.StripOffsets) + _numbers(tags, Base.TileOffsets):
        return "some of its strips or tiles have no data"
    color = tags.get(Base.PhotometricInterpretation)
    is_separate = tags.get(Base.PlanarConfiguration) == _SEPARATE
    if color == _INKS and tags.get(Base.SamplesPerPixel) in (1, 2, 3):
        return "its inks are not cyan, magenta, yellow and black"
    is_whole = is_separate or _numbers(tags, Base.YCbCrSubSampling) == (1, 1)
    if color == _YCBCR and is_whole and _compression(tags) not in ("tiff_jpeg", "jpeg"):
        return "its luma has no more pixels than its chroma, or they are in planes"
    bits, kinds = _numbers(tags, Base.BitsPerSample), _numbers(tags, Base.SampleFormat)
    is_half, is_grey = _FLOAT in kinds and 16 in bits, color in (0, 1)
    if is_separate and (
        is_half or (is_grey and tags.get(Base.SamplesPerPixel, 1) > 1)
    ):  # libvips would read these planes as if their samples were interleaved
        return "its grey and alpha, or its floats of 16 bits, are in planes"
    return ""
