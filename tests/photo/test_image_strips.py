"""Strips and tiles of a TIFF are read right or refused, in the memory that its header says."""

import tracemalloc
import zlib

import numpy as np
import pytest
from pictures import tiff_file
from test_image_planes import packed

from gauss2svg.errors import InputError
from gauss2svg.photo.load import header_of, load_image
from gauss2svg.photo.photo import Header
from gauss2svg.pipeline.memory_budget import check_decoding

WIDTH, HEIGHT = 1200, 800
SIZE = {"t256": WIDTH, "t257": HEIGHT, "t278": HEIGHT}
RGB = {**SIZE, "t262": 2, "t277": 3}
FLOATS = {"t339": [3] * 3}
LZW = 5


def zeros(bits: int) -> bytes:
    """The data of a plane, or of a picture of so many bits per px."""
    return bytes(WIDTH * HEIGHT * bits // 8)


def tiled(side: int, tile: int) -> bytes:
    """Grey with alpha of 16 bits."""
    data = zlib.compress(bytes(4 * tile * tile), 1)
    tags = {"t256": side, "t257": side, "t262": 1, "t277": 2, "t338": 2, "t258": [16, 16]}
    return tiff_file(data, t259=8, t322=tile, t323=tile, **tags)


@pytest.mark.parametrize(
    ("side", "tile", "most"),
    [(10, 1024, 1024), (10, 1040, 1024), (10, 4096, 1024), (1040, 2048, 2048), (1040, 2064, 2048)],
)
def test_a_tile_is_hardly_larger_than_its_picture(side, tile, most):
    file = tiled(side, tile)
    if tile <= most:
        assert load_image(file).pixels.shape == (side, side, 3)
        return
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=rf"at most {most}x{most} px.*got {tile}x{tile} px"):
            load_image(file)
        assert tracemalloc.get_traced_memory()[1] < 4e6 + len(file)
    finally:
        tracemalloc.stop()


PLANES = [np.full((4, 4), 3, np.uint8).tobytes() * 8] * 3
UNREAD = {
    "24-bit floats": {"t258": [24] * 3, **FLOATS},
    "24-bit numbers": {"t258": [24] * 3},
    "unequal bits": {"t258": [5, 6, 5]},
    "an unknown predictor": {"t258": [16] * 3, "t317": 5},
    "differences of 12 bits": {"t258": [12] * 3, "t317": 2},
    "differences of floats, of whole numbers": {"t258": [16] * 3, "t317": 3},
    "complex numbers": {"t258": [32] * 3, "t339": [5] * 3},
}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("name", UNREAD)
def test_what_is_not_read_right_is_refused(name, separate, order):
    strips = [zlib.compress(data) for data in (PLANES if separate else [b"".join(PLANES)])]
    tags = {"t256": 4, "t257": 4, "t259": 8, "t262": 2, "t277": 3, "t278": 4, "t284": 1 + separate}
    with pytest.raises(InputError, match="must be"):
        load_image(tiff_file(*strips, order=order, **tags, **UNREAD[name]))


def test_a_predictor_is_of_compressed_data_alone():
    tags = {"t256": 4, "t257": 4, "t259": 1, "t262": 2, "t277": 3, "t278": 4, "t258": [16] * 3}
    values = np.random.default_rng(0).integers(0, 65536, (3, 4, 4), dtype=np.uint16)
    for separate in (False, True):
        stored = values if separate else np.moveaxis(values, 0, -1)
        strips = [plane.tobytes() for plane in stored] if separate else [stored.tobytes()]
        photo = load_image(tiff_file(*strips, t284=1 + separate, t317=2, **tags))
        np.testing.assert_allclose(photo.pixels, np.moveaxis(values, 0, -1) / 65535, atol=1e-6)


KINDS = {
    "12 bits": lambda: tiff_file(zeros(36), t258=[12] * 3, t259=1, **RGB),
    "1 bit": lambda: tiff_file(*[zeros(1)] * 3, t258=[1] * 3, t259=1, t284=2, **RGB),
    "float64": lambda: tiff_file(zeros(192), t258=[64] * 3, t259=1, **RGB, **FLOATS),
    "float64 in planes": lambda: tiff_file(
        *[zeros(64)] * 3, t258=[64] * 3, t259=1, t284=2, **RGB, **FLOATS
    ),
    "float64, differences": lambda: tiff_file(
        zlib.compress(zeros(192)), t258=[64] * 3, t259=8, t317=3, **RGB, **FLOATS
    ),
    "float32, packed by Pillow": lambda: tiff_file(
        packed(np.zeros((HEIGHT, WIDTH, 3), np.float32), 3), t258=[32] * 3, t259=LZW, t317=3,
        **RGB, **FLOATS,
    ),
    "16 bits in planes, bits reversed": lambda: tiff_file(
        *[zeros(16)] * 3, t258=[16] * 3, t259=1, t284=2, t266=2, **RGB
    ),
    "float64 and alpha": lambda: tiff_file(
        zeros(256), t258=[64] * 4, t259=1, t262=2, t277=4, t338=2, t339=[3] * 4, **SIZE
    ),
    "premultiplied 16 bits in planes": lambda: tiff_file(
        *[zeros(16)] * 4, t258=[16] * 4, t259=1, t262=2, t277=4, t284=2, t338=1, **SIZE
    ),
    "premultiplied floats": lambda: tiff_file(
        zeros(128), t258=[32] * 4, t259=1, t262=2, t277=4, t338=1, t339=[3] * 4, **SIZE
    ),
    "inks of 16 bits": lambda: tiff_file(
        *[zeros(16)] * 4, t258=[16] * 4, t259=1, t262=5, t277=4, t284=2, **SIZE
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_decoding_takes_no_more_memory_than_its_header_says(name, monkeypatch):
    file = KINDS[name]()
    header = header_of(file)
    assert isinstance(header, Header)
    tracemalloc.start()
    try:
        photo = load_image(file)
        taken = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert photo.pixels.shape == (HEIGHT, WIDTH, 3)
    module = "gauss2svg.pipeline.memory_budget"
    monkeypatch.setattr(f"{module}.BASE", 0)
    monkeypatch.setattr(f"{module}.MARGIN", 1)
    with pytest.raises(InputError, match="a photo of 1200x800 px"):
        check_decoding(header, taken - 1)


def test_a_strip_is_part_of_what_decoding_takes():
    tags = {"t258": [64] * 3, "t259": 8, **FLOATS}
    data = zlib.compress(zeros(192))
    one = header_of(tiff_file(data, **tags, **RGB))
    parts = [zlib.compress(bytes(WIDTH * 24 * 8))] * 100
    many = header_of(tiff_file(*parts[:100], **tags, **{**RGB, "t278": 8}))
    assert one is not None
    assert many is not None
    assert one.part_bytes == 100 * many.part_bytes == WIDTH * HEIGHT * 24
