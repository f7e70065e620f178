"""Laws of the document: names, physical size, parts, packing."""

import gzip
import io
import json
import re
from xml.etree.ElementTree import fromstring as parse

import numpy as np
import pytest
from conftest import random_scene
from flat import vectorize
from PIL import Image
from svg_texts import assert_same

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.photo.load import load_image
from gauss2svg.raster import rasterize
from gauss2svg.scene import Scene
from gauss2svg.svg.document import DEFAULT_TITLE, Document, SvgFormat
from gauss2svg.svg.file import bytes_by_part, file_bytes
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

SVG = "{http://www.w3.org/2000/svg}"
QUICK = {"gaussians": 60, "iterations": 30}
QUICK_OPTIONS = ["--gaussians", "60", "--iterations", "30", "--quiet"]
SCENE = random_scene(30, 60, 45, 7)


@pytest.fixture
def picture(photo, tmp_path):
    path = tmp_path / "photo.png"
    Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8)).save(path, dpi=(96, 96))
    return path


def test_default_names_include_the_count():
    root = parse(write_svg(SCENE))
    assert root.get("role") == "img"
    assert root[0].text == DEFAULT_TITLE
    assert (root[1].text or "").startswith("30 Gaussians, fitted and written by gauss2svg ")


def test_background_and_rounds_have_ids_of_their_own():
    scene = random_scene(2000, seed=3)
    root = parse(write_svg(scene))
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    assert root.find(SVG + "rect").get("id") == "background"
    assert [g.get("id") for g in root.findall(SVG + "g")] == ["round-1", "round-2", "round-3"]
    assert not any(circle.get("id") for circle in root.iter(SVG + "circle"))


def test_rounds_that_draw_nothing_have_no_group_and_change_no_other_id():
    scene = SCENE.replace(opacity=np.where(SCENE.round_index == 1, 0.0, SCENE.opacity))
    root = parse(write_svg(scene, document=Document(animate=2)))
    assert [g.get("id") for g in root.findall(SVG + "g")] == ["round-1", "round-3"]
    assert re.findall(r"#(round-\d)\{", root.findtext(SVG + "style") or "") == [
        "round-1", "round-3",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("size", "width", "height"),
    [
        ("120mm", "120mm", "90mm"),
        ("5in", "5in", "3.75in"),
        ("300px", "300px", "225px"),
        ("10.50cm", "10.5cm", "7.875cm"),
        (".5pt", "0.5pt", "0.375pt"),
        ("1000pc", "1000pc", "750pc"),
    ],
)
def test_size_has_its_unit_and_the_proportions(size, width, height):
    document = Document(size=size, aspect="xMinYMid slice")
    text = write_svg(SCENE, document=document)
    root = parse(text)
    assert (root.get("width"), root.get("height")) == (width, height)
    assert root.get("preserveAspectRatio") == "xMinYMid slice"
    assert (rasterize(text, 60, 45) == rasterize(write_svg(SCENE), 60, 45)).all()
    assert_same(read_svg(text), read_svg(write_svg(SCENE)))


def test_canvas_is_given_in_px_only_where_the_size_does_not_give_it():
    assert "data-canvas" not in write_svg(SCENE)
    assert 'data-canvas="60 45"' in write_svg(SCENE, document=Document(size="9cm"))
    assert "preserveAspectRatio" not in write_svg(SCENE)


@pytest.mark.parametrize("markup", ["editable", "minimal"])
def test_a_responsive_file_has_proportions_and_no_size(markup):
    text = write_svg(SCENE, SvgFormat(markup=markup), Document(size="responsive"))
    head = text[text.index("<svg") : text.index(">", text.index("<svg"))]
    assert " viewBox=" in head
    assert " width=" not in head
    assert " height=" not in head
    width, height = (read_svg(text).width, read_svg(text).height)
    assert width / height == pytest.approx(60 / 45, rel=1e-3)
    assert markup == "minimal" or (width, height) == (60, 45)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"title": ""}, "title must be text that is not empty; got ''"),
        ({"title": "a\x0bb"}, "title must be text of UTF-8 without control characters"),
        ({"title": "\udcff"}, "title must be text of UTF-8 without control characters"),
        ({"alt": " "}, "alt must be .*; got ' '"),
        ({"alt": "a\nb"}, "alt must be text of UTF-8 without control characters"),
        ({"size": "120"}, "size must be .*; got '120'"),
        ({"size": "0mm"}, "size must be .*; got '0mm'"),
        ({"size": "-3in"}, "size must be .*; got '-3in'"),
        ({"size": "1e3mm"}, "size must be .*; got '1e3mm'"),
        ({"size": "9999999mm"}, "size must be .*; got '9999999mm'"),
        ({"size": "3em"}, "size must be .*; got '3em'"),
        ({"size": 3}, "size must be .*; got 3"),
        ({"aspect": "xMidYMid cover"}, "aspect must be .*; got 'xMidYMid cover'"),
        ({"aspect": "xmidymid"}, "aspect must be .*; got 'xmidymid'"),
        ({"aspect": 'none" onload="'}, "aspect must be .*; got 'none"),
    ],
)
def test_document_that_cannot_be_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        Document(**change)


