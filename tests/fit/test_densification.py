"""Properties of the number of Gaussians that a fit has, and of the sizes at which it refines."""

import itertools
import time

import numpy as np
import pytest
from flat import fit_config, session_of

from gauss2svg.fit.schedule import FULL_FROM, GROWTH_SHARE
from gauss2svg.fit.session import DensificationPolicy
from gauss2svg.measure import metrics
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.render import render


def test_resized_fit_has_the_count_and_stays_a_good_fit(photo):
    """A fit of fewer Gaussians is worse, and one that has them again nearly as good as before."""
    session = session_of(photo, fit_config(400, 100))
    session.fit()
    scores = [metrics.psnr(render(session.scene()), photo)]
    for count in (200, 400):
        session.resize(count, 40)
        assert len(session.state) <= count
        scores.append(metrics.psnr(render(session.scene()), photo))
    before, fewer, again = scores
    assert fewer < before - 0.5
    # 0.4 dB under the first fit and 3.5 over the smaller one
    assert again > max(before - 0.7, fewer + 3)


def test_fit_takes_the_time_until_its_deadline_and_no_more(photo, monkeypatch):
    ticks = itertools.count()
    # A clock that counts how often it is read, so that no machine is too slow or too fast.
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))

    def steps(limit: int, most: int | None) -> int:
        begun = next(ticks)
        config = fit_config(60, most)
        session = session_of(photo[::4, ::4], config, deadline=lambda: float(begun + limit))
        session.fit()
        assert session.result().stop_reason == "time_limit"
        assert len(session.state) == 60
        assert next(ticks) - begun < limit + 20
        return session.result().iterations

    for most in (None, 2000):
        assert steps(150, most) * 1.5 < steps(450, most)


def large(count, iterations=60, config=None):
    """A session on a picture large enough for reduced refinement, and the sizes of its steps."""
    y, x = np.mgrid[:256, :320] / 256
    stripes = 0.5 + 0.3 * np.sin(17 * x * (1 + y)) * np.cos(9 * y)
    pixels = np.stack([stripes, x / 1.25, 1 - y], axis=-1).astype(np.float32)
    policy = DensificationPolicy(fit_config(count, iterations))
    config = config or fit_config(count, iterations)
    sizes: list[tuple[float, int, float]] = []

    def look(now) -> None:
        moments = float(session.state.adam_v.sum())
        sizes.append((now.done, session.population.reduction, moments))

    session = session_of(pixels, config, policy, progress=look)
    return session, sizes


@pytest.mark.parametrize("goal", [{}, {"target_psnr": 60.0}, {"max_bytes": 10**6}])
def test_refinement_ends_at_full_size_and_is_all_at_it_where_the_count_adapts(goal):
    options = Options.from_flat({"gaussians": 40, "iterations": 60, **goal})
    session, sizes = large(40, config=Plan(options).fit_config)
    session.fit()
    refined = [step for step in sizes if step[0] > GROWTH_SHARE]
    early = [size for done, size, _ in refined if done < FULL_FROM]
    late = [size for done, size, _ in refined if done >= FULL_FROM]
    assert len(early) > 10
    assert len(late) > 10
    assert set(late) == {session.population.reduction} == {1}
    assert all(size == 1 if goal else size > 1 for size in early)
    for (_, size, before), (_, larger, after) in itertools.pairwise(refined):
        if larger < size:  # squared gradients are of sums over pixels
            assert after == pytest.approx(before * (size / larger) ** 4, rel=0.5)
