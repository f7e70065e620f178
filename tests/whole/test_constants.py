"""Constants that ablations chose: each varies by its name, and changes a result."""

from pkgutil import resolve_name

import pytest
from flat import fit_config

from gauss2svg.compare.variants import apply_constants
from gauss2svg.fit.fit import fit


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fit.adam.FIRST_DECAY", 0.5),
        ("fit.adam.INITIAL_OPACITY_LOGIT", 0.0),
        ("fit.placement.LEAST_SIGMA", 3.0),
        ("fit.population.RELOCATED", 0.3),
        ("fit.schedule.GROWTH_SHARE", 0.6),
        ("fit.population.BETA_PRICE", 0.5),
        ("fit.target.EXPONENT", 0.1),
    ],
)
def test_a_constant_of_the_fit_changes_it_and_its_default_no_bit(photo, monkeypatch, name, value):
    default = resolve_name(f"gauss2svg.{name}")
    monkeypatch.setattr(f"gauss2svg.{name}", default)  # restores it at the end
    pixels, config = photo[:48, :64], fit_config(40, 20)

    def means():
        return fit(pixels, config).scene.mean.tobytes()

    usual = means()
    apply_constants({name: default})
    assert means() == usual
    apply_constants({name: value})
    assert means() != usual
