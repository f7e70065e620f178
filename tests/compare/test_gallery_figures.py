"""Crops, charts and numbers of a gallery, against exhaustive searches and tables."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.compare import chart
from gauss2svg.compare.chart import BESIDE, PAGE, Point, scatter
from gauss2svg.compare.pages.artifacts import crops_of
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


points = st.lists(
    st.builds(
        Point,
        cost=st.floats(1e-2, 1e7) | st.sampled_from([1.27, 3.0, 3.0, 7.0]),
        score=st.none() | st.floats(-5, 120, allow_subnormal=False) | st.sampled_from([30.0, 35.0]),
        series=st.integers(0, 3),
        group=st.none() | st.integers(0, 2),
        text=st.just(""),
    ),
    min_size=1,
    max_size=10,
)


@pytest.mark.parametrize("frame", [PAGE, BESIDE])
@given(points)
@example([Point(1.27, 30.0, 0, None, "")])
@example([Point(7.0, None, 0, 0, "")] * 2)
@example([Point(1.0, 30.0, 0, 0, ""), Point(1.0, 30.0, 1, 0, "")])
def test_points_and_ticks_lie_in_the_frame_in_their_order(frame, given_points):
    chart = scatter(given_points, lambda cost: f"{cost:g}", frame=frame)
    assert chart.frame == frame
    assert [placed.point for placed in chart.points] == given_points
    for placed in chart.points:
        assert frame.left < placed.x < frame.right
        assert frame.top <= placed.y <= frame.bottom
        assert (placed.y == chart.equal_y) == (placed.point.score is None)
    assert (chart.equal_y is None) == all(point.score is not None for point in given_points)
    by_cost = sorted(chart.points, key=lambda placed: placed.point.cost)
    assert all(one.x <= other.x for one, other in pairwise(by_cost))
    finite = sorted(
        (placed for placed in chart.points if placed.point.score is not None),
        key=lambda placed: placed.point.score,
    )
    assert all(one.y >= other.y for one, other in pairwise(finite))
    if chart.equal_y is not None:
        assert all(placed.y > chart.equal_y for placed in finite)

    assert chart.x_ticks
    assert len(chart.x_ticks) < 12
    places = [x for x, _ in chart.x_ticks]
    assert places == sorted(set(places))
    assert all(frame.left <= x <= frame.right for x in places)
    assert all(other - one >= 28 for one, other in pairwise(places))  # so that texts fit
    assert 2 <= len(chart.y_ticks) <= 9
    assert all(frame.top <= y <= frame.bottom for y, _ in chart.y_ticks)
    levels = [float(text) for _, text in chart.y_ticks]
    assert levels == sorted(set(levels))
    for placed in finite:
        assert levels[0] <= placed.point.score <= levels[-1]


@given(points)
def test_points_of_a_group_are_joined_by_their_cost(given_points):
    chart = scatter(given_points, str)
    joined = [[tuple(map(float, pair.split(","))) for pair in line.split()] for line in chart.lines]
    groups = {}
    for placed in chart.points:
        if placed.point.group is not None:
            groups.setdefault(placed.point.group, []).append((placed.x, placed.y))
    for one in groups.values():
        one.sort(key=lambda at: at[0])
    assert joined == list(groups.values())


def test_point_lies_at_the_tick_of_its_value():
    given_points = [Point(cost, psnr, 0, None, "") for cost, psnr in ((10, 30), (1000, 36))]
    chart = scatter(given_points, lambda cost: f"{cost:g}")
    by_text = {text: x for x, text in chart.x_ticks}
    assert [placed.x for placed in chart.points] == [by_text["10"], by_text["1000"]]
    by_text = {text: y for y, text in chart.y_ticks}
    assert [placed.y for placed in chart.points] == [by_text["30"], by_text["36"]]
    assert scatter([], str) is None


NOTHING = "\N{EN DASH}"
NARROW = "\N{NARROW NO-BREAK SPACE}"


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
        (chart.short_size, 500, "500 B"), (chart.short_size, 5e4, "50 kB"),
        (chart.short_size, 2e6, "2 MB"), (chart.short_size, 0.5, "0.5 B"),
        (chart.short_seconds, 0.5, "0.5 s"), (chart.short_seconds, 20.0, "20 s"),
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
