"""Any picture in, one clean array out: sRGB, float32 in 0..1, (height, width, 3)."""

from __future__ import annotations

import dataclasses
import io
import math
import numbers
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageCms, ImageOps, UnidentifiedImageError

from gauss2svg.errors import InputError

ImageSource = Any  # a path, bytes, a binary file, a PIL image, a numpy array or a torch tensor

# Decoders that are tried; anything else is refused unread.
FORMATS = ("JPEG", "PNG", "WEBP", "TIFF", "GIF", "BMP", "AVIF", "PPM")
_LEAST_DPI = 1.0  # what says this or less says nothing
_PROFILE_MODES = {"GRAY": "L", "RGB": "RGB", "CMYK": "CMYK"}  # Pillow's name of a colour space


@dataclass(frozen=True, eq=False)
class Photo:
    """A decoded picture.

    pixels  (height, width, 3) float32 sRGB in 0..1, alpha not multiplied in
    notes   what was changed on the way in, for the report
    dpi     px an inch across and down, by the file's resolution tag; None where it has none
    alpha   (height, width) float32 in 0..1; None where every pixel is opaque
    """

    pixels: NDArray[np.float32]
    notes: tuple[str, ...] = ()
    dpi: tuple[float, float] | None = None
    alpha: NDArray[np.float32] | None = None

    @property
    def width(self) -> int:
        """Width in px."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Height in px."""
        return self.pixels.shape[0]


def load_image(source: ImageSource, *, matte: tuple[float, float, float] | None = None) -> Photo:
    """Decode a path, bytes, binary file, PIL image, numpy array or torch tensor.

    Arrays are (h, w), (h, w, 1), (h, w, 3) or (h, w, 4), torch tensors (c, h, w) or
    (h, w): uint8, uint16, bool, or floating point in 0..1. EXIF orientation is applied,
    embedded colour profiles are converted to sRGB. matte is an sRGB colour in 0..1 over which
    transparency is shown; None: it is kept.
    Raises InputError for anything that cannot be read as a picture.
    """
    photo = _loaded(source)
    return photo if matte is None else _flattened(photo, matte)


def _loaded(source: ImageSource) -> Photo:
    torch = sys.modules.get("torch")  # a tensor can only exist once torch is loaded
    if torch is not None and isinstance(source, torch.Tensor):
        dense = source.detach().cpu().to_dense()
        array = (dense.float() if dense.dtype == torch.bfloat16 else dense).numpy()
        return _from_array(np.moveaxis(array, 0, -1) if array.ndim == 3 else array, "tensor")
    if isinstance(source, np.ndarray):
        return _from_array(source, "array")
    if isinstance(source, Image.Image):
        return _from_lazy_pillow(source, "image")
    if isinstance(source, (bytes, bytearray, memoryview)):
        return _decode(io.BytesIO(source), f"{len(source)} bytes")
    if isinstance(source, (str, os.PathLike)):
        path = Path(source)
        try:
            with path.open("rb") as file:
                return _decode(file, str(path))
        except InputError:
            raise
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(f"cannot read {path}: {reason}; give the path of a photo") from error
    if hasattr(source, "read"):
        return _decode(source, "file object")
    raise InputError(
        f"got {type(source).__name__}; needed is a path, bytes, a binary file, a PIL image, "
        "a numpy array or a torch tensor"
    )


def _decodable() -> tuple[str, ...]:
    """FORMATS less those that this build of Pillow lacks, as some lack AVIF."""
    Image.init()
    return tuple(name for name in FORMATS if name in Image.OPEN)


def _decode(file: BinaryIO, name: str) -> Photo:
    with opened(file, name) as picture:
        return _from_lazy_pillow(picture, name)


