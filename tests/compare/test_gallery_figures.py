"""Crops, charts and numbers of a gallery, against exhaustive searches and tables."""

import math
import re
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.compare import chart
from gauss2svg.compare.chart import COSTS, NARROW, WIDE, scatter, template_environment
from gauss2svg.compare.run import crops_of
from gauss2svg.measure.scores import PSNR, SSIM


@pytest.mark.parametrize(
    ("height", "width", "side"), [(9, 14, 4), (3, 14, 5), (12, 6, 6), (1, 1, 3)]
)
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
    assert crops_of(image, image, side)["worst"]["psnr"] == math.inf


def point(cost, score, group=None):
    return {"cost": cost, "score": score, "group": group}


points = st.lists(
    st.builds(
        point,
        cost=st.floats(1e-2, 1e7) | st.sampled_from([1.27, 3.0, 3.0, 7.0]),
        score=st.none() | st.floats(-5, 120, allow_subnormal=False) | st.sampled_from([30.0, 35.0]),
        group=st.none() | st.integers(0, 2),
    ),
    min_size=1,
    max_size=10,
)


@pytest.mark.parametrize("frame", [WIDE, NARROW])
@given(points)
@example([point(1.27, 30.0)])
@example([point(7.0, None, 0)] * 2)
@example([point(1.0, 30.0, 0), point(1.0, 30.0, 0)])
def test_points_and_ticks_lie_in_the_frame_in_their_order(frame, given_points):
    chart = scatter(given_points, COSTS[0], frame=frame)
    placed, equal_y = chart["points"], chart["equal_y"]
    assert chart["frame"] == frame
    assert [{name: one[name] for name in point(0, 0)} for one in placed] == given_points
    for one in placed:
        assert frame.left < one["x"] < frame.right
        assert frame.top <= one["y"] <= frame.bottom
        assert (one["y"] == equal_y) == (one["score"] is None)
    assert (equal_y is None) == all(one["score"] is not None for one in given_points)
    by_cost = sorted(placed, key=lambda one: one["cost"])
    assert all(one["x"] <= other["x"] for one, other in pairwise(by_cost))
    finite = [one for one in placed if one["score"] is not None]
    finite.sort(key=lambda one: one["score"])
    assert all(one["y"] >= other["y"] for one, other in pairwise(finite))
    if equal_y is not None:
        assert all(one["y"] > equal_y for one in finite)

    places = [x for x, _ in chart["x_ticks"]]
    assert 0 < len(places) < 12
    assert places == sorted(set(places))
    assert all(frame.left <= x <= frame.right for x in places)
    assert all(other - one >= 28 for one, other in pairwise(places))  # so that texts fit
    assert 2 <= len(chart["y_ticks"]) <= 9
    assert all(frame.top <= y <= frame.bottom for y, _ in chart["y_ticks"])
    levels = [float(text) for _, text in chart["y_ticks"]]
    assert levels == sorted(set(levels))
    for one in finite:
        assert levels[0] <= one["score"] <= levels[-1]


@given(points)
def test_points_of_a_group_are_joined_by_their_cost(given_points):
    chart = scatter([one | {"series": 0, "text": ""} for one in given_points], COSTS[0])
    plot = template_environment().get_template("chart.jinja").module.plot(chart)
    lines = [
        re.findall(r"([\d.-]+),([\d.-]+)", line) for line in re.findall('points="(.*?)"', plot)
    ]
    joined = [[(float(x), float(y)) for x, y in line] for line in lines]
    groups = {one["group"]: [] for one in chart["points"] if one["group"] is not None}
    for one in chart["points"]:
        if one["group"] is not None:
            groups[one["group"]].append((one["x"], one["y"]))
    assert joined == [sorted(groups[group], key=lambda at: at[0]) for group in sorted(groups)]


def test_point_lies_at_the_tick_of_its_value():
    chart = scatter([point(10, 30), point(1000, 36)], COSTS[0])
    by_text = {text: x for x, text in chart["x_ticks"]} | {text: y for y, text in chart["y_ticks"]}
    places = [at for one in chart["points"] for at in (one["x"], one["y"])]
    assert places == [by_text[text] for text in (f"10{NARROW}B", "30", f"1{NARROW}kB", "36")]
    assert scatter([], COSTS[0]) is None


NOTHING = "\N{EN DASH}"
NARROW = "\N{NARROW NO-BREAK SPACE}"
in_bytes, in_seconds = partial(chart.tick, unit="bytes"), partial(chart.tick, unit="seconds")


@pytest.mark.parametrize(
    ("show", "value", "text"),
    [
        (chart.size, 0, "0 B"), (chart.size, 999, "999 B"), (chart.size, 999.4, "999 B"),
        (chart.size, 999.5, "1.00 kB"), (chart.size, 1000, "1.00 kB"),
        (chart.size, 9994, "9.99 kB"), (chart.size, 9995, "10.0 kB"),
        (chart.size, 2625, "2.63 kB"), (chart.size, 1125, "1.13 kB"),  # ties, as of scripts
        (chart.size, 58_345, "58.3 kB"), (chart.size, 99_949, "99.9 kB"),
        (chart.size, 99_950, "100 kB"), (chart.size, 999_499, "999 kB"),
        (chart.size, 999_500, "1.00 MB"), (chart.size, 1_680_000, "1.68 MB"),
        (chart.size, 1.5e9, "1 500 MB"), (chart.size, None, NOTHING),
        (chart.seconds, 0.844, "0.84 s"), (chart.seconds, 9.994, "9.99 s"),
        (chart.seconds, 9.995, "10.0 s"), (chart.seconds, 99.94, "99.9 s"),
        (chart.seconds, 99.95, "100 s"), (chart.seconds, 401.4, "401 s"),
        (chart.seconds, 12_345.6, "12 346 s"), (chart.seconds, None, NOTHING),
        (PSNR.text, 31.416, "31.42 dB"), (PSNR.text, None, "equal"),
        (SSIM.text, 1.0, "1.000"), (SSIM.text, 0.6666, "0.667"), (SSIM.text, None, NOTHING),
        (chart.whole, 0, "0"), (chart.whole, 1_234_567, "1 234 567"),
        (chart.whole, None, NOTHING),
        (in_bytes, 500, "500 B"), (in_bytes, 5e4, "50 kB"),
        (in_bytes, 2e6, "2 MB"), (in_bytes, 0.5, "0.5 B"),
        (in_seconds, 0.5, "0.5 s"), (in_seconds, 20.0, "20 s"),
    ],
)  # fmt: skip
def test_numbers_are_shown_so(show, value, text):
    assert show(value).replace(NARROW, " ") == text
    assert " " not in show(value)  # no line break separates the unit


@given(st.floats(1, 1e9))
def test_sizes_have_three_digits_and_are_right_to_them(count):
    text, unit = chart.size(count).split(NARROW)[-2:]
    value = float("".join(chart.size(count).split(NARROW)[:-1]))
    assert value * {"B": 1, "kB": 1e3, "MB": 1e6}[unit] == pytest.approx(
        count, rel=0.00501, abs=0.5
    )
    if count >= 1000:
        assert len(text.replace(".", "")) == 3
