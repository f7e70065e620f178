"""Load a photo from a file, bytes, an array, a tensor or a PIL image."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, brief, quoted, refusal
from gauss2svg.files import reading
from gauss2svg.options import Field, file_name
from gauss2svg.photo import (
    DEFAULT_MAX_PIXELS,
    FORMATS,
    MOST_PIXELS,
    OF_PILLOW,
    PREFIX_BYTES,
    format_of,
)
from gauss2svg.photo.libvips import TYPES, samples
from gauss2svg.photo.pixels import (
    FOCUS_STRENGTH,
    Focus,
    Header,
    Photo,
    Size,
    SizeNeeded,
    has_alpha,
    over,
    pixels_of,
    reduced_size,
    shrunk,
    unit,
)
from gauss2svg.photo.srgb import PRIMARIES, TRANSFERS, ColorSpace, in_srgb

SWAPPED = (5, 6, 7, 8)  # EXIF orientations that exchange width and height
_LEAST_DPI = 1.0  # px per inch. A resolution of this or less counts as unknown
_WHITE = 0.5  # least grey in 0..1 of a mask that counts as white
_SQUARE = 0.01  # largest relative difference of dpi across and down at which pixels are square
# libjpeg decodes a JPEG at least this many times as large as needed, and `resized` reduces it
# further, because libjpeg's filter removes high frequencies (docs/decisions/photo.md).
OVERSIZE = 3
_OPAQUE = {"uchar": 255, "ushort": 65535, "float": 1}  # alpha of an opaque pixel, by sample format
_TRUNCATED = "premature end of data segment"  # libjpeg's message, only a warning in libvips


@dataclass(eq=False)
class StoredImage:
    """The first image of a file, as it is stored.

    width, height    size in px
    colors           number of colour channels: 1 for grey, 3 for RGB, CMYK_CHANNELS for CMYK
    alpha            index of the alpha channel, or None
    picture          function that decodes the image, reduced by one of `scales`, to a picture of
                     libvips. The samples are uint8, uint16, or float32 in 0..1
    reduced_bytes    as in Header
    scales           factors by which the decoder can make the image smaller
    space            colour space
    orientation      1..8 as in EXIF. 1 is upright as stored
    density          px across and down in one unit of length, as stored. None if the file has none
    is_per_inch      whether the unit of `density` is known to be an inch
    notes            notes on changes, for the report
    reports_warning  whether the decoder's last warning becomes a note
    """

    width: int
    height: int
    colors: int
    alpha: int | None
    picture: Callable[[int], Any]
    reduced_bytes: int | None
    scales: tuple[int, ...] = (1,)
    space: ColorSpace = field(default_factory=ColorSpace)
    orientation: int = 1
    density: tuple[float, float] | None = None
    is_per_inch: bool = True
    notes: list[str] = field(default_factory=list)
    reports_warning: bool = False

    @property
    def header(self) -> Header:
        """Size, alpha, and memory for decoding."""
        return Header(self.width, self.height, self.alpha is not None, self.reduced_bytes)

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height in px of the upright photo."""
        is_swapped = self.orientation in SWAPPED
        return (self.height, self.width) if is_swapped else (self.width, self.height)

    def resolution(self) -> tuple[tuple[float, float] | None, list[str]]:
        """Return px per inch across and down the upright photo (None if unknown), and notes."""
        if self.density is None or min(self.density) <= 0:
            return None, []
        across, down = self.density[::-1] if self.orientation in SWAPPED else self.density
        notes = []
        if abs(across / down - 1) > _SQUARE:
            notes.append(
                f"pixels are {down / across:.3g} times as wide as high by the resolution tag; "
                "treated as square"
            )
        is_known = self.is_per_inch and min(self.density) > _LEAST_DPI
        return (across, down) if is_known else None, notes

    def set_codes(self, source: str, codes: Sequence[int]) -> None:
        """Set the colour space by H.273 codes (primaries, transfer). Note unsupported codes."""
        primaries, transfer = codes
        chromaticity, gamma = PRIMARIES.get(primaries), TRANSFERS.get(transfer)
        if chromaticity and gamma:
            self.space = ColorSpace(None, gamma, chromaticity, source)
        else:
            kind = f"{source} with primaries {primaries} and transfer {transfer}"
            self.notes.append(f"{kind} not supported; ignored")

    def set_gamma(self, gamma: float, chromaticity: Sequence[float]) -> None:
        """Set the colour space by the gAMA of a PNG, and by its cHRM if that has eight numbers."""
        source = f"gAMA of {gamma:g}"
        self.space = ColorSpace(gamma=gamma, source=source)
        if len(chromaticity) == 8:
            self.space = ColorSpace(None, gamma, tuple(chromaticity), f"{source} and cHRM")

    def note_frames(self, count: int, noun: str = "frames") -> None:
        """Add a note if there is more than one frame or page."""
        if count > 1:
            self.notes.append(f"first of {count} {noun}")


