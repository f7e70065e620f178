"""Constants that ablations chose: each is described, varies by its name, and changes a result."""

import ast
import dataclasses
import re
from importlib import import_module
from pathlib import Path

import pytest
from flat import fit_config

import gauss2svg
from gauss2svg.compare.axes import apply_constants, parse_axis
from gauss2svg.fit.fit import fit

ROOT = Path(gauss2svg.__path__[0])
HOMES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in ROOT.rglob("*.py")
    if re.search(r"^TUNING = \w+\(\)$", path.read_text("utf-8"), re.MULTILINE)
)


def test_nothing_reads_a_tuning_at_import_or_keeps_a_copy():
    """A varied value would not reach it: at module level, in a default, in a cached function."""
    for path in ROOT.rglob("*.py"):
        text = path.read_text("utf-8")
        if "TUNING" not in text:
            continue
        tree = ast.parse(text)
        kept = (ast.FunctionDef, ast.ClassDef, ast.Expr)
        early: list[ast.AST] = [node for node in tree.body if not isinstance(node, kept)]
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                assert "TUNING" not in [name.name for name in node.names], path
            elif isinstance(node, ast.FunctionDef):
                early += node.args.defaults + [one for one in node.args.kw_defaults if one]
                how = [ast.unparse(one) for one in node.decorator_list]
                early += (
                    node.body if any(one.split("(")[0].endswith("cache") for one in how) else []
                )
        for node in early:
            assert not re.search(r"\bTUNING\.", ast.unparse(node)), (path, ast.unparse(node))


@pytest.mark.parametrize("home", HOMES)
def test_every_tuning_is_frozen_described_and_an_axis(home):
    tuning = import_module(f"gauss2svg.{home}").TUNING
    assert type(tuning).__dataclass_params__.frozen
    for name, value in dataclasses.asdict(tuning).items():
        assert re.search(rf"^ +{name} +\S", type(tuning).__doc__, re.MULTILINE), name
        assert parse_axis(f"{home}.{name}={value}") == (f"{home}.{name}", (value,))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fit.adam.first_decay", 0.5),
        ("fit.blending.initial_opacity_logit", 0.0),
        ("fit.placement.least_sigma", 3.0),
        ("fit.population.relocated", 0.3),
        ("fit.schedule.growth_share", 0.6),
        ("fit.session.beta_price", 0.5),
        ("fit.weight.exponent", 0.1),
    ],
)
def test_a_constant_of_the_fit_changes_it_and_its_default_no_bit(photo, monkeypatch, name, value):
    home, _, field = name.rpartition(".")
    module = import_module(f"gauss2svg.{home}")
    monkeypatch.setattr(module, "TUNING", module.TUNING)  # which restores it
    pixels, config = photo[:48, :64], fit_config(40, 20)

    def means():
        return fit(pixels, config).scene.mean.tobytes()

    usual = means()
    apply_constants({name: getattr(module.TUNING, field)})
    assert means() == usual
    apply_constants({name: value})
    assert means() != usual
