"""Laws of files in inks: groups and plates that draw what the scene draws."""

import numpy as np
import pytest
from conftest import random_scene
from flat import vectorize
from PIL import Image
from scipy.ndimage import maximum_filter, minimum_filter

from gauss2svg.cli.main import main
from gauss2svg.raster import rasterize
from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.inks import ink_colors
from gauss2svg.svg.document import SvgFormat
from gauss2svg.svg.minimal_shapes import overlaps
from gauss2svg.svg.plates import grouped_by_ink, ink_name, plate_of
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import plate_svg, write_svg

INKS = "#f7c306,#c0322c,#17324d"
BY_INK = SvgFormat(layers="inks", precision=0.01)


def scene_in_inks(count: int = 60, seed: int = 3) -> Scene:
    colors = ink_colors(INKS)
    return random_scene(count, 90, 70, seed, (3, 12), (20, 40)).replace(
        opacity=np.ones(count),
        color=colors[np.random.default_rng(seed).integers(0, 3, count)],
        drawn=np.full(count, PLAIN),
        background=colors[0],
    )


def raster_of(scene: Scene) -> np.ndarray:
    return rasterize(write_svg(scene, SvgFormat(precision=0.01)), 180, 140)


def test_inks_of_a_scene_are_its_colours_and_none_of_another_scene():
    scene = scene_in_inks()
    assert [ink_name(ink) for ink in scene.inks] == sorted(INKS.split(","))
    assert len(scene.replace(transparent=True).select(slice(0, 0)).inks) == 0
    assert scene.replace(drawn=np.zeros(len(scene))).inks is None
    assert scene.replace(opacity=np.full(len(scene), 0.99)).inks is None


@pytest.mark.parametrize("seed", range(4))
def test_grouped_by_ink_looks_the_same_in_fewer_runs_and_stays_as_it_is(seed):
    scene = scene_in_inks(seed=seed)
    grouped = grouped_by_ink(scene)
    np.testing.assert_allclose(raster_of(grouped), raster_of(scene), atol=2 / 255)
    changes = (np.diff(scene.color, axis=0) != 0).any(axis=1).sum()
    assert grouped.round_index[-1] < changes
    again = grouped_by_ink(grouped)
    np.testing.assert_array_equal(again.mean, grouped.mean)
    np.testing.assert_array_equal(again.round_index, grouped.round_index)


def test_shapes_that_lie_apart_are_one_group_an_ink():
    scene = scene_in_inks(30).replace(
        mean=np.stack(np.meshgrid(np.arange(6), np.arange(5)), axis=-1).reshape(-1, 2) * 14 + 7.0,
        sigma=np.full((30, 2), 2.0),
    )
    assert grouped_by_ink(scene).round_index[-1] == 2


def test_each_group_has_the_fill_of_its_ink_and_reading_gives_the_scene():
    scene = grouped_by_ink(scene_in_inks())
    svg = write_svg(scene, BY_INK)
    assert svg.count("<g ") == scene.round_index[-1] + 1
    assert svg.count(" fill=") == svg.count("<g ") + 1  # and the background's
    assert 'id="ink-1"' in svg
    assert write_svg(scene_in_inks(), BY_INK) == svg
    again = read_svg(svg)
    np.testing.assert_array_equal(again.color, scene.color)
    np.testing.assert_array_equal(again.round_index, scene.round_index)
    np.testing.assert_allclose(again.mean, scene.mean, atol=0.01)
    np.testing.assert_array_equal(again.inks, scene.inks)


def test_plates_add_up_to_the_picture():
    scene = scene_in_inks()
    picture, total = raster_of(scene), np.zeros((140, 180, 3))
    for ink in INKS.split(","):
        plate = 1 - rasterize(plate_svg(scene, ink), 180, 140)[:, :, :1]
        total += plate * ink_colors(ink)
    same = maximum_filter(picture, (3, 3, 1)) == minimum_filter(picture, (3, 3, 1))
    inside = same.all(axis=2)  # edges are antialiased several times
    assert inside.mean() > 0.5
    np.testing.assert_allclose(total[inside], picture[inside], atol=1 / 255)
    assert np.abs(total - picture).mean() < 0.01


def test_plate_leaves_out_what_changes_nothing():
    scene = scene_in_inks()
    for ink in INKS.split(","):
        plate = plate_of(scene, ink)
        everything = scene.replace(
            color=np.repeat((scene.color != ink_colors(ink)).any(axis=1)[:, None], 3, axis=1) * 1.0,
            background=np.zeros(3) if ink == INKS.split(",")[0] else np.ones(3),
        )
        np.testing.assert_allclose(raster_of(plate), raster_of(everything), atol=1 / 255)
    rare = scene.replace(
        color=np.where(np.arange(60)[:, None] == 5, [1.0, 0, 0], ink_colors(INKS)[1])
    )
    assert len(plate_of(rare, "#ff0000")) < 60