@pytest.mark.parametrize(
    "name", ["jfif.jpg", "jfif.cm", "exif.jpg", "phys.png", "tiff.tif", "turned.jpg"]
)
def test_physical_size_is_that_of_the_photos_tag(name, photo):
    picture = Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8))
    stream, exif, width = io.BytesIO(), Image.Exif(), 64
    exif[0x011A], exif[0x011B], exif[0x0128] = 50.0, 50.0, 3  # an inch is 127 px
    if name in ("jfif.jpg", "jfif.cm"):
        picture.save(stream, "JPEG", dpi=(127, 127))
        if name == "jfif.cm":  # 50 a centimetre, as the header's unit 2 says
            inches, metric = b"JFIF\0\1\1\1\0\x7f\0\x7f", b"JFIF\0\1\1\2\0\x32\0\x32"
            assert inches in stream.getvalue()
            stream = io.BytesIO(stream.getvalue().replace(inches, metric))
    elif name == "exif.jpg":
        picture.save(stream, "JPEG", exif=exif)
    elif name == "turned.jpg":
        exif[0x0112], width = 6, 48
        picture.save(stream, "JPEG", exif=exif)
    else:
        picture.save(stream, "PNG" if name == "phys.png" else "TIFF", dpi=(127, 127))
    result = vectorize(stream.getvalue(), size="photo", **QUICK)
    root = parse(result.svg)
    assert float(root.get("width", "").removesuffix("mm")) == pytest.approx(width / 5, abs=0.002)
    assert result.report["size"] == result.document.size == root.get("width")


@pytest.mark.parametrize("form", ["PNG", "JPEG", "TIFF", "WEBP", "BMP", "exif"])
def test_photo_without_a_resolution_has_no_physical_size(form, photo):
    stream, exif = io.BytesIO(), Image.Exif()
    exif[0x010F] = "a camera"
    picture = Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8))
    given = {"exif": exif} if form == "exif" else {}
    picture.save(stream, "JPEG" if form == "exif" else form, **given)
    if form == "BMP":
        data = bytearray(stream.getvalue())
        data[38:46] = bytes(8)  # Pillow writes 96 dpi by itself
        stream = io.BytesIO(bytes(data))
    assert load_image(stream.getvalue()).dpi is None
    with pytest.raises(InputError, match=r"size must be .* resolution tag; got 'photo'"):
        vectorize(stream.getvalue(), size="photo", **QUICK)


def test_resolution_turns_with_the_photo(photo):
    exif, found = Image.Exif(), []
    exif[0x011A], exif[0x011B], exif[0x0128] = 100.0, 200.0, 2
    picture = Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8))
    for turn in (1, 3, 6, 8):
        exif[0x0112], stream = turn, io.BytesIO()
        picture.save(stream, "JPEG", exif=exif)
        found.append(load_image(stream.getvalue()).dpi)
    assert found == [(100, 200), (100, 200), (200, 100), (200, 100)]


def test_pixels_that_are_not_square_have_no_physical_size(photo):
    stream = io.BytesIO()
    picture = Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8))
    picture.save(stream, "PNG", dpi=(300, 150))
    with pytest.raises(InputError, match="not square"):
        vectorize(stream.getvalue(), size="photo", **QUICK)


def test_bytes_by_part_are_those_of_the_elements_and_sum_to_all():
    text = write_svg(
        SCENE, document=Document(title="<circle r='1'/> größe <defs></defs>", animate=3)
    )
    parts = bytes_by_part(text)
    assert sum(parts.values()) == len(text.encode())
    less = write_svg(SCENE.select(slice(0, 29)), SvgFormat())
    more = write_svg(SCENE, SvgFormat())
    circle = re.findall("<circle[^>]*>", more)
    assert bytes_by_part(more)["geometry"] == sum(map(len, circle))
    defs = more[more.index("<defs>") : more.index("</defs>") + len("</defs>")]
    assert bytes_by_part(more)["gradients"] == len(defs)
    assert bytes_by_part(more)["overhead"] == bytes_by_part(less)["overhead"]
    assert bytes_by_part(write_svg(Scene(4, 4)))["geometry"] == 0


