"""Options: one class each group, from which the call, the command, axes and report are derived."""

import inspect
import json
import math
from typing import Any

import numpy as np
import pytest
from cyclopts import App

import gauss2svg
from gauss2svg.batch import BatchOptions
from gauss2svg.cli.main import build_app, main
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.compare.variants import AXES
from gauss2svg.errors import InputError, RendererError
from gauss2svg.fit import FitOptions
from gauss2svg.measure import TARGETS
from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import GROUPS, Goal, Options, RunOptions, SvgOptions
from gauss2svg.pipeline.plan import Plan
from gauss2svg.svg import Document, SvgFormat

FIELDS = [field for group in GROUPS.values() for field in fields_of(group)]
ALL_GROUPS = [*GROUPS.values(), BatchOptions, GalleryOptions, SvgFormat]
ALL_FIELDS = [
    pytest.param(group, field, id=f"{group.__name__}.{field.name}")
    for group in ALL_GROUPS
    for field in fields_of(group)
]
WRONG = (object(), [], b"7", (), {"a": 1}, complex(1, 2), float("nan"))


def help_of(everything: bool, capsys) -> str:
    build_app(everything)(["--help-all" if everything else "--help"], exit_on_error=False)
    return capsys.readouterr().out


def valid(field) -> list:
    """Some values that an option takes, with what is stored."""
    found = [(one, one) for one in field.choices]
    found += [(np.int16(one), one) for one in field.words if isinstance(one, int)]
    if field.kind is int:
        least = max(field.least, 1)
        found += [(least, least), (field.most, field.most), (np.int64(least), least)]
        found += [("auto", None)] if field.words else []
    if field.kind is float:
        found += [(np.float32(field.most), float(np.float32(field.most))), (field.most, field.most)]
    return found


def beyond(field) -> list:
    """Values of the right type that an option does not take."""
    if field.kind is bool:
        return [1, 0.0, "no"]
    if field.kind is int:
        return [field.least - 1, field.most + 1, field.least + 0.5, True]
    if field.kind is float:
        below = field.least if field.is_above else math.nextafter(field.least, -math.inf)
        return [below, -math.inf, math.inf, math.nextafter(field.most, math.inf), True]
    return ["bogus"] if field.choices else []


@pytest.mark.parametrize(("group", "field"), ALL_FIELDS)
def test_an_option_stores_plain_values_and_refuses_others_by_its_name(group, field):
    for value, stored in valid(field):
        got = getattr(group(**{field.name: value}), field.name)
        assert got == stored or np.float32(got) == np.float32(stored)
        assert type(got) in (bool, int, float, str, type(None))
    for wrong in (*WRONG, *beyond(field)):
        with pytest.raises(InputError) as refusal:
            group(**{field.name: wrong})
        text = str(refusal.value)
        assert text.startswith(f"{field.name} must be ")
        assert "; got " in text
        assert "\n" not in text


def test_options_of_the_same_values_are_equal_whichever_they_are():
    assert Options() == Options()
    assert hash(Options()) == hash(Options())
    assert Options() != Options.from_flat({"seed": 1})
    given = [Document(title=title) for title in ("a", "a", "b")]
    assert given[0] == given[1]
    assert len(set(given)) == 2


def test_names_of_options_are_unique():
    names = [field.name for field in FIELDS]
    assert len(set(names)) == len(names)


def test_flat_options_come_back_and_fit_into_json():
    options = Options.from_flat({"gaussians": 30, "loss": "l1", "animate": 1.5, "gzip": True})
    assert Options.from_flat(options.flat()).flat() == options.flat()
    assert json.loads(json.dumps(options.flat())) == options.flat()
    assert options.changed(title="b", gaussians=5).flat() == {
        **options.flat(), "title": "b", "gaussians": 5,
    }  # fmt: skip
    for name in ("speed", "self"):  # Python uses the second
        with pytest.raises(InputError, match=f"option must be one of quality, .*; got '{name}'"):
            Options.from_flat({name: 1})


