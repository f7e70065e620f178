"""HEIC photos, of phones, by libheif as pi-heif has it."""

from __future__ import annotations

import io
import re

import numpy as np
import pi_heif

from gauss2svg.photo.alpha import straight
from gauss2svg.photo.reduce import rows_at_once
from gauss2svg.photo.srgb import ColorSpace
from gauss2svg.photo.stored import Rows, Stored

# References of metadata, which have nothing that is used, and on which pi-heif 1.4 may crash.
_METADATA = re.compile(rb"(\0\0..)cdsc", re.DOTALL)
_REDUCED_BYTES = 10  # for each pixel and 8 bits, while a photo is decoded and reduced


def opened(file: bytes, _loader: str) -> Stored:
    """Read the header of the primary image, which libheif turns and crops."""
    file = _METADATA.sub(rb"\1free", file)
    heif = pi_heif.open_heif(io.BytesIO(file), convert_hdr_to_8bit=False, hdr_to_16bit=False)
    if not len(heif):
        raise ValueError("it has no picture of HEVC")
    kind, _, bits = heif.mode.partition(";")
    depth = int(bits or 8)

    def rows(_scale: int) -> Rows:
        samples = np.atleast_3d(np.asarray(heif))
        for top in range(0, len(samples), step := rows_at_once(*samples.shape[1:])):
            part = samples[top : top + step]
            if depth not in (8, 16) or heif.premultiplied_alpha:
                part = part / np.float32((1 << depth) - 1)
            yield straight(part[:, :, :-1], part[:, :, -1]) if heif.premultiplied_alpha else part

    colors = 3 if kind.upper().startswith("RGB") else 1
    alpha = colors if heif.has_alpha else None
    stored = Stored(*heif.size, colors, alpha, rows, _REDUCED_BYTES * -(-depth // 8))
    if profile := heif.info.get("icc_profile"):
        stored.space = ColorSpace(profile)
    elif nclx := heif.info.get("nclx_profile"):
        codes = nclx["color_primaries"], nclx["transfer_characteristics"]
        stored.set_codes("nclx", codes)
    if len(heif) > 1:
        stored.notes.append(f"primary image of {len(heif)}")
    return stored
