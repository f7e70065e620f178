"""What any source and each format can hold arrives as it was stored, or is refused."""

import io

import numpy as np
import pytest
from pictures import CONVERTED, DATA, assert_read, chunk, encoded, png, srgb_curve
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import shrunk

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)
WIDE = RNG.integers(0, 65536, (11, 13, 4), dtype=np.uint16)
SMOOTH = np.uint8(np.mgrid[:24, :40].sum(0)[:, :, None] * [3, 2, 1] + [20, 60, 100])


def test_every_kind_of_source_gives_the_same_pixels(tmp_path):
    picture = Image.fromarray(BYTES)
    png = encoded(picture, "PNG")
    path = tmp_path / "a photo.png"
    path.write_bytes(png)
    big_endian = (BYTES / 255).astype(">f8")
    arrays = np.asfortranarray(BYTES), big_endian, BYTES.astype(np.uint16) * 257
    streams = [io.BytesIO(png) for _ in range(3)]
    for stream, at in zip(streams, (0, 9, 10**6), strict=True):
        stream.seek(at)  # files are read from their start, wherever they were read to
    for source in (path, str(path), png, bytearray(png), *streams, picture, *arrays):
        photo = assert_read(source, BYTES / 255)
        assert photo.pixels.dtype == np.float32


RGBA = np.dstack([BYTES, RNG.integers(0, 3, (6, 9), dtype=np.uint8) * 100])


@pytest.mark.parametrize("source", [RGBA, RGBA / 255, encoded(Image.fromarray(RGBA), "PNG")])
def test_alpha_is_kept_beside_colours_or_covers_a_matte(source):
    alpha = RGBA[:, :, 3:] / 255
    shown = BYTES / 255 * (alpha > 0)  # not a colour that nobody sees
    assert assert_read(source, shown, alpha=alpha[:, :, 0]).pixels.dtype == np.float32
    for matte, name in (((1, 1, 1), "#ffffff"), ((0.2, 0.4, 0.6), "#336699")):
        over = load_image(source, matte=name)
        expected = BYTES / 255 * alpha + np.array(matte) * (1 - alpha)
        np.testing.assert_allclose(over.pixels, expected, atol=1e-6)
        assert over.pixels.shape[2] == 3
        assert over.notes == (f"composited over {name}",)
    assert_read(np.dstack([BYTES, np.full((6, 9), 255, np.uint8)]), BYTES / 255)


@pytest.mark.sweep
def test_tensors_are_read_or_refused():
    torch = pytest.importorskip("torch")
    levels = torch.from_numpy(np.moveaxis(BYTES, -1, 0).copy())
    for one in (levels, levels / 255, (levels / 255).to_sparse()):
        assert_read(one, BYTES / 255)
    assert_read((levels / 255).bfloat16(), BYTES / 255, atol=1 / 128)
    with pytest.raises(InputError, match="tensor must be one that NumPy can hold; got Cannot"):
        load_image(torch.empty(3, 4, 4, device="meta"))
    with pytest.raises(InputError, match=r"tensor must be .*; got \(6, 9, 3\). Try tensor.permute"):
        load_image(torch.zeros((6, 9, 3)))


