import io

import numpy as np
import pytest
from pictures import assert_read, encoded
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo import MOST_PIXELS
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import shrunk

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)


def test_every_kind_of_source_gives_the_same_pixels(tmp_path):
    picture = Image.fromarray(BYTES)
    png = encoded(picture, "PNG")
    path = tmp_path / "a photo.png"
    path.write_bytes(png)
    arrays = BYTES, BYTES.astype(np.float64) / 255, BYTES.astype(np.uint16) * 257
    for source in (path, str(path), png, bytearray(png), io.BytesIO(png), picture, *arrays):
        photo = assert_read(source, BYTES / 255)
        assert photo.pixels.dtype == np.float32
        assert (photo.height, photo.width) == (6, 9)


RGBA = np.dstack([BYTES, RNG.integers(0, 3, (6, 9), dtype=np.uint8) * 100])


@pytest.mark.parametrize("source", [RGBA, RGBA / 255, encoded(Image.fromarray(RGBA), "PNG")])
def test_alpha_is_kept_beside_colours_or_covers_a_matte(source):
    alpha = RGBA[:, :, 3:] / 255
    shown = BYTES / 255 * (alpha > 0)  # not a colour that nobody sees
    assert assert_read(source, shown, alpha=alpha[:, :, 0]).alpha.dtype == np.float32
    for matte, name in (((1, 1, 1), "#ffffff"), ((0.2, 0.4, 0.6), "#336699")):
        over = load_image(source, matte=matte)
        expected = BYTES / 255 * alpha + np.array(matte) * (1 - alpha)
        np.testing.assert_allclose(over.pixels, expected, atol=1e-6)
        assert over.alpha is None
        assert over.notes == (f"composited over {name}",)
    assert_read(np.dstack([BYTES, np.full((6, 9), 255, np.uint8)]), BYTES / 255)


def test_grey_integers_are_of_sixteen_bits():
    levels = Image.fromarray(np.array([[65535, 257]], np.int32))
    np.testing.assert_allclose(load_image(levels).pixels[0, :, 0], [1, 1 / 255], atol=1e-7)


def test_tensors_are_read_or_refused():
    torch = pytest.importorskip("torch")
    levels = torch.from_numpy(np.moveaxis(BYTES, -1, 0).copy())
    for one in (levels, levels / 255, (levels / 255).to_sparse()):
        assert_read(one, BYTES / 255)
    assert_read((levels / 255).bfloat16(), BYTES / 255, atol=1 / 128)
    for wrong, line in (
        (torch.full((3, 2, 2), float("nan")), "got nan at row 0"),
        (torch.zeros(3, 4, 4, dtype=torch.complex64).conj(), "NumPy can hold; got .* conjugate"),
        (torch.empty(3, 4, 4, device="meta"), "tensor must be one that NumPy can hold; got Cannot"),
    ):
        with pytest.raises(InputError, match=line):
            load_image(wrong)


GREY = BYTES[:, :, 0]
FORMS = {
    "one channel": (GREY[:, :, None], GREY / 255),
    "reversed": (BYTES[::-1, ::-2, ::-1], BYTES[::-1, ::-2, ::-1] / 255),
    "big-endian": ((BYTES.astype(np.uint16) * 257).astype(">u2"), BYTES / 255),
    "unaligned": (
        np.frombuffer(b"x" + np.float32(BYTES / 255).tobytes(), np.float32, offset=1)
        .reshape(BYTES.shape), BYTES / 255,
    ),
    "long floats": (np.longdouble(BYTES) / 255, BYTES / 255),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_arrays_of_any_form_are_read_as_plain_ones(name):
    array, expected = FORMS[name]
    before = array.tobytes()
    pixels = assert_read(array, np.atleast_3d(expected)).pixels
    assert type(pixels) is np.ndarray
    assert pixels.flags.c_contiguous
    assert pixels.dtype.isnative
    assert array.tobytes() == before


CLOSED = io.BytesIO()
CLOSED.close()


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (np.zeros((4, 4, 2)), r"shape of array must be .*; got \(4, 4, 2\)"),
        (np.zeros((0, 4, 3)), "must be at least 1x1 px; got 4x0 px"),
        (np.zeros((4, 4), np.int64), "type of array must be uint8, .*; got int64"),
        (np.full((4, 4), 1.5), "must be finite and in 0..1; got 1.5 at row 0, column 0, channel 0"),
        (np.array([[0, float("inf")]]), "got inf at row 0, column 1, channel 0"),
        (42, "got int"),
        (np.ma.array(BYTES, mask=BYTES > 100), r"array must be without masked .* Try .filled\(0\)"),
        (io.StringIO("text"), "must be binary; got one that reads str"),
        (CLOSED, "file object must be open; got a closed one"),
        (Image.fromarray(np.array([[70000, 5]], np.int32)), r"in 0\.\.1; got 1\.068"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(source, message):
    with pytest.raises(InputError, match=message) as caught:
        load_image(source)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "given",
    [*({"matte": matte} for matte in ((1, 1), (1, 1, 1.5), (0, 0, float("nan")), 0.5)),
     *({"max_pixels": limit} for limit in (0, MOST_PIXELS + 1, 1.5))],
)  # fmt: skip
def test_options_of_reading_are_refused_by_name(given):
    with pytest.raises(InputError, match=f"{next(iter(given))} must be"):
        load_image(RGBA, **given)


def test_shrinking_averages_areas_and_weights_colours_by_alpha():
    pixels = RNG.random((12, 18, 4), dtype=np.float32)
    pixels[:3, :3, 3] = 0
    small = shrunk(pixels, 4, 6)
    alpha = pixels[:, :, 3].reshape(4, 3, 6, 3)
    np.testing.assert_allclose(small[:, :, 3], alpha.mean(axis=(1, 3)), atol=1e-6)
    light = (pixels[:, :, :3] * pixels[:, :, 3:]).reshape(4, 3, 6, 3, 3).sum(axis=(1, 3))
    weight = alpha.sum(axis=(1, 3))[:, :, None]
    expected = np.divide(light, weight, out=np.zeros_like(light), where=weight > 0)
    np.testing.assert_allclose(small[:, :, :3], expected, atol=1e-5)
    assert (small[0, 0] == 0).all()
    opaque = np.dstack([pixels[:, :, :3], np.ones((12, 18), np.float32)])
    for one in (pixels, pixels[:, :, :3]):
        assert shrunk(one, 12, 18) is one
    alone = shrunk(pixels[:, :, :3], 5, 7)
    np.testing.assert_allclose(shrunk(opaque, 5, 7)[:, :, :3], alone, atol=1e-6)


def test_an_open_file_is_read_from_its_start_wherever_it_was_read_to():
    stream = io.BytesIO(encoded(Image.fromarray(BYTES), "PNG"))
    for at in (0, 9, 10**6):
        stream.seek(at)
        assert_read(stream, BYTES / 255)
