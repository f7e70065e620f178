"""Laws of options: any combination gives a result or one refusal, and a refusal writes nothing.

The short form of tests/shared/fuzz_options.py.
"""

from pathlib import Path

import pytest
from fuzz_options import _SVG as SVG
from fuzz_options import PIXELS, Pathless, Rude, outcome_of

import gauss2svg
from gauss2svg.compare.table import run_bench
from gauss2svg.errors import InputError
from gauss2svg.fit.options import DensifyOptions, FitOptions
from gauss2svg.measure import CheckOptions
from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import Goal, Options, RunOptions
from gauss2svg.pipeline.plan import Plan
from gauss2svg.svg.document import Document

A_PHOTO = Path(__file__).parents[1] / "golden" / "crisp-0.png"
NO_PHOTO = "missing.png"  # what is refused before the photo is read names something else


def refused(seed: int, numbers: range) -> None:
    kinds = set()
    for number in numbers:
        kind, said = outcome_of(seed, number)
        assert not kind.startswith("FINDING"), f"{kind}: seed {seed}, number {number}: {said}"
        kinds.add(kind)
    assert {"result", "refused by InputError", "refused by the command"} <= kinds


@pytest.mark.sweep
def test_some_combinations_give_a_result_or_one_refusal():
    refused(1, range(60))


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2, 6))
def test_many_combinations_give_a_result_or_one_refusal(seed):
    refused(seed, range(100))


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"progress": 5}, "progress must be a function; got int"),
        ({"stop": "x"}, "stop must be a function; got str"),
        ({"stop": PIXELS}, "stop must be a function; got ndarray"),
        ({"run": RunOptions(threads=2**31 - 1)}, r"threads must be a whole number in 1\.\."),
        (
            {"fit": FitOptions(blend="add"), "document": Document(animate=9)},
            "animate must not be given with additive blending",
        ),
        ({"densify": DensifyOptions(schedule="linear")}, "schedule must be given with a number"),
    ],
)
def test_what_cannot_work_is_refused_before_the_photo_is_read(given, match, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=match):
        gauss2svg.vectorize(NO_PHOTO, **given)
    assert not list(tmp_path.iterdir())


def test_built_in_functions_of_unknown_arguments_are_taken():
    result = gauss2svg.vectorize(PIXELS, gaussians=2, quality="draft", stop=bool)
    assert result.report["stop_reason"] != "interrupted"


@pytest.mark.parametrize("schedule", ["linear", "all-at-once"])
def test_a_schedule_needs_a_number_of_gaussians_without_a_target(schedule):
    def plan(**goal):
        return Plan(Options(goal=Goal(**goal), densify=DensifyOptions(schedule=schedule)))

    assert plan(gaussians=30).fit_config.totals[-1] == 30
    for goal in ({}, {"gaussians": "auto"}, {"gaussians": 30, "target_psnr": 30}):
        with pytest.raises(
            InputError, match="schedule must be given with a number of Gaussians, and without"
        ):
            plan(**goal)


def test_a_result_is_saved_under_a_path_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = gauss2svg.vectorize(PIXELS, gaussians=2, quality="draft")
    for path in (5, b"out.svg", None, "", object(), PIXELS):
        with pytest.raises(InputError, match="path must be the path of a file; got"):
            result.save(path)
    with pytest.raises(InputError, match="gzip must be True or False; got 5"):
        result.save("out.svg", gzip=5)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", [Rude(), Pathless()])
@pytest.mark.parametrize(
    ("name", "call"),
    {
        "photo": gauss2svg.vectorize,
        "photo of check": lambda path: gauss2svg.check(path, SVG),
        "svg": lambda path: gauss2svg.check(PIXELS, path),
        "source": gauss2svg.read_svg,
        "file": gauss2svg.Scene(4, 4).save,
        "scene file": gauss2svg.Scene.load,
        "photos": lambda path: gauss2svg.build_gallery([path], "new"),
        "directory": lambda path: gauss2svg.build_gallery(["photo.png"], path),
        "images": lambda path: run_bench([path], "new"),
        "directory of a benchmark": lambda path: run_bench([A_PHOTO], path),
    }.items(),
)
def test_a_path_that_raises_or_is_none_is_refused_by_its_name(
    name, call, path, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"^{name.partition(' of ')[0]} must be ") as refusal:
        call(path)
    assert "\n" not in str(refusal.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [f.name for f in fields_of(CheckOptions)])
@pytest.mark.parametrize("value", [["resvg"], PIXELS, Rude(), True, b"5", float("nan")])
def test_what_check_cannot_take_is_refused_by_its_name(name, value):
    with pytest.raises(InputError, match=f"^{name} must be "):
        gauss2svg.check(PIXELS, SVG, **{name: value})


def test_errors_are_one_line_whatever_files_are_called():
    for call in (gauss2svg.vectorize, gauss2svg.read_svg):
        with pytest.raises(InputError, match=r"a b\\x1b") as refusal:
            call("a\nb\x1b")
        assert str(refusal.value).isprintable()


@pytest.mark.parametrize("value", [10**400, PIXELS, Rude(), Pathless()])
@pytest.mark.parametrize("name", ["learning_rate", "animate", "max_memory", "loss"])
def test_a_value_that_raises_where_it_is_read_is_refused_by_its_name(name, value):
    with pytest.raises(InputError, match=f"^{name} must be "):
        Options.from_flat({name: value})
