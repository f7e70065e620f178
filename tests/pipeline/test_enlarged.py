"""Drawings enlarged: what fits agree on between the pixels of a picture, and files fitted to it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from skimage import data

from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.alpha import over, shrunk, stacked
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search import by_bytes
from gauss2svg.pipeline.search import enlarged as enlarging
from gauss2svg.pipeline.search.by_bytes import ByBytes
from gauss2svg.pipeline.search.enlarged import TUNING, enlarged, large_raster
from gauss2svg.pipeline.search.outcome import Watch, best_of
from gauss2svg.pipeline.search.subject import Subject
from gauss2svg.raster import rasterize

SIDE, UP = 32, TUNING.times


def disc(x=16.3, y=15.2, radius=9.6, alpha=False):
    """A disc of flat colour at four times the size, perhaps on a clear ground."""
    down, across = (np.mgrid[: SIDE * UP, : SIDE * UP] + 0.5) / UP
    inside = np.hypot(across - x, down - y) < radius
    picture = np.where(inside[:, :, None], [0.9, 0.2, 0.1], [0.95, 0.9, 0.8]).astype(np.float32)
    return (
        np.dstack([picture * inside[:, :, None], inside]).astype(np.float32) if alpha else picture
    )


def sign(side=SIDE):
    """A ring and a bar of flat colours, at four times that size."""
    down, across = (np.mgrid[: side * UP, : side * UP] + 0.5) / UP * (32 / side)
    picture = np.full((*down.shape, 3), 0.95, np.float32)
    picture[np.abs(np.hypot(across - 13, down - 14) - 8) < 2] = 0.1, 0.3, 0.7
    picture[(np.abs(across - down - 7) < 2.5) & (across + down < 52)] = 0.9, 0.2, 0.1
    return picture


def pixels_of(large):
    return shrunk(large, large.shape[0] // UP, large.shape[1] // UP)


def misplaced(seed, alpha=False, count=3):
    """Discs as fits may place them: each a little elsewhere."""
    rng = np.random.default_rng(seed)
    shifts = rng.normal(0, 0.15, (count, 3))
    return [disc(16.3 + dx, 15.2 + dy, 9.6 + dr, alpha) for dx, dy, dr in shifts]


def search(picture, limit, **given):
    options = Options.from_flat({"max_bytes": limit, **given})
    return ByBytes(Plan(options, by_bytes=True), Subject.of(picture), Watch())


def by_pixel(picture, rasters):
    """`enlarged` as its docstring says it, one value after the other."""
    times, (height, width, channels) = UP, picture.shape
    values = np.array(rasters, np.float64)
    start, spread = values.mean(axis=0), values.var(axis=0)
    uncertain = np.empty(start.shape[:2])
    for y, x in np.ndindex(uncertain.shape):
        rows = np.clip([y - 1, y, y + 1], 0, height * times - 1)
        columns = np.clip([x - 1, x, x + 1], 0, width * times - 1)
        near = start[np.ix_(rows, columns)].reshape(9, channels)
        uncertain[y, x] = np.mean(spread[y, x]) + 0.3 * np.mean(near.var(axis=0)) + 0.001
    found = start.copy()
    for _ in range(5):
        for y, x in np.ndindex(height, width):
            block = np.s_[times * y : times * (y + 1), times * x : times * (x + 1)]
            share = uncertain[block] / uncertain[block].mean()
            missing = picture[y, x] - found[block].mean(axis=(0, 1))
            found[block] = np.clip(found[block] + share[:, :, None] * missing, 0, 1)
    half = found.reshape(height * 2, times // 2, width * 2, times // 2, channels)
    return half.mean(axis=(1, 3))


@pytest.mark.parametrize("count", [1, 3])
def test_an_enlarged_picture_is_what_the_formula_says(count):
    picture = pixels_of(disc())[4:14, 3:16]  # at the rim
    rasters = [r[4 * UP : 14 * UP, 3 * UP : 16 * UP] for r in misplaced(1, count=count)]
    np.testing.assert_allclose(enlarged(picture, rasters), by_pixel(picture, rasters), atol=2e-5)


@pytest.mark.parametrize("alpha", [False, True])
def test_an_enlarged_picture_averages_to_the_picture(alpha):
    picture = pixels_of(disc(alpha=alpha))
    large = enlarged(picture, misplaced(2, alpha))
    assert large.shape == (2 * SIDE, 2 * SIDE, picture.shape[2])
    small = shrunk(large, SIDE, SIDE)
    for background in (0.0, 1.0):
        assert np.abs(over(small, background) - over(picture, background)).max() < 0.02


@pytest.mark.parametrize("alpha", [False, True])
def test_what_fits_show_truly_stays(alpha):
    truth = disc(alpha=alpha)
    large = enlarged(pixels_of(truth), [truth, truth])
    assert psnr(stacked(large), stacked(shrunk(truth, 2 * SIDE, 2 * SIDE))) > 60


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_an_enlarged_picture_is_closer_to_the_truth_than_each_fit_and_their_mean(seed, alpha):
    truth = shrunk(disc(alpha=alpha), 2 * SIDE, 2 * SIDE)
    rasters = misplaced(seed, alpha)

    def score(large):
        return psnr(stacked(large), stacked(truth))

    single = [score(shrunk(r, 2 * SIDE, 2 * SIDE)) for r in rasters]
    mean = np.mean([stacked(shrunk(r, 2 * SIDE, 2 * SIDE)) for r in rasters], axis=0)
    found = score(enlarged(pixels_of(disc(alpha=alpha)), rasters))
    assert found > max(single) + 1
    assert found > psnr(mean, stacked(truth)) + 1


def test_a_raster_is_four_times_as_large_and_has_the_alpha_of_the_picture():
    svg = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 4"><path d="M0 0h4v4H0"/></svg>'
    opaque, clear = (large_raster(svg, np.zeros((4, 8, n), np.float32), "resvg") for n in (3, 4))
    assert opaque.shape == (16, 32, 3)
    np.testing.assert_array_equal(clear[:, :, 3], np.repeat([[1.0] * 16 + [0.0] * 16], 16, axis=0))


@pytest.mark.sweep
@pytest.mark.parametrize("clear", [False, True])
def test_a_small_file_of_a_drawing_is_closer_when_it_is_enlarged(monkeypatch, clear):
    truth = sign(48)
    if clear:
        truth = np.dstack([truth, truth.min(axis=2) < 0.9]).astype(np.float32)
    picture = pixels_of(truth)
    now = search(picture, 4000).file()
    monkeypatch.setattr(enlarging, "TUNING", dataclasses.replace(TUNING, up_to=0))
    before = search(picture, 4000).file()

    def score(file, at):
        side = at.shape[0]
        shown = rasterize(file.svg, side, side)
        return psnr(shown, over(at))

    assert now.size <= 4000
    assert score(now, truth) > score(before, truth) + 1
    assert score(now, picture) > score(before, picture) - 3


def fits_enlarged(monkeypatch, picture, limit, **given):
    """Sizes of the pictures that a search fits."""
    sizes, session = [], by_bytes.FitSession

    def spied(pixels, *rest, **named):
        sizes.append(pixels.shape[1::-1])
        return session(pixels, *rest, **named)

    monkeypatch.setattr(by_bytes, "FitSession", spied)
    search(picture, limit, iterations=4, **given).file()
    return sizes


def test_a_small_drawing_is_fitted_once_more_at_twice_its_size(monkeypatch):
    sizes = fits_enlarged(monkeypatch, small_sign(), 2500)
    assert sizes[-1] == (128, 128)
    assert set(sizes[:-1]) == {(64, 64)}


def small_sign():
    return pixels_of(sign(64))


def large_sign():
    return pixels_of(sign(260))


@pytest.mark.parametrize(
    ("picture", "limit", "given"),
    [
        (small_sign, 1900, {}),
        (small_sign, 2500, {"max_size": 60}),
        (large_sign, 2500, {}),
        (lambda: sign(16), 2500, {}),  # three colours, of whole pixels
        (lambda: shrunk((data.astronaut() / 255).astype(np.float32), 64, 64), 2500, {}),
    ],
    ids=["few bytes", "reduced", "large", "few colours", "photo"],
)
def test_other_pictures_are_fitted_at_their_size(monkeypatch, picture, limit, given):
    sizes = fits_enlarged(monkeypatch, picture(), limit, **given)
    assert len(set(sizes)) == 1


def test_of_two_searches_the_file_that_is_closer_to_the_enlarged_drawing_is_kept():
    """The other is closer at the drawing's own size."""
    outcome = search(small_sign(), 3000, iterations=20).run()
    assert outcome.enlarged is not None
    other = dataclasses.replace(
        outcome,
        enlarged=None,
        svg='<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"/>',
        measured=SimpleNamespace(psnr_lowest=99.0),
    )

    class Given:
        def __init__(self, one):
            self.run = lambda: one

    assert best_of([Given(outcome), Given(other)]).svg == outcome.svg
    without = dataclasses.replace(outcome, enlarged=None)
    assert best_of([Given(without), Given(other)]).svg == other.svg


def test_the_file_of_an_enlarged_drawing_is_measured_against_the_drawing():
    picture = small_sign()
    outcome = search(picture, 2500, iterations=20).run()
    assert outcome.enlarged is not None
    assert outcome.working.shape == outcome.measured.raster.shape == picture.shape
    shown = rasterize(outcome.svg, 64, 64)
    assert outcome.measured.psnr_lowest == pytest.approx(psnr(shown, picture), abs=0.01)
