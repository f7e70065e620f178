"""Laws of placeholders: keys, data URIs, and what one bad photo of many costs."""

import base64
import errno
import html
import io
import json
import os
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image, ImageColor
from screens import drawn_in_pages

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.cli.signals import Terminated
from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.pipeline.placeholder import Placeholder, PlaceholderList
from gauss2svg.raster import rasterize

pytestmark = pytest.mark.usefixtures("hasty")


@pytest.fixture
def photos(tmp_path):
    """Two photos, their folder, and one that is none."""
    y, x = np.mgrid[:24, :36] / 24
    made = []
    for name, turn in (("one", 0.0), ("two words", 1.0)):
        path = tmp_path / f"{name}.png"
        path.write_bytes(as_png(np.stack([x / 1.5, y, 0 * x + turn], axis=-1)))
        made.append(str(path))
    bad = tmp_path / "bad.png"
    bad.write_bytes(b"no picture")
    return [*made, str(bad)]


def test_a_record_has_the_keys_of_sqip(photos):
    found = gauss2svg.placeholder(photos[0], 400)
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


def test_data_uris_decode_to_the_same_elements(photos):
    found = gauss2svg.placeholder(photos[0], 400)
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


def test_a_transparent_photo_loses_its_placeholder_when_it_has_come(photos):
    with Image.open(photos[0]) as picture:
        picture.putalpha(Image.linear_gradient("L").resize(picture.size))
        found = gauss2svg.placeholder(picture, 400)
    text = found.snippet("a.png")
    assert text.endswith(""" onload="this.style.background='none'">""")
    assert f"background:{found.color}" not in text


@pytest.mark.sweep
def test_the_page_names_photos_by_their_address_from_its_folder(photos, tmp_path, capsys):
    odd = tmp_path / "a #1 50%?\n.png"
    odd.write_bytes(Path(photos[0]).read_bytes())
    strange = os.fsencode(tmp_path) + b"/caf\xe9.png"
    Path(os.fsdecode(strange)).write_bytes(odd.read_bytes())
    page = tmp_path / "pages" / "page.html"
    command = ["placeholder", str(odd), os.fsdecode(strange), "--max-bytes", "300", "-o", str(page)]
    assert main([*command, "--format", "html"]) == 0
    sources = [line.split('"')[1] for line in page.read_text().splitlines()]
    assert sources == ["../a%20%231%2050%25%3F%0A.png", "../caf%E9.png"]
    assert main([*command[:-1], str(tmp_path / "all.json")]) == 0
    assert len(json.loads((tmp_path / "all.json").read_text())) == 2
    capsys.readouterr()


@pytest.mark.parametrize("form", ["json", "object", "html", "picture", "svg"])
def test_where_every_photo_fails_nothing_is_written(form, photos, tmp_path, capfdbinary):
    output = tmp_path / ("bad" if form == "svg" else "placeholders")
    file = output / "bad.svg" if form == "svg" else output
    if form == "svg":
        output.mkdir()
    earlier = {
        "json": "[]", "object": "{}", "html": '<img src="a.png">',
        "picture": '<picture><img src="a.png"></picture>', "svg": "of an earlier run",
    }[form]  # fmt: skip
    file.write_text(earlier)
    command = ["placeholder", photos[-1], "--format", form]
    assert main([*command, "-o", str(output)]) == 1
    assert file.read_text() == earlier
    assert main([*command[:1], photos[0], *command[2:], "--max-bytes", "20"]) == 1
    out, err = capfdbinary.readouterr()
    assert out == b""
    assert b"--max-bytes must be at least" in err
    assert err.count(b"1 failed, and nothing was written") == 2


@pytest.mark.parametrize("form", ["json", "html"])
def test_a_photo_that_fails_keeps_the_entry_that_it_had(form, photos, tmp_path, capsys, counted):
    output = tmp_path / "placeholders"
    command = ["placeholder", *photos, "--max-bytes", "300", "--format", form, "-o", str(output)]
    main(command)
    before = output.read_text()
    Path(photos[0]).write_bytes(b"no picture any more")
    assert main(command) == 1
    assert output.read_text() == before
    assert "2 failed; 1 of them kept from before" in capsys.readouterr().err
    # What is not asked for any more is not kept.
    assert main([*command[:1], *command[2:]]) == 1
    assert len(output.read_text()) < len(before)


FOREIGN = {
    "json": [b"no JSON", b"", b"[1]", b"{}", b"{", b'{"a": 1}', b'[{"metadata": 1}]',
             b"[" * 100_000, b'["\xff"]'],
    "object": [b"no JSON", b"[]", b'{"a": 1}', b'{"a": {"metadata": {}}}'],
    "html": [b"", b"<p>mine</p>", b'<img src="a.png">\n<p>mine</p>', b'<img src="\xff">'],
}  # fmt: skip


