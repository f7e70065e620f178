"""Properties of the document: names, sizes, layers, style sheets, parts and packing."""

import gzip
import io
import json
import re
from xml.etree.ElementTree import fromstring as parse
from xml.etree.ElementTree import tostring

import numpy as np
import pytest
from conftest import needs
from flat import vectorize
from PIL import Image
from scenes import random_areas, random_scene
from screens import captured, chromium
from svg_texts import assert_same

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.raster import rasterize
from gauss2svg.svg import DEFAULT_TITLE, Document, SvgFormat
from gauss2svg.svg.encode import outline_svg
from gauss2svg.svg.file import bytes_by_part, file_bytes, is_own
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

SVG = "{http://www.w3.org/2000/svg}"
ROOT = 'xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"'
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
QUICK = {"gaussians": 20, "iterations": 6}
QUICK_OPTIONS = ["--gaussians", "20", "--iterations", "6"]
SCENE = random_scene(30, 60, 45, 7)
PLAIN = write_svg(SCENE)


def test_a_file_has_its_size_names_background_and_a_layer_for_each_round_that_draws():
    scene = random_scene(300, 70, 50, seed=3)
    scene = scene.replace(opacity=np.where(scene.round_index == 1, 0.0, 1.0))
    root = parse(write_svg(scene, document=Document(animate=2)))
    assert (root.get("width"), root.get("height"), root.get("role")) == ("70", "50", "img")
    assert root.get("viewBox") == "0 0 1750 1250"  # of 0.04 px
    shapes = len(root.findall(f".//{SVG}g/{SVG}circle"))
    assert root[0].text == DEFAULT_TITLE
    assert root[1].text.startswith(f"{shapes} Gaussians, fitted and written by gauss2svg ")
    layers = list(root.iter(SVG + "g"))
    assert [g.get("id") for g in layers] == ["round-1", "round-3"]
    assert [g.get(INKSCAPE + "groupmode") for g in layers] == ["layer"] * 2
    assert re.findall(r"#(round-\d)\{", root.findtext(SVG + "style")) == ["round-1", "round-3"]
    for gradient in root.iter(SVG + "radialGradient"):  # resvg is 13 dB worse without the focus
        assert float(gradient.get("fx")) / float(gradient.get("r")) == 0.001
    fills = {circle.get("fill", "") for circle in root.iter(SVG + "circle")}
    used = {fill[5:-1] for fill in fills if not fill.startswith("#")}
    assert used == {gradient.get("id") for gradient in root.iter(SVG + "radialGradient")}
    layers = list(parse(PLAIN).iter(SVG + "g"))
    assert [len(g) for g in layers] == np.bincount(SCENE.round_index).tolist()


@pytest.mark.parametrize(("count", "text"), [(1, "1 Gaussian"), (1200, "1,200 Gaussians")])
def test_a_file_counts_its_gaussians_in_words(count, text):
    scene = random_scene(count).replace(opacity=np.ones(count), round_index=np.zeros(count, int))
    root = parse(write_svg(scene))
    assert root[1].text.startswith(f"{text}, fitted and written by")
    assert [g.get(INKSCAPE + "label") for g in root.iter(SVG + "g")] == [f"Round 1: {text}"]
    assert text in repr(scene)


@pytest.mark.parametrize(
    ("size", "sides"),
    [
        ("120mm", ("120mm", "90mm")), ("10.50cm", ("10.5cm", "7.875cm")),
        (".5pt", ("0.5pt", "0.375pt")), ("1000pc", ("1000pc", "750pc")),
        ("responsive", (None, None)),
    ],
)  # fmt: skip
def test_size_has_its_unit_and_the_proportions(size, sides):
    document = Document(size=size, aspect="xMinYMid slice")
    text = write_svg(SCENE, document=document)
    root = parse(text)
    assert (root.get("width"), root.get("height")) == sides
    assert root.get("preserveAspectRatio") == "xMinYMid slice"
    assert root.get("data-canvas") == "60 45"
    assert (rasterize(text, 60, 45) == rasterize(PLAIN, 60, 45)).all()
    assert_same(read_svg(text), read_svg(PLAIN))
    minimal = read_svg(write_svg(SCENE, SvgFormat(markup="minimal"), document))
    assert minimal.width / minimal.height == pytest.approx(60 / 45, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"title": ""}, "title must be text that is not empty; got ''"),
        ({"title": "\udcff"}, "title must be text of UTF-8 without control characters"),
        ({"alt": " "}, "alt must be .*; got ' '"),
        ({"alt": "a\nb"}, "alt must be text of UTF-8 without control characters"),
        *(({"size": size}, f"size must be .*; got {size!r}") for size in ("120", "0mm", 3)),
        ({"aspect": 'none" onload="'}, "aspect must be none or such as xMidYMid"),
    ],
)  # fmt: skip
def test_document_that_cannot_be_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        Document(**change)


