"""Files made to harm their reader end in an answer: no crash, no endless work, little memory."""

import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from gauss2svg.photo.entropy import lack, table_of
from gauss2svg.photo.jpeg import Survey, survey
from hostile_jpegs import (
    BASELINE,
    CODES,
    END,
    LARGE,
    START,
    UNUSUAL,
    codes,
    frame,
    scan,
)

from gauss2svg.pipeline.vectorize import vectorize

SHARED = Path(__file__).parents[1] / "shared"


@pytest.mark.parametrize("compiled", [True, False])
def test_hostile_jpegs_crash_nothing_and_end(compiled):
    # Python in place of machine code checks each index.
    without = {} if compiled else {"NUMBA_DISABLE_JIT": "1"}
    child = subprocess.run(
        [sys.executable, SHARED / "hostile_jpegs.py"], timeout=300, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(SHARED.parents[1]), **without}, check=False,
    )  # fmt: skip
    assert child.returncode == 0, child.stdout + child.stderr
    *lines, long_codes, _ = child.stdout.splitlines()
    assert lines[::2] == [f"{name} True" for name in UNUSUAL]
    assert "Error" not in child.stderr
    assert long_codes == "its data end at row 0 of 8"


@pytest.mark.parametrize("name", UNUSUAL)
def test_an_unusual_jpeg_is_not_judged_and_takes_no_memory(name):
    file, size = UNUSUAL[name]
    survey(START + frame((8, 8), 0x11) + CODES + scan([1], 0, 0) + END, (8, 8))
    tracemalloc.start()
    try:
        assert survey(file + END, size) == Survey()
        # Of a large picture one number for each block.
        assert tracemalloc.get_traced_memory()[1] < 2e6 + size[0] * size[1] / 4
    finally:
        tracemalloc.stop()


def test_a_jpeg_of_another_size_than_its_decoder_takes_it_for_is_not_judged():
    file = START + frame((20, 31), 0x11) + CODES + scan([1], 0, 0) + END
    assert survey(file, (20, 31)).missing
    assert survey(file, (5, 8), scale=4).missing
    for size, scale in (((31, 20), 1), ((20, 31), 2), ((8, 8), 1)):
        assert survey(file, size, scale) == Survey()


def test_the_usual_kinds_of_scans_are_judged():
    head = START + frame(LARGE, 0x22, 0x11, 0x11) + CODES
    for usual in (scan([1, 2, 3], 0, 0), scan([1, 2, 3], 0, 0, 0x10), scan([2], 1, 63)):
        assert "scans are missing" in survey(head + usual + END, LARGE).missing
    ten = START + frame((8, 8), 0x42, 0x11, 0x11, marker=BASELINE) + CODES
    for direct in (0, 15):
        file = ten + codes(0, direct) + scan([1, 2, 3], 0, 63) + END
        assert survey(file, (8, 8)).missing == "its data end at row 0 of 8"


@pytest.mark.parametrize(("band", "refines"), [((1, 63), False), ((1, 5), True), ((0, 63), True)])
def test_coefficients_known_are_those_of_each_unit(band, refines):
    table = table_of(b"\1" + bytes(15), b"\1")
    for units, known in ((4, 1), (4, 3), (1, 4)):
        with pytest.raises(ValueError, match=rf"must be .* {units}; got {known}"):
            lack([b"\0"], units, units, [(table, table)], band, refines, np.zeros(known, np.uint64))


def test_restarts_may_follow_any_number_of_fill_bytes():
    head = START + frame((16, 8), 0x11, marker=BASELINE) + CODES + codes(0x10, 0)
    head += scan([1], 0, 63)
    for fill in (1, 2, 5):
        whole = head + b"\x3f" + b"\xff" * fill + b"\xd0\x3f"
        assert survey(whole + END, (16, 8)).missing == ""
        assert survey(whole[:-1] + END, (16, 8)).missing == "its data end at row 0 of 8"


FIRST_JPEG = """
import io
from PIL import Image
from gauss2svg.photo.entropy import _lack
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.run import compile_kernels
compile_kernels()
compiled = list(_lack.signatures)
for options in ({}, {"progressive": True}, {"restart_marker_blocks": 1}, {"optimize": True}):
    stream = io.BytesIO()
    Image.effect_noise((40, 24), 50).convert("RGB").save(stream, "JPEG", **options)
    load_image(stream.getvalue())
assert len(compiled) == 1, compiled
assert _lack.signatures == compiled
"""


def test_no_jpeg_compiles_what_is_not_compiled_ahead():
    child = subprocess.run(
        [sys.executable, "-c", FIRST_JPEG], cwd=SHARED.parents[1], capture_output=True, timeout=300,
        env={**os.environ, "NUMBA_DISABLE_JIT": "0"}, text=True, check=False,
    )  # fmt: skip
    assert child.returncode == 0, child.stderr


def test_the_first_jpeg_on_a_machine_is_not_compiled_within_a_time_limit(monkeypatch):
    steps = []
    module = "gauss2svg.pipeline.run"
    monkeypatch.setattr(f"{module}.compile_reading", lambda: steps.append("compiled") or 0.0)

    def stopped(*_, **__):
        steps.append("read")
        raise KeyboardInterrupt

    monkeypatch.setattr(f"{module}.load_image", stopped)
    with pytest.raises(KeyboardInterrupt):
        vectorize(np.zeros((8, 8, 3)))
    assert steps == ["compiled", "read"]