@contextmanager
def _refusing(name: str) -> Iterator[None]:
    """Turn every exception that a hostile file causes, except MemoryError, into InputError."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
        raise InputError(
            f"{name} must be a complete image of a supported kind; got one that is broken, "
            f"truncated or unsupported: {brief(reason)}. Try re-saving it as PNG"
        ) from error


def opened(file: bytes, name: str, max_pixels: int) -> StoredImage:
    """Read the header of an image file.

    Raise InputError if it is unsupported, broken, or larger than max_pixels.
    """
    kind = format_of(file[:PREFIX_BYTES])
    if isinstance(kind, str):
        raise InputError(
            f"{name} must be a supported image ({', '.join(FORMATS)}); got {kind}. Try "
            "converting it"
        )
    with _refusing(name):
        stored = resolve_name(kind.decoder)(file, kind.loader)
    check_size((stored.width, stored.height), name, max_pixels)
    return stored


def decoded(stored: StoredImage, name: str, needed: SizeNeeded | None = None) -> Photo:
    """Decode an opened image and reduce it to the size needed. Raise InputError if it is broken."""
    size = reduced_size(needed, stored.width, stored.height)
    with _refusing(name):
        pixels, warnings = samples(lambda: _picture(stored, size, name))
        if any(_TRUNCATED in warning for warning in warnings):
            raise ValueError(_TRUNCATED)
    if size is not None and pixels.dtype == np.float32:  # the filter may overshoot 0..1
        pixels = pixels.clip(0, 1)
    pixels = unit(pixels, name)
    notes = [*stored.notes]
    if stored.reports_warning:
        notes += (f"decoder warns: {brief(warning)}" for warning in warnings[-1:])
    color, color_notes = in_srgb(pixels[:, :, : stored.colors], stored.space)
    dpi, dpi_notes = stored.resolution()
    orientation = stored.orientation
    if orientation != 1:
        notes.insert(0, "EXIF orientation applied")
    color, alpha = upright(color, orientation), None
    color = np.ascontiguousarray(color if color.shape[2] == 3 else color.repeat(3, axis=2))
    if stored.alpha is not None and (pixels[:, :, -1] < 1).any():
        alpha = upright(pixels[:, :, -1], orientation)
        color = np.where(alpha[:, :, None] > 0, color, np.float32(0))
    return Photo(color, stored.upright_size, (*notes, *dpi_notes, *color_notes), dpi, alpha)


def _picture(stored: StoredImage, size: Size | None, name: str) -> Any:
    """Return a libvips picture of colour and alpha only, reduced to `size` if that is not None."""
    full = stored.width, stored.height
    scale = max(s for s in stored.scales if s == 1 or (size and _leaves_enough(full, size, s)))
    picture = stored.picture(scale)
    if (picture.width, picture.height) != tuple(-(-side // scale) for side in full):
        raise ValueError(f"its pixels are {picture.width}x{picture.height}")
    bands = [*range(stored.colors), *([] if stored.alpha is None else [stored.alpha])]
    if picture.bands > len(bands):
        picture = picture[bands[0]].bandjoin([picture[band] for band in bands[1:]])
    if size is None:
        return picture
    if picture.format == "float":  # `unit` refuses samples outside of 0..1
        picture = pyvips.Image.new_from_array(unit(samples(lambda: picture)[0], name))
    return resized(picture, size, stored.alpha is not None)


def resized(picture: Any, size: Size, has_alpha: bool) -> Any:
    """Return a libvips picture reduced to `size`. With alpha, its samples become floats in 0..1.

    Opaque pictures are reduced by the cubic filter of Catmull and Rom, and others by a triangle
    filter. A filter with negative weights would leave faint rings around edges of alpha
    (docs/decisions/photo.md).
    """
    across, down = (
        small / side for small, side in zip(size, (picture.width, picture.height), strict=True)
    )
    if has_alpha:
        picture = (picture / _OPAQUE[picture.format]).premultiply(max_alpha=1)
    picture = picture.resize(across, vscale=down, kernel="linear" if has_alpha else "cubic")
    return picture.unpremultiply(max_alpha=1) if has_alpha else picture


def _leaves_enough(stored: Size, needed: Size, scale: int) -> bool:
    """Return whether decoding at 1 / `scale` leaves at least OVERSIZE times the size needed."""
    return all(scale * OVERSIZE * small <= side for side, small in zip(stored, needed, strict=True))


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return an image (h, w, ...) turned upright by its orientation (EXIF 2.32, 4.6.4, tag 274)."""
    if orientation in SWAPPED:
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):  # the first row belongs at the bottom
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def check_size(size: Size, name: str, max_pixels: int) -> None:
    """Raise InputError if a size (width, height) has no pixels, or more than max_pixels."""
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


ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor
WHITE = (1.0, 1.0, 1.0)  # sRGB of the background that browsers show


