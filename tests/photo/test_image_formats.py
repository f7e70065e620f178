"""What each format can hold arrives as it was stored."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from pictures import assert_read, chunk, encoded, png, srgb_curve
from PIL import Image

from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
CONVERTED = "converted from its embedded ICC profile to sRGB"
DATA = Path(__file__).parents[1] / "data"
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)
WIDE = RNG.integers(0, 65536, (11, 13, 4), dtype=np.uint16)
SMOOTH = np.uint8(np.mgrid[:24, :40].sum(0)[:, :, None] * [3, 2, 1] + [20, 60, 100])


@pytest.mark.parametrize("name", ["PNG", "BMP", "TIFF", "GIF", "WEBP", "JPEG2000", "JPEG", "AVIF"])
def test_every_format_gives_what_was_stored(name):
    is_lossy = name in ("JPEG", "AVIF")
    options = {"lossless": True} if name == "WEBP" else {"quality": 95} if is_lossy else {}
    stored = SMOOTH if is_lossy else BYTES // 64 * 64  # colours that a GIF's palette holds
    file = encoded(Image.fromarray(stored), name, **options)
    assert_read(file, stored / 255, atol=10 / 255 if is_lossy else 1e-7)
    for side in ((1, 1), (1, 5000), (5000, 1), (2, 2), (3, 3)) if name != "AVIF" else ():
        thin = assert_read(encoded(Image.new("RGB", side, (255, 255, 255)), name), 1)
        assert (thin.width, thin.height) == side


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize(
    ("bits", "channels"),
    [(1, 1), (2, 1), (4, 1), *((bits, n) for bits in (8, 16) for n in (1, 2, 3, 4))],
)
def test_png_keeps_every_bit_and_one_colour_may_be_clear(bits, channels, interlaced):
    samples = WIDE[:, :, :channels] >> (16 - bits)
    color, alpha = samples[:, :, : 3 if channels > 2 else 1] / (2**bits - 1), None
    if channels in (2, 4):
        alpha = samples[:, :, -1] / (2**bits - 1)
    shown = color * (1 if alpha is None else (alpha > 0)[:, :, None])
    assert_read(png(samples, bits=bits, interlaced=interlaced), shown, alpha=alpha)
    if alpha is None:
        clear = chunk(b"tRNS", samples[2, 3].astype(">u2").tobytes())
        shows = (samples != samples[2, 3]).any(axis=2)
        file = png(samples, clear, bits=bits, interlaced=interlaced)
        assert_read(file, color * shows[:, :, None], alpha=shows)


def test_frames_of_a_gif_are_where_they_lie_on_its_screen():
    picture = Image.fromarray(np.uint8([[[220, 30, 30], [30, 30, 220]]] * 3)).quantize(4)
    file = bytearray(encoded(picture, "GIF"))
    place = file.index(b",", 13 + (6 << (file[10] & 7)))
    file[6:10] = struct.pack("<HH", 6, 5)  # the screen
    file[place + 1 : place + 5] = struct.pack("<HH", 2, 1)  # where the frame begins
    photo, shows = load_image(bytes(file)), np.zeros((5, 6))
    shows[1:4, 2:4] = 1
    np.testing.assert_array_equal(photo.alpha, shows)
    np.testing.assert_allclose(photo.pixels[2, 2:4] * 255, [[220, 30, 30], [30, 30, 220]], atol=1)
    first, later = Image.new("RGB", (6, 5), (220, 30, 30)), Image.new("RGB", (6, 5), (220, 30, 30))
    later.paste((30, 30, 220), (2, 1, 4, 4))
    file = encoded(first, "GIF", save_all=True, append_images=[later], disposal=1)
    with Image.open(io.BytesIO(file)) as image:
        image.seek(1)
        photo = load_image(image)
    assert photo.alpha is None
    np.testing.assert_allclose(photo.pixels * 255, np.asarray(later), atol=1)


QUARTERS = np.uint8([[[220, 30, 30], [30, 160, 30]], [[30, 30, 220], [240, 220, 40]]])


@pytest.mark.parametrize("name", ["turned", "alpha", "ten_bits", "second", "profile", "cropped"])
def test_heic_of_a_phone_and_a_cropped_avif_are_read(name):
    (path,) = DATA.glob(f"{name}.[ah][ve]i[cf]")
    photo = load_image(path)
    y, x = np.mgrid[:16, :24]
    blocks = np.kron(QUARTERS, np.ones((8, 12, 1))) / 255
    if name == "ten_bits":
        np.testing.assert_allclose(photo.pixels[:, :, 0], x / 23, atol=3 / 1023)
        np.testing.assert_allclose(photo.pixels[:, :, 2], y / 15, atol=3 / 1023)
    elif name == "turned":  # by irot, and by EXIF data that say the same
        np.testing.assert_allclose(photo.pixels, np.rot90(blocks, -1), atol=2 / 255)
    elif name == "profile":  # of linear light
        np.testing.assert_allclose(photo.pixels, srgb_curve(blocks), atol=4 / 255)
    else:
        shows = (x > 0 if name == "alpha" else x >= 0)[:, :, None]
        np.testing.assert_allclose(photo.pixels, blocks * shows, atol=2 / 255)
    notes = {"second": "primary image of 2", "profile": CONVERTED}
    assert photo.notes == ((notes[name],) if name in notes else ())
    alpha = np.ones((16, 24)) if photo.alpha is None else photo.alpha
    np.testing.assert_allclose(alpha, x / 25.5 if name == "alpha" else 1, atol=1 / 255)


# Where the corners of the stored rows are seen (EXIF 2.32, 4.6.4, tag 274).
STORED = np.uint8([[10, 20, 30], [40, 50, 60]])
SEEN = {
    1: [[10, 20, 30], [40, 50, 60]], 2: [[30, 20, 10], [60, 50, 40]],
    3: [[60, 50, 40], [30, 20, 10]], 4: [[40, 50, 60], [10, 20, 30]],
    5: [[10, 40], [20, 50], [30, 60]], 6: [[40, 10], [50, 20], [60, 30]],
    7: [[60, 30], [50, 20], [40, 10]], 8: [[30, 60], [20, 50], [10, 40]],
}  # fmt: skip


@pytest.mark.parametrize("orientation", SEEN)
@pytest.mark.parametrize("name", ["JPEG", "PNG", "WEBP", "TIFF", "AVIF"])
def test_orientation_is_applied_to_whole_and_to_reduced_photos(name, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    blocks = np.kron(STORED, np.ones((16, 16), np.uint8))  # so that JPEG keeps them
    options = {"lossless": True} if name == "WEBP" else {}
    picture = Image.fromarray(blocks).convert("RGB")
    if name not in ("JPEG", "AVIF"):
        picture.putalpha(Image.fromarray(255 - blocks))
    file = encoded(picture, name, exif=exif, **options)
    for needed, side in ((None, 16), (24, 8)):
        photo = load_image(file, needed=needed)
        at = np.s_[side // 2 :: side, side // 2 :: side]
        np.testing.assert_allclose(photo.pixels[..., 0][at] * 255, SEEN[orientation], atol=1.5)
        if photo.alpha is not None:
            seen = 255 - photo.alpha[at] * 255
            np.testing.assert_allclose(seen, SEEN[orientation], atol=1.5)
        # An AVIF is turned by its own boxes.
        assert ("EXIF orientation applied" in photo.notes) == (orientation != 1 and name != "AVIF")


def exif_of(kind: int, count: int, value: bytes) -> bytes:
    """EXIF data with an orientation of any type."""
    return b"II*\0\x08\0\0\0\x01\0" + struct.pack("<HHI4s", 0x0112, kind, count, value) + bytes(4)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "exif",
    [
        exif_of(3, 1, b"\x09\0"), exif_of(2, 2, b"6\0"), exif_of(5, 1, b"\xff\0\0\0"),
        exif_of(3, 9999, b"\x06\0"), exif_of(99, 1, b"\x06\0"), b"II*\0\x08\0\0\0\xff", b"nonsense",
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["JPEG", "PNG", "WEBP"])
def test_orientation_that_is_none_turns_nothing(name, exif):
    picture = Image.fromarray(np.kron(STORED, np.ones((16, 16), np.uint8)))
    options = {"lossless": True} if name == "WEBP" else {}
    photo = load_image(encoded(picture, name, exif=b"Exif\0\0" + exif, **options))
    np.testing.assert_allclose(photo.pixels[8::16, 8::16, 0] * 255, STORED, atol=1)


@pytest.mark.parametrize("name", ["TIFF", "GIF", "WEBP", "PNG", "AVIF"])
def test_first_of_several_frames_is_taken_and_noted(name):
    frames = [Image.new("RGB", (16, 16), (level, level, level)) for level in (200, 100, 0)]
    file = encoded(frames[0], name, save_all=True, append_images=frames[1:])
    count, what = "several" if name == "AVIF" else 3, "pages" if name == "TIFF" else "frames"
    assert_read(file, 200 / 255, (f"first of {count} {what}",), 2 / 255)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("PNG", (300, 150)), ("TIFF", (300, 150)), ("JPEG", (300, 150)), ("exif", (300, 150)),
     ("turned", (150, 300)), ("cm", (127, 254))],
)  # fmt: skip
def test_resolution_is_that_of_the_tag_as_the_photo_is_turned_and_one_of_oblong_pixels_is_noted(
    name, expected
):
    exif = Image.Exif()
    exif[0x011A], exif[0x011B], exif[0x0128] = 300.0, 150.0, 2
    exif[0x0112] = 6 if name == "turned" else 1
    by_exif = name in ("exif", "turned")
    options = {"exif": exif} if by_exif else {"dpi": (300, 150)}
    picture = Image.fromarray(BYTES)
    file = encoded(picture, "JPEG" if by_exif or name == "cm" else name, **options)
    if name == "cm":  # 50 and 100 a centimetre, as the header's unit 2 says
        place = file.index(b"JFIF") + 7
        file = file[:place] + b"\2\0\x32\0\x64" + file[place + 5 :]
    photo = load_image(file)
    assert photo.dpi == pytest.approx(expected, rel=1e-4)
    times = 2 if expected[0] < expected[1] else 0.5
    assert any(note.startswith(f"pixels are {times} times as wide") for note in photo.notes)
    square = load_image(encoded(picture, "PNG", dpi=(300, 300)))
    assert (square.notes, square.dpi) == ((), pytest.approx((300, 300), rel=1e-4))
    assert load_image(encoded(picture, "PNG")).dpi is None


def test_proportions_of_pixels_in_no_unit_are_noted():
    jpeg = encoded(Image.fromarray(BYTES), "JPEG")
    place = jpeg.index(b"JFIF") + 7
    for file, times in (
        (png(BYTES, chunk(b"pHYs", b"\0\0\0\2\0\0\0\1\0")), 0.5),
        (jpeg[:place] + b"\0\0\6\0\2" + jpeg[place + 5 :], 3),
    ):
        photo = load_image(file)
        assert any(note.startswith(f"pixels are {times} times as wide") for note in photo.notes)
        assert photo.dpi is None
    short = jpeg[:2] + b"\xff\xe0\0\7JFIF\0" + jpeg[20:]  # which has no density
    assert load_image(short).notes == ()
