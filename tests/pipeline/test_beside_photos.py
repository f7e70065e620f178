"""Properties of what is given beside a photo: a mask of it, or a scene to start with.

The photo is closer where its mask is white, whatever the goal and the loss. A run that starts with
a scene is never worse than that, and cheaper than a new fit.
"""

from pathlib import Path

import numpy as np
import pytest
from flat import vectorize
from PIL import Image
from skimage import data

from gauss2svg import Scene, read_svg
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize

NAMES = ("astronaut", "coffee")
PART = 0, 0, 320, 240  # px of the picture
Y, X = np.mgrid[:48, :64]
MASK = np.uint8(255 * ((X - 23) ** 2 / 16**2 + (Y - 27) ** 2 / 13**2 < 1))


def small(name: str, box: tuple[int, ...] | None = None) -> np.ndarray:
    """A picture of scikit-image, or a part of it, reduced."""
    photo = Image.fromarray(getattr(data, name)())
    return np.asarray(photo.resize((64, 48), Image.Resampling.BOX, box))


def psnr_where(raster, photo, where) -> float:
    return float(-10 * np.log10(np.mean(np.square(raster - photo)[where])))


COUNT = {"gaussians": 60, "iterations": 40}
GOALS = {
    "count": COUNT, "inks": {**COUNT, "inks": 8}, "psnr": {**COUNT, "tune": "psnr"},
    "ssim": {**COUNT, "loss": "mse+ssim"}, "additive": {**COUNT, "blend": "add"},
    "small file": {"max_bytes": 1000, "iterations": 40},
    "editable file": {"max_bytes": 20_000, "markup": "editable", "iterations": 40},
}  # fmt: skip


@pytest.mark.parametrize(
    "goal", [pytest.param(g, marks=[pytest.mark.sweep] * (k > 1)) for k, g in enumerate(GOALS)]
)
def test_a_photo_is_closer_inside_of_its_mask_at_the_cost_of_the_rest(goal):
    gains = []
    for name in NAMES:
        plain, focused = (
            vectorize(small(name), **GOALS[goal], **more) for more in ({}, {"focus": MASK})
        )
        psnrs = [
            [psnr_where(result.raster, result.photo, where) for where in (MASK > 0, MASK == 0)]
            for result in (plain, focused)
        ]
        report = focused.report
        assert [report["psnr_svg_inside"], report["psnr_svg_outside"]] == pytest.approx(psnrs[1])
        assert plain.report["psnr_svg_inside"] is plain.report["focus_strength"] is None
        gains.append(np.subtract(psnrs[1], psnrs[0]))
    inside, outside = np.mean(gains, axis=0)
    assert inside > 0.5
    assert outside < 0


def test_a_mask_is_read_like_a_photo(tmp_path):
    photo, image = small("coffee"), Image.fromarray(MASK)
    image.save(tmp_path / "mask.png")
    clear = np.dstack([np.full((*MASK.shape, 3), 255, np.uint8), MASK])  # white where it is opaque
    masks = [MASK, MASK > 0, image, str(tmp_path / "mask.png"), clear]
    assert len({vectorize(photo, gaussians=9, iterations=3, focus=mask).svg for mask in masks}) == 1


