"""HEIC photos, of phones, by libheif as pi-heif has it."""

from __future__ import annotations

import io

import numpy as np
import pi_heif

from gauss2svg.photo.reduce import rows_at_once
from gauss2svg.photo.srgb import SRGB, ColorSpace, by_codes
from gauss2svg.photo.stored import Rows, Stored, frames_note
from gauss2svg.photo.tags import exif_tags, tags_of

_REDUCED_BYTES = 10  # for each pixel and 8 bits, while a photo is decoded and reduced


def opened(file: bytes, _loader: str, _name: str) -> Stored:
    """Read the header of the primary image, which libheif turns, whatever its EXIF data say."""
    heif = pi_heif.open_heif(io.BytesIO(file), convert_hdr_to_8bit=False, hdr_to_16bit=False)
    kind, _, bits = heif.mode.partition(";")
    depth = int(bits or 8)
    space, notes = SRGB, frames_note(len(heif))
    if profile := heif.info.get("icc_profile"):
        space = ColorSpace(profile)
    elif nclx := heif.info.get("nclx_profile"):
        coded = by_codes(nclx["color_primaries"], nclx["transfer_characteristics"], "nclx")
        if isinstance(coded, str):
            notes.append(coded)
        else:
            space = coded

    def rows(_scale: int) -> Rows:
        samples = np.atleast_3d(np.asarray(heif))
        for top in range(0, len(samples), step := rows_at_once(*samples.shape[1:])):
            yield samples[top : top + step]

    colors = 3 if kind.upper().startswith("RGB") else 1
    return Stored(
        *heif.size,
        colors,
        colors if heif.has_alpha else None,
        rows,
        _REDUCED_BYTES * -(-depth // 8),
        top=None if depth in (8, 16) else (1 << depth) - 1,
        is_premultiplied=heif.premultiplied_alpha,
        space=space,
        tags=tags_of(*exif_tags(heif.info.get("exif"), is_turned=True)),
        notes=notes,
    )
