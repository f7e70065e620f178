"""Crops, charts and numbers of a gallery, against exhaustive searches and tables."""

import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.compare import chart
from gauss2svg.compare.chart import COSTS, NARROW, WIDE, scatter
from gauss2svg.compare.run import crops_of
from gauss2svg.measure import PSNR, SSIM


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
    assert all(other - one >= 28 for one, other in pairwise(places))  # so that texts fit
    assert 2 <= len(chart["y_ticks"]) <= 9
    assert all(frame.top <= y <= frame.bottom for y, _ in chart["y_ticks"])
    levels = [float(text) for _, text in chart["y_ticks"]]
    assert levels == sorted(set(levels))
    assert all(levels[0] <= one["score"] <= levels[-1] for one in finite)


NOTHING = "\N{EN DASH}"
NARROW = "\N{NARROW NO-BREAK SPACE}"
in_bytes, in_seconds = partial(chart.tick, unit="bytes"), partial(chart.tick, unit="seconds")


@pytest.mark.parametrize(
    ("show", "value", "text"),
    [
        (chart.size, 0, "0 B"), (chart.size, 999.4, "999 B"), (chart.size, 999.5, "1.00 kB"),
        (chart.size, 2625, "2.63 kB"), (chart.size, 9995, "10.0 kB"),  # ties, as of scripts
        (chart.size, 99_949, "99.9 kB"), (chart.size, 999_500, "1.00 MB"),
        (chart.size, 1.5e9, "1 500 MB"), (chart.size, None, NOTHING),
        (chart.seconds, 0.844, "0.84 s"), (chart.seconds, 9.995, "10.0 s"),
        (chart.seconds, 12_345.6, "12 346 s"), (chart.seconds, None, NOTHING),
        (PSNR.text, 31.416, "31.42 dB"), (PSNR.text, None, "equal"), (SSIM.text, 0.6666, "0.667"),
        (SSIM.text, None, NOTHING), (chart.whole, 1_234_567, "1 234 567"),
        (chart.whole, None, NOTHING), (in_bytes, 5e4, "50 kB"), (in_seconds, 0.5, "0.5 s"),
    ],
)  # fmt: skip
def test_numbers_are_shown_so(show, value, text):
    assert show(value).replace(NARROW, " ") == text
    assert " " not in show(value)  # no line break separates the unit
