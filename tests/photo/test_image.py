import io

import numpy as np
import pytest
from pictures import encoded
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.alpha import shrunk
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.photo.load import load_image

RNG = np.random.default_rng(0)
BYTES = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)


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
    ]
    for source in sources:
        photo = load_image(source)
        assert photo.pixels.dtype == np.float32
        assert (photo.height, photo.width) == (6, 9)
        np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-7)


RGBA = np.dstack([BYTES, RNG.integers(0, 3, (6, 9), dtype=np.uint8) * 100])


@pytest.mark.parametrize("source", [RGBA, RGBA / 255, encoded(Image.fromarray(RGBA), "PNG")])
def test_alpha_is_kept_beside_colours_that_it_is_not_multiplied_with(source):
    photo = load_image(source)
    assert photo.alpha is not None
    assert photo.alpha.dtype == np.float32
    np.testing.assert_allclose(photo.alpha, RGBA[:, :, 3] / 255, atol=1e-7)
    shows = RGBA[:, :, 3] > 0
    np.testing.assert_allclose(photo.pixels[shows], BYTES[shows] / 255, atol=1e-7)
    assert (photo.pixels[~shows] == 0).all()
    assert photo.notes == ()


def test_colour_that_nobody_sees_changes_nothing():
    other = np.where(RGBA[:, :, 3:] > 0, RGBA, np.uint8([9, 8, 7, 0]))
    assert (load_image(RGBA).pixels == load_image(other).pixels).all()


@pytest.mark.parametrize("matte", [(1, 1, 1), (0.2, 0.4, 0.6)])
def test_matte_shows_through_and_is_noted(matte):
    photo = load_image(RGBA, matte=matte)
    alpha = RGBA[:, :, 3:] / 255
    expected = BYTES / 255 * alpha + np.array(matte) * (1 - alpha)
    np.testing.assert_allclose(photo.pixels, expected, atol=1e-6)
    assert photo.alpha is None
    color = "#ffffff" if matte == (1, 1, 1) else "#336699"
    assert photo.notes == (f"composited over {color}",)


def test_opaque_photo_has_no_alpha_and_needs_no_matte():
    opaque = np.dstack([BYTES, np.full((6, 9), 255, np.uint8)])
    for matte in (None, (0, 0, 0)):
        photo = load_image(opaque, matte=matte)
        assert photo.alpha is None
        assert photo.notes == ()
        np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-7)


@pytest.mark.parametrize("matte", [(1, 1), (1, 1, 1.5), (0, 0, float("nan")), 0.5])
def test_matte_that_is_no_colour_is_refused(matte):
    with pytest.raises(InputError, match="matte must be three numbers"):
        load_image(RGBA, matte=matte)


def test_grey_integers_are_of_sixteen_bits_and_others_are_refused():
    levels = Image.fromarray(np.array([[65535, 257]], np.int32))
    np.testing.assert_allclose(load_image(levels).pixels[0, :, 0], [1, 1 / 255], atol=1e-7)
    levels = Image.fromarray(np.array([[70000, 5]], np.int32))
    with pytest.raises(InputError, match=r"in 0\.\.1; got 1\.068"):
        load_image(levels)


def test_tensors_are_read_or_refused():
    torch = pytest.importorskip("torch")
    levels = torch.from_numpy(np.moveaxis(BYTES, -1, 0).copy())
    tensor = levels / 255
    for one in (levels, tensor, tensor.to_sparse()):
        photo = load_image(one)
        assert photo.pixels.dtype == np.float32
        np.testing.assert_allclose(photo.pixels, BYTES / 255, atol=1e-7)
    assert np.abs(load_image(tensor.bfloat16()).pixels - BYTES / 255).max() < 1 / 128
    complex_ones = torch.zeros(3, 4, 4, dtype=torch.complex64)
    for wrong, line in (
        (torch.full((3, 2, 2), float("nan")), "got nan at row 0"),
        (complex_ones.conj(), "NumPy can hold; got .* conjugate"),
        (torch.empty(3, 4, 4, device="meta"), "tensor must be one that NumPy can hold; got Cannot"),
    ):
        with pytest.raises(InputError, match=line) as caught:
            load_image(wrong)
        assert "\n" not in str(caught.value)


class Odd(np.ndarray):
    """Whose own operators are wrong."""

    def __getitem__(self, _):
        raise ZeroDivisionError

    __mul__ = __truediv__ = __ge__ = __getitem__


