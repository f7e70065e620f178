"""Laws of layers by segment: who is in which, in what order, and that this order is measured."""

import math
import re
from functools import partial
from xml.etree.ElementTree import fromstring as parse

import numpy as np
import pytest
from conftest import random_scene
from flat import fit_config, vectorize
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.fit.densification import AdaptiveCount, GrowthLimits, as_given
from gauss2svg.fit.order import SegmentOrder
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.state import STEPS, State
from gauss2svg.measure import metrics
from gauss2svg.photo.segments import MOST_SEGMENTS, labels_of, superpixels
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.svg.document import Document
from gauss2svg.svg.layers import grouped_by_segment, segment_at
from gauss2svg.svg.reader.read import read_svg
from gauss2svg.svg.write import write_svg

SVG = "{http://www.w3.org/2000/svg}"
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
MODE = "{http://www.inkscape.org/namespaces/inkscape}groupmode"
QUICK = {"gaussians": 200, "iterations": 60}
# Left and right of a slanted border, and a disc of a third label.
Y, X = np.mgrid[:128, :128]
LABELS = np.where((X - 60) ** 2 + (Y - 50) ** 2 < 900, 7, np.where(X + Y > 140, 2, 0))


def groups_of(svg: str) -> list[tuple[int, int, list[tuple[float, float]]]]:
    """Round, segment and centres in px, in the order of the file."""
    root = parse(svg)
    unit = float(root.get("width", 0)) / float(root.get("viewBox", "").split()[2])
    found = []
    for group in root.findall(f"{SVG}g/{SVG}g"):
        index, segment = (int(n) for n in re.findall(r"\d+", group.get("id", "")))
        matrices = [c.get("transform", "")[len("matrix(") : -1].split() for c in group]
        found.append(
            (index - 1, segment, [(unit * float(m[4]), unit * float(m[5])) for m in matrices])
        )
    return found


@pytest.fixture(scope="module")
def result(photo):
    return vectorize(photo, segments=LABELS, **QUICK)


def test_file_has_the_scene_in_its_order_and_each_shape_where_its_centre_lies(result):
    scene, groups = result.scene, groups_of(result.svg)
    centres = np.concatenate([at for _, _, at in groups])
    np.testing.assert_allclose(centres, scene.mean, atol=0.03)
    cell = np.clip(np.floor(scene.mean), 0, 127).astype(int)
    under = LABELS[cell[:, 1], cell[:, 0]].tolist()
    expected = list(zip(scene.round_index.tolist(), under, strict=True))
    listed = [(index, segment) for index, segment, at in groups for _ in at]
    assert listed == expected == sorted(expected)
    assert len(groups) == len(set(expected))


def test_what_is_measured_is_what_is_written(result, photo):
    drawn = rasterize(result.svg, 128, 128)
    assert (result.raster == drawn).all()
    assert result.report["psnr_svg"] == pytest.approx(metrics.psnr(drawn, photo))
    model = np.clip(render(result.scene), 0, 1)
    assert result.report["psnr_model"] == pytest.approx(metrics.psnr(model, photo))
    assert result.report["segments"] == 3


@pytest.mark.sweep
def test_fit_makes_up_for_the_order(result, photo):
    free = vectorize(photo, **QUICK)
    assert result.report["psnr_svg"] > free.report["psnr_svg"] - 0.6
    # the same layers of a scene that was not fitted for them are another picture
    late = grouped_by_segment(free.scene, LABELS)
    assert metrics.psnr(render(late), photo) < result.report["psnr_svg"] - 0.3
    # from the start, or it makes up for little of it: 30.3 dB
    many = {"gaussians": 500, "iterations": 150}
    psnr = [vectorize(photo, segments=n, **many).report["psnr_svg"] for n in (None, 100)]
    assert psnr[1] > psnr[0] - 1.2


def test_finished_fit_has_the_order_already(photo):
    labels = np.random.default_rng(0).integers(0, 9, (32, 32))
    options = fit_config(gaussians=300, iterations=60)
    policy = AdaptiveCount(GrowthLimits(0.0, 1.0, math.inf, 300), as_given)
    session = FitSession(photo, options, policy, segment_at=partial(segment_at, labels))
    for change in (session.fit, lambda: session.resize(200, 20)):
        change()
        scene = session.scene()
        assert len(np.unique(scene.round_index)) > 2
        np.testing.assert_array_equal(grouped_by_segment(scene, labels).mean, scene.mean)


