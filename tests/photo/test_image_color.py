"""Colours of any kind arrive as sRGB: by ICC profile, by gamma and primaries, by ink, by Lab."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from pictures import chunk, encoded, png, srgb_curve, tiff
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
        tags[b"kTRC"] = curve
    else:
        for k, letter in enumerate("rgb"):
            tags[f"{letter}XYZ".encode()] = b"XYZ " + bytes(4) + fixed(*srgb[:, k])
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
    photo = load_image(
        encoded(Image.fromarray(level), name, icc_profile=matrix_profile(1.0), **options)
    )
    np.testing.assert_allclose(photo.pixels, srgb_curve(level / 255), atol=4 / 255)
    assert photo.notes == (CONVERTED,)


def test_profile_moves_primaries_and_leaves_alpha():
    profile = bytearray(matrix_profile(2.2))
    # Exchange the red and the blue primary in the table of tags: what a file in this
    # space calls red is shown blue.
    red, blue = profile.index(b"rXYZ"), profile.index(b"bXYZ")
    profile[red : red + 4], profile[blue : blue + 4] = b"bXYZ", b"rXYZ"
    alpha = RNG.integers(1, 256, (6, 9, 1), dtype=np.uint8)
    picture = Image.fromarray(np.concatenate([BYTES, alpha], axis=2))
    photo = load_image(encoded(picture, "PNG", icc_profile=bytes(profile)))
    expected = srgb_curve((BYTES[:, :, ::-1] / 255) ** 2.2)
    np.testing.assert_allclose(photo.pixels, expected, atol=4 / 255)
    np.testing.assert_allclose(photo.alpha, alpha[:, :, 0] / 255, atol=1e-7)
    assert photo.notes == (CONVERTED,)


def test_profile_that_is_srgb_changes_no_pixel():
    for array in (BYTES, BYTES[:, :, 0]):
        photo = load_image(encoded(Image.fromarray(array), "PNG", icc_profile=SRGB))
        np.testing.assert_allclose(photo.pixels, np.atleast_3d(array) / 255 * np.ones(3), atol=1e-7)
        assert photo.notes == ()
    wide = RNG.integers(0, 65536, (6, 9, 3), dtype=np.uint16)
    icc = chunk(b"iCCP", b"x\0\0" + zlib.compress(SRGB))
    np.testing.assert_allclose(load_image(png(wide, icc, bits=16)).pixels, wide / 65535, atol=1e-7)


def test_grey_has_profiles_of_grey_and_of_colours():
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    for space in (b"GRAY", b"RGB "):
        profile = matrix_profile(1.0, space)
        photo = load_image(encoded(Image.fromarray(levels), "PNG", icc_profile=profile))
        for k in range(3):
            np.testing.assert_allclose(
                photo.pixels[:, :, k], srgb_curve(levels / 255), atol=1 / 255
            )
        assert photo.notes == (CONVERTED,)


def test_sixteen_bits_with_a_profile_stay_sixteen():
    wide = RNG.integers(0, 65536, (6, 9, 3), dtype=np.uint16)
    icc = chunk(b"iCCP", b"x\0\0" + zlib.compress(matrix_profile(1.8)))
    photo = load_image(png(wide, icc, bits=16))
    np.testing.assert_allclose(photo.pixels, srgb_curve((wide / 65535) ** 1.8), atol=1.5 / 255)
    assert photo.notes == (CONVERTED,)


@pytest.mark.parametrize(
    "profile",
    [
        b"nonsense",
        SRGB[:200],
        matrix_profile(2.2, b"GRAY"),
        ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes(),
    ],
)
@pytest.mark.parametrize("name", ["PNG", "TIFF"])
def test_profile_that_does_not_fit_is_noted_and_left_out(name, profile):
    photo = load_image(encoded(Image.fromarray(BYTES), name, icc_profile=profile))
    np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-7)
    assert photo.notes == (UNUSABLE,)


P3 = b"\0\x0c\0\x0d"  # primaries and transfer of Display P3 (ITU-T H.273)
PQ = b"\0\x09\0\x10"  # of HDR


def coded(name: str, codes: bytes) -> bytes:
    """A file of (200, 60, 60) on the left whose colours are of these codes."""
    halves = np.kron(np.uint8([[[200, 60, 60], [60, 200, 60]]]), np.ones((16, 12, 1), np.uint8))
    if name == "PNG":
        return png(halves, chunk(b"cICP", bytes((codes[1], codes[3], 0, 1))))
    file = (DATA / "p3.heic").read_bytes()
    if name == "AVIF":
        file = encoded(Image.fromarray(halves), "AVIF", quality=95, subsampling="4:4:4")
    place = file.index(b"colrnclx") + 8
    return file[:place] + codes + file[place + 4 :]


@pytest.mark.parametrize("name", ["PNG", "AVIF", "HEIC"])
def test_codes_of_primaries_are_converted_and_hdr_is_noted(name):
    source = "cICP" if name == "PNG" else "nclx"
    photo = load_image(coded(name, P3))
    np.testing.assert_allclose(photo.pixels[8, 4] * 255, [217, 42, 52], atol=2)  # CSS Color 4
    assert photo.notes == (f"converted from {source} to sRGB",)
    photo = load_image(coded(name, PQ))
    np.testing.assert_allclose(photo.pixels[8, 4] * 255, [200, 60, 60], atol=2)
    assert photo.notes == (f"{source} with primaries 9 and transfer 16 not supported; ignored",)


GAMMAS = [1.0, 0.45455, 0.4545 * 1.009, 0.5556, 0.3]


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("gamma", GAMMAS)
def test_gamma_of_a_png_becomes_the_curve_of_srgb(gamma, channels, bits):
    samples = RNG.integers(0, 2**bits, (6, 9, channels))
    photo = load_image(
        png(samples, chunk(b"gAMA", struct.pack(">I", round(gamma * 1e5))), bits=bits)
    )
    values = samples / (2**bits - 1) * np.ones(3)
    near = abs(gamma * 2.2 - 1) < 0.01
    expected = values if near else srgb_curve(values ** (1 / (round(gamma * 1e5) / 1e5)))
    np.testing.assert_allclose(photo.pixels, expected, atol=1e-5)
    assert (photo.notes == ()) == near


def test_primaries_of_a_png_are_those_of_its_chrm():
    # Display P3's (SMPTE EG 432-1): its red is outside of sRGB, its white is the same.
    primaries = 0.3127, 0.329, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06
    chunks = (
        chunk(b"gAMA", struct.pack(">I", 100000)),
        chunk(b"cHRM", struct.pack(">8I", *(round(v * 1e5) for v in primaries))),
    )
    light = np.array([[[255, 255, 255], [128, 128, 128], [255, 0, 0], [100, 150, 120]]])
    photo = load_image(png(light, *chunks))
    # CSS Color 4, 10.1: from linear P3 to XYZ, and from XYZ to linear sRGB.
    to_xyz = [[0.48657095, 0.26566769, 0.19821729], [0.22897456, 0.69173852, 0.07928691],
              [0, 0.04511338, 1.04394437]]  # fmt: skip
    to_srgb = [[3.24096994, -1.53738318, -0.49861076], [-0.96924364, 1.8759675, 0.04155506],
               [0.05563008, -0.20397696, 1.05697151]]  # fmt: skip
    expected = np.clip(light / 255 @ (np.array(to_srgb) @ to_xyz).T, 0, 1)
    np.testing.assert_allclose(photo.pixels, srgb_curve(expected), atol=1e-3)
    assert photo.notes == ("converted from gAMA of 1 and cHRM to sRGB",)


NONE = [(0.3127, 0, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06), (0.3,) * 8, (0.9, 0.05) + (0.3, 0.3) * 3]
UNUSED = [(45455, (*(round(v * 1e5) for v in one),)) for one in NONE]
UNUSED += [(gamma, ()) for gamma in (0, 1, 2**31)]


@pytest.mark.parametrize(("gamma", "primaries"), UNUSED)
def test_gamma_and_primaries_that_are_none_are_noted(gamma, primaries):
    chunks = [chunk(b"gAMA", struct.pack(">I", gamma))]
    chunks += [chunk(b"cHRM", struct.pack(">8I", *primaries))] if primaries else []
    photo = load_image(png(BYTES, *chunks))
    np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-7)
    source = f"gAMA of {gamma / 1e5:g}" + (" and cHRM" if primaries else "")
    assert photo.notes == (f"{source} unusable; sRGB assumed",)


def test_profile_and_srgb_take_precedence_over_gamma_and_cicp_over_all():
    linear = chunk(b"gAMA", struct.pack(">I", 100000))
    icc = chunk(b"iCCP", b"x\0\0" + zlib.compress(matrix_profile(1.8)))
    broken = chunk(b"iCCP", b"x\0\0" + zlib.compress(b"nonsense"))
    plain = BYTES / 255
    by_profile, by_gamma = srgb_curve(plain**1.8), srgb_curve(plain)
    is_srgb, is_pq = chunk(b"cICP", b"\x01\x0d\0\x01"), chunk(b"cICP", b"\x09\x10\0\x01")
    for chunks, expected in (
        ((chunk(b"sRGB", b"\0"), linear), plain),
        ((linear, icc), by_profile),
        ((linear, broken), by_gamma),
        ((is_srgb, linear, icc), plain),
        ((is_pq, linear), by_gamma),
    ):
        photo = load_image(png(BYTES, *chunks))
        np.testing.assert_allclose(photo.pixels, expected, atol=3 / 255)
        assert ("cICP with primaries 9 and transfer 16 not supported; ignored" in photo.notes) == (
            is_pq in chunks
        )


INKS = np.uint8([[0, 0, 0, 0], [255, 0, 0, 0], [0, 255, 0, 0], [0, 0, 255, 0], [0, 0, 0, 255],
                 [128, 64, 0, 32]])  # fmt: skip


def inked(name: str, **options) -> bytes:
    blocks = np.kron(INKS[None], np.ones((16, 16, 1), np.uint8))
    options |= {"quality": 100} if name == "JPEG" else {}
    return encoded(Image.fromarray(blocks, "CMYK"), name, **options)


@pytest.mark.parametrize("profile", [b"", b"nonsense", matrix_profile(2.2)])
@pytest.mark.parametrize("name", ["JPEG", "TIFF"])
def test_ink_without_a_profile_of_ink_covers_paper(name, profile):
    photo = load_image(inked(name, icc_profile=profile))
    seen = photo.pixels[8, 8::16]
    expected = (1 - INKS[:, :3] / 255) * (1 - INKS[:, 3:] / 255)
    np.testing.assert_allclose(seen, expected, atol=4 / 255)
    assert "CMYK without a usable ICC profile; converted by the naive formula" in photo.notes
    assert len(photo.notes) == 1 + bool(profile)


@pytest.mark.parametrize("name", ["JPEG", "TIFF"])
def test_ink_is_what_its_profile_says(name):
    photo = load_image(inked(name, icc_profile=ink_profile()))
    np.testing.assert_allclose(photo.pixels[8, 8 : 5 * 16 : 16, 0], [1, 1, 0, 1, 1], atol=4 / 255)
    assert photo.notes == (CONVERTED,)


def test_ycck_of_adobe_is_ink_as_well():
    # The Adobe marker's last byte says what the four components are: 2 is YCCK, whose first
    # three are the YCbCr of the complements of C, M and Y. In grey ink Cb and Cr are 128.
    stored = np.uint8([[200, 128, 128, 255], [60, 128, 128, 255], [90, 128, 128, 55]])
    blocks = np.kron(255 - stored[None], np.ones((16, 16, 1), np.uint8))
    jpeg = bytearray(encoded(Image.fromarray(blocks, "CMYK"), "JPEG", quality=100))
    place = jpeg.index(b"Adobe") + 11
    assert jpeg[place] == 0
    jpeg[place] = 2
    seen = load_image(bytes(jpeg)).pixels[8, 8::16]
    # Adobe stores inks inverted: 255 - luma is what is stored of C, M and Y.
    expected = (255 - stored[:, :1]) / 255 * stored[:, 3:] / 255 * np.ones(3)
    np.testing.assert_allclose(seen, expected, atol=4 / 255)


def test_lab_is_converted():
    # L in 0..255, a and b signed (TIFF 6.0, section 23): white, black, and sRGB's red, green
    # and blue by D50 (CSS Color 4).
    lab = np.array([[100, 0, 0], [0, 0, 0], [54.29, 80.81, 69.89], [87.82, -79.27, 80.99],
                    [29.57, 68.3, -112.03]])  # fmt: skip
    stored = np.round(lab * [2.55, 1, 1]).astype(np.int16) % 256
    photo = load_image(tiff(stored.astype(np.uint8)[None], photometric="cielab"))
    expected = [[1, 1, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    np.testing.assert_allclose(photo.pixels[0], expected, atol=10 / 255)
    assert photo.notes == ("converted from CIELAB to sRGB",)
