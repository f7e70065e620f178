"""Parts of benchmarks and galleries that need no run: settings, names, records, crops, charts."""

import json
import math
import re
from collections import Counter
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.batch.inputs import listed_photos, slug_of
from gauss2svg.compare import chart
from gauss2svg.compare.grid import add_row, rows_in
from gauss2svg.compare.run import crops_of
from gauss2svg.compare.variants import parse_axes, settings_of
from gauss2svg.errors import InputError
from gauss2svg.measure import PSNR, SSIM


def test_later_row_of_a_key_counts_and_damaged_lines_do_not(tmp_path):
    path = tmp_path / "rows.jsonl"
    first, last = {"key": "a", "error": "x"}, {"key": "a", "n": 2}
    lines = [json.dumps(first), "rubbish", "[1]", json.dumps(last), '{"n": 3}', '{"k']
    path.write_text("\n".join(lines))
    assert rows_in(path) == {"a": last}
    add_row(path, first | {"key": "b"})  # after half a line
    add_row(path, last | {"n": 4})
    assert rows_in(path) == {"a": last | {"n": 4}, "b": first | {"key": "b"}}
    assert path.read_text().count("\n") == len(lines) + 2


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("inks=3,6", (3, 6)),
        ("inks=6;#fff,#000; f7c306,17324d", (6, "#ffffff,#000000", "#f7c306,#17324d")),
        ("gaussians=auto, 5", ("auto", 5)),
        ("form", ("gradient",)), ("renderer", ("resvg", "cairo")),  # which need no other program
    ],
)  # fmt: skip
def test_values_of_an_axis_stand_between_commas_or_semicolons(text, values):
    ((name, parsed),) = parse_axes([text]).items()
    assert parsed == values
    assert {dict(s)[name] for s in settings_of({name: values})} == set(values)


@pytest.mark.parametrize(
    ("axes", "line"),
    [
        (["colour"], "axis must be one of quality, .*max_size; got 'colour'$"),
        (["gausians=3"], ".*got 'gausians'. Try gaussians$"),
        (["inks=6,griin"], "axis inks must be .*Try 6, or"),
        ({"loss": ["l3"]}, "axis loss must be one of weighted, mse"),
        (["form=gradient,blur", "renderer=chromium,cairo"], ".*for form blur; got 'cairo'"),
    ],
)
def test_axes_that_no_run_could_have_are_refused_on_one_line(axes, line):
    with pytest.raises(InputError, match=f"^ax[ie]s:?.*{line.removeprefix('axis')}") as refusal:
        settings_of(axes if isinstance(axes, dict) else parse_axes(axes))
    assert "\n" not in str(refusal.value)


odd_letters = st.sampled_from("\udcff\ud800\u202e\u200f🙂/\\.:-x1 A\u0130")


@given(st.text(st.characters(codec="utf-8") | odd_letters, max_size=60))
@example("")
@example("K" * 300)
def test_slug_is_a_safe_name_of_a_folder_on_any_system(name):
    slug = slug_of(name)
    assert re.fullmatch(r"[a-z0-9]([a-z0-9-]*[a-z0-9])?", slug)
    assert len(slug) <= 48


# Few names, so that they clash in every way, also with one that ends in a digest.
FOLDERS, NAMES = ["", "a", "a/b", "b/a"], ["x", "X", "x.", "y", "x-2", "é"]
clashing = st.tuples(st.sampled_from(FOLDERS), st.sampled_from(NAMES)).map("/none/".join)


@given(st.lists(clashing, min_size=1, max_size=12, unique=True), st.randoms(use_true_random=False))
def test_names_and_slugs_are_unique_short_and_of_no_order(paths, random):
    found = listed_photos(paths)
    assert len({photo.slug for photo in found}) == len({p.name for p in found}) == len(paths)
    mixed = {photo.path: photo.slug for photo in listed_photos(random.sample(paths, len(paths)))}
    assert mixed == {photo.path: photo.slug for photo in found}
    names = Counter(Path(path).name for path in paths)
    for photo in found:  # the name is that of the file, or the path if another has the same
        own = Path(photo.path).name
        assert photo.name == (own if names[own] == 1 else Path(photo.path).as_posix())