def load_image(
    source: ImageSource,
    *,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: Sequence[float] | None = None,
    needed: SizeNeeded | None = None,
) -> Photo:
    """Decode a path, bytes, binary file, PIL image, NumPy array or torch tensor.

    max_pixels  largest number of pixels, 1..MOST_PIXELS, checked before decoding
    matte       sRGB colour in 0..1 over which a transparent photo is composited. None keeps alpha
    needed      longest side in px that is needed, or a function that returns the needed width and
                height from the stored ones. A larger photo is reduced to that size while it is
                decoded, before its profile and orientation are applied. None keeps all pixels

    A file has one of gauss2svg.photo.FORMATS. The first of several frames is read.
    Arrays are (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), and torch tensors (c, h, w) or (h, w), of
    uint8, uint16, bool, or floating point in 0..1. EXIF orientation is applied. ICC profiles and
    the gamma of a PNG are converted to sRGB. Colour under alpha 0, which is invisible, becomes 0.
    Raise InputError for anything else.
    """
    Field("max_pixels", int, 1, MOST_PIXELS).checked(max_pixels)
    stored, name = _stored(source, max_pixels)
    return _composited(decoded(stored, name, needed), matte)


def load_focus(source: ImageSource, strength: float | None, photo: Photo, max_pixels: int) -> Focus:
    """Return the mask of a photo, read like a photo, with its transparent parts black.

    Raise InputError if it cannot be read, is not of the photo's proportions, or has one colour.
    """
    try:
        needed = max(photo.width, photo.height)
        mask = load_image(source, max_pixels=max_pixels, matte=(0, 0, 0), needed=needed)
    except InputError as error:
        raise InputError(f"focus must be a picture, but {error}") from error
    (width, height), (across, down) = mask.original_size, photo.original_size
    if abs(width * down - height * across) > max(across, down):  # over 1 px of the shorter side
        needed = f"a mask of the photo's proportions, {across}x{down}"
        raise refusal("focus", needed, f"{width}x{height} px", "the photo's size")
    grey = mask.pixels.mean(axis=2, keepdims=True)
    if not grey.min() < _WHITE <= grey.max():
        needed = "a mask with white where detail matters, and black elsewhere"
        raise refusal("focus", needed, "one colour", "painting on black with white")
    return Focus(grey, strength or FOCUS_STRENGTH)


def header_of(source: ImageSource, *, max_pixels: int = DEFAULT_MAX_PIXELS) -> Header | None:
    """Return the header of a source of `load_image`, or None for an array or a tensor.

    Raise InputError as `load_image` does. Pass an open file through `rereadable` first.
    """
    return None if _is_array(source) else _stored(source, max_pixels)[0].header


def reduced(photo: Photo, size: Size) -> Photo:
    """Return a photo reduced by `shrunk` to `size`, (width, height) in px, which is not larger."""
    if size == (photo.width, photo.height):
        return photo
    pixels = shrunk(pixels_of(photo), size[1], size[0], sharp=True)
    alpha = np.ascontiguousarray(pixels[:, :, 3]) if has_alpha(pixels) else None
    color = np.ascontiguousarray(pixels[:, :, :3])
    return dataclasses.replace(photo, pixels=color, alpha=alpha)