def test_layers_are_named_and_counted(result):
    root = parse(result.svg)
    for layer in root.findall(SVG + "g"):
        parts = list(layer)
        total = re.search(r": (\d+) ", layer.get(LABEL, ""))
        assert total is not None
        assert int(total[1]) == sum(len(part) for part in parts)
        for part in parts:
            assert part.get(MODE) == "layer"
            segment = part.get("id", "").removeprefix(layer.get("id", "") + "-segment-")
            assert part.get(LABEL) == f"Segment {segment}: {len(part)} Gaussians"
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert len(ids) == len(set(ids))


def test_same_photo_and_segments_give_the_same_bytes(photo, result):
    assert vectorize(photo, segments=LABELS.astype(np.uint8), threads=1, **QUICK).svg == result.svg


def test_file_comes_back_with_its_rounds(result):
    back = read_svg(result.svg)
    np.testing.assert_array_equal(back.round_index, result.scene.round_index)
    np.testing.assert_allclose(back.mean, result.scene.mean, atol=0.03)


@given(st.integers(0, 500), st.integers(1, 6), st.integers(1, 6))
def test_order_is_by_round_and_segment_and_otherwise_kept(seed, rows, columns):
    scene = random_scene(40, seed=seed)
    labels = np.random.default_rng(seed).integers(0, 4, (rows, columns))
    sorted_scene = grouped_by_segment(scene, labels)
    cell = [
        labels[
            min(max(int(y * rows / scene.height), 0), rows - 1),
            min(max(int(x * columns / scene.width), 0), columns - 1),
        ]
        for x, y in scene.mean
    ]
    order = sorted(range(40), key=lambda i: (scene.round_index[i], cell[i]))
    np.testing.assert_array_equal(sorted_scene.mean, scene.mean[order])
    np.testing.assert_array_equal(grouped_by_segment(sorted_scene, labels).mean, sorted_scene.mean)


def test_segments_change_no_shape_and_nothing_of_a_scene_that_has_their_order():
    labels = np.arange(6).reshape(2, 3)
    scene = grouped_by_segment(random_scene(50, seed=4), labels)
    grouped, plain = write_svg(scene, document=Document(segments=labels)), write_svg(scene)
    circles = [re.findall("<circle[^>]*>", text) for text in (grouped, plain)]
    assert circles[0] == circles[1]
    assert (rasterize(grouped, 40, 30) == rasterize(plain, 40, 30)).all()


def test_shapes_that_are_not_drawn_leave_empty_segments_out():
    labels = np.array([[1, 2]])
    scene = random_scene(30, seed=5)
    faint = scene.mean[:, 0] >= 20
    text = write_svg(
        scene.replace(opacity=np.where(faint, 0, 1)), document=Document(segments=labels)
    )
    assert {segment for _, segment, _ in groups_of(text)} == {1}
    assert sum(len(at) for _, _, at in groups_of(text)) == (~faint).sum()


def test_centres_that_leave_their_segment_go_back_no_further_than_they_came():
    rng = np.random.default_rng(1)
    home, away = rng.uniform(0, 100, (300, 2)), rng.uniform(0, 100, (300, 2))

    def below(position):
        return (position[:, 0] > position[:, 1]).astype(np.intp)

    def state(mean):
        n = len(mean)
        ones, wide = np.ones(n), np.zeros((n, STEPS))
        return State(
            mean, np.ones((n, 3)), ones, np.ones((n, 3)), ones,
            np.zeros(n, np.int32), np.zeros(n, np.int8), wide, wide, ones,
        )  # fmt: skip

    order = SegmentOrder(below)
    fixed = order.fix(state(home), 100, 100)
    assert (np.diff(below(fixed.mean)) >= 0).all()
    kept = order.kept(state(away), 100, 100)
    np.testing.assert_array_equal(below(kept.mean), below(fixed.mean))
    stayed = below(away) == below(fixed.mean)
    np.testing.assert_array_equal(kept.mean[stayed], away[stayed])
    to_border = np.abs(np.diff(kept.mean[~stayed], axis=1))
    assert to_border.max() < 150 / 2**8