def test_options_of_the_document_reach_the_file_and_its_report_and_change_no_shape(
    picture, tmp_path
):
    out, report = tmp_path / "o.svgz", tmp_path / "r.json"
    options = ["--title", "T & U", "--alt", "seen", "--size", "photo", "--animate", "4"]
    options += ["--aspect", "none", "--fragments", "--report", str(report), *QUICK_OPTIONS]
    assert main([str(picture), "-o", str(out), *options]) == 0
    data = out.read_bytes()
    svg, written = gzip.decompress(data).decode(), json.loads(report.read_text())
    root = parse(svg)
    assert [root[0].text, root[1].text] == ["T & U", "seen"]
    assert (root.get("preserveAspectRatio"), root.get("width")) == ("none", written["size"])
    assert float(written["size"].removesuffix("mm")) == pytest.approx(64 / 96 * 25.4, abs=0.01)
    assert re.search(":target.*@keyframes", root.findtext(SVG + "style"))
    assert (written["bytes_by_part"], written["svgz_bytes"]) == (bytes_by_part(svg), len(data))
    assert data[4:8] == bytes(4)  # no date
    plain = vectorize(picture, **QUICK)
    circles = [re.findall("<circle[^>]*>", text) for text in (plain.svg, svg)]
    assert circles[0] == circles[1]


@pytest.mark.parametrize(
    ("texts", "areas"), [(("T & U", "seen"), 4), (("T & U", None), 0), ((None, "seen"), 0)]
)
def test_minimal_files_keep_title_and_alt_and_have_a_name(texts, areas):
    title, alt = texts
    document = Document(alt=alt, **({"title": title} if title else {}))
    scene = SCENE.replace(areas=random_areas(areas, 1))
    root = parse(write_svg(scene, SvgFormat(markup="minimal", precision=0.5), document))
    assert root.get("role") == "img"
    assert [one.text for one in root if one.tag in (SVG + "title", SVG + "desc")] == [
        text for text in texts if text
    ]
    assert root.findtext(SVG + "title")  # without one, screen readers have no name of the picture


CRISP = SCENE.replace(opacity=np.ones(30), beta=np.full(30, 256.0))
CLEAR = CRISP.replace(background=np.ones(3), transparent=True)
OTHERS = [
    f"<svg {ROOT}><path d='M0 0h8v8z'/></svg>",
    f'<svg {ROOT}>\n  <path fill="#fff" d="M0 0h8v8H0"/>\n</svg>',
    f'<svg {ROOT}><path fill="#fff" d="M0 0h8v8H0z"/><path d="M1 1h4v4z"/></svg>',
    f"<svg {ROOT}><path fill='#fff' d='M0 0h8v8H0'/></svg>".replace('"', "'"),
    f'<svg {ROOT}><text>written by gauss2svg</text></svg>',
    "<svg/>", "", "no SVG",
]  # fmt: skip


@pytest.mark.parametrize("scene", [SCENE, CLEAR])
@pytest.mark.parametrize("document", [Document(), Document(title="It's", alt="<a>", size="9mm")])
@pytest.mark.parametrize("markup", ["editable", "minimal"])
def test_own_files_are_known_until_another_program_saves_them(scene, document, markup, tmp_path):
    precision = 0.5 if markup == "minimal" else 0.04
    svg = write_svg(scene, SvgFormat(markup=markup, precision=precision), document)
    path = tmp_path / "o.svg"
    for gzipped in (False, True):
        path.write_bytes(file_bytes(svg, gzipped))
        assert is_own(path)
    path.write_bytes(tostring(parse(svg)))
    assert not is_own(path)


def test_files_by_hand_or_of_another_program_are_not_own(tmp_path):
    path = tmp_path / "o.svg"
    for other in OTHERS:
        path.write_text(other)
        assert not is_own(path), other