def test_options_of_the_document_reach_the_file_and_its_report(picture, tmp_path):
    out, report = tmp_path / "o.svg", tmp_path / "r.json"
    options = ["--title", "T & U", "--alt", "what is seen", "--size", "photo", "--animate", "4"]
    options += ["--aspect", "none", "--fragments", "--report", str(report)]
    assert main([str(picture), "-o", str(out), *options, *QUICK_OPTIONS]) == 0
    root, written = parse(out.read_text()), json.loads(report.read_text())
    assert (
        [root[0].text, root[1].text]
        == ["T & U", "what is seen"]
        == [written["title"], written["alt"]]
    )
    assert root.get("preserveAspectRatio") == written["aspect"] == "none"
    assert float(root.get("width", "")[:-2]) == pytest.approx(64 / 96 * 25.4, abs=0.01)
    assert "@keyframes" in root.findtext(SVG + "style", "")
    assert ":target" in root.findtext(SVG + "style", "")
    assert (written["animate"], written["fragments"]) == (4, True)
    assert written["bytes_by_part"] == bytes_by_part(out.read_text())
    assert written["gzip"] is False


def test_document_changes_no_shape(photo):
    plain = vectorize(photo, seed=0, **QUICK)
    document = {"title": "x", "alt": "y", "size": "9cm", "aspect": "none", "animate": 2.0}
    document["fragments"] = True
    other = vectorize(photo, seed=0, **QUICK, **document)
    circles = [re.findall("<circle[^>]*>", result.svg) for result in (plain, other)]
    assert circles[0] == circles[1]
    assert (plain.raster == other.raster).all()


@pytest.mark.parametrize("name", ["o.svgz", "o.SVGZ"])
def test_extension_gzips_without_a_date(name, picture, tmp_path, drawn_here):
    out, plain, report = tmp_path / name, tmp_path / "p.svg", tmp_path / "r.json"
    reported = ["--report", str(report)]
    assert main([str(picture), "-o", str(out), *QUICK_OPTIONS, *reported]) == 0
    assert main([str(picture), "-o", str(plain), *QUICK_OPTIONS]) == 0
    data = out.read_bytes()
    assert gzip.decompress(data) == plain.read_bytes()
    assert data[4:8] == bytes(4)
    assert json.loads(report.read_text())["svgz_bytes"] == len(data)
    assert_same(read_svg(out), read_svg(plain))
    assert main(["check", str(picture), str(out), "--quiet"]) == 0


def test_gzip_is_an_option_too_and_of_streams(picture, tmp_path, capfdbinary):
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), "--gzip", *QUICK_OPTIONS]) == 0
    assert main([str(picture), "-o", "-", "--gzip", *QUICK_OPTIONS]) == 0
    assert capfdbinary.readouterr().out == (tmp_path / "o.svg").read_bytes()
    assert (tmp_path / "o.svg").read_bytes()[:2] == b"\x1f\x8b"


def test_result_is_saved_by_its_extension_or_as_given(photo, tmp_path):
    result = vectorize(photo, **QUICK)
    plain, packed = (file_bytes(result.svg, gzipped) for gzipped in (False, True))
    for name, given, expected in (
        ("a.svg", None, plain), ("a.svgz", None, packed),
        ("b.svg", True, packed), ("b.svgz", False, plain),
    ):  # fmt: skip
        result.save(tmp_path / name, gzip=given)
        assert (tmp_path / name).read_bytes() == expected
    assert len(packed) == result.report["svgz_bytes"]
    for name in ("a.png", "a.tar.gz", "folder/"):
        with pytest.raises(InputError, match="path must be "):
            result.save(f"{tmp_path}/{name}")
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.sweep
def test_maximum_size_is_that_of_the_gzipped_file(photo, tmp_path):
    result = vectorize(photo, max_bytes=9000, gzip=True, iterations=60)
    result.save(tmp_path / "o.svg")
    assert 7500 < (tmp_path / "o.svg").stat().st_size == result.report["svgz_bytes"] <= 9000
    assert result.report["svg_bytes"] > 20000
    assert result.report["stop_reason"] == "max_bytes"
    assert not result.report["unreached"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "12"], "size must be a width above 0 with its unit"),
        (["--size", "12mm", "--aspect", "middle"], "aspect must be none or such as xMidYMid"),
        (["--title", ""], "title must be text that is not empty; got ''"),
        (["--animate", "soon"], "soon"),
        (["--outline", "OUT"], "is also another output"),
        (["--outline", "PHOTO"], "is also the photo"),
    ],
)
def test_bad_document_is_one_line_status_two_and_no_file(
    options, message, picture, tmp_path, capsys
):
    before = sorted(tmp_path.iterdir())
    names = {"PHOTO": picture, "OUT": tmp_path / "o.svg"}
    given = [str(names.get(option, option)) for option in options]
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *given]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err
    assert sorted(tmp_path.iterdir()) == before