GREY = BYTES[:, :, 0]
FORMS = {
    "matrix": (GREY.view(np.matrix), GREY / 255),
    "one channel": (GREY[:, :, None], GREY / 255),
    "matrix of floats": ((GREY / 255).view(np.matrix), GREY / 255),
    "subclass": (BYTES.view(Odd), BYTES / 255),
    "nothing masked": (np.ma.array(BYTES), BYTES / 255),
    "read-only": (np.frombuffer(BYTES.tobytes(), np.uint8).reshape(BYTES.shape), BYTES / 255),
    "reversed": (BYTES[::-1, ::-2, ::-1], BYTES[::-1, ::-2, ::-1] / 255),
    "by columns": (np.asfortranarray(BYTES), BYTES / 255),
    "broadcast": (np.broadcast_to(np.uint8(51), (6, 9, 3)), np.full((6, 9), 0.2)),
    "big-endian": ((BYTES.astype(np.uint16) * 257).astype(">u2"), BYTES / 255),
    "big-endian floats": ((BYTES / 255).astype(">f8"), BYTES / 255),
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
    photo = load_image(array)
    expected = np.atleast_3d(expected) * np.ones(3)
    np.testing.assert_allclose(photo.pixels, expected, atol=1e-7)
    assert type(photo.pixels) is np.ndarray
    assert photo.pixels.flags.c_contiguous
    assert photo.pixels.dtype.isnative
    assert array.tobytes() == before


def test_picture_opened_lazily_and_broken_is_refused():
    with pytest.raises(InputError, match="broken"):
        load_image(Image.open(io.BytesIO(encoded(Image.fromarray(BYTES), "PNG")[:60])))


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
        (BYTES.astype(object), "type of array must be uint8, .*; got object"),
        (np.zeros((4, 4), [("r", "u1")]), "type of array must be uint8, .*; got .*'r'"),
        (np.array(3), r"shape of array must be .*; got \(\)"),
        (np.full((4, 4), "a"), "type of array must be uint8, .*; got <U1"),
        (io.StringIO("text"), "must be binary; got one that reads str"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(source, message):
    with pytest.raises(InputError, match=message) as caught:
        load_image(source)
    assert "\n" not in str(caught.value)


def test_limit_of_pixels_holds_for_arrays_as_well():
    assert load_image(BYTES, max_pixels=54).width == 9
    with pytest.raises(InputError, match=r"at most 53 px \(--max-pixels\); got 9x6 = 54 px"):
        load_image(BYTES, max_pixels=53)
    with pytest.raises(InputError, match="9x6 = 54 px"):
        load_image(Image.fromarray(BYTES), max_pixels=53)
    for limit in (0, -1, MOST_PIXELS + 1, 1.5):
        with pytest.raises(InputError, match="max_pixels must be"):
            load_image(BYTES, max_pixels=limit)
    assert Image.MAX_IMAGE_PIXELS == DEFAULT_MAX_PIXELS  # as Pillow has it by itself


def test_shrinking_keeps_the_mean_and_averages_areas():
    pixels = RNG.random((12, 18, 3), dtype=np.float32)
    small = shrunk(pixels, 4, 6)
    expected = pixels.reshape(4, 3, 6, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small, expected, atol=1e-6)
    assert shrunk(pixels, 12, 18) is pixels


def test_shrinking_weights_colours_by_alpha():
    pixels = RNG.random((12, 18, 4), dtype=np.float32)
    pixels[:3, :3, 3] = 0
    small = shrunk(pixels, 4, 6)
    color, alpha = pixels[:, :, :3], pixels[:, :, 3]
    blocks = alpha.reshape(4, 3, 6, 3)
    np.testing.assert_allclose(small[:, :, 3], blocks.mean(axis=(1, 3)), atol=1e-6)
    sums = (color * alpha[:, :, None]).reshape(4, 3, 6, 3, 3).sum(axis=(1, 3))
    weights = blocks.sum(axis=(1, 3))[:, :, None]
    expected = np.divide(sums, weights, out=np.zeros_like(sums), where=weights > 0)
    np.testing.assert_allclose(small[:, :, :3], expected, atol=1e-5)
    assert (small[0, 0] == 0).all()
    assert shrunk(pixels, 12, 18) is pixels


def test_shrinking_an_opaque_image_with_alpha_is_shrinking_its_colours():
    pixels = RNG.random((12, 18, 3), dtype=np.float32)
    opaque = np.dstack([pixels, np.ones((12, 18), np.float32)])
    np.testing.assert_allclose(shrunk(opaque, 5, 7)[:, :, :3], shrunk(pixels, 5, 7), atol=1e-6)
