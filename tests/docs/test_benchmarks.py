"""The scripts of benchmarks/: their pictures, and tables of the quick ones."""

import csv
import importlib
import sys

import pytest

pytestmark = pytest.mark.example


@pytest.fixture
def printed(monkeypatch, capsys):
    """Run a script with its arguments; return the cells of each line of its tables."""

    def run(name: str, *arguments: str) -> list[list[str]]:
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *map(str, arguments)])
        importlib.import_module(name).main()
        lines = capsys.readouterr().out.splitlines()
        return [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")]

    return run


def test_measure_prints_files_refusals_means_and_steps_down(printed, tmp_path, monkeypatch):
    measure = importlib.import_module("measure")
    monkeypatch.setitem(measure.FAMILIES, "counts", ["--gaussians 30", "--gaussians 1"])
    picture = tmp_path / "disc.svg"
    disc = '<circle cx="60" cy="50" r="30" fill="#f80"/><circle cx="20" cy="90" r="9"/>'
    svg = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">'
    picture.write_text(f'{svg}<path fill="#fff" d="M0 0H100V100H0z"/>{disc}</svg>')
    given = [picture, "--set", "--max-bytes 20", "--family", "counts", "--columns"]
    given += ["psnr,enlarged,bytes,shapes", "--beside", "lanczos", "--keep", tmp_path / "runs"]
    rows = {tuple(row[:3]): row[3:] for row in printed("measure", *given)}
    assert rows["disc", "--max-bytes 20", "now"] == ["-"] * 4
    many, few = (rows["disc", f"--gaussians {count}", "now"] for count in (30, 1))
    assert float(many[0]) > float(few[0]) + 10
    assert int(many[2]) > int(few[2])
    assert rows["mean of 1", "--gaussians 30", "now"] == many
    assert rows["disc", "--gaussians 1", "lanczos"][0] == "exact"
    assert {tuple(row[:3]): row[3:] for row in printed("measure", *given)} == rows
    assert [path.name for path in (tmp_path / "runs").glob("*.png")] == ["disc.png"]


def test_scale_of_batches_is_measured_in_all_runs(tmp_path, capsys):
    import batch_scale

    runs = ["first", "second"]
    batch_scale.scale(12, tmp_path, runs)
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[:2] for row in rows] == [["| 12", run] for run in runs]
    (table,) = (path.read_text().splitlines() for path in (tmp_path / "out").rglob("table.csv"))
    assert [row["skipped"] for row in csv.DictReader(table)] == ["True"] * 12
