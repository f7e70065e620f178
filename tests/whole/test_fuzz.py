"""Broken photos, broken SVGs and odd options give a result or one refusal, and nothing else.

GAUSS2SVG_EXAMPLES=10000 tries a thousand times as many.
"""

import itertools
import json
import re
from contextlib import suppress
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
from odd_options import PIXELS, Pathless, Rude

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.cli.terminal import Interruption
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.compare.table import run_bench
from gauss2svg.errors import Gauss2SvgError, InputError
from gauss2svg.files import as_png
from gauss2svg.measure import CheckOptions
from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.vectorize import vectorize_by

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


def files():
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


@pytest.mark.sweep
def test_any_combination_of_options_gives_a_result_or_one_refusal_in_python_and_as_a_command(
    tmp_path, monkeypatch, capfd
):
    seen = set()
    for number in range(6 * EXAMPLES):
        (tmp_path / str(number)).mkdir()
        monkeypatch.chdir(tmp_path / str(number))
        Path("photo.png").write_bytes(as_png(PIXELS / 255))
        before, given = files(), odd_options.flat_options(Random(number))
        asked = itertools.count()  # both fits end after a few steps
        monkeypatch.setattr(Interruption, "should_stop", lambda _, asked=asked: next(asked) > 20)
        with suppress(Gauss2SvgError):
            options = Options.from_flat(given)
            result = vectorize_by(options, "photo.png", stop=lambda asked=asked: next(asked) > 20)
            json.dumps(result.report, allow_nan=False)
            seen.add("result")
        assert files() == before
        capfd.readouterr()
        status = main(["photo.png", "-o", "out.svg", *odd_options.as_words(given)])
        lines = capfd.readouterr().err.splitlines()
        assert status == 0 or (status, len(lines), files()) == (2, 1, before), (given, lines)
        seen.add(status)
    assert seen == {"result", 0, 2}


CALLS = {
    "photo": gauss2svg.vectorize,
    "svg": lambda path: gauss2svg.check(PIXELS, path),
    "source": gauss2svg.read_svg,
    "file": gauss2svg.Scene(4, 4).save,
    "scene file": gauss2svg.Scene.load,
    "photos": lambda path: gauss2svg.build_gallery([path], "new"),
    "directory": lambda path: gauss2svg.build_gallery(["photo.png"], path),
    "images": lambda path: run_bench([path], "new"),
}


@pytest.mark.parametrize("path", [Rude(), Pathless()])
@pytest.mark.parametrize("name", CALLS)
def test_a_path_that_raises_or_is_none_is_refused_by_its_name(name, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"^{name} must be .*$"):
        CALLS[name](path)
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


@pytest.mark.parametrize("path", [5, b"out.svg", None, "", object(), PIXELS])
def test_a_result_is_saved_under_a_path_alone(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = gauss2svg.vectorize(PIXELS, gaussians=0)
    with pytest.raises(InputError, match="path must be the path of a file; got"):
        result.save(path)
    with pytest.raises(InputError, match="gzip must be True or False; got 5"):
        result.save("out.svg", gzip=5)
    assert not list(tmp_path.iterdir())
