"""Broken photos, broken SVGs and odd options give a result or one refusal, and nothing else.

GAUSS2SVG_EXAMPLES=10000 tries a thousand times as many.
"""

import re
from pathlib import Path
from random import Random

import odd_options
import pytest
from fuzzing import (
    READERS,
    broken_picture,
    broken_svg,
    mutated_bytes,
    outcome,
    picture_seeds,
    svg_seeds,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from odd_options import PIXELS, SVG, Pathless, Rude

import gauss2svg
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.compare.table import run_bench
from gauss2svg.errors import InputError
from gauss2svg.fit import DensifyOptions, FitOptions
from gauss2svg.measure import CheckOptions
from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import GROUPS, RunOptions
from gauss2svg.svg import Document

A_PHOTO = Path(__file__).parents[1] / "golden" / "crisp-0.png"
SEEDED = st.integers(0, 2**32 - 1).map(Random)
EXAMPLES = settings().max_examples
MANY = settings(max_examples=25 * EXAMPLES, suppress_health_check=list(HealthCheck))


@pytest.mark.sweep
def test_whole_pictures_and_svgs_are_read_or_refused_by_what_they_use():
    assert {outcome("photo", data) for data in picture_seeds()} == {"accepted"}
    said = [outcome("svg", data) for data in svg_seeds()]
    assert all(line == "accepted" or "what the SVG uses" in line for line in said)
    assert said.count("accepted") > 5


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("reader", "broken"), [("photo", broken_picture), ("svg", broken_svg), ("scene", broken_svg)]
)
@MANY
@given(rng=SEEDED)
def test_broken_files_are_accepted_or_refused(reader, broken, rng):
    outcome(reader, broken(rng))


@pytest.mark.sweep
@MANY
@given(st.binary(max_size=200), SEEDED)
def test_rubbish_is_refused(data, rng):
    for reader in READERS:
        for rubbish in (data, mutated_bytes(rng, data or b"<", data or b"<svg")):
            assert outcome(reader, rubbish) != "accepted"


@pytest.mark.sweep
def test_any_combination_of_options_gives_a_result_or_one_refusal(tmp_path, monkeypatch):
    seen = set()
    for number in range(6 * EXAMPLES):
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        seen.add(odd_options.outcome(Random(number)))
    assert {"result", "refused", "done by the command", "refused by the command"} <= seen


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"progress": 5}, "progress must be a function; got int"),
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
        gauss2svg.vectorize("missing.png", **given)
    assert not list(tmp_path.iterdir())


def test_a_result_is_saved_under_a_path_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # bool has no signature that Python could tell.
    result = gauss2svg.vectorize(PIXELS, gaussians=2, quality="draft", stop=bool)
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
    with pytest.raises(InputError, match=f"^{name.partition(' of ')[0]} must be .*$"):
        call(path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("group", [*GROUPS.values(), CheckOptions, GalleryOptions])
def test_any_value_of_an_option_is_taken_or_refused_on_one_line(group):
    refusals = []
    for field in fields_of(group):
        for value in odd_options.odd_values():
            try:
                group(**{field.name: value})
            except InputError as error:
                refusals.append(str(error))
    assert len(refusals) > 100
    assert [line for line in refusals if not line.isprintable() or len(line) > 2000] == []
    assert [line for line in refusals if not re.search("must|cannot read", line)] == []


def test_errors_are_one_line_whatever_files_are_called():
    for call in (gauss2svg.vectorize, gauss2svg.read_svg):
        with pytest.raises(InputError, match=r"a b\\x1b") as refusal:
            call("a\nb\x1b")
        assert str(refusal.value).isprintable()