def test_shapes_overlap_where_their_ellipses_do():
    mean = np.array([[0.0, 0], [5, 0], [11, 0], [0, 30]])
    factor = np.array([[3.0, 0, 3], [3, 0, 3], [2, 0, 2], [1, 0, 1]])
    for kind, margin, pairs in (
        (np.arange(4), 0.0, [[0, 1]]),
        (np.arange(4), 1.5, [[0, 1], [1, 2]]),
        (np.array([0, 0, 1, 1]), 1.5, [[1, 2]]),
    ):
        bits = np.unpackbits(overlaps(mean, factor, kind, margin), axis=1, count=4)
        assert np.argwhere(bits).tolist() == pairs


def test_overlaps_of_several_blocks_are_those_of_the_upper_triangle():
    rng = np.random.default_rng(0)
    mean, factor = rng.uniform(0, 300, (150, 2)), rng.uniform(1, 20, (150, 3))
    whole = np.unpackbits(overlaps(mean, factor, np.arange(150), 0.0), axis=1, count=150)
    assert 0 < whole.sum() == np.triu(whole, 1).sum()
    for some in (slice(60, 70), slice(100, 150)):
        part = overlaps(mean[some], factor[some], np.arange(150)[some], 0.0)
        count = some.stop - some.start
        np.testing.assert_array_equal(np.unpackbits(part, axis=1, count=count), whole[some, some])


def test_separations_are_files_beside_the_picture(photo, tmp_path):
    Image.fromarray(np.round(photo * 255).astype(np.uint8)).save(tmp_path / "photo.png")
    out, plates = tmp_path / "o.svg", tmp_path / "plate.svg"
    quick = ["--gaussians", "40", "--iterations", "20", "--quiet", "--inks", "3"]
    given = [str(tmp_path / "photo.png"), "-o", str(out), "--separations", str(plates), *quick]
    assert main(given) == 0
    result = vectorize(tmp_path / "photo.png", gaussians=40, iterations=20, inks=3)
    assert out.read_text() == result.svg
    made = [path.read_text() for path in sorted(tmp_path.glob("plate-*.svg"))]
    assert made == list(result.plates().values())
    titles = [f"<title>Vectorised photo: {ink}</title>" for ink in result.plates()]
    assert all(title in svg for title, svg in zip(titles, made, strict=True))


def test_plates_keep_the_number_of_their_ink_where_another_is_unused(photo, tmp_path, capsys):
    Image.fromarray(np.round(photo * 255).astype(np.uint8)).save(tmp_path / "photo.png")
    inks = ["#00ff00", "#202020", "#d0d0d0"]  # a green of which nothing is
    given = [str(tmp_path / "photo.png"), "-o", str(tmp_path / "o.svg"), "--inks", ",".join(inks)]
    quick = ["--gaussians", "20", "--iterations", "10"]
    assert main([*given, "--separations", str(tmp_path / "p.svg"), *quick]) == 0
    said = capsys.readouterr().err
    assert f"{tmp_path / 'p-1.svg'} is not written, because #00ff00 is visible nowhere" in said
    assert ", ".join(inks) in said
    made = {path.name: path.read_text() for path in sorted(tmp_path.glob("p-*.svg"))}
    assert list(made) == ["p-2.svg", "p-3.svg"]
    for name, ink in zip(made, inks[1:], strict=True):
        assert f": {ink}</title>" in made[name]


def test_opaque_shapes_that_hide_others_are_warned_of_with_outlines(photo, tmp_path, capsys):
    picture, lines = tmp_path / "photo.png", tmp_path / "lines.svg"
    Image.fromarray(np.round(photo * 255).astype(np.uint8)).save(picture)
    given = [str(picture), "-o", str(tmp_path / "o.svg"), "--gaussians", "30", "--inks", "3"]
    for more, warned in ((["--outline", str(lines)], True), ([], False)):
        assert main([*given, "--iterations", "20", *more]) == 0
        assert ("shows lines that the picture hides" in capsys.readouterr().err) == warned


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["--separations", "p.svg"], "--separations must be given with --inks"),
        (["--inks", "3", "--separations", "p.png"], "--separations must be a name that ends in"),
        (["--inks", "3", "--separations", "PHOTO"], "is also the photo"),
        (["--inks", "3", "--separations", ""], "cannot write .: it is a folder"),
        (["--inks", "3", "--separations", "/"], "cannot write /: it is a folder"),
        (["--inks", "1"], "--inks must be a whole number in 2..64"),
        (["--inks", "#fff,blue"], "--inks must be colours such as #c0322c"),
        (["--inks", "64"], "inks must be at most 2, the number of colours in the picture; got 64"),
        (["--pens", "3"], "--pens must be given with --outline"),
        (["--pens", "0", "--outline", "l.svg"], "--pens must be"),
        (["--pens", "2", "--outline", "l.svg", "--animate", "2"], "not be given with --animate"),
    ],
)
def test_bad_inks_and_pens_are_one_line_status_two_and_no_file(given, why, tmp_path, capsys):
    levels = np.zeros((20, 30, 3), np.uint8)
    levels[5:, 10:] = 255
    picture = tmp_path / "photo-1.svg"  # as the first plate of photo.svg would be called
    Image.fromarray(levels).save(picture, "PNG")
    names = {"PHOTO": str(tmp_path / "photo.svg"), "p.svg": str(tmp_path / "p.svg")}
    words = [names.get(word, word) for word in given]
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *words]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert why in err
    assert list(tmp_path.iterdir()) == [picture]