def test_the_short_help_fits_one_screen_and_has_what_people_use(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = help_of(False, capsys)
    assert len(text.rstrip().splitlines()) <= 41  # lines are a character shorter on Windows
    for field in fields_of(Goal):
        assert f"--{field.name.replace('_', '-')}" in text
    assert "--help-all" in text
    assert "--learning-rate" not in text
    assert text.count("gauss2svg photo.jpg ") == 3
    assert "--count-gzipped" in text


def test_every_group_but_the_run_and_the_document_may_be_varied_in_a_benchmark():
    varied = {f.name for key in ("goal", "fit", "densify", "svg") for f in fields_of(GROUPS[key])}
    assert set(AXES) == (varied - {"seed"}) | {"renderer", "max_size"}


def test_functions_have_few_parameters():
    parameters = inspect.signature(gauss2svg.vectorize).parameters
    assert sum(one.kind is not one.VAR_KEYWORD for one in parameters.values()) <= 16
    goal = [field.name for field in fields_of(Goal)]
    assert list(parameters)[2 : 2 + len(goal)] == goal
    for function in (
        gauss2svg.build_gallery,
        gauss2svg.vectorize_many,
        gauss2svg.check,
        gauss2svg.write_svg,
    ):
        most = 11 if function is gauss2svg.check else 9  # five of its are limits of untrusted files
        assert len(inspect.signature(function).parameters) <= most


def test_goals_may_be_given_by_name_or_together(photo):
    small = photo[:24, :24]
    named = gauss2svg.vectorize(small, gaussians=6, quality="draft")
    together = gauss2svg.vectorize(small, Goal(gaussians=6, quality="draft"))
    mixed = gauss2svg.vectorize(small, Goal(gaussians=6), quality="draft")
    assert named.svg == together.svg == mixed.svg
    with pytest.raises(InputError, match="fit must be a FitOptions; got SvgOptions"):
        gauss2svg.vectorize(small, fit=SvgOptions())


@pytest.mark.parametrize("score", TARGETS, ids=lambda score: score.slug)
def test_a_number_of_gaussians_beside_any_target_is_a_cap(score):
    goal = Goal(gaussians=50, **{score.option: 50.0})
    assert goal.target is score
    assert goal.count_adapts
    assert not Goal(gaussians=50).count_adapts


def test_the_report_has_every_option(photo):
    report = gauss2svg.vectorize(
        photo[:24, :24], gaussians=4, fit=FitOptions(iterations=3), run=RunOptions(threads=1)
    ).report
    assert {field.name for field in FIELDS} <= set(report)
    json.dumps(report, allow_nan=False)


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        ({"portable": True}, InputError, "portable must be given with blend add"),
        ({"blend": "add", "renderer": "cairo"}, RendererError, "renderer must be one of .*resvg"),
        (
            {"form": "blur"},
            RendererError,
            "renderer must be one of chromium.* for form blur; got 'resvg'",
        ),
        ({"per_round": 5}, InputError, "per_round must be given with .*--gaussians 1000 alone"),
        ({"loss": "mse", "ssim_weight": 0.1}, InputError, "loss must be one with ssim.*l?mse.ssim"),
        ({"blend": "add", "falloff": "adaptive"}, InputError, "falloff must be gaussian"),
        (
            {"blend": "add", "animate": 2},
            InputError,
            "animate must not be given with additive blending.*--portable",
        ),
        ({"blend": "add", "fragments": True}, InputError, "fragments must not be given with add"),
        (
            {"blend": "add", "form": "blur", "renderer": "chromium"},
            InputError,
            "form blur must not be given with add.*Try --form gradient",
        ),
        (
            {"target_psnr": 20, "round_iterations": 4},
            InputError,
            "round_iterations must be given with .*--gaussians 1000 alone",
        ),
    ],
)
def test_options_that_exclude_each_other_are_refused_with_a_way_out(given, error, match):
    with pytest.raises(error, match=match):
        Plan(Options.from_flat(given))


def test_the_command_takes_what_the_classes_take(monkeypatch, capsys):
    pytest.importorskip("pydantic")  # by which the parser checks types where it is loaded
    seen = {}
    monkeypatch.setattr(
        "gauss2svg.cli.vectorize._run", lambda photo, output, options, files: seen.update(
            options.flat(), quiet=files.quiet, kind=type(options)
        ) or 0,
    )  # fmt: skip
    app: App = build_app()
    app(
        "p.jpg -o o.svg --gaussians auto --max-bytes 5k --no-relocate --palette 30 --stops 8 "
        "--portable --blend add --learning-rate 0.5 --quiet",
        exit_on_error=False,
    )
    assert seen["gaussians"] is None
    assert seen["max_bytes"] == 5000
    assert not seen["relocate"]
    assert (seen["palette"], seen["stops"], seen["learning_rate"]) == (30, 8, 0.5)
    assert seen["portable"]
    assert seen["quiet"]
    assert seen["kind"] is Options  # which workers of a batch can be sent
    assert main(["p.jpg", "-o", "o.svg", "--learning-rate", "0"]) == 2
    assert "--learning-rate must be a number in 1e-06..1e+06; got 0.0" in capsys.readouterr().err


def test_keywords_are_refused_with_the_class_to_which_they_belong():
    taken = inspect.signature(gauss2svg.vectorize).parameters
    call: Any = gauss2svg.vectorize
    for key, group in GROUPS.items():
        for name in {field.name for field in fields_of(group)} - set(taken):
            belongs = rf"{name} belongs to {key}={group.__name__}\({name}=\.\.\.\)"
            with pytest.raises(TypeError, match=belongs):
                call("photo.png", **{name: 1})
    with pytest.raises(TypeError, match=r"option must be one of .* got 'gausians'"):
        call("photo.png", gausians=7)


def test_a_precision_too_fine_for_the_photo_is_refused_before_the_fit():
    wide, phases = np.zeros((1, 20_100, 3), np.uint8), list[str]()
    with pytest.raises(InputError, match=r"precision must be at least 0\.0010 for 20100 px"):
        gauss2svg.vectorize(
            wide, svg=SvgOptions(precision=0.001), progress=lambda now: phases.append(now.phase)
        )
    assert "fit" not in phases