@pytest.mark.parametrize("mode", ["1", "L", "P", "I;16", "I", "RGB", "RGBA", "LA"])
def test_every_value_or_colour_of_a_label_image_is_a_segment(mode, photo, tmp_path):
    part = np.where(LABELS == 7, 1, 0) if mode == "1" else LABELS
    if mode == "1":
        picture, expected = Image.fromarray(part.astype(bool)), part
    elif mode == "P":
        picture, expected = Image.fromarray(part.astype(np.uint8)), part
        picture.putpalette([9, 9, 9] * 256)  # labels are indices, whatever colours these have
    elif mode in ("RGB", "RGBA", "LA"):
        # apart in one channel only, the last or the first; ranked by the first
        color = np.zeros((128, 128, len(mode)), np.uint8)
        color[:, :, -1], color[:, :, 0] = 5 * (part == 7), 5 * (part == 2)
        picture = Image.fromarray(color, mode)
        expected = np.where(part == 0, 1, np.where(part == 7, 2, 3))
    else:
        wide = part * (1 if mode == "L" else 9000)
        kind = {"L": np.uint8, "I;16": np.uint16, "I": np.int32}[mode]
        picture, expected = Image.fromarray(wide.astype(kind)), wide
    name = tmp_path / f"labels.{'tif' if mode == 'I' else 'png'}"
    picture.save(name)
    np.testing.assert_array_equal(labels_of(str(name), (128, 128), photo), expected)


def test_segments_from_a_file_are_those_of_the_array(photo, result, tmp_path):
    Image.fromarray(LABELS.astype(np.uint8)).save(tmp_path / "labels.png")
    assert vectorize(photo, segments=tmp_path / "labels.png", **QUICK).svg == result.svg


def test_superpixels_cover_the_picture_and_are_about_as_many_as_asked_for(photo):
    for count in (1, 4, 30):
        labels = superpixels(photo, count)
        assert labels.shape == (128, 128)
        assert set(np.unique(labels)) == set(range(1, labels.max() + 1))
        assert 0.4 * count <= labels.max() <= 1.6 * count
        np.testing.assert_array_equal(labels, superpixels(photo, count))


def test_smaller_fit_has_the_same_segments(photo):
    result = vectorize(photo, segments=LABELS, max_size=50, **QUICK)
    cell = np.clip(np.floor(result.scene.mean), 0, 127).astype(int)
    of_scene = LABELS[cell[:, 1], cell[:, 0]].tolist()
    listed = [segment for _, segment, at in groups_of(result.svg) for _ in at]
    assert listed == of_scene


@pytest.mark.sweep
def test_bytes_are_met_with_the_layers_in_them(photo):
    result = vectorize(photo, segments=40, max_bytes=30_000, iterations=60)
    assert 26_000 < len(result.svg.encode()) <= 30_000


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 5, 3), (1, 90, 3)])
def test_tiny_pictures_have_segments(shape):
    pixels = np.random.default_rng(0).random(shape)
    result = vectorize(pixels, gaussians=20, iterations=10, segments=3)
    assert sum(len(at) for _, _, at in groups_of(result.svg)) == result.svg.count("<circle")


@pytest.mark.parametrize(
    ("segments", "message"),
    [
        (0, r"segments must be a whole number in 1\.\.10000; got 0"),
        (MOST_SEGMENTS + 1, r"segments must be a whole number in 1\.\.10000; got 10001"),
        (np.zeros((4, 5), int), "photo, 128x128 px; got 5x4 px"),
        (np.zeros((128, 128)), "segments must be whole numbers; got type float64"),
        (np.full((128, 128), -2), r"segments must be whole numbers in 0\.\..*; got -2\.\.-2"),
        (np.zeros((128, 128, 3), int), r"segments must be an array .*; got shape \(128, 128, 3\)"),
        (np.arange(128 * 128).reshape(128, 128), "at most 10000; got 16384"),
        ("no such file.png", "cannot read no such file"),
        ("text.png", r"text\.png must be"),
        ("float.tif", "type float32"),
        ("photo.png", r"photo\.png .*at most 10000"),
    ],
)
def test_segments_that_cannot_be_are_refused_before_the_fit(
    segments, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    pixels = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)
    (tmp_path / "text.png").write_text("no picture")
    Image.fromarray(np.zeros((128, 128), np.float32)).save("float.tif")
    Image.fromarray(pixels).save("photo.png")
    with pytest.raises(InputError, match=message):
        vectorize(pixels, segments=segments, progress=_no_fit)


def _no_fit(progress):
    assert progress.phase != "fit"
