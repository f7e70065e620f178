import io

import numpy as np
import pytest
import torch
from PIL import Image, ImageCms

from gauss2svg.errors import InputError
from gauss2svg.image import load_image, shrink

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)


def encoded(picture: Image.Image, name: str, **options) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, name, **options)
    return stream.getvalue()


def test_every_kind_of_source_gives_the_same_pixels(tmp_path):
    picture = Image.fromarray(BYTES)
    png = encoded(picture, "PNG")
    path = tmp_path / "a photo.png"
    path.write_bytes(png)
    sources = [
        path,
        str(path),
        png,
        bytearray(png),
        io.BytesIO(png),
        picture,
        BYTES,
        BYTES.astype(np.float64) / 255,
        BYTES.astype(np.uint16) * 257,
        torch.from_numpy(np.moveaxis(BYTES, -1, 0).copy()),
        torch.from_numpy(np.moveaxis(BYTES, -1, 0) / np.float32(255)),
    ]
    for source in sources:
        photo = load_image(source)
        assert photo.pixels.dtype == np.float32
        assert (photo.height, photo.width) == (6, 9)
        np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-7)


@pytest.mark.parametrize("name", ["BMP", "TIFF", "GIF", "WEBP", "PPM"])
def test_formats_are_decoded(name):
    options = {"lossless": True} if name == "WEBP" else {}
    photo = load_image(encoded(Image.fromarray(BYTES), name, **options))
    atol = 0.1 if name == "GIF" else 1e-7
    np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=atol)


@pytest.mark.parametrize("shape", [(6, 9), (6, 9, 1)])
def test_grey_is_repeated_over_the_channels(shape):
    grey = RNG.random(shape).astype(np.float32)
    pixels = load_image(grey).pixels
    for channel in range(3):
        assert (pixels[:, :, channel] == grey.reshape(6, 9)).all()


def test_sixteen_bit_grey_png_keeps_its_levels():
    levels = RNG.integers(0, 65536, (6, 9), dtype=np.uint16)
    pixels = load_image(encoded(Image.fromarray(levels), "PNG")).pixels
    np.testing.assert_allclose(pixels[:, :, 0], levels / 65535, atol=1e-7)


def test_transparency_is_kept_and_shown_over_a_matte_where_one_is_given():
    rgba = np.dstack([BYTES, np.full((6, 9), 51, np.uint8)])
    kept = load_image(encoded(Image.fromarray(rgba), "PNG"))
    np.testing.assert_allclose(kept.pixels, BYTES / 255, atol=1e-6)
    np.testing.assert_allclose(kept.alpha, 0.2, atol=1e-6)
    photo = load_image(encoded(Image.fromarray(rgba), "PNG"), matte=(1.0, 1.0, 1.0))
    assert photo.alpha is None
    np.testing.assert_allclose(photo.pixels, BYTES / 255 * 0.2 + 0.8, atol=1e-6)
    assert any("transparency" in note for note in photo.notes)


def test_palette_with_transparency_has_alpha():
    picture = Image.new("P", (4, 4), 1)
    picture.putpalette([255, 0, 0, 0, 0, 0])
    assert (load_image(encoded(picture, "PNG", transparency=1)).alpha == 0).all()
    photo = load_image(encoded(picture, "PNG", transparency=1), matte=(1.0, 1.0, 1.0))
    assert (photo.pixels == 1).all()


def test_orientation_is_applied_and_noted():
    exif = Image.Exif()
    exif[0x0112] = 6  # turn right by a quarter to see it upright
    photo = load_image(encoded(Image.fromarray(BYTES), "PNG", exif=exif))
    np.testing.assert_allclose(photo.pixels, np.rot90(BYTES, -1) / 255, atol=1e-7)
    assert any("EXIF" in note for note in photo.notes)


def test_cmyk_is_converted():
    assert load_image(encoded(Image.new("CMYK", (4, 4)), "JPEG")).pixels.min() > 0.97


def test_embedded_profile_is_converted_to_srgb():
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    # Exchange the red and the blue primary in the table of tags: what a file in this
    # space calls red is shown blue.
    red, blue = profile.index(b"rXYZ"), profile.index(b"bXYZ")
    profile[red : red + 4], profile[blue : blue + 4] = b"bXYZ", b"rXYZ"
    photo = load_image(encoded(Image.fromarray(BYTES), "PNG", icc_profile=bytes(profile)))
    np.testing.assert_allclose(photo.pixels, BYTES[:, :, ::-1] / 255, atol=3 / 255)
    assert any("sRGB" in note for note in photo.notes)


def test_grey_picture_with_a_colour_profile_is_converted():
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    photo = load_image(encoded(Image.fromarray(BYTES[:, :, 0]), "PNG", icc_profile=profile))
    assert any("sRGB" in note for note in photo.notes)
    np.testing.assert_allclose(photo.pixels[:, :, 1], BYTES[:, :, 0] / 255, atol=2 / 255)


def test_grey_levels_that_would_wrap_are_refused():
    levels = Image.fromarray(np.array([[70000, 5]], np.int32))
    with pytest.raises(InputError, match="70000"):
        load_image(levels)


def test_unusual_arrays_and_tensors_are_read():
    big_endian = (BYTES.astype(np.uint16) * 257).astype(">u2")
    np.testing.assert_allclose(load_image(big_endian).pixels, BYTES / 255, atol=1e-7)
    tensor = torch.from_numpy(np.moveaxis(BYTES, -1, 0) / np.float32(255))
    assert np.abs(load_image(tensor.bfloat16()).pixels - BYTES / 255).max() < 1 / 128
    np.testing.assert_allclose(load_image(tensor.to_sparse()).pixels, BYTES / 255, atol=1e-7)


def test_picture_opened_lazily_and_broken_is_refused():
    with pytest.raises(InputError, match="broken"):
        load_image(Image.open(io.BytesIO(encoded(Image.fromarray(BYTES), "PNG")[:60])))


def test_unreadable_profile_is_noted_not_hidden():
    photo = load_image(encoded(Image.fromarray(BYTES), "PNG", icc_profile=b"nonsense"))
    assert any("profile unreadable" in note for note in photo.notes)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("no/such/photo.png", "cannot read no/such/photo.png: No such file"),
        (b"", "no picture that can be read"),
        (b"<svg/>", "no picture that can be read"),
        (encoded(Image.fromarray(BYTES), "PNG")[:60], "broken"),
        (np.zeros((4, 4, 2)), r"shape \(4, 4, 2\)"),
        (np.zeros((0, 4, 3)), "at least one pixel"),
        (np.zeros((4, 4), np.int64), "type int64"),
        (np.full((4, 4), 1.5), "is 1.5 at row 0, column 0, channel 0"),
        (torch.full((3, 2, 2), float("nan")), "is nan at row 0"),
        ("a\0b.png", "cannot read"),
        (42, "got int"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(source, message):
    with pytest.raises(InputError, match=message) as caught:
        load_image(source)
    assert "\n" not in str(caught.value)


def test_bomb_is_refused_before_it_is_decoded(monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 20)
    with pytest.raises(InputError, match="too large"):
        load_image(encoded(Image.fromarray(BYTES), "PNG"))


def test_shrinking_keeps_the_mean_and_averages_areas():
    pixels = RNG.random((12, 18, 3), dtype=np.float32)
    small = shrink(pixels, 4, 6)
    expected = pixels.reshape(4, 3, 6, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small, expected, atol=1e-6)
    assert shrink(pixels, 12, 18) is pixels
