"""Drawings of other programs are read as they are drawn, and so are files that Inkscape saved."""

import contextlib
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scenes import random_scene
from svg_texts import assert_same, document

from gauss2svg.areas.scenes import with_ellipses_as_areas
from gauss2svg.errors import InputError
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg import SvgFormat
from gauss2svg.svg.forms import BLUR, GRADIENT
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

STOPS = '<stop stop-color="red"/><stop offset="50%" stop-color="#0f0"/><stop offset="1"/>'
DEFS = (
    f'<linearGradient id="box">{STOPS}</linearGradient><radialGradient id="disc">{STOPS}'
    '</radialGradient><linearGradient id="turned" x1="10%" x2=".3" y2="1" '
    'gradientTransform="rotate(20 .5 .5)" xlink:href="#box"/>'
    '<clipPath id="page"><rect width="40" height="30" fill="white"/></clipPath>'
    '<clipPath id="moved"><rect width="99" height="40" transform="translate(-9 -5)"/></clipPath>'
)
BOX = 'd="M3 3h9v20z" fill="blue"'
RING = "M20 14m-12 0a12 12 0 1 1 24 0a12 12 0 1 1-24 0M20 14m-6 0a6 6 0 1 1 12 0a6 6 0 1 1-12 0z"
# What is drawn, and what a scene has of it
DRAWN = {
    '<path d="M5 5H25V20H5z" fill="red" fill-opacity=".8" stroke="blue" stroke-opacity=".3" '
    'stroke-width="4"/>':
        "1 area and 1 line of 8 nodes",
    '<path fill="red" d="M5 5a5 9 30 0020 20zM30 5a4 2 0 1110 0a4 2-20 0 1-10 1"/>':
        "1 area of 8 nodes",
    '<path fill="red" d="M5 5q9 0 12 9t10 9 3-3Q30 4 20 3T9 4z"/>': "1 area of 6 nodes",
    '<path fill="red" d="M5 5C7 0 9 3 15 9T30 20s4 5 3-9Q3 3 4 9S7 9 9 20z"/>': "1 area of 6 nodes",
    '<rect fill="red" x="3" y="2" width="50%" height="12" rx="19" ry="4"/>': "1 area of 6 nodes",
    '<rect fill="url(#box)" x="3" y="2" width="20" height="12" '
    'transform="rotate(20)matrix(1 0 .36 1 0 0)"/>':
        "1 area of 4 nodes",
    '<polyline points="1,2 13,4 5,19" fill="red" stroke="blue" stroke-width="2"/>':
        "1 area and 1 line of 6 nodes",
    '<line x1="3" y1="4" x2="30" y2="20" stroke="red" stroke-width="3" stroke-linecap="round"/>':
        "1 line of 2 nodes",
    '<ellipse cx="20" cy="14" rx="9" ry="12" fill="url(#disc)" stroke="#0a0" stroke-width="4"/>':
        "1 area and 1 line of 8 nodes",
    f'<circle r="9" cx="9" cy="9"/><path {BOX}/><ellipse rx="3" ry="9" cx="8" cy="20" '
    'fill="red" opacity=".5" transform="rotate(-30)"/>': "3 areas of 11 nodes",
    f'<g clip-path="url(#page)"><g clip-path="url(#moved)"><path {BOX}/></g></g>':
        "1 area of 3 nodes",
    '<path fill-rule="evenodd" fill="red" d="M2 2h30v25H2zM6 6h20v15H6zM9 9h9v9H9zM34 2h4v4h-4z"/>':
        "1 area of 16 nodes",
    f'<path style="fill-rule:evenodd" fill="red" d="{RING}"/>': "1 area of 8 nodes",
    '<path fill-rule="evenodd" fill="red" d="M2 2h30v25H2zM6 6v15h20V6z"/>': "1 area of 8 nodes",
    '<path d="M5 5H25V20H5z" fill="red" stroke="blue" stroke-width="4" stroke-linejoin="round" '
    'stroke-miterlimit="10" style="paint-order:stroke fill markers"/>':
        "1 area and 1 line of 8 nodes",
    f'<path fill="none" d="M0 0H40V30H0z"/><path {BOX}/>': "1 area of 3 nodes",
}  # fmt: skip