def rereadable(source: ImageSource) -> ImageSource:
    """Return a source that can be read twice: all bytes of an open file, or the source itself."""
    return _file(source)[0] if hasattr(source, "read") else source


def _is_array(source: ImageSource) -> bool:
    torch = sys.modules.get("torch")  # a tensor can only exist once torch is loaded
    return isinstance(source, np.ndarray if torch is None else (np.ndarray, torch.Tensor))


def _stored(source: ImageSource, max_pixels: int) -> tuple[StoredImage, str]:
    """Return a source as StoredImage, and its name in errors. Raise InputError above max_pixels."""
    if isinstance(source, np.ndarray):
        return _of_array(source, "array", max_pixels), "array"
    if _is_array(source):
        samples = _tensor_samples(source)
        samples = np.moveaxis(samples, 0, -1) if samples.ndim == 3 else samples
        return _of_array(samples, "tensor", max_pixels), "tensor"
    if isinstance(source, Image.Image):
        check_size(source.size, "image", max_pixels)
        return resolve_name(OF_PILLOW)(source), "image"
    file, name = _file(source)
    return opened(file, name, max_pixels), name


def _file(source: ImageSource) -> tuple[bytes, str]:
    """Return the bytes of a file and its name in errors. Raise InputError for any other source."""
    if isinstance(source, (bytes, bytearray, memoryview)):
        return bytes(source), f"photo of {len(source)} bytes"
    if isinstance(source, (str, os.PathLike)):
        name = file_name("photo", source)
        with reading(name, "the path of a photo, or - for standard input") as file:
            is_photo = not isinstance(format_of(file.read(PREFIX_BYTES)), str)
            file.seek(0)
            return file.read(-1 if is_photo else PREFIX_BYTES), name
    if not hasattr(source, "read"):
        raise InputError(
            "photo must be a path, bytes, a binary file, a PIL image, a numpy array or a torch "
            f"tensor; got {type(source).__name__}"
        )
    if getattr(source, "closed", False):
        raise InputError(
            "file object must be open; got a closed one. Try the path of the photo, or a file "
            "that is open"
        )
    with suppress(AttributeError, OSError):  # a pipe cannot seek
        source.seek(0)
    data = source.read()
    if not isinstance(data, bytes):
        raise InputError(
            f"file object must be binary; got one that reads {type(data).__name__}. Try "
            "open(path, 'rb')"
        )
    return data, "file object"


def _tensor_samples(tensor: Any) -> NDArray[Any]:
    try:
        dense = tensor.detach().cpu().to_dense()
        # NumPy has no bfloat16.
        return (dense.float() if dense.is_floating_point() else dense).numpy()
    except (RuntimeError, TypeError) as error:  # a masked, quantized, nested or meta tensor
        needed, reason = "one that NumPy can hold", str(error).partition("\n")[0].rstrip(".")
        raise InputError(
            f"tensor must be {needed}; got {brief(reason)}. Try a dense tensor of floating point"
        ) from error


def _of_array(array: NDArray[Any], name: str, max_pixels: int) -> StoredImage:
    if np.ma.is_masked(array):
        raise InputError(f"{name} must be without masked samples; got some. Try .filled(0)")
    array = np.asarray(array)  # a subclass may redefine operators
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InputError(
            f"shape of {name} must be (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), of a tensor "
            f"with the channels first; got {array.shape}"
        )
    height, width, channels = array.shape
    check_size((width, height), name, max_pixels)
    samples = array if array.dtype in TYPES.values() else unit(array, name)
    picture = pyvips.Image.new_from_array(np.ascontiguousarray(samples))
    alpha = 3 if channels == 4 else None
    return StoredImage(width, height, min(channels, 3), alpha, lambda _scale: picture, None)


def _composited(photo: Photo, matte: Sequence[float] | None) -> Photo:
    """Return the photo over the colour `matte`, or unchanged if `matte` is None."""
    if matte is None:
        return photo
    color = np.asarray(matte, np.float32)
    if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
        raise InputError(
            f"matte must be three numbers in 0..1: red, green, blue; got {quoted(matte)}"
        )
    if photo.alpha is None:
        return photo
    name = "".join(f"{round(255 * float(level)):02x}" for level in color)
    notes = (*photo.notes, f"composited over #{name}")
    pixels = over(pixels_of(photo), tuple(color))
    return dataclasses.replace(photo, pixels=pixels, alpha=None, notes=notes)
