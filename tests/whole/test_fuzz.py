"""Laws of reading: mutated images and SVGs are accepted or refused by one error.

The short form of tests/shared/fuzz.py.
"""

import os
import subprocess
import sys
from pathlib import Path
from random import Random

import fuzz
import pytest
from fuzzing import (
    TARGETS,
    broken_picture,
    broken_svg,
    chunks,
    mutated_bytes,
    outcome,
    picture_seeds,
    png_of,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from svg_fuzzing import svg_seeds

import gauss2svg

pytestmark = pytest.mark.sweep

SEEDED = st.integers(0, 2**32 - 1).map(Random)
FEW = settings(max_examples=250, suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("index", range(len(picture_seeds())))
def test_whole_pictures_are_accepted(index):
    assert outcome("loader", picture_seeds()[index])[0] == "accepted"


@pytest.mark.parametrize("index", range(len(svg_seeds())))
def test_whole_svgs_are_rasterised_or_refused_by_what_they_use(index):
    said = outcome("svg", svg_seeds()[index])[0]
    assert said == "accepted" or "what the SVG uses" in said


@pytest.mark.posix
def test_the_long_form_runs_by_itself_and_counts_its_inputs(tmp_path):
    command = [fuzz.__file__, "--inputs", "3", "--jobs", "1", "--folder", str(tmp_path / "found")]
    # As a program: without the folders that pytest imports from.
    done = subprocess.run(
        [sys.executable, *command, "loader"],
        env={**os.environ, "PYTHONPATH": str(Path(gauss2svg.__file__).parents[1])},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.startswith("loader, seed 0: 3 inputs, ")
    assert not list((tmp_path / "found").iterdir())


def test_checksums_are_right_again():
    pngs = [seed for seed in picture_seeds() if seed.startswith(b"\x89PNG")]
    assert len(pngs) > 4
    for png in pngs:
        assert png_of(chunks(png)) == png


@FEW
@given(st.randoms(use_true_random=False) | SEEDED)
def test_broken_pictures_are_accepted_or_refused(rng):
    assert outcome("loader", broken_picture(rng))[1] == []


@pytest.mark.parametrize("target", ["svg", "read"])
@FEW
@given(rng=st.randoms(use_true_random=False) | SEEDED)
def test_broken_svgs_are_accepted_or_refused(target, rng):
    assert outcome(target, broken_svg(rng))[1] == []


@FEW
@given(st.binary(max_size=200), SEEDED)
def test_rubbish_is_refused(data, rng):
    for target in TARGETS:
        for rubbish in (data, mutated_bytes(rng, data or b"<", data or b"<svg")):
            assert outcome(target, rubbish)[0] != "accepted"
