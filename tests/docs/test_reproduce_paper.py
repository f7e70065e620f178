"""benchmarks/reproduce_paper.py: each claim has a verdict, and each figure a file."""

import sys

import pytest
from PIL import Image


@pytest.mark.nightly
def test_every_claim_has_its_row_and_every_figure_its_file(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch")
    import reproduce_paper as paper

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