def test_a_file_is_gzipped_by_its_extension_or_as_given(picture, tmp_path, capfdbinary):
    result = vectorize(picture, **QUICK)
    plain, packed = (file_bytes(result.svg, gzipped) for gzipped in (False, True))
    for name, gzipped, expected in (
        ("a.svg", None, plain), ("a.SVGZ", None, packed),
        ("b.svg", True, packed), ("b.svgz", False, plain),
    ):  # fmt: skip
        result.save(tmp_path / name, gzip=gzipped)
        assert (tmp_path / name).read_bytes() == expected
    assert gzip.decompress(packed) == plain == result.svg.encode()
    for name in ("a.png", "a.tar.gz", "folder/"):
        with pytest.raises(InputError, match="path must be "):
            result.save(f"{tmp_path}/{name}")
    assert len(list(tmp_path.iterdir())) == 5
    assert main([str(picture), "-o", "-", "--gzip", "--quiet", *QUICK_OPTIONS]) == 0
    assert capfdbinary.readouterr().out == packed


@pytest.mark.parametrize(("dpi", "line"), [(None, "resolution tag"), ((300, 150), "not square")])
def test_a_photo_without_a_resolution_has_no_physical_size(dpi, line, picture):
    Image.open(picture).save(picture, **({} if dpi is None else {"dpi": dpi}))
    with pytest.raises(InputError, match=f"size must be .*{line}"):
        vectorize(picture, size="photo", **QUICK)


SMALL = random_scene(30, 60, 45, 7, (2, 9))
STILL, MOVING = write_svg(SMALL), write_svg(SMALL, document=Document(animate=6))
# Played, paused at a time in ms, or finished; and what the root then looks like.
# Two frames later, as a busy browser may show an earlier one until then.
AT = """async (ms) => {
    for (const a of document.getAnimations()) {
        if (ms === null) a.finish(); else { a.pause(); a.currentTime = ms; await a.ready; }
    }
    for (let k = 0; k < 2; k++) await new Promise(requestAnimationFrame);
}"""


@pytest.fixture(scope="module")
def shown():
    """A browser without the flags by which a renderer starts it."""
    needs("chromium")
    with chromium(flags=()) as browser:
        yield browser


def screenshots(shown, folder, motion: str, files: dict[str, str], visits: list) -> list[bytes]:
    """What Chromium shows of addresses of files at a time in ms, or after all (None)."""
    for name, svg in files.items():
        (folder / name).write_text(svg, encoding="utf-8")
    taken = []
    with shown.new_page(reduced_motion=motion, viewport={"width": 60, "height": 45}) as page:
        for address, time in visits:
            page.goto(f"{folder.as_uri()}/{address}")
            if time != 0:
                page.evaluate(AT, time)
            taken.append(captured(page))
    return taken


@pytest.mark.parametrize("write", [write_svg, outline_svg])
def test_a_document_shows_the_rounds_up_to_the_one_in_its_address(write, shown, tmp_path):
    files = {f"{k}.svg": write(SMALL.select(SMALL.round_index < k)) for k in (1, 2, 3)}
    files["out.svg"] = write(SMALL, document=Document(fragments=True))
    addresses = [*files, *(f"out.svg#round-{k}" for k in (1, 2, 3, 9))]
    *parts, plain, first, middle, last, other = screenshots(
        shown, tmp_path, "reduce", files, [(address, None) for address in addresses]
    )
    assert [first, middle, last] == parts
    assert plain == other == last
    assert len({first, middle, last}) == 3


def test_a_browser_fades_rounds_in_or_shows_the_end_at_once(shown, tmp_path):
    files = {"still.svg": STILL, "moving.svg": MOVING}
    still, begin, middle, end = screenshots(
        shown, tmp_path, "no-preference", files,
        [("still.svg", 0), ("moving.svg", 1e-3), ("moving.svg", 3000), ("moving.svg", None)],
    )  # fmt: skip
    assert end == still
    begun, halfway, ended = (
        np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float)
        for png in (begin, middle, end)
    )
    assert np.abs(begun - np.round(SMALL.background * 255)).max() <= 1
    assert np.abs(halfway - begun).max() > 50
    assert np.abs(halfway - ended).max() > 50
    assert screenshots(shown, tmp_path, "reduce", files, [("moving.svg", 0)]) == [still]
