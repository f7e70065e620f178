"""The scripts of benchmarks/: their pictures, and tables of the quick ones."""

import csv
import importlib
import io
import re
import sys

import numpy as np
import pytest
from PIL import Image

from gauss2svg.errors import RendererError

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


def test_drawings_are_on_8_bits_and_sources_have_an_enlargement():
    from common import pictures

    drawings = list(pictures(["drawings"]))
    assert len(drawings) == len({picture.name for picture in drawings}) == 10
    for picture in drawings:
        levels = np.round(picture.pixels * 255).astype(np.uint8)
        np.testing.assert_allclose(picture.pixels, levels / np.float32(255), atol=1e-6)
        assert picture.large is None
    sources = list(pictures(["sources"]))
    assert len(sources) == 26
    assert {picture.large.shape for picture in sources} == {(1024, 1024, 3)}


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


def test_measure_refuses_two_pictures_of_one_name(printed, capsys):
    with pytest.raises(SystemExit):
        printed("measure", "drawings", "sources")
    assert "names of their own; got 2 named icon" in capsys.readouterr().err


def test_of_another_tool_each_score_is_that_of_its_best_file():
    from common import Picture
    from measure import File, value

    def grey(level: float, side: int) -> np.ndarray:
        return np.full((side, side, 3), level, np.float32)

    picture = Picture("grey", grey(0.5, 8), grey(0.5, 32))
    # The closer a file is at its own size, the worse it is enlarged.
    levels = [(0.5 + k / 100, 0.6 - k / 100) for k in range(1, 10)]
    files = [File(grey(own, 8), lambda at=at: grey(at, 32)) for own, at in levels]
    assert value("psnr", files, picture) == pytest.approx(40, abs=0.1)
    assert value("enlarged", files, picture) == pytest.approx(40, abs=0.1)


@pytest.mark.parametrize(
    ("options", "limit"),
    [("--max-bytes 10k", 10_000), ("--max-bytes 1M --seed 3", 1_000_000), ("--quality fast", 0)],
)
def test_the_limit_of_other_tools_is_that_of_the_options(options, limit):
    from measure import limit_of

    assert limit_of(options) == limit


@pytest.mark.parametrize(
    ("own", "enlarged", "steps"),
    [
        ([30, 35, 33], [25, 25, 25], [0, 2]),
        ([42, 45, 44], [36, 35.9, 33], [0, 3]),  # both are seen at their own size
        ([60, 55, 40], [30, 31, 32], [0, 1]),  # up to 41 dB
    ],
)
def test_a_step_down_of_a_source_is_enlarged_from_41_db_on(own, enlarged, steps):
    from measure import source_steps_down

    assert source_steps_down(own, enlarged) == pytest.approx(steps)


def test_steps_down_are_from_the_best_before_and_up_to_50_db():
    from measure import steps_down

    assert steps_down([20, 30, 28, 29, 60, 52]) == [0, 2, 1, 0, 0]


def test_renderers_prints_each_form_and_leaves_out_what_is_missing_or_refused(
    printed, photo, tmp_path, monkeypatch
):
    renderers = importlib.import_module("renderers")
    Image.fromarray(np.uint8(255 * photo[:64, 40:104])).save(tmp_path / "small.png")

    def version(name: str) -> str:
        if name == "librsvg":
            raise RendererError("librsvg must be installed")
        return name

    def rasterized(svg: str, width: int, height: int, name: str):
        if name == "cairo":
            raise RendererError("cairo must draw this")
        return np.zeros((height, width, 3), np.float32)

    monkeypatch.setattr(renderers, "renderer_version", version)
    monkeypatch.setattr(renderers, "rasterize", rasterized)
    given = [tmp_path / "small.png", "--counts", "60", "--renderers", "resvg", "cairo", "librsvg"]
    head, *rows = printed("renderers", *given)
    assert [name.split(":")[0] for name in head[5:]] == ["resvg", "cairo"]
    assert [row[:3] for row in rows] == [["gradient", "60", name] for name in ("small", "mean")]
    assert all(re.fullmatch(r"\S+ / \S+ / \S+, \S+ s", row[5]) and row[6] == "-" for row in rows)


def test_figures_of_the_documentation_are_small(tmp_path, monkeypatch):
    import figures

    monkeypatch.setattr(sys, "argv", ["figures.py", str(tmp_path), "model", "counts", "drawings"])
    figures.main()
    for name in ("model", "counts", "drawings"):
        data = (tmp_path / "figures" / f"{name}.webp").read_bytes()
        assert len(data) <= 60_000
        with Image.open(io.BytesIO(data)) as image:
            assert image.width == figures.WIDTH_PX


def test_scale_of_batches_is_measured_in_all_runs(tmp_path, capsys):
    import batch_scale

    runs = ["first", "second"]
    batch_scale.scale(12, tmp_path, runs)
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[:2] for row in rows] == [["| 12", run] for run in runs]
    (table,) = (path.read_text().splitlines() for path in (tmp_path / "out").rglob("table.csv"))
    assert [row["skipped"] for row in csv.DictReader(table)] == ["True"] * 12


def test_every_figure_that_a_page_names_can_be_made():
    import figures

    root = figures.ROOT
    pages = [root / "README.md", *(root / "docs").rglob("*.md")]
    command = re.compile(r"figures\.py\s+docs/_static\s+([\w-]+)")
    named = {name for page in pages for name in command.findall(page.read_text(encoding="utf-8"))}
    assert len(named) > 20
    assert named <= figures.OF_START.keys() | figures.FIGURES.keys()
