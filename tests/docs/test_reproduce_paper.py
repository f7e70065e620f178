"""benchmarks/reproduce_paper.py: windows are the paper's, and verdicts follow from the numbers."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scenes import random_sum


@pytest.fixture(scope="module")
def paper():
    """The script, which loads PyTorch and matplotlib."""
    pytest.importorskip("torch")
    import reproduce_paper

    return reproduce_paper


scenes = st.builds(random_sum, st.just(8), st.just(50), st.just(40), st.integers(0, 2**32 - 1))


@pytest.mark.example
@given(scenes, st.floats(4, 60))
def test_an_adaptive_window_leaves_out_no_more_than_the_tail_beyond_2_5_sigma(
    paper, scene, kernel_size
):
    whole = paper.windowed(scene, 1e9, False)[0]
    cropped, jumps = paper.windowed(scene, kernel_size, True)
    tail = math.exp(-(2.5**2) / 2)
    assert (np.abs(cropped - whole) <= tail * np.abs(scene.color).sum(axis=0) + 1e-12).all()
    assert (jumps <= tail + 1e-12).all()


@pytest.mark.example
def test_a_gain_holds_beyond_its_spread_and_of_three_or_more(paper):
    given = {(1, 1.2, 0.9): True, (0.5, -0.6, 0.3): False, (-1, -1.1, -1): False, (1, 2): None}
    assert {values: paper.gain([*values])[1] for values in given} == given


@pytest.mark.nightly
def test_every_claim_has_its_row_and_every_figure_its_file(paper, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["reproduce_paper.py", str(tmp_path), "--quick"])
    paper.main()
    table = capsys.readouterr().out.split("| claim tested |")[1].splitlines()[2:]
    assert len(table) == 10
    assert {row.split(" | ")[-1] for row in table} <= {"yes |", "no |", "not tested |"}
    names = {"rounds", "iterations", "windows", "losses-astronaut", "shapes"}
    assert {path.stem for path in tmp_path.iterdir()} == names
    for path in tmp_path.iterdir():
        with Image.open(path) as opened:
            assert opened.width > 1000