@contextmanager
def opened(file: BinaryIO, name: str) -> Iterator[Image.Image]:
    """A picture file of one of FORMATS, closed afterwards; raises InputError that names it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(file, formats=_decodable()) as picture:
                yield picture
    except UnidentifiedImageError as error:
        known = ", ".join(_decodable())
        raise InputError(
            f"{name} is no picture that can be read; needed is one of {known}"
        ) from error
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise InputError(f"{name} is too large to decode: {error}; shrink it first") from error
    except InputError:
        raise
    except (OSError, SyntaxError, ValueError, EOFError, RuntimeError) as error:
        raise _broken(name, error) from error


def _broken(name: str, error: Exception) -> InputError:
    return InputError(f"{name} is broken: {error}; save it anew and try again")


def _from_lazy_pillow(picture: Image.Image, name: str) -> Photo:
    try:
        picture.load()
    except (OSError, SyntaxError, ValueError, EOFError, RuntimeError) as error:
        raise _broken(name, error) from error
    return dataclasses.replace(_from_pillow(picture, name), dpi=_resolution(picture))


def _resolution(picture: Image.Image) -> tuple[float, float] | None:
    """Pixels an inch across and down after EXIF orientation; None where no tag says so."""
    # Pillow makes up 72 for a JPEG and 1 for a TIFF without one, so their tags are asked.
    stated = picture.info.get("jfif_unit") in (1, 2) or picture.format in ("PNG", "BMP", None)
    dpi = picture.info.get("dpi") if stated else None
    exif = picture.getexif()
    if dpi is None and ExifTags.Base.XResolution in exif and ExifTags.Base.YResolution in exif:
        inch = {2: 1.0, 3: 2.54}.get(exif.get(ExifTags.Base.ResolutionUnit, 2), 0.0)
        tags = exif[ExifTags.Base.XResolution], exif[ExifTags.Base.YResolution]
        dpi = [inch * float(tag) for tag in tags] if all(map(_is_number, tags)) else None
    if dpi is None or not all(_LEAST_DPI < v < math.inf for v in dpi):
        return None
    turned = exif.get(ExifTags.Base.Orientation, 1) in (5, 6, 7, 8)
    across, down = (float(v) for v in (reversed(dpi) if turned else dpi))
    return across, down


def _is_number(tag: Any) -> bool:
    return isinstance(tag, numbers.Real)


def _from_pillow(picture: Image.Image, name: str) -> Photo:
    notes = []
    oriented = picture
    if picture.getexif().get(ExifTags.Base.Orientation, 1) != 1:
        oriented = ImageOps.exif_transpose(picture)
        notes.append("turned as its EXIF orientation says")
    if oriented.mode in ("I;16", "I;16L", "I;16B", "I", "F"):
        return _from_array(_wide_grey(oriented, name), name, tuple(notes))
    has_alpha = oriented.has_transparency_data
    profile = picture.info.get("icc_profile")
    if oriented.mode in ("P", "PA", "LA", "La", "RGBa"):
        oriented = oriented.convert("RGBA" if has_alpha else "RGB")
    if profile:
        converted = _to_srgb(oriented, profile, has_alpha)
        if converted is not None:
            oriented = converted
            notes.append("converted from its embedded colour profile to sRGB")
        else:
            notes.append("embedded colour profile unreadable, taken as sRGB")
    array = np.asarray(oriented.convert("RGBA" if has_alpha else "RGB"))
    return _from_array(array, name, tuple(notes))


def _wide_grey(picture: Image.Image, name: str) -> NDArray[Any]:
    array = np.asarray(picture)
    if picture.mode == "F":
        return array
    if array.min() < 0 or array.max() > np.iinfo(np.uint16).max:
        raise InputError(
            f"{name} has grey levels {array.min()}..{array.max()}; needed are 0..65535: "
            "rescale it and try again"
        )
    return array.astype(np.uint16)


def _to_srgb(picture: Image.Image, profile: bytes, has_alpha: bool) -> Image.Image | None:
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space: str = opened.profile.xcolor_space  # pyright: ignore[reportAttributeAccessIssue]
        mode = _PROFILE_MODES.get(space.strip(), "RGB")
        return ImageCms.profileToProfile(
            picture.convert("RGBA" if mode == "RGB" and has_alpha else mode),
            opened,
            ImageCms.createProfile("sRGB"),
            outputMode="RGBA" if has_alpha else "RGB",
        )
    except (ImageCms.PyCMSError, OSError, ValueError):
        return None  # noted by the caller


def _from_array(array: NDArray[Any], name: str, notes: tuple[str, ...] = ()) -> Photo:
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        raise InputError(
            f"{name} has shape {array.shape}; needed is (h, w), (h, w, 1), (h, w, 3) or "
            "(h, w, 4), for a torch tensor the channels first"
        )
    if 0 in array.shape:
        raise InputError(f"{name} has shape {array.shape}; needed is at least one pixel")
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype == np.bool_:
        pixels = array.astype(np.float32)
    elif array.dtype in (np.uint8, np.uint16):
        pixels = array.astype(np.float32) / np.iinfo(array.dtype).max
    elif np.issubdtype(array.dtype, np.floating):
        bad = ~((array >= 0) & (array <= 1))
        if bad.any():
            y, x, c = (int(v) for v in np.argwhere(bad)[0])
            raise InputError(
                f"{name} is {array[y, x, c]} at row {y}, column {x}, channel {c}; needed are "
                "finite values in 0..1: divide by the largest value, or clip"
            )
        pixels = array.astype(np.float32)
    else:
        raise InputError(f"{name} has type {array.dtype}; needed is uint8, uint16, bool or float")
    return _photo(np.asarray(pixels, np.float32), notes)


def _photo(pixels: NDArray[np.float32], notes: tuple[str, ...]) -> Photo:
    alpha = None
    if pixels.shape[2] == 4:
        alpha = np.ascontiguousarray(pixels[:, :, 3]) if (pixels[:, :, 3] < 1).any() else None
        pixels = pixels[:, :, :3]
    elif pixels.shape[2] == 1:
        pixels = np.repeat(pixels, 3, axis=2)
    return Photo(np.ascontiguousarray(pixels), notes, alpha=alpha)


def _flattened(photo: Photo, matte: tuple[float, float, float]) -> Photo:
    """The photo as a page of that colour shows it."""
    if photo.alpha is None:
        return photo
    alpha = photo.alpha[:, :, None]
    page = np.array(matte, np.float32)
    pixels = np.asarray(photo.pixels * alpha + (1 - alpha) * page, np.float32)
    shown = "#" + "".join(f"{round(255 * v):02x}" for v in matte)
    notes = (*photo.notes, f"transparency shown over {shown}")
    return dataclasses.replace(photo, pixels=pixels, alpha=None, notes=notes)


def over_white(color: NDArray[np.float32], alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """Transparent pixels (h, w, 3) as a page shows them; alpha (h, w, 1) in 0..1."""
    return np.asarray(color * alpha + (1 - alpha), np.float32)


def shrink_photo(photo: Photo, height: int, width: int) -> Photo:
    """Area average of a photo on a smaller grid; colours count by their alpha."""
    if photo.alpha is None:
        return dataclasses.replace(photo, pixels=shrink(photo.pixels, height, width))
    if (height, width) == photo.alpha.shape:
        return photo
    alpha = photo.alpha[:, :, None]
    small = shrink(np.concatenate([photo.pixels * alpha, alpha], axis=2), height, width)
    color, alpha = small[:, :, :3], small[:, :, 3:]
    color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return dataclasses.replace(photo, pixels=np.minimum(color, 1), alpha=alpha[:, :, 0].copy())


def shrink(pixels: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Area average of (h, w, channels) float32 pixels on a smaller grid; the mean is kept."""
    if (height, width) == pixels.shape[:2]:
        return pixels
    planes = [
        Image.fromarray(np.ascontiguousarray(pixels[:, :, c])).resize(
            (width, height), Image.Resampling.BOX
        )
        for c in range(pixels.shape[2])
    ]
    return np.clip(np.stack([np.asarray(p) for p in planes], axis=2), 0, 1, dtype=np.float32)
