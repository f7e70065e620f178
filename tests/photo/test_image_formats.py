"""What each format can hold arrives as it was stored."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from flat import vectorize
from names import possible
from pictures import chunk, encoded, png, srgb_curve
from PIL import Image

from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
CONVERTED = "converted from its embedded ICC profile to sRGB"
DATA = Path(__file__).parents[1] / "data"
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)
WIDE = RNG.integers(0, 65536, (11, 13, 4), dtype=np.uint16)
SMOOTH = np.uint8(np.mgrid[:24, :40].sum(0)[:, :, None] * [3, 2, 1] + [20, 60, 100])


@pytest.mark.parametrize("name", ["PNG", "BMP", "TIFF", "GIF", "WEBP", "JPEG2000"])
def test_lossless_formats_give_what_was_stored(name):
    options = {"lossless": True} if name == "WEBP" else {}
    few = BYTES // 64 * 64  # colours that a GIF's palette holds
    photo = load_image(encoded(Image.fromarray(few), name, **options))
    np.testing.assert_allclose(photo.pixels, few / 255, atol=1e-7)
    assert photo.alpha is None
    assert photo.notes == ()


@pytest.mark.parametrize("name", ["JPEG", "WEBP", "AVIF"])
def test_lossy_formats_are_near_it(name):
    pixels = load_image(encoded(Image.fromarray(SMOOTH), name, quality=95)).pixels
    assert np.abs(pixels - SMOOTH / 255).max() < 10 / 255


@pytest.mark.parametrize("side", [(1, 1), (1, 5000), (5000, 1), (2, 2), (3, 3)])
@pytest.mark.parametrize("name", ["JPEG", "PNG", "WEBP", "TIFF", "GIF", "BMP"])
def test_smallest_and_thinnest_pictures_are_read(name, side):
    photo = load_image(encoded(Image.new("RGB", side, (255, 255, 255)), name))
    assert (photo.width, photo.height) == side
    assert (photo.pixels == 1).all()


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize("bits", [8, 16])
def test_png_keeps_every_bit(channels, interlaced, bits):
    samples = WIDE[:, :, :channels] >> (16 - bits)
    photo = load_image(png(samples, bits=bits, interlaced=interlaced))
    alpha = samples[:, :, -1] / (2**bits - 1) if channels in (2, 4) else np.ones((11, 13))
    color = samples[:, :, : 3 if channels > 2 else 1] / (2**bits - 1)
    np.testing.assert_allclose(
        photo.pixels, color * np.ones(3) * (alpha > 0)[:, :, None], atol=1e-7
    )
    np.testing.assert_allclose(1 if photo.alpha is None else photo.alpha, alpha, atol=1e-7)


@pytest.mark.parametrize(
    ("bits", "channels"), [(1, 1), (2, 1), (4, 1), (8, 1), (16, 1), (8, 3), (16, 3)]
)
@pytest.mark.parametrize("interlaced", [False, True])
def test_samples_spread_over_the_range_and_one_colour_may_be_clear(bits, channels, interlaced):
    samples = WIDE[:, :, :channels] >> (16 - bits)
    clear = chunk(b"tRNS", samples[2, 3].astype(">u2").tobytes())
    photo = load_image(png(samples, clear, bits=bits, interlaced=interlaced))
    shows = (samples != samples[2, 3]).any(axis=2)
    assert photo.alpha is not None
    assert (photo.alpha == shows).all()
    np.testing.assert_allclose(
        photo.pixels[shows], (samples / (2**bits - 1) * np.ones(3))[shows], atol=1e-7
    )


def test_palette_has_colours_and_an_alpha_for_each():
    entries = RNG.integers(0, 256, (4, 3), dtype=np.uint8)
    indices = RNG.integers(0, 4, (5, 7, 1))
    alphas = np.uint8([255, 128, 7, 200])
    file = png(
        indices, chunk(b"PLTE", entries.tobytes()), chunk(b"tRNS", alphas.tobytes()), bits=2, kind=3
    )
    photo = load_image(file)
    np.testing.assert_allclose(photo.pixels, entries[indices[:, :, 0]] / 255, atol=1e-7)
    np.testing.assert_allclose(photo.alpha, alphas[indices[:, :, 0]] / 255, atol=1e-7)


def test_gif_has_one_clear_colour():
    picture = Image.fromarray(np.uint8([[0, 1], [1, 0]])).convert("P")
    picture.putpalette([10, 20, 30, 200, 100, 50])
    photo = load_image(encoded(picture, "GIF", transparency=0))
    np.testing.assert_array_equal(photo.alpha, [[0, 1], [1, 0]])
    np.testing.assert_allclose(photo.pixels[0, 1] * 255, [200, 100, 50], atol=1e-4)


@pytest.mark.parametrize("spread", ["full", "limited"])
def test_grey_avif_has_black_and_white(spread):
    levels = np.kron(np.uint8([[0, 128, 255]]), np.ones((16, 16), np.uint8))
    file = encoded(Image.fromarray(levels), "AVIF", quality=95, range=spread)
    seen = load_image(file).pixels[8, 8::16, 0] * 255
    np.testing.assert_allclose(seen, [0, 128, 255], atol=2)


def framed(picture: Image.Image, at: tuple[int, int], screen: tuple[int, int]) -> bytes:
    """A GIF whose frame is placed on a larger screen."""
    file = bytearray(encoded(picture, "GIF"))
    place = 13 + (6 << (file[10] & 7))
    while file[place] == 0x21:
        place += 3 + file[place + 2] + 1
    file[6:10] = struct.pack("<HH", *screen)
    file[place + 1 : place + 5] = struct.pack("<HH", *at)
    return bytes(file)


def test_gif_is_clear_where_its_first_frame_is_not():
    picture = Image.fromarray(np.uint8([[[220, 30, 30], [30, 30, 220]]] * 3)).quantize(4)
    photo = load_image(framed(picture, (2, 1), (6, 5)))
    expected = np.zeros((5, 6))
    expected[1:4, 2:4] = 1
    np.testing.assert_array_equal(photo.alpha, expected)
    np.testing.assert_allclose(photo.pixels[2, 2:4] * 255, [[220, 30, 30], [30, 30, 220]], atol=1)


def test_later_frame_of_a_gif_that_is_open_covers_those_before():
    red, blue = Image.new("RGB", (6, 5), (220, 30, 30)), Image.new("RGB", (6, 5), (220, 30, 30))
    blue.paste((30, 30, 220), (2, 1, 4, 4))
    file = encoded(red, "GIF", save_all=True, append_images=[blue], disposal=1)
    with Image.open(io.BytesIO(file)) as image:
        image.seek(1)
        photo = load_image(image)
    assert photo.alpha is None
    np.testing.assert_allclose(photo.pixels * 255, np.asarray(blue), atol=1)


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
    1: [[10, 20, 30], [40, 50, 60]],
    2: [[30, 20, 10], [60, 50, 40]],
    3: [[60, 50, 40], [30, 20, 10]],
    4: [[40, 50, 60], [10, 20, 30]],
    5: [[10, 40], [20, 50], [30, 60]],
    6: [[40, 10], [50, 20], [60, 30]],
    7: [[60, 30], [50, 20], [40, 10]],
    8: [[30, 60], [20, 50], [10, 40]],
}


@pytest.mark.parametrize("orientation", SEEN)
@pytest.mark.parametrize("name", ["JPEG", "PNG", "WEBP", "TIFF", "AVIF"])
def test_orientation_is_applied(name, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    blocks = np.kron(STORED, np.ones((16, 16), np.uint8))  # so that JPEG keeps them
    options = {"lossless": True} if name == "WEBP" else {}
    picture = Image.fromarray(blocks).convert("RGB")
    photo = load_image(encoded(picture, name, exif=exif, **options))
    seen = np.round(photo.pixels[8::16, 8::16, 0] * 255)
    np.testing.assert_allclose(seen, SEEN[orientation], atol=1)
    # An AVIF is turned by its own boxes.
    assert ("EXIF orientation applied" in photo.notes) == (orientation != 1 and name != "AVIF")


def exif_of(kind: int, count: int, value: bytes) -> bytes:
    """EXIF data with an orientation of any type."""
    entry = struct.pack("<HHI4s", 0x0112, kind, count, value)
    return b"Exif\0\0II*\0\x08\0\0\0\x01\0" + entry + bytes(4)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("kind", "count", "value"),
    [
        (3, 1, b"\0\0"),
        (3, 1, b"\x09\0"),
        (2, 2, b"6\0"),
        (5, 1, b"\xff\0\0\0"),
        (3, 9999, b"\x06\0"),
        (99, 1, b"\x06\0"),
    ],
)
@pytest.mark.parametrize("name", ["JPEG", "PNG", "WEBP"])
def test_orientation_that_is_none_turns_nothing(name, kind, count, value):
    picture = Image.fromarray(np.kron(STORED, np.ones((16, 16), np.uint8)))
    options = {"lossless": True} if name == "WEBP" else {}
    photo = load_image(encoded(picture, name, exif=exif_of(kind, count, value), **options))
    np.testing.assert_allclose(photo.pixels[8::16, 8::16, 0] * 255, STORED, atol=1)


@pytest.mark.parametrize("data", [b"II*\0\x08\0\0\0\xff", b"nonsense", b"MM\0*\xff\xff\xff\xff"])
def test_broken_exif_turns_nothing(data):
    photo = load_image(encoded(Image.fromarray(STORED), "PNG", exif=b"Exif\0\0" + data))
    np.testing.assert_allclose(photo.pixels[:, :, 0] * 255, STORED, atol=1e-4)
    assert photo.notes == ()


def test_bilevel_is_black_and_white():
    bits = RNG.random((5, 11)) < 0.5
    for name in ("PNG", "TIFF", "BMP"):
        photo = load_image(encoded(Image.fromarray(bits), name))
        assert (photo.pixels == bits[:, :, None]).all()


@pytest.mark.parametrize("name", ["TIFF", "GIF", "WEBP", "PNG", "AVIF"])
def test_first_of_several_frames_is_taken_and_noted(name):
    frames = [Image.new("RGB", (16, 16), (level, level, level)) for level in (200, 100, 0)]
    file = encoded(frames[0], name, save_all=True, append_images=frames[1:])
    photo = load_image(file)
    assert np.abs(photo.pixels * 255 - 200).max() < 2
    count, what = "several" if name == "AVIF" else 3, "pages" if name == "TIFF" else "frames"
    assert photo.notes == (f"first of {count} {what}",)


@pytest.mark.parametrize("name", ["PNG", "TIFF", "JPEG"])
def test_pixels_that_are_not_square_stay_and_are_noted(name):
    photo = load_image(encoded(Image.fromarray(BYTES), name, dpi=(300, 150)))
    assert (photo.width, photo.height) == (9, 6)
    assert any(note.startswith("pixels are 0.5 times as wide as high") for note in photo.notes)
    square = load_image(encoded(Image.fromarray(BYTES), name, dpi=(300, 300)))
    assert square.notes == ()


def test_proportions_of_pixels_in_no_unit_are_noted():
    aspect = chunk(b"pHYs", b"\0\0\0\2\0\0\0\1\0")
    photo = load_image(png(BYTES, aspect))
    assert any(note.startswith("pixels are 0.5 times as wide") for note in photo.notes)
    assert photo.dpi is None
    jpeg = bytearray(encoded(Image.fromarray(BYTES), "JPEG"))
    place = jpeg.index(b"JFIF") + 7
    jpeg[place : place + 5] = b"\0\0\6\0\2"
    notes = load_image(bytes(jpeg)).notes
    assert any(note.startswith("pixels are 3 times as wide") for note in notes)
    short = jpeg[:2] + b"\xff\xe0\0\7JFIF\0" + jpeg[20:]  # which has no density
    assert load_image(bytes(short)).notes == ()


@pytest.mark.sweep
def test_nothing_of_the_file_reaches_the_svg(tmp_path):
    words = b"</svg><script>alert(1)</script>&\x1b[31m"
    text = b"".join(chunk(b"tEXt", key + b"\0" + words) for key in (b"Title", b"Description"))
    path = tmp_path / possible("<script>&'\".png")
    path.write_bytes(png(BYTES, text))
    result = vectorize(path, gaussians=3, iterations=2)
    assert "script" not in result.svg
    assert "script" not in repr(result.report)
