"""Files of drawings by every command: read and written again, they are the same bytes."""

import html
import re
from pathlib import Path
from urllib.parse import unquote

import pytest
from pictures import ball
from rewritten import rewritten

from gauss2svg import Scene, read_svg
from gauss2svg.cli.main import main
from gauss2svg.files import as_png, saved
from gauss2svg.raster import rasterize
from gauss2svg.svg.encode import outline_svg

pytestmark = pytest.mark.usefixtures("hasty")

# A drawing on a clear page with a gradient, a line and a shape that is half clear.
DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 96 96"><linearGradient id="a">
<stop stop-color="#fc4"/><stop offset="1" stop-color="#347"/></linearGradient>
<path fill="url(#a)" d="M6 6h84v50H6z"/><circle cx="30" cy="33" r="21" fill="#c0322c"/>
<path d="M60 62h26v26z" fill="#17324d" fill-opacity=".5"/><path d="M8 80c22-22 40 10 48-10"
fill="none" stroke="#084" stroke-width="3"/></svg>"""
OUT = ("drawing.png", "-o", "out.svg", "--save-scene", "scene.npz")
PAGE = {"animate": 3.0, "fragments": True, "size": "90mm", "aspect": "none", "alt": "a & b"}
COMMANDS = {
    "editable": (OUT, {}),
    "minimal": ((*OUT, "--markup", "minimal"), {}),
    "page": (
        (*OUT, "--animate", "3", "--fragments", "--size", "90mm", "--aspect", "none",
         "--alt", "a & b"),
        PAGE,
    ),
    "inks": ((*OUT, "--inks", "5", "--separations", "plate.svg"), {"layers": "inks"}),
    "start of a file": ((*OUT, "--start", "first.svg"), {}),
    "Gaussians": (("ball.png", *OUT[1:], "--max-bytes", "3k", "--markup", "minimal"), {}),
    "placeholder": (("placeholder", "drawing.png", "-o", "small", "--format", "svg"), {}),
    "HTML": (("placeholder", "drawing.png", "-o", "small.html", "--format", "html"), {}),
}  # fmt: skip


SLOW = {"Gaussians", "placeholder", "HTML", "inks"}


@pytest.fixture(scope="module")
def drawings(tmp_path_factory):
    """A folder with two pictures, and the files and the scene of the first."""
    folder = tmp_path_factory.mktemp("drawings")
    (folder / "drawing.png").write_bytes(as_png(rasterize(DRAWING, 96, 96, alpha=True)))
    (folder / "ball.png").write_bytes(as_png(ball(64)))
    paths = [str(folder / name) for name in ("first.svg", "first.npz", "outlines.svg")]
    files = ("-o", paths[0], "--save-scene", paths[1], "--outline", paths[2])
    assert main([str(folder / "drawing.png"), *files, "--quiet"]) == 0
    return folder


def svg_of(path: Path) -> str:
    """The text of an SVG, which may be the data URI of a page."""
    content = path.read_bytes()
    if path.suffix != ".html":
        return content.decode()
    (data,) = re.findall(r'data:image/svg\+xml,(.*?)"', html.unescape(content.decode()))
    return unquote(data).replace("'", '"')


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.sweep] * (name in SLOW)) for name in COMMANDS],
)
def test_what_a_command_writes_is_read_and_written_as_the_same_bytes(
    name, drawings, tmp_path, monkeypatch, capfd
):
    words, settings = COMMANDS[name]
    monkeypatch.chdir(tmp_path)
    names = {path.name for path in drawings.iterdir()}
    for one in names:
        Path(one).write_bytes((drawings / one).read_bytes())
    assert main([*words, "--quiet"]) == 0
    assert capfd.readouterr() == ("", "")
    written = [path for path in Path().rglob("*.*") if path.name not in names and path.is_file()]
    svgs = [path for path in written if path.suffix in (".svg", ".html")]
    assert svgs
    for path in svgs:
        svg = svg_of(path)
        assert read_svg(svg).areas
        # A data URI has quotes of one kind.
        again = rewritten(svg, **settings)
        assert (again.replace("'", '"') if path.suffix == ".html" else again) == svg
    for path in (path for path in written if path.suffix == ".npz"):
        scene, svg = Scene.load(path), svg_of(Path("out.svg"))
        assert saved(scene.save) == path.read_bytes()
        assert rewritten(svg, scene, **settings) == svg


def test_outlines_are_read_as_lines_and_written_as_the_same_bytes(drawings):
    outlines = (drawings / "outlines.svg").read_text()
    again = outline_svg(read_svg(outlines))
    assert again.replace("4 lines", "3 areas and 1 line") == outlines
