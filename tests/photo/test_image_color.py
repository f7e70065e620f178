"""Colours of any kind arrive as sRGB: by ICC profile, by gamma and primaries, by ink, by Lab."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from pictures import assert_read, chunk, encoded, png, srgb_curve, tiff
from PIL import Image, ImageCms

from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
DATA = Path(__file__).parents[1] / "data"
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
CONVERTED = "converted from its embedded ICC profile to sRGB"
UNUSABLE = "embedded ICC profile unreadable or for another colour space; sRGB assumed"


def fixed(*values: float) -> bytes:
    """Numbers of an ICC profile, s15Fixed16."""
    return struct.pack(f">{len(values)}i", *(round(v * 65536) for v in values))


def icc_profile(kind: bytes, space: bytes, pcs: bytes, tags: dict[bytes, bytes]) -> bytes:
    """An ICC profile (ICC.1:2001-04, version 2.4), made by hand."""
    table, body, start = b"", b"", 132 + 12 * len(tags)
    for name, data in tags.items():
        table += name + struct.pack(">II", start + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(">I4sI", 0, b"none", 0x02400000) + kind + space + pcs + bytes(12)
    head += b"acsp" + bytes(28) + fixed(0.9642, 1.0, 0.8249) + bytes(48)
    whole = head + struct.pack(">I", len(tags)) + table + body
    return struct.pack(">I", len(whole)) + whole[4:]


def matrix_profile(gamma: float, space: bytes = b"RGB ") -> bytes:
    """The primaries of sRGB with a pure power, or grey of that."""
    srgb = np.array([[0.4361, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7141]])
    curve = b"curv" + bytes(4) + struct.pack(">IHH", 1, round(gamma * 256), 0)
    tags = {b"wtpt": b"XYZ " + bytes(4) + fixed(0.9642, 1.0, 0.8249)}
    if space == b"GRAY":
        return icc_profile(b"mntr", space, b"XYZ ", tags | {b"kTRC": curve})
    for column, letter in zip(srgb.T, "rgb", strict=True):
        tags[f"{letter}XYZ".encode()] = b"XYZ " + bytes(4) + fixed(*column)
        tags[f"{letter}TRC".encode()] = curve
    return icc_profile(b"mntr", space, b"XYZ ", tags)


def ink_profile() -> bytes:
    """Inks of a press that prints black where there is magenta, and paper everywhere else."""
    straight = bytes(range(256))
    corners = [(c, m, y, k) for c in (0, 1) for m in (0, 1) for y in (0, 1) for k in (0, 1)]
    lab = b"".join(bytes((0 if m else 255, 128, 128)) for _, m, _, _ in corners)
    lut = b"mft1" + bytes(4) + bytes((4, 3, 2, 0)) + fixed(1, 0, 0, 0, 1, 0, 0, 0, 1)
    tags = {b"A2B0": lut + 4 * straight + lab + 3 * straight}
    return icc_profile(b"prtr", b"CMYK", b"Lab ", tags)


@pytest.mark.parametrize("name", ["PNG", "JPEG", "WEBP", "TIFF", "AVIF"])
def test_profile_of_each_format_is_converted_as_its_curve_says(name):
    level = np.full((16, 16, 3), [60, 120, 200], np.uint8)
    options = {"lossless": True} if name == "WEBP" else {}
    file = encoded(Image.fromarray(level), name, icc_profile=matrix_profile(1.0), **options)
    assert_read(file, srgb_curve(level / 255), (CONVERTED,), 4 / 255)


def test_profile_moves_primaries_and_leaves_alpha():
    profile = bytearray(matrix_profile(2.2))
    # Exchange the red and the blue primary in the table of tags: what a file in this
    # space calls red is shown blue.
    red, blue = profile.index(b"rXYZ"), profile.index(b"bXYZ")
    profile[red : red + 4], profile[blue : blue + 4] = b"bXYZ", b"rXYZ"
    alpha = RNG.integers(1, 256, (6, 9, 1), dtype=np.uint8)
    file = png(np.concatenate([BYTES, alpha], axis=2), iccp(bytes(profile)))
    expected = srgb_curve(VALUES[:, :, ::-1] ** 2.2)
    assert_read(file, expected, (CONVERTED,), 4 / 255, alpha[:, :, 0] / 255)


def iccp(profile: bytes) -> bytes:
    return chunk(b"iCCP", b"x\0\0" + zlib.compress(profile))


def gama(gamma: int, *primaries: float) -> bytes:
    """Chunks of a gamma times 100 000 and of primaries."""
    stored = (round(v * 1e5) for v in primaries)
    chrm = chunk(b"cHRM", struct.pack(">8I", *stored)) if primaries else b""
    return chunk(b"gAMA", struct.pack(">I", gamma)) + chrm


VALUES, GREY = BYTES / 255, BYTES[:, :, :1]
WIDE = RNG.integers(0, 65536, (6, 9, 3), dtype=np.uint16)
LINEAR, BY_GAMMA, BY_PROFILE = gama(100000), srgb_curve(VALUES), srgb_curve(VALUES**1.8)
IS_SRGB, IS_PQ = chunk(b"cICP", b"\x01\x0d\0\x01"), chunk(b"cICP", b"\x09\x10\0\x01")
HDR = "cICP with primaries 9 and transfer 16 not supported; ignored"
AS_GAMMA = "converted from gAMA of 1 to sRGB"
# Chunks of a PNG, its samples, and how they are to be read.
CHUNKS = [
    *((iccp(SRGB), one, one / (65535 if one is WIDE else 255), ()) for one in (BYTES, GREY, WIDE)),
    (iccp(matrix_profile(1.8, b"GRAY")), GREY, srgb_curve((GREY / 255) ** 1.8), (CONVERTED,)),
    (iccp(matrix_profile(1.8)), GREY, srgb_curve((GREY / 255) ** 1.8), (CONVERTED,)),
    (iccp(matrix_profile(1.8)), WIDE, srgb_curve((WIDE / 65535) ** 1.8), (CONVERTED,)),
    *((iccp(one), BYTES, VALUES, (UNUSABLE,))
      for one in (b"nonsense", SRGB[:200], matrix_profile(2.2, b"GRAY"))),
    *((gama(gamma), one, one / (65535 if one is WIDE else 255), ())
      for gamma in (45455, 45859) for one in (BYTES, GREY, WIDE)),
    *((gama(gamma), one, srgb_curve((one / (65535 if one is WIDE else 255)) ** (1e5 / gamma)),
       (f"converted from gAMA of {gamma / 1e5:g} to sRGB",))
      for gamma in (100000, 55560, 30000) for one in (BYTES, GREY, WIDE)),
    *((gama(gamma), BYTES, VALUES, (f"gAMA of {gamma / 1e5:g} unusable; sRGB assumed",))
      for gamma in (0, 1, 2**31)),
    *((gama(45455, *one), BYTES, VALUES, ("gAMA of 0.45455 and cHRM unusable; sRGB assumed",))
      for one in ((0.3127, 0, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06), (0.3,) * 8,
                  (0.9, 0.05) + (0.3, 0.3) * 3)),
    # A profile and sRGB take precedence over a gamma, and cICP over all.
    (chunk(b"sRGB", b"\0") + LINEAR, BYTES, VALUES, ()),
    (LINEAR + iccp(matrix_profile(1.8)), BYTES, BY_PROFILE, (CONVERTED,)),
    (LINEAR + iccp(b"nonsense"), BYTES, BY_GAMMA, (UNUSABLE, AS_GAMMA)),
    (IS_SRGB + LINEAR + iccp(matrix_profile(1.8)), BYTES, VALUES, ()),
    (IS_PQ + LINEAR, BYTES, BY_GAMMA, (HDR, AS_GAMMA)),
]  # fmt: skip


@pytest.mark.parametrize(("chunks", "samples", "expected", "notes"), CHUNKS)
def test_chunks_of_a_png_say_its_colours(chunks, samples, expected, notes):
    file = png(samples, chunks, bits=16 if samples is WIDE else 8)
    assert_read(file, expected, notes, 1.5 / 255 if CONVERTED in notes else 1e-5)


def test_primaries_of_a_png_are_those_of_its_chrm():
    # Display P3's (SMPTE EG 432-1): its red is outside of sRGB, its white is the same.
    light = np.array([[[255, 255, 255], [128, 128, 128], [255, 0, 0], [100, 150, 120]]])
    file = png(light, gama(100000, 0.3127, 0.329, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06))
    # CSS Color 4, 10.1: from linear P3 to XYZ, and from XYZ to linear sRGB.
    to_xyz = [[0.48657095, 0.26566769, 0.19821729], [0.22897456, 0.69173852, 0.07928691],
              [0, 0.04511338, 1.04394437]]  # fmt: skip
    to_srgb = [[3.24096994, -1.53738318, -0.49861076], [-0.96924364, 1.8759675, 0.04155506],
               [0.05563008, -0.20397696, 1.05697151]]  # fmt: skip
    expected = srgb_curve(np.clip(light / 255 @ (np.array(to_srgb) @ to_xyz).T, 0, 1))
    assert_read(file, expected, ("converted from gAMA of 1 and cHRM to sRGB",), 1e-3)


@pytest.mark.parametrize("name", ["PNG", "AVIF", "HEIC"])
def test_codes_of_primaries_are_converted_and_hdr_is_noted(name):
    halves = np.kron(np.uint8([[[200, 60, 60], [60, 200, 60]]]), np.ones((16, 12, 1), np.uint8))
    source, file = ("cICP" if name == "PNG" else "nclx"), (DATA / "p3.heic").read_bytes()
    if name == "AVIF":
        file = encoded(Image.fromarray(halves), "AVIF", quality=95, subsampling="4:4:4")
    for codes, seen, note in (  # Display P3 (ITU-T H.273) as in CSS Color 4, and HDR
        (b"\0\x0c\0\x0d", [217, 42, 52], f"converted from {source} to sRGB"),
        (b"\0\x09\0\x10", [200, 60, 60],
         f"{source} with primaries 9 and transfer 16 not supported; ignored"),
    ):  # fmt: skip
        place = file.index(b"colrnclx") + 8
        coded = file[:place] + codes + file[place + 4 :]
        if name == "PNG":
            coded = png(halves, chunk(b"cICP", bytes((codes[1], codes[3], 0, 1))))
        photo = load_image(coded)
        np.testing.assert_allclose(photo.pixels[8, 4] * 255, seen, atol=2)
        assert photo.notes == (note,)


INKS = np.uint8([[0, 0, 0, 0], [255, 0, 0, 0], [0, 255, 0, 0], [0, 0, 255, 0], [0, 0, 0, 255],
                 [128, 64, 0, 32]])  # fmt: skip


@pytest.mark.parametrize("profile", [b"", b"nonsense", matrix_profile(2.2), ink_profile()])
@pytest.mark.parametrize("name", ["JPEG", "TIFF"])
def test_ink_is_what_its_profile_says_or_covers_paper(name, profile):
    picture = Image.fromarray(np.kron(INKS[None], np.ones((16, 16, 1), np.uint8)), "CMYK")
    options = {"quality": 100} if name == "JPEG" else {}
    photo = load_image(encoded(picture, name, icc_profile=profile, **options))
    seen = photo.pixels[8, 8::16]
    if profile == ink_profile():
        np.testing.assert_allclose(seen[:5, 0], [1, 1, 0, 1, 1], atol=4 / 255)
        assert photo.notes == (CONVERTED,)
        return
    expected = (1 - INKS[:, :3] / 255) * (1 - INKS[:, 3:] / 255)
    np.testing.assert_allclose(seen, expected, atol=4 / 255)
    assert "CMYK without a usable ICC profile" in "; ".join(photo.notes)
    assert len(photo.notes) == 1 + bool(profile)


def test_lab_is_converted():
    # L in 0..255, a and b signed (TIFF 6.0, section 23): white, black, and sRGB's red, green
    # and blue by D50 (CSS Color 4).
    lab = np.array([[100, 0, 0], [0, 0, 0], [54.29, 80.81, 69.89], [87.82, -79.27, 80.99],
                    [29.57, 68.3, -112.03]])  # fmt: skip
    stored = np.round(lab * [2.55, 1, 1]).astype(np.int16) % 256
    file = tiff(stored.astype(np.uint8)[None], photometric="cielab")
    expected = [[1, 1, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert_read(file, [expected], ("converted from CIELAB to sRGB",), 10 / 255)