@pytest.mark.parametrize("body", DRAWN)
def test_what_other_programs_draw_is_read_as_it_is_drawn(body):
    text = document(body, DEFS)
    scene = with_ellipses_as_areas(read_svg(text))
    assert (str(AreaCounts.of(scene.areas)), len(scene)) == (DRAWN[body], 0)
    # resvg has few levels along edges.
    assert psnr(render(scene, 160, 120), rasterize(text, 160, 120)) > 36


DATA = Path(__file__).parents[1] / "data"


def edited_scene() -> Scene:
    """Thirty shapes of all exponents in three rounds, two of them plain ellipses."""
    scene = random_scene(30, 120, 80, 2, (2, 14))
    color = np.resize([[0.2, 0.4, 0.6], [1.0, 0.6, 0.0], [0.0, 0.4, 0.2]], (30, 3))
    opacity = np.clip(scene.opacity, 0.2, 1)
    return scene.replace(beta=np.resize(BETA_CLASSES, 30), opacity=opacity, color=color)


def saved_by_inkscape(before: Path, after: Path) -> None:
    """Shape 3 moved by (3, 4), shape 5 made a path, the last round moved by (5, -2)."""
    ids = after.with_name("ids.svg")
    _inkscape(before, ids, "select-all")
    root = ElementTree.parse(ids).getroot()
    layers = [g.get("id") for g in root.iter("{http://www.w3.org/2000/svg}g")]
    circles = [c.get("id") for c in root.iter("{http://www.w3.org/2000/svg}circle")]
    ids.unlink()
    _inkscape(
        before, after,
        f"select-by-id:{circles[3]};transform-translate:3,4;select-clear;"
        f"select-by-id:{circles[5]};object-to-path;select-clear;"
        f"select-by-id:{layers[-1]};transform-translate:5,-2",
    )  # fmt: skip


def _inkscape(before: Path, after: Path, actions: str) -> None:
    actions += f";export-filename:{after};export-plain-svg:false;export-do"
    subprocess.run(
        ["inkscape", str(before), f"--actions={actions}"],
        check=True, capture_output=True, timeout=60,
    )  # fmt: skip


@pytest.mark.parametrize("source", ["saved", "installed"])
@pytest.mark.parametrize("form", [GRADIENT, BLUR])
def test_shapes_moved_in_inkscape_are_moved_and_nothing_else_is(
    form, source, pytestconfig, tmp_path
):
    before, after = DATA / f"{form}.svg", DATA / f"{form}_by_inkscape.svg"
    if source == "installed":
        if shutil.which("inkscape") is None:
            pytest.skip("needs Inkscape on the PATH")
        before, after = tmp_path / before.name, tmp_path / after.name
    if source == "installed" or pytestconfig.getoption("--rewrite-golden"):
        before.write_text(write_svg(edited_scene(), SvgFormat(form=form)))
        saved_by_inkscape(before, after)
    old, new = read_svg(before), read_svg(after)
    shift = np.zeros((30, 2))
    shift[3] = 3, 4
    shift[old.round_index == 2] = 5, -2
    assert (shift != 0).any(axis=1).sum() > 5
    # What 8 digits leave of a covariance in px^2 and of a mean in px.
    assert_same(new, old.replace(mean=old.mean + shift), atol=2e-4)
    assert "<path" in after.read_text()
    # What it makes of a circle that is moved, unless a filter refers to its units.
    assert ("<ellipse" in after.read_text()) == ("filter=" not in before.read_text())
    assert (form == BLUR) == ("filter=" in before.read_text())
    assert form == BLUR or set(BETA_CLASSES) <= set(old.beta)


SCALED = '<linearGradient id="g" gradientTransform="scale(1e200)"><stop/><stop offset="1"/>'


@pytest.mark.parametrize(
    "body",
    [
        '<path d="M0 0a5 5 0 0 1 1e-200 0h9v9z"/>',
        '<path d="M0 0A5 5 1e300 0 1 10 10h3z"/>',
        f'{SCALED}</linearGradient><path fill="url(#g)" d="M0 0h9v9z"/>',
    ],
)
def test_extreme_numbers_are_read_or_refused(body):
    with contextlib.suppress(InputError):
        read_svg(f'<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20">{body}</svg>')
