"""Laws of fits of few Gaussians, whose refinement begins on reduced pictures."""

import numpy as np
import pytest
from flat import fit_config

from gauss2svg.fit.schedule import FULL_FROM, GROWTH_SHARE, refinement_reduction
from gauss2svg.fit.session import DensificationPolicy, FitSession
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan


def large(count, iterations=60, config=None, **given):
    """A session on a picture large enough for reduced refinement, and the sizes of its steps."""
    y, x = np.mgrid[:256, :320] / 256
    stripes = 0.5 + 0.3 * np.sin(17 * x * (1 + y)) * np.cos(9 * y)
    pixels = np.stack([stripes, x / 1.25, 1 - y], axis=-1).astype(np.float32)
    policy = DensificationPolicy(fit_config(count, iterations))
    config = config or fit_config(count, iterations, **given)
    sizes: list[tuple[float, int]] = []
    session = FitSession(
        pixels, config, policy,
        progress=lambda now: sizes.append((now.done, session.population.reduction)),
    )  # fmt: skip
    return session, sizes


@pytest.mark.parametrize("goal", [{}, {"target_psnr": 60.0}, {"max_bytes": 10**6}])
def test_refinement_ends_at_full_size_and_is_all_at_it_where_the_count_adapts(goal):
    options = Options.from_flat({"gaussians": 40, "iterations": 60, **goal})
    session, sizes = large(40, config=Plan(options).fit_config)
    session.fit()
    early = [size for done, size in sizes if GROWTH_SHARE < done < FULL_FROM]
    late = [size for done, size in sizes if done >= FULL_FROM]
    assert len(early) > 10
    assert len(late) > 10
    assert set(late) == {session.population.reduction} == {1}
    assert all(size == 1 if goal else size > 1 for size in early)


def test_refinement_is_reduced_only_while_gaussians_keep_their_pixels():
    factors = [refinement_reduction(0.3, n, 768, 512) for n in (1, 682, 683, 2730, 2731, 10_000)]
    assert factors == [4, 4, 2, 2, 1, 1]
    assert [refinement_reduction(d, 256, 768, 512) for d in (0.3, 0.5, 0.55, 1)] == [4, 2, 1, 1]
    assert refinement_reduction(0.3, 1, 255, 512) == 1
    configs = [fit_config(n, 200, extend=True) for n in (0, 256, 2731)]
    assert [config.steps(768, 512) for config in configs] == [200, 400, 200]


def is_refining(session) -> bool:
    """Whether growth has ended, which no public attribute says."""
    return session.clock._steps is not None


def test_moments_follow_the_size_of_the_picture_in_refinement_alone(monkeypatch):
    session, _ = large(40, 30)
    population, real, grown = session.population, session.population.reduce_to, []

    def spy(factor, **given):
        before, size = population.state.adam_m, population.reduction
        real(factor, **given)
        if len(before):
            change = (size / factor) ** 2 if is_refining(session) else 1.0
            np.testing.assert_allclose(population.state.adam_m, before * change)
            grown.append(change)

    monkeypatch.setattr(population, "reduce_to", spy)
    session.fit()
    assert 1.0 in grown
    assert max(grown) >= 4


def test_an_interrupted_reduced_refinement_ends_at_full_size():
    session, _ = large(40)
    session.clock._stop = lambda: session.population.reduction > 1 and is_refining(session)
    session.fit()
    assert session.clock.stopped
    assert session.population.reduction == 1
    assert session.scene().mean.max() > 160


def test_a_fit_of_few_visits_fewer_pixels_than_one_of_many():
    pairs = []
    for count in (13, 520):  # as many pixels for each as 256 and 10 000 have on a photo
        session, _ = large(count, 20, extend=True)
        session.fit()
        pairs.append(session.pixel_pairs)
    assert 3 * pairs[0] <= pairs[1]