with Image.open(io.BytesIO(encoded(Image.fromarray(BYTES), "PNG"))) as CLOSED:
    pass


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (np.zeros((3, 6, 9)), r"shape of .* got \(3, 6, 9\). Try array.transpose\(1, 2, 0\)"),
        (np.zeros((1, 6, 9, 3)), r"got \(1, 6, 9, 3\). Try .* one picture of many"),
        (CLOSED, "must be a complete image of a supported kind"),
        (np.zeros((4, 4), np.int64), "type of array must be uint8, .*; got int64"),
        (np.full((4, 4), 1.5), "must be finite and in 0..1; got 1.5. Try dividing"),
        (np.full((4, 4), np.nan), "must be finite and in 0..1; got nan. Try numpy.nan_to_num"),
        (42, "got int"),
        (io.StringIO("text"), "must be binary; got one that reads str"),
        (Image.fromarray(np.array([[70000, 5]], np.int32)), r"in 0\.\.1; got 1\.068"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(source, message):
    with pytest.raises(InputError, match=message) as caught:
        load_image(source)
    assert "\n" not in str(caught.value)


def test_shrinking_averages_areas_and_weights_colours_by_alpha():
    pixels = RNG.random((12, 18, 4), dtype=np.float32)
    pixels[:3, :3, 3] = 0
    small, (*colors, alpha) = shrunk(pixels, 4, 6), np.moveaxis(pixels, 2, 0)
    light = [(one * alpha).reshape(4, 3, 6, 3).mean(axis=(1, 3)) for one in colors]
    np.testing.assert_allclose(small[:, :, :3] * small[:, :, 3:], np.stack(light, -1), atol=1e-5)
    assert (small[0, 0] == 0).all()


@pytest.mark.parametrize("name", ["PNG", "BMP", "TIFF", "GIF", "WEBP", "JPEG2000", "JPEG", "AVIF"])
def test_every_format_gives_what_was_stored(name):
    is_lossy = name in ("JPEG", "AVIF")
    options = {"lossless": True} if name == "WEBP" else {"quality": 95} if is_lossy else {}
    stored = SMOOTH if is_lossy else BYTES // 64 * 64  # colours that a GIF's palette holds
    file = encoded(Image.fromarray(stored), name, **options)
    assert_read(file, stored / 255, atol=10 / 255 if is_lossy else 1e-7)
    for side in ((1, 1), (1, 5000), (3, 3)) if name != "AVIF" else ():
        thin = assert_read(encoded(Image.new("RGB", side, (255, 255, 255)), name), 1)
        assert (thin.width, thin.height) == side


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize(("bits", "channels"), [(1, 1), (4, 1), (8, 2), (8, 3), (16, 1), (16, 4)])
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
        np.testing.assert_allclose(photo.pixels[:, :, :3], blocks * shows, atol=2 / 255)
    assert photo.notes == ((CONVERTED,) if name == "profile" else ())
    if name == "alpha":
        np.testing.assert_allclose(photo.pixels[:, :, 3], x / 25.5, atol=1 / 255)
    assert photo.pixels.shape[2] == (4 if name == "alpha" else 3)


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
        if photo.pixels.shape[2] == 4:
            seen = 255 - photo.pixels[:, :, 3][at] * 255
            np.testing.assert_allclose(seen, SEEN[orientation], atol=1.5)
        # An AVIF is turned by its own boxes.
        assert ("EXIF orientation applied" in photo.notes) == (orientation != 1 and name != "AVIF")


@pytest.mark.parametrize("name", ["TIFF", "GIF", "WEBP", "PNG", "AVIF"])
def test_first_of_several_frames_is_taken_and_noted(name):
    frames = [Image.new("RGB", (16, 16), (level, level, level)) for level in (200, 100, 0)]
    file = encoded(frames[0], name, save_all=True, append_images=frames[1:])
    note = f"first of 3 {'pages' if name == 'TIFF' else 'frames'}"
    assert_read(file, 200 / 255, () if name == "AVIF" else (note,), 2 / 255)


@pytest.mark.parametrize("name", ["PNG", "TIFF", "JPEG", "exif", "turned"])
def test_resolution_is_that_of_the_tag_as_the_photo_is_turned(name):
    exif = Image.Exif()
    exif[0x011A], exif[0x011B], exif[0x0128] = 300.0, 150.0, 2
    exif[0x0112] = 6 if name == "turned" else 1
    by_exif = name in ("exif", "turned")
    options = {"exif": exif} if by_exif else {"dpi": (300, 150)}
    file = encoded(Image.fromarray(BYTES), "JPEG" if by_exif else name, **options)
    expected = (150, 300) if name == "turned" else (300, 150)
    assert load_image(file).dpi == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("most", "count"), [(4095, 1), (0, 0), (9000, 0)])
def test_samples_of_12_bits_in_16_are_noted(most, count):
    samples = np.linspace(0, most, 64).astype(np.uint16).reshape(8, 8)
    assert len(load_image(samples).notes) == count
