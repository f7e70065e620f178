"""Laws of files that Inkscape saved: what was moved is moved, and nothing else is."""

import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scenes import random_areas, random_scene
from svg_texts import assert_same

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg import SvgFormat
from gauss2svg.svg.forms import BLUR, GRADIENT
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

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
    assert form == BLUR or set(BETA_CLASSES) < set(old.beta)


@pytest.mark.skipif(shutil.which("inkscape") is None, reason="needs Inkscape on the PATH")
def test_areas_moved_in_inkscape_are_moved_and_nothing_else_is(tmp_path):
    before, after = tmp_path / "before.svg", tmp_path / "after.svg"
    scene = random_scene(3, 120, 80, 2).replace(areas=random_areas(12, 4, (120, 80)))
    before.write_text(write_svg(scene))
    _inkscape(
        before, after,
        "select-by-id:area-2,area-5,area-7;transform-translate:3,4;select-clear;"
        "select-by-id:area-7;transform-rotate:90;select-clear;"
        "select-by-id:areas;transform-translate:5,-2",
    )  # fmt: skip
    old, new = read_svg(before), read_svg(after)
    assert len(new.areas) == len(old.areas)
    for k, (area, moved) in enumerate(zip(old.areas, new.areas, strict=True), start=1):
        shift = np.array([5, -2]) + np.array([3, 4]) * (k in (2, 5))
        assert (moved.width, moved.cap) == (pytest.approx(area.width, abs=1e-4), area.cap)
        for one, other in zip(area.outlines, moved.outlines, strict=True):
            assert (one.curved, one.closed) == (other.curved, other.closed)
            if k != 7:
                np.testing.assert_allclose(np.add(one.points, shift), other.points, atol=1e-3)
        if k != 7:
            at = np.random.default_rng(k).uniform(0, 80, (2, 50))
            own = area.paint
            if not isinstance(own, tuple):
                colors = moved.paint.at(*(at + shift[:, None]))
                np.testing.assert_allclose(own.at(*at), colors, atol=0.01)
