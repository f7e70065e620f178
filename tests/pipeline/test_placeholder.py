"""Laws of the placeholder of a photo: its keys, data URIs and HTML, and the bytes that it has."""

import base64
import html
from urllib.parse import unquote

import numpy as np
import pytest
from pictures import antialiased_badge
from PIL import ImageColor
from screens import drawn_in_pages

import gauss2svg
from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.placeholder import Placeholder
from gauss2svg.raster import rasterize
from gauss2svg.scene.areas import AreaCounts

pytestmark = pytest.mark.usefixtures("hasty")


@pytest.fixture
def picture():
    """A small photo."""
    y, x = np.mgrid[:24, :36] / 24
    return np.stack([x / 1.5, y, 0 * x], axis=-1)


def test_a_record_has_the_keys_of_sqip():
    found = Placeholder("<svg/>", 36, 24, "#888888", 1)
    record = found.record("one.png")
    assert {"content", "metadata"} == set(record)
    assert set(record["metadata"]) == {
        "filename", "originalWidth", "originalHeight", "width", "height", "type", "mimeType",
        "backgroundColor", "transparent", "dataURI", "dataURIBase64",
    }  # fmt: skip
    assert (record["metadata"]["width"], record["metadata"]["height"]) == (36, 24)
    assert record["content"] == found.inline


def test_the_placeholder_of_a_drawing_has_areas_if_they_are_closer():
    drawing = antialiased_badge(48)
    found = gauss2svg.placeholder(drawing, 600, bytes_of="data_uri")
    assert len(found.data_uri) <= 600
    assert psnr(rasterize(found.svg, 48, 48), drawing) > 26
    assert AreaCounts.of(gauss2svg.read_svg(found.svg).areas).areas > 0


@pytest.mark.parametrize(
    "svg",
    ['<svg title="50% of #1"><desc>it\'s "a" \u00e9\n</desc></svg>', '<svg viewBox="0 0 1 1"/>'],
)
def test_data_uris_decode_to_the_svg_and_are_whole(svg):
    found = Placeholder(svg, 1, 1, "#000", 0)
    head, _, body = found.data_uri.partition(",")
    assert head == "data:image/svg+xml"
    assert unquote(body).replace("'", '"') == svg.replace("'", '"')
    assert not set(body) & set('"#\n\t')
    assert body.isascii()
    assert base64.b64decode(found.data_uri_base64.partition(",")[2]).decode() == svg


def test_a_snippet_is_one_image_whose_attributes_are_whole():
    found = Placeholder("<svg/>", 4032, 3024, "#888888", 1)
    text = found.snippet('a&"b".png', alt="a <b>")
    assert text.startswith('<img src="a&amp;&quot;b&quot;.png" alt="a <b>" width="4032" ')
    style = text.partition('style="')[2].removesuffix('">')
    assert '"' not in style
    assert style.startswith("max-width:100%;height:auto;background:#888888 url(")
    # Where object-fit: cover crops the photo, the placeholder is cropped alike.
    assert f'url("{found.data_uri}") center/cover' in html.unescape(style)


def test_a_transparent_photo_loses_its_placeholder_when_it_has_come():
    found = Placeholder("<svg/>", 36, 24, "#888888", 1, transparent=True)
    text = found.snippet("a.png")
    assert text.endswith(""" onload="this.style.background='none'">""")
    assert f"background:{found.color}" not in text


def test_the_form_that_is_used_can_have_the_bytes(picture):
    found = gauss2svg.placeholder(picture, 700, bytes_of="data_uri_base64")
    assert len(found.data_uri_base64) <= 700
    assert found.gaussians > 0
    for given in ({"bytes_of": "gzip"}, {"max_bytes": "21k"}):
        with pytest.raises(InputError, match=f"{next(iter(given))} must be"):
            gauss2svg.placeholder(picture, **given)


def test_a_browser_draws_every_form_as_it_draws_the_svg_inline(picture, browser):
    """Every form looks as the SVG does, also below another inline file with the same names."""
    found, other = (gauss2svg.placeholder(picture, size) for size in (700, 1500))
    size = f"width:{found.width}px;height:{found.height}px"
    nothing = np.zeros((found.height, found.width, 4), np.float32)  # of the photo's proportions
    clear = "data:image/png;base64," + base64.b64encode(as_png(nothing)).decode()
    svg, *others = drawn_in_pages(
        [
            f'<div style="{size}">{found.svg}</div>',
            f'<div style="overflow:hidden;height:0">{other.inline}</div>'
            f'<div style="{size}">{found.inline}</div>',
            f'<img style="display:block;{size}" src="{found.data_uri_base64}">',
            found.snippet(clear),  # which has the other URI in its style sheet
        ],
        found.width,
        found.height,
    )
    assert svg.std() > 10
    assert max(np.abs(drawn - svg).mean() for drawn in others) < 3


def test_a_large_photo_has_the_placeholder_of_its_reduction_at_its_own_size():
    y, x = np.mgrid[:600, :900] / 600
    large = np.float32(np.stack([x / 1.5, y, np.sin(5 * x) / 2 + 0.5], -1))
    found = gauss2svg.placeholder(large, 500)
    assert (found.width, found.height) == (900, 600)
    mean = 255 * large.mean(axis=(0, 1))
    np.testing.assert_allclose(ImageColor.getrgb(found.color), mean, atol=9)  # short, as #8a7
    small = large[5::10, 5::10]
    assert np.mean((rasterize(found.svg, 90, 60) - small) ** 2) < 0.25 * small.var()