@pytest.mark.parametrize("form", FOREIGN)
def test_a_file_that_is_no_list_of_placeholders_is_kept_and_said_before_any_work(
    form, photos, tmp_path, capsys, counted, monkeypatch
):
    output = tmp_path / "placeholders"
    command = ["placeholder", photos[0], "--max-bytes", "300", "--format", form, "-o", str(output)]

    def refuses(reason):
        assert main(command) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert reason in line
        assert "Try another name" in line

    with monkeypatch.context() as patch:
        # None of the photos is looked at.
        patch.setattr("gauss2svg.pipeline.placeholder.placeholder", pytest.fail)
        for data in FOREIGN[form]:
            output.write_bytes(data)
            refuses(f"--output must be a file of placeholders in {form}, or none yet")
            assert output.read_bytes() == data
        opened = os.open

        def denied(path, flags, *given, **named):
            if path == str(output) and not flags & (os.O_WRONLY | os.O_RDWR):
                raise PermissionError(errno.EACCES, "Permission denied")
            return opened(path, flags, *given, **named)

        patch.setattr(os, "open", denied)
        refuses("Permission denied")
    output.unlink()
    assert main(command) == 0
    assert main(command) == 0  # its own file is one


ODD_NAMES = [
    "two  spaces.png",
    "no\u00a0break.png",
    "family \U0001f468\u200d\U0001f469.png",
    "a\tb.png",
]


@pytest.fixture
def counted(monkeypatch):
    """The photos of which placeholders are made, which are all one."""
    asked = []
    one = Placeholder("<svg/>", 36, 24, "#888888", 1)

    def made(path, *_, **__):
        if Path(path).read_bytes().startswith(b"no picture"):
            raise InputError("photo must be a supported image")
        asked.append(Path(path).name)
        return one

    monkeypatch.setattr("gauss2svg.pipeline.placeholder.placeholder", made)
    return asked


@pytest.mark.parametrize("form", ["json", "object"])
def test_what_has_not_changed_is_kept_and_found_by_its_path(
    form, photos, tmp_path, capsys, counted, monkeypatch
):
    deep = tmp_path / "deep"
    deep.mkdir()
    Path(photos[2]).unlink()
    output = tmp_path / "made" / "placeholders"
    command = ["placeholder", str(tmp_path), "--format", form, "-o", str(output)]
    assert main(command) == 0
    assert sorted(counted) == ["one.png", "two words.png"]
    records = json.loads(output.read_text())
    entries = records if form == "object" else {r["metadata"]["path"]: r for r in records}
    assert list(entries) == ["../one.png", "../two words.png"]
    written = output.stat()
    assert main(command) == 0
    assert len(counted) == 2
    assert output.stat().st_ino == written.st_ino  # not even written anew
    assert "2 of them unchanged" in capsys.readouterr().err
    # Of bytes, of the limit and of the version.
    Path(photos[0]).write_bytes(Path(photos[1]).read_bytes())
    (deep / "one.png").write_bytes(Path(photos[0]).read_bytes())
    assert main(command) == 0
    assert sorted(counted[2:]) == ["one.png"] * 2
    assert main([*command, "--max-bytes", "500"]) == 0
    assert len(counted) == 7
    monkeypatch.setattr("gauss2svg.pipeline.placeholder.__version__", "0")
    assert main([*command, "--max-bytes", "500"]) == 0
    assert len(counted) == 10
    # From a root of one's own.
    assert main([*command, "--root", str(tmp_path)]) == 0
    paths = ["one.png", "two words.png", "deep/one.png"]
    records = json.loads(output.read_text())
    found = records.values() if form == "object" else records
    assert [record["metadata"]["path"] for record in found] == paths
    capsys.readouterr()


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt, 130), (Terminated, 143)])
def test_what_was_made_before_an_interrupt_is_written_and_kept(
    error, status, photos, tmp_path, capsys, counted, monkeypatch
):
    made = gauss2svg.pipeline.placeholder.placeholder

    def interrupted(path, *given, **named):
        if Path(path).name != "one.png":
            raise error
        return made(path, *given, **named)

    output = tmp_path / "made.json"
    command = ["placeholder", *photos[:2], "-o", str(output)]
    monkeypatch.setattr("gauss2svg.pipeline.placeholder.placeholder", interrupted)
    assert main(command) == status
    assert [one["metadata"]["path"] for one in json.loads(output.read_text())] == ["one.png"]
    monkeypatch.setattr("gauss2svg.pipeline.placeholder.placeholder", made)
    assert main(command) == 0
    assert counted == ["one.png", "two words.png"]
    # Standard output is written whole or not at all.
    monkeypatch.setattr("gauss2svg.pipeline.placeholder.placeholder", interrupted)
    assert main(command[:-2]) == status
    assert capsys.readouterr().out == ""


