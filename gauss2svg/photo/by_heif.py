"""Open HEIC files, in which many phones save photos, by libheif in the package pi-heif."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
import pi_heif
import pyvips

from gauss2svg.photo.load import StoredImage
from gauss2svg.photo.srgb import ColorSpace

# References to metadata match this pattern. `opened` removes the references, because pi-heif 1.4
# may crash when it reads metadata.
_METADATA = re.compile(rb"(\0\0..)cdsc", re.DOTALL)
# Number of bytes of memory per pixel that decoding and reducing a photo takes.
# This is the number for samples of one byte. For samples of two bytes it is twice as large.
_REDUCED_BYTES = 10
pi_heif.options.DECODE_THREADS = 1  # more threads could exceed the limit of --threads


def opened(file: bytes, _loader: str) -> StoredImage:
    """Read the header of the file's primary image.

    libheif itself rotates and crops the image as the file says, so the image is upright.
    """
    file = _METADATA.sub(rb"\1free", file)
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
    stored = StoredImage(*heif.size, colors, alpha, picture, _REDUCED_BYTES * -(-depth // 8))
    if profile := heif.info.get("icc_profile"):
        stored.space = ColorSpace(profile)
    elif nclx := heif.info.get("nclx_profile"):
        codes = nclx["color_primaries"], nclx["transfer_characteristics"]
        stored.set_codes("nclx", codes)
    if len(heif) > 1:
        stored.notes.append(f"primary image of {len(heif)}")
    return stored
