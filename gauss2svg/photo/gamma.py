"""The gAMA, cHRM and cICP chunks of a PNG, used where no ICC profile takes precedence."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

_SRGB_GAMMA = 1 / 2.2  # the gAMA of an sRGB image
_SAME_GAMMA = 0.01  # relative difference up to which a gamma counts as that
_LEAST_GAMMA, _MOST_GAMMA = 0.1, 10.0
# x and y of white, red, green and blue of sRGB (ITU-R BT.709).
_SRGB_PRIMARIES = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
_SAME_PRIMARY = 0.005
_LEAST_DETERMINANT = 1e-4  # primaries below it span no triangle
# Bradford cone responses, for the adaptation of white (ICC.1:2022, annex E).
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
_CICP_SRGB = (1, 13)  # primaries and transfer (ITU-T H.273)
_PNG_SIGNATURE_BYTES = 8


def cicp_of(file: BinaryIO) -> tuple[int, int] | None:
    """Primaries and transfer of a PNG's cICP chunk, which Pillow does not read; None without."""
    file.seek(_PNG_SIGNATURE_BYTES)
    while len(head := file.read(8)) == 8 and head[4:] not in (b"IDAT", b"IEND"):
        if head[4:] == b"cICP":
            data = file.read(4)
            return (data[0], data[1]) if len(data) == 4 else None
        file.seek(int.from_bytes(head[:4], "big") + 4, 1)  # with its checksum
    return None


def says_srgb(cicp: tuple[int, int] | None) -> bool:
    """Whether a cICP chunk declares sRGB, which takes precedence over the ICC profile."""
    return cicp == _CICP_SRGB


def converted(
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
    if chromaticity is not None and color.shape[2] == 3 and not _are_srgb(chromaticity):
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
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


def _srgb_value(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """SRGB values of linear light (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055).astype(
        np.float32
    )


def _are_srgb(chromaticity: tuple[float, ...]) -> bool:
    return bool(np.allclose(chromaticity, _SRGB_PRIMARIES, rtol=0, atol=_SAME_PRIMARY))


def _to_srgb_primaries(chromaticity: tuple[float, ...]) -> NDArray[np.floating] | None:
    """Matrix (3, 3) from linear light of these primaries to that of sRGB; None if degenerate."""
    theirs, srgb = _to_xyz(chromaticity), _to_xyz(_SRGB_PRIMARIES)
    if theirs is None or srgb is None:
        return None
    whites = _BRADFORD @ srgb.sum(axis=1), _BRADFORD @ theirs.sum(axis=1)
    if not (whites[1] > 0).all():
        return None
    adapted = np.linalg.inv(_BRADFORD) @ np.diag(whites[0] / whites[1]) @ _BRADFORD
    return np.linalg.inv(srgb) @ adapted @ theirs


def _to_xyz(chromaticity: tuple[float, ...]) -> NDArray[np.floating] | None:
    """Matrix (3, 3) from linear light to CIE XYZ, whose white has Y = 1 (SMPTE RP 177)."""
    x, y = np.array(chromaticity, float).reshape(4, 2).T
    if not (y > 0).all():
        return None
    white, *primaries = np.stack([x / y, np.ones(4), (1 - x - y) / y], axis=1)
    columns = np.stack(primaries, axis=1)
    if abs(np.linalg.det(np.stack([x[1:], y[1:], np.ones(3)]))) < _LEAST_DETERMINANT:
        return None
    return columns * np.linalg.solve(columns, white)
