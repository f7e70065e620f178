"""Open photos by libvips (JPEG, PNG, WebP, TIFF, AVIF), libheif (HEIC) or Pillow, and convert them.

Each loader is called by its name. So libvips does not choose a loader by the content of a file. Its
settings hold for the whole process. Samples are fetched in the calling thread, so that libvips
starts no pool of threads. `--threads` would not limit such a pool, and a forked process would not
have its threads.
"""

from __future__ import annotations

import importlib
import io
import logging
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray
from PIL import Image, ImageCms
from PIL.ExifTags import Base
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from gauss2svg.photo.pixels import unit

TURNED = (5, 6, 7, 8)  # the EXIF orientations that exchange width and height
TYPES = {"uchar": np.uint8, "ushort": np.uint16, "float": np.float32}

logging.getLogger("pyvips").setLevel(logging.CRITICAL)  # warnings that errors do not repeat
pyvips.cache_set_max(0)  # a cache would keep earlier photos in memory
# Block all loaders except the five below. This blocks formats such as SVG and PDF.
pyvips.operation_block_set("VipsForeignLoad", True)
for _loader in ("Jpeg", "Png", "Webp", "Tiff", "Heif"):
    pyvips.operation_block_set(f"VipsForeignLoad{_loader}", False)


@dataclass(eq=False)
class StoredImage:
    """The first image of a file, as it is stored.

    width, height    size in px
    colors           number of colour channels: 1 for grey, 3 for RGB, 4 for CMYK
    alpha            index of the alpha channel, or None
    picture          function that decodes the image, and returns it as a picture of libvips. Its
                     argument is one of `scales`, by which the decoder reduces the image. The
                     samples of the picture are uint8, uint16, or float32 in 0..1
    reduced_bytes    as in Header
    scales           factors by which the decoder can make the image smaller
    profile          ICC profile. None if the file has none
    orientation      orientation 1..8, as in EXIF. An image of orientation 1 is stored upright
    dpi              px per inch across and down, as stored. None if not known
    notes            notes on changes, for the report
    """

    width: int
    height: int
    colors: int
    alpha: int | None
    picture: Callable[[int], Any]
    reduced_bytes: int | None
    scales: tuple[int, ...] = (1,)
    profile: bytes | None = None
    orientation: int = 1
    dpi: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height in px of the upright photo."""
        is_swapped = self.orientation in TURNED
        return (self.height, self.width) if is_swapped else (self.width, self.height)

    def note_frames(self, count: int, noun: str = "frames") -> None:
        """Add a note if the file has more than one frame or page."""
        if count > 1:
            self.notes.append(f"first of {count} {noun}")


def of_file(file: bytes, loader: str) -> StoredImage:
    """Read the header of a file by the loader of its Format."""
    if not loader:
        return _opened_by_libheif(file)
    return (_opened_by_libvips if loader.endswith("load") else _opened_by_pillow)(file, loader)


def _opened_by_libvips(file: bytes, loader: str) -> StoredImage:
    """Read the header of a file by a loader of libvips."""
    tags = _tiff_tags(file) if loader == "tiffload" else {}
    if tags.get(Base.PhotometricInterpretation) == 8:  # CIELAB, which this loader cannot decode
        return _opened_by_pillow(file, "Tiff")
    if tags.get(Base.NewSubfileType) == 1 or Base.DNGVersion in tags:
        raise ValueError("it is a camera's raw file, or begins with a preview")
    # If a tile is broken, libtiff only warns. Warnings about other TIFFs are about harmless tags.
    options: dict[str, Any] = {"fail_on": "warning" if Base.TileWidth in tags else "error"}
    if loader == "tiffload":
        options["unlimited"] = True  # otherwise libtiff allocates at most 50 MB at once

    def image(**more: int) -> Any:
        load = getattr(pyvips.Image, f"{loader}_buffer")
        picture = load(file, access="sequential", **options, **more)
        if loader == "heifload" and picture.format == "ushort":
            # libvips returns numbers of 16 bits. A sample is in the upper part of such a number.
            # This part has `bits` bits, and the bits below it are 0.
            bits = picture.get("bits-per-sample")
            return picture / ((1 << bits) - 1 << 16 - bits)
        return picture

    def picture(scale: int) -> Any:
        if scale == 1:
            return image()
        # libvips rounds the reduced size down. To get the size rounded up, the last row and the
        # last column are repeated.
        size = -(-header.width // scale), -(-header.height // scale)
        return image(shrink=scale).embed(0, 0, *size, extend="copy")

    header = image()
    colors = {"b-w": 1, "grey16": 1, "cmyk": 4}.get(header.interpretation, 3)
    # A hostile file could have thousands of samples for each pixel.
    if header.format not in TYPES or not colors <= header.bands <= colors + 4:
        raise ValueError(f"samples of type {header.format}, {header.bands} for each pixel")
    # Only these fields are read, because reading a field fails if its text is not valid Unicode.
    names = ("resolution-unit", "orientation", "icc-profile-data", "n-pages")
    fields = {name: header.get(name) for name in names if header.get_typeof(name)}
    alpha = colors if header.hasalpha() else None
    size = header.bands * np.dtype(TYPES[header.format]).itemsize
    # Bytes per pixel that are needed to decode and reduce an image (docs/decisions/memory.md).
    reduced = {"pngload": size + 2, "webpload": 14, "tiffload": 3 * size}.get(loader, 5 * size + 1)
    if loader == "jpegload":
        reduced = 3 * size if header.get("jpeg-multiscan") else 3
    stored = StoredImage(header.width, header.height, colors, alpha, picture, reduced)
    # If a file has no resolution, libvips reports one of its own.
    has_resolution = "resolution-unit" in fields and header.xres != 1
    if loader == "pngload":
        head = file[: file.find(b"IDAT")]
        if (place := head.find(b"pHYs")) > 0:
            has_resolution = head[place + 12 : place + 13] == b"\1"  # the unit: px per metre
        if (place := head.find(b"acTL")) > 0:
            fields["n-pages"] = int.from_bytes(head[place + 4 : place + 8])
    if has_resolution:
        stored.dpi = header.xres * 25.4, header.yres * 25.4
    stored.orientation = fields.get("orientation", 1)
    stored.profile = fields.get("icc-profile-data")
    stored.note_frames(fields.get("n-pages", 1), "pages" if loader == "tiffload" else "frames")
    if loader == "jpegload":
        stored.scales = (1, 2, 4, 8)
    elif loader == "heifload":
        if codes := re.search(rb"colrnclx(..)(..)", file, re.DOTALL):
            _take_codes(stored, *(int.from_bytes(code, "big") for code in codes.groups()))
    elif stored.alpha is not None and (kinds := tags.get(Base.ExtraSamples)):
        # The kind 1 is premultiplied alpha, the kind 2 is straight alpha, and 0 has no meaning.
        is_alpha = [kind in (1, 2) for kind in (kinds if isinstance(kinds, tuple) else (kinds,))]
        stored.alpha = colors + is_alpha.index(True) if True in is_alpha else None
    return stored


def _take_codes(stored: StoredImage, primaries: int, transfer: int) -> None:
    """Take the profile of Display P3, or a note on HDR, from codes of H.273 in a phone's photo."""
    if stored.profile is None and transfer in (16, 18):
        stored.notes.append("its colours are HDR; read as those of sRGB")
    elif stored.profile is None and primaries == 12:
        stored.profile = pyvips.Operation.call("profile_load", "p3")


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