@pytest.mark.parametrize(("height", "width", "side"), [(9, 14, 4), (3, 14, 5), (1, 1, 3)])
def test_crops_are_the_worst_window_and_one_of_the_median_error(height, width, side):
    image, other = np.random.default_rng(0).random((2, height, width, 3))
    down, across = min(side, height), min(side, width)
    squares = np.lib.stride_tricks.sliding_window_view((image - other) ** 2, (down, across, 3))
    errors = squares.mean(axis=(3, 4, 5))[:, :, 0]
    crops = crops_of(image, other, side)
    for kind, off in (("worst", -errors), ("typical", np.abs(errors - np.median(errors)))):
        crop = crops[kind]
        assert (crop["width"], crop["height"]) == (across, down)
        assert off[crop["y"], crop["x"]] == pytest.approx(off.min())
        assert crop["psnr"] == pytest.approx(-10 * math.log10(errors[crop["y"], crop["x"]]))
    assert crops_of(image, image, side)["worst"]["psnr"] is None


points = st.lists(
    st.fixed_dictionaries(
        {
            "cost": st.floats(1e-2, 1e7) | st.sampled_from([1.27, 3.0, 7.0]),
            "score": st.none() | st.floats(-5, 120, allow_subnormal=False) | st.just(30.0),
        }
    ),
    min_size=1,
    max_size=10,
)


@pytest.mark.parametrize("frame", [chart.WIDE, chart.NARROW])
@given(points)
@example([{"cost": 7.0, "score": None}] * 2)
@example([{"cost": 1.0, "score": 30.0}] * 2)
@example([{"cost": 0.0, "score": 30.0}, {"cost": 2.0, "score": 31.0}])
def test_points_and_ticks_lie_in_the_frame_in_their_order(frame, given_points):
    drawn = chart.scatter([{"group": 0} | one for one in given_points], chart.COSTS[0], frame=frame)
    placed, equal_y, levels = drawn["points"], drawn["equal_y"], drawn["y_ticks"]
    assert [{name: one[name] for name in ("cost", "score")} for one in placed] == given_points
    for one in placed:
        assert frame.left < one["x"] < frame.right
        assert frame.top <= one["y"] <= frame.bottom
        assert (one["y"] == equal_y) == (one["score"] is None)
    by_cost = sorted(placed, key=lambda one: one["cost"])
    assert all(one["x"] <= other["x"] for one, other in pairwise(by_cost))
    finite = [one for one in placed if one["score"] is not None]
    finite.sort(key=lambda one: one["score"])
    assert all(one["y"] >= other["y"] for one, other in pairwise(finite))
    places = [x for x, _ in drawn["x_ticks"]]
    assert all(other - one >= 28 for one, other in pairwise(places))  # so that texts fit
    assert 2 <= len(levels) <= 9
    assert all(frame.top <= y <= frame.bottom for y, _ in levels)
    least, most = float(levels[0][1]), float(levels[-1][1])
    assert all(least <= one["score"] <= most for one in finite)


in_bytes, in_seconds = partial(chart.tick, unit="bytes"), partial(chart.tick, unit="seconds")


@pytest.mark.parametrize(
    ("show", "value", "text"),
    [
        (chart.size, 999.5, "1.00 kB"), (chart.size, 1.5e9, "1 500 MB"),
        (chart.size, None, "\N{EN DASH}"), (chart.seconds, 0.844, "0.84 s"),
        (chart.seconds, 9.995, "10.0 s"), (PSNR.text, 31.416, "31.42 dB"),
        (PSNR.text, None, "equal"), (SSIM.text, 0.6666, "0.667"), (in_bytes, 5e4, "50 kB"),
        (chart.whole, 1_234_567, "1 234 567"), (in_seconds, 0.5, "0.5 s"),
    ],
)  # fmt: skip
def test_numbers_are_shown_so(show, value, text):
    assert show(value).replace("\N{NARROW NO-BREAK SPACE}", " ") == text
    assert " " not in show(value)  # no line break separates the unit
