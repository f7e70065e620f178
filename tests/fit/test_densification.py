"""Properties of the number of Gaussians that a fit has, and of the sizes at which it refines."""

import itertools
import time

from flat import fit_config, session_of

from gauss2svg.fit.schedule import Clock
from gauss2svg.measure import metrics
from gauss2svg.render import render


def test_resized_fit_has_the_count_and_stays_a_good_fit(photo):
    """A fit of fewer Gaussians is worse, and one that has them again nearly as good as before."""
    session = session_of(photo, fit_config(400, 100))
    session.fit()
    scores = [metrics.psnr(render(session.scene()), photo)]
    for count in (200, 400):
        session.resize(count, 40)
        assert session.count <= count
        scores.append(metrics.psnr(render(session.scene()), photo))
    before, fewer, again = scores
    assert fewer < before - 0.5
    # 0.4 dB under the first fit and 3.5 over the smaller one
    assert again > max(before - 0.7, fewer + 3)


def test_fit_takes_the_time_until_its_deadline_and_no_more(photo, monkeypatch):
    ticks = itertools.count()
    # A clock that counts how often it is read, so that no machine is too slow or too fast.
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))

    def steps(limit: int, most: int) -> int:
        begun = next(ticks)
        config = fit_config(60, most)
        session = session_of(photo[::4, ::4], config, deadline=lambda: float(begun + limit))
        session.fit()
        assert session.result().stop_reason == "time_limit"
        assert session.count == 60
        assert next(ticks) - begun < limit + 20
        return session.result().iterations

    for most in (2000, 10**6):
        assert steps(150, most) * 1.5 < steps(450, most)


def test_refinement_that_begins_after_a_pause_ends_at_the_deadline(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    clock = Clock(100, 1, lambda: 10.0)
    with clock.paused():
        now[0] = 4.0
    clock.begin_refinement(100, 0.5)
    now[0] = 7.0
    assert clock.refinement_progress() == 0.75
    now[0] = 10.0
    assert clock.refinement_progress() == 1