@pytest.mark.parametrize(
    ("mask", "line"),
    [
        (MASK.T, r"focus must be a mask of the photo's proportions, 64x48; got 48x64 px. Try the"),
        (np.zeros((48, 64)), "focus must be a mask with white .*; got greys from 0 to 0 of"),
        (7, "focus must be a picture, but photo must be a path, .*; got int"),
        (np.full((48, 64), 2.0), "focus must be a picture, but samples of array .*0..1"),
        (b"rubbish", "focus must be a picture, but .* got an unknown format"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(mask, line):
    with pytest.raises(InputError, match=line):
        vectorize(small("coffee", PART), gaussians=10, focus=mask)


@pytest.mark.parametrize(
    "goal",
    [
        {"gaussians": 30}, pytest.param({}, marks=pytest.mark.sweep),
        {"max_bytes": 6000, "markup": "editable"},
    ],
)  # fmt: skip
def test_it_is_never_worse_than_the_file_that_it_starts_with(goal):
    photo = small("coffee", PART)
    first = vectorize(photo, **goal)
    for start in (first.scene, read_svg(first.svg)):
        again = vectorize(photo, **goal, start=start)
        assert again.report["psnr_svg"] >= first.report["psnr_svg"] - 0.01
        assert again.report["gaussians"] <= goal.get("gaussians", np.inf)
        assert again.report["svg_bytes"] <= goal.get("max_bytes", np.inf)


def test_shapes_are_scaled_to_the_photo_and_a_target_gets_more_of_them():
    photo = small("coffee", PART)
    start = vectorize(photo[::2, ::2], gaussians=40).scene
    assert (start.width, start.height) == (32, 24)
    kept = vectorize(photo, start=start).report
    assert kept["stop_reason"] == "start"
    assert 0.9 * 40 <= kept["gaussians"] <= 40
    grown = vectorize(photo, target_psnr=kept["psnr_svg"] + 2, start=start).report
    assert grown["psnr_svg"] > kept["psnr_svg"] + 1.9
    assert grown["gaussians"] > 40


def test_the_command_starts_with_a_scene_or_with_an_svg(tmp_path, photo, refusal):
    svg, npz, out, picture = (str(tmp_path / name) for name in ("a.svg", "a.npz", "b.svg", "a.png"))
    Image.fromarray(np.uint8(photo[:48, :64] * 255)).save(picture)
    quick = ["--gaussians", "30", "--iterations", "40", "--quiet"]
    assert main([picture, "-o", svg, "--save-scene", npz, *quick]) == 0
    for start in (svg, npz):
        assert main([picture, "-o", out, "--start", start, *quick]) == 0
        assert len(read_svg(out)) <= 30
    assert "which is also the scene" in refusal(picture, "-o", svg, "--start", svg)
    line = refusal(picture, "-o", out, "--start", npz, "--blend", "add")
    assert "--start must be alpha-composited, like the file; got a scene of over for a file" in line
    with pytest.raises(InputError, match="got a scene of add for a file of over"):
        vectorize(photo, start=Scene(9, 9, blend="add"))
    with pytest.raises(InputError, match="start must be a Scene; got str"):
        vectorize(photo, start=svg)


def drawing(shift: float, page: str, red: str, root: str = 'width="96" height="72"') -> str:
    """A drawing as a person, or a tracer with needless nodes, would write it."""
    needless = "".join(f"L{8 + 40 * k / 90:g} 60" for k in range(90))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {root}><rect width="96" height="72" fill="{page}"'
        f'/><g transform="translate({shift} {-shift})"><path d="M8 60{needless}L48 60V12H8z" '
        f'style="fill:{red}"/><circle cx="64" cy="30" r="18" fill="#26a"/><path fill="#fc2" '
        'fill-rule="evenodd" d="M50 40H90V66H50zM60 48H80V58H60z"/></g></svg>'
    )


def test_a_drawing_of_another_program_is_refined_to_the_photo(tmp_path, refusal):
    picture, start, out = (str(tmp_path / name) for name in ("a.png", "a.svg", "b.svg"))
    root = 'width="24mm" height="18mm" viewBox="0 0 96 72"'
    photo = rasterize(drawing(0, "#fff", "#c20"), 96, 72)
    Path(picture).write_bytes(as_png(photo))
    Path(start).write_text(drawing(0.8, "#fff", "#b11", root))
    assert main([picture, "-o", out, "--start", start, "--areas", "always", "--quiet"]) == 0
    first, scene = read_svg(start), read_svg(out)
    assert (len(first.areas), len(scene.areas)) == (2, 3)  # the circle is an area, too
    before, after = (rasterize(Path(name).read_text(), 96, 72) for name in (start, out))
    assert psnr(after, photo) > max(40, psnr(before, photo) + 15)
    assert sum(area.nodes for area in scene.areas) < 50  # of 106
    Path(start).write_text(drawing(0, "#fff", "url(#none)"))
    line = refusal(picture, "-o", out, "--start", start)
    assert '<path d="' in line
    assert "its reference must be to a radialGradient" in line