def test_a_picture_offers_the_better_files_of_its_name(photos, tmp_path, capsys, counted):
    for name in ("one.webp", "one.avif", "two words.avif", "alone.avif"):
        (tmp_path / name).write_bytes(Path(photos[0]).read_bytes() + name.encode())
    Path(photos[2]).unlink()
    page = tmp_path / "page.html"
    assert main(["placeholder", str(tmp_path), "--format", "picture", "-o", str(page)]) == 0
    alone, one, two = page.read_text().splitlines()
    assert alone.startswith('<picture><img src="alone.avif"')
    avif, webp = (f'<source srcset="one.{kind}" type="image/{kind}">' for kind in ("avif", "webp"))
    assert one.startswith(f'<picture>{avif}{webp}<img src="one.png"')
    assert one.endswith("></picture>")
    assert two.startswith(
        '<picture><source srcset="two%20words.avif" type="image/avif"><img src="two%'
    )
    capsys.readouterr()


@pytest.mark.parametrize("form", ["inline", "data_uri", "data_uri_base64"])
def test_the_form_that_is_used_can_have_the_bytes(form, photos):
    limit = 460
    found = gauss2svg.placeholder(photos[0], limit, bytes_of=form)
    assert len(getattr(found, form)) <= limit
    assert found.gaussians > 0
    for given in ({"bytes_of": "gzip"}, {"max_bytes": "21k"}, {"max_bytes": "many"}):
        with pytest.raises(InputError, match=f"{next(iter(given))} must be"):
            gauss2svg.placeholder(photos[0], **given)


def test_names_in_the_list_are_those_of_the_files(photos, tmp_path, capsys, counted):
    strange = [*ODD_NAMES, os.fsdecode(b"caf\xe9.png")]
    for name in strange:
        (tmp_path / name).write_bytes(Path(photos[0]).read_bytes() + name[:3].encode())
    output = tmp_path / "placeholders.json"
    given = [str(tmp_path / name) for name in strange]
    assert main(["placeholder", *given, "--max-bytes", "300", "-o", str(output)]) == 0
    records = json.loads(output.read_text())
    assert [record["metadata"]["filename"] for record in records] == strange
    capsys.readouterr()


def test_one_bad_photo_of_many_costs_only_itself(photos, tmp_path, capsys):
    output = tmp_path / "placeholders.json"
    given = [*photos, photos[0], str(tmp_path / "none.png")]
    assert main(["placeholder", *given, "--max-bytes", "300", "-o", str(output)]) == 1
    records = json.loads(output.read_text())
    assert [r["metadata"]["filename"] for r in records] == ["one.png", "two words.png"]
    lines = capsys.readouterr().err.splitlines()
    assert sum("bad.png" in line for line in lines) == 1
    assert sum("none.png" in line for line in lines) == 1
    assert sum("more than once" in line for line in lines) == 1


def test_files_are_named_by_their_photos(photos, tmp_path, capsys, counted):
    folder = tmp_path / "new" / "folder"
    assert main(["placeholder", *photos[:2], "--format", "svg", "--quiet", "-o", str(folder)]) == 0
    assert sorted(p.name for p in folder.iterdir()) == ["one.svg", "two-words.svg"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("one.png -o one.png", "output must be a file of its own"),
        ("one.png bad.png --format svg", "--output must be given for several SVGs"),
        ("one.png --format svg -o one.svg", "--output must be a folder"),
        ("one.png --max-bytes 21k", "--max-bytes must be at most 20000"),
        ("one.png --max-bytes 0", "--max-bytes must be a size"),
        ("one.png --bytes-of gzip", "--bytes-of"),
    ],
)
def test_what_cannot_be_written_is_refused(words, line, photos, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert line in refusal("placeholder", *words.split())
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_browser_draws_every_form_as_it_draws_the_svg_inline(photos, browser):
    found = gauss2svg.placeholder(photos[0], 700)
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


def test_files_inline_in_one_page_keep_their_own_shapes(photos, browser):
    first, second = (gauss2svg.placeholder(photos[0], size) for size in (1000, 2500))
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


def test_a_list_that_goes_while_placeholders_are_made_is_written_anew(
    photos, tmp_path, monkeypatch
):
    """As where a build empties its folder."""
    output = tmp_path / "o.json"
    command = ["placeholder", *photos[:1], "-o", str(output), "--max-bytes", "300", "--quiet"]
    assert main(command) == 0
    listed = output.read_bytes()
    files = PlaceholderList.files

    def gone(listed):
        output.unlink()
        return files(listed)

    monkeypatch.setattr(PlaceholderList, "files", gone)
    assert main(command) == 0
    assert output.read_bytes() == listed