def _opened_by_libheif(file: bytes) -> StoredImage:
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
        picture = pyvips.Image.new_from_array(np.asarray(heif))
        return picture if picture.format == "uchar" else picture / ((1 << depth) - 1)

    colors = 3 if kind.upper().startswith("RGB") else 1
    # Decoding and reducing a photo takes 10 bytes of memory per pixel for samples of one byte, and
    # twice as many for samples of two bytes.
    alpha, size = colors if heif.has_alpha else None, 10 * -(-depth // 8)
    stored = StoredImage(*heif.size, colors, alpha, picture, size)
    stored.profile = heif.info.get("icc_profile")
    if nclx := heif.info.get("nclx_profile"):
        _take_codes(stored, nclx["color_primaries"], nclx["transfer_characteristics"])
    return stored


def _opened_by_pillow(file: bytes, loader: str) -> StoredImage:
    """Read the header of a file by one of Pillow's plugins.

    The plugin is called directly, so the size limit of Image.open does not apply.
    """
    if loader == "Jpeg2K" and file.rfind(b"\xff\xd9") <= file.rfind(b"\xff\x93"):
        # OpenJPEG would decode the missing part as black pixels, without an error.
        raise ValueError("its data end early")
    plugin = importlib.import_module(f"PIL.{loader}ImagePlugin")
    return of_image(getattr(plugin, f"{loader}ImageFile")(io.BytesIO(file)))


def of_image(image: Image.Image) -> StoredImage:
    """Return a PIL image as StoredImage. Its pixels need not be loaded yet."""
    mode, info = image.mode, image.info
    if mode in ("PA", "La", "RGBa") or image.has_transparency_data:
        mode = "LA" if mode in ("LA", "La") else "RGBA"
    elif mode == "1":
        mode = "L"
    elif not (mode in ("L", "RGB", "CMYK", "F") or mode.startswith("I")):
        mode = "RGB"
    colors = {"RGB": 3, "RGBA": 3, "CMYK": 4}.get(mode, 1)

    def picture(_scale: int) -> Any:
        array = np.asarray(image.convert(mode))
        # Integers of 16 or 32 bits are grey levels in 0..65535. A higher level becomes more than 1
        # here, and `unit` refuses it later.
        if array.dtype.kind in "iu" and array.dtype != np.uint8:
            array = array.astype(np.float32) / 65535
        return pyvips.Image.new_from_array(array)

    alpha = colors if mode.endswith("A") else None
    # Decoding and reducing takes 20 bytes per pixel (docs/decisions/memory.md).
    stored = StoredImage(image.width, image.height, colors, alpha, picture, 20)
    stored.profile = info.get("icc_profile")
    try:
        if image.format == "GIF" and not image.tell():
            stored.note_frames(getattr(image, "n_frames", 1))
        if dpi := info.get("dpi"):  # two numbers, which are fractions if the image is a TIFF
            stored.dpi = float(dpi[0]), float(dpi[1])
        if image.format != "TIFF":  # Pillow itself turns a TIFF upright
            turn = image.getexif().get(Base.Orientation)
            stored.orientation = turn if turn and turn in range(1, 9) else 1
    except Exception:  # if EXIF data or later frames are broken, the photo is read all the same
        stored.notes.append("its EXIF data, or frames after the first, are broken; ignored")
    return stored


def samples(picture: Any) -> NDArray[Any]:
    """Return the samples (h, w, bands) of a picture of libvips."""
    width, height, bands = picture.width, picture.height, picture.bands
    array = np.empty((height, width, bands), TYPES[picture.format])
    region, step = pyvips.Region.new(picture), 4  # rows that are fetched at a time
    for top in range(0, height, step):
        rows = min(step, height - top)
        fetched = np.frombuffer(region.fetch(0, top, width, rows), array.dtype)
        array[top : top + rows] = fetched.reshape(-1, width, bands)
    return array


_SAME = 1 / 255  # a profile that changes no level by more than this counts as sRGB


def in_srgb(
    color: NDArray[np.float32], profile: bytes | None
) -> tuple[NDArray[np.float32], list[str]]:
    """Convert color in 0..1 to sRGB by its ICC profile, and return it with notes on the conversion.

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
