"""Laws of the placeholder of a photo: its keys, data URIs and HTML, and the bytes that it has."""

import base64
import html
import io
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image, ImageColor
from screens import drawn_in_pages

import gauss2svg
from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.pipeline.placeholder import Placeholder
from gauss2svg.raster import rasterize

pytestmark = pytest.mark.usefixtures("hasty")


@pytest.fixture
def picture():
    """A small photo."""
    y, x = np.mgrid[:24, :36] / 24
    return np.stack([x / 1.5, y, 0 * x], axis=-1)


def test_a_record_has_the_keys_of_sqip(picture):
    found = gauss2svg.placeholder(picture, 400)
    record = found.record("one.png")
    metadata = record["metadata"]
    assert set(record) == {"content", "metadata"}
    assert set(metadata) == {
        "filename", "originalWidth", "originalHeight", "width", "height", "type", "mimeType",
        "backgroundColor", "transparent", "dataURI", "dataURIBase64",
    }  # fmt: skip
    assert (metadata["width"], metadata["height"]) == (36, 24)
    assert len(found.svg) <= 400
    assert found.gaussians > 0
    assert record["content"] == found.inline


def test_data_uris_decode_to_the_same_elements(picture):
    found = gauss2svg.placeholder(picture, 400)
    head, _, body = found.data_uri.partition(",")
    assert head == "data:image/svg+xml"
    assert unquote(body).replace("'", '"') == found.svg
    assert not set(body) & set('"#\n\t')
    assert body.isascii()
    assert base64.b64decode(found.data_uri_base64.partition(",")[2]).decode() == found.svg
    assert len(found.data_uri) < len(found.data_uri_base64)


def test_whatever_ends_a_data_uri_is_escaped():
    svg = '<svg title="50% of #1"><desc>it\'s "a" \u00e9\n</desc></svg>'
    found = Placeholder(svg, 1, 1, "#000", 0)
    body = found.data_uri.partition(",")[2]
    assert unquote(body) == svg
    assert not set(body) & set('"#\n')


def test_a_snippet_is_one_image_whose_attributes_are_whole():
    found = Placeholder("<svg/>", 4032, 3024, "#888888", 1)
    text = found.snippet('a&"b".png', alt="a <b>")
    assert text.startswith('<img src="a&amp;&quot;b&quot;.png" alt="a <b>" width="4032" ')
    style = text.partition('style="')[2].removesuffix('">')
    assert '"' not in style
    assert style.startswith("max-width:100%;height:auto;background:#888888 url(")
    assert f'url("{found.data_uri}")' in html.unescape(style)


def test_a_transparent_photo_loses_its_placeholder_when_it_has_come(picture):
    found = gauss2svg.placeholder(np.dstack([picture, picture[:, :, 0]]), 400)
    text = found.snippet("a.png")
    assert text.endswith(""" onload="this.style.background='none'">""")
    assert f"background:{found.color}" not in text


@pytest.mark.parametrize("form", ["inline", "data_uri", "data_uri_base64"])
def test_the_form_that_is_used_can_have_the_bytes(form, picture):
    limit = 460
    found = gauss2svg.placeholder(picture, limit, bytes_of=form)
    assert len(getattr(found, form)) <= limit
    assert found.gaussians > 0
    for given in ({"bytes_of": "gzip"}, {"max_bytes": "21k"}, {"max_bytes": "many"}):
        with pytest.raises(InputError, match=f"{next(iter(given))} must be"):
            gauss2svg.placeholder(picture, **given)


def test_a_browser_draws_every_form_as_it_draws_the_svg_inline(picture, browser):
    found = gauss2svg.placeholder(picture, 700)
    size = f"width:{found.width}px;height:{found.height}px"
    css = f'url("{found.data_uri}") 0 0/100% 100%'
    nothing = np.zeros((found.height, found.width, 4), np.float32)  # of the photo's proportions
    clear = "data:image/png;base64," + base64.b64encode(as_png(nothing)).decode()
    bodies = {
        "inline": f'<div style="{size}">{found.svg}</div>',
        "plain": f'<img style="display:block;{size}" src="{found.data_uri}">',
        "base64": f'<img style="display:block;{size}" src="{found.data_uri_base64}">',
        "css": f"<style>div{{{size};background:{css}}}</style><div>",
        "snippet": found.snippet(clear),
    }
    inline, *others = drawn_in_pages(bodies.values(), found.width, found.height)
    assert inline.std() > 10
    for name, picture in zip([*bodies][1:], others, strict=True):
        assert np.abs(picture - inline).mean() < 3, name


def test_files_inline_in_one_page_keep_their_own_shapes(picture, browser):
    first, second = (gauss2svg.placeholder(picture, size) for size in (1000, 2500))
    assert first.svg.count('id="a"') == second.svg.count('id="a"') == 1
    box = '<div style="width:72px;height:48px{}">{}</div>'
    bodies = [
        before + box.format("", second.inline)
        for before in ("", box.format(";overflow:hidden;height:0", first.inline))
    ]
    alone, together = drawn_in_pages(bodies, 72, 48)
    assert np.abs(alone - together).max() <= 1


def test_a_large_photo_has_the_placeholder_of_its_reduction_at_its_own_size():
    y, x = np.mgrid[:600, :900] / 600
    large = np.uint8(np.stack([x / 1.5, y, np.sin(5 * x) / 2 + 0.5], axis=-1) * 255)
    file = io.BytesIO()
    Image.fromarray(large).save(file, "JPEG", quality=95)
    found = gauss2svg.placeholder(file.getvalue(), 500)
    small = gauss2svg.placeholder(
        np.asarray(Image.fromarray(large).resize((640, 427), Image.Resampling.BOX)), 500
    )
    assert (found.width, found.height) == (900, 600)
    assert (small.width, small.height) == (640, 427)
    one, other = (np.array(ImageColor.getrgb(p.color)) for p in (found, small))
    assert np.abs(one - other).max() <= 1
    assert len(found.svg) <= 500
    photo = np.asarray(Image.fromarray(large).resize((90, 60), Image.Resampling.BOX)) / 255
    one, other = (np.mean((rasterize(p.svg, 90, 60) - photo) ** 2) for p in (found, small))
    assert one < 1.2 * other < photo.var()
