"""The scripts of benchmarks/: their pictures, and tables of the quick ones."""

import csv
import importlib
import io
import re
import sys

import numpy as np
import pytest
from flat import vectorize
from PIL import Image

from gauss2svg.errors import RendererError

pytestmark = pytest.mark.example


def test_drawings_are_ten_pictures_on_8_bits_the_same_every_time():
    from drawings import drawings

    first, second = dict(drawings()), dict(drawings())
    assert len(first) == 10
    for name, pixels in first.items():
        assert pixels.dtype == np.float32
        assert pixels.ndim == 3
        assert pixels.shape[2] == 3
        assert pixels.min() >= 0
        assert pixels.max() <= 1
        levels = np.round(pixels * 255).astype(np.uint8)
        np.testing.assert_array_equal(pixels, levels / np.float32(255))
        np.testing.assert_array_equal(pixels, second[name])


def test_pictures_at_the_limits_have_three_channels():
    import stability

    assert {p.shape[2] for p in stability.pictures().values()} == {3}


def test_bad_inputs_are_refused_in_one_line_each(capsys):
    import bad_inputs

    bad_inputs.main()
    head, rule, *rows = capsys.readouterr().out.splitlines()
    assert head.count("|") == rule.count("|") == 4
    assert len(rows) > 25
    for row in rows:
        assert re.fullmatch(r"\| [^|]+ \| 2 \| `[^|]+` \|", row), row


@pytest.fixture
def renderers():
    return importlib.import_module("renderers")


def test_renderers_writes_its_tables_without_a_browser(renderers, photo, tmp_path, monkeypatch):
    Image.fromarray(np.uint8(255 * photo[:64, 40:104])).save(tmp_path / "small.png")
    out = tmp_path / "out.md"
    command = ["renderers.py", str(tmp_path / "small.png"), "--counts", "60", "-o", str(out)]
    monkeypatch.setattr(sys, "argv", [*command, "--renderers", "resvg", "librsvg"])
    monkeypatch.setattr(renderers, "version_of", {"resvg": "resvg"}.get)
    monkeypatch.setattr(renderers, "PRESETS", ["draft"])
    renderers.main()
    text = out.read_text()
    assert "the gradient form alone" in text
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    cells = re.fullmatch(r"\| gradient \| 60 \| small \| \S+ \| (\S+) \| not installed \|", rows[2])
    assert cells is not None
    assert float(cells[1]) > 45
    # The head, the rule and the rows of each table; resvg is the only renderer of the zoom.
    assert len(rows) == (2 + 2) + (2 + 1) + (2 + 2) + (2 + 1)


def test_renderers_distinguishes_refused_missing_and_rasterised(renderers, monkeypatch):
    blurred = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"><filter id="a">'
        '<feGaussianBlur stdDeviation="1"/></filter>'
        '<g transform="skewX(30)"><circle r="2" cx="4" cy="4" filter="url(#a)"/></g></svg>'
    )
    monkeypatch.setattr(renderers, "version_of", {"resvg": "resvg"}.get)
    white = np.ones((8, 8, 3), np.float32)
    assert renderers.decibels("resvg", blurred, white, white) == ["refused"] * 2
    assert renderers.decibels("librsvg", blurred, white) == ["not installed"]
    plain = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"/>'
    assert renderers.decibels("resvg", plain, white) == [np.inf]


def test_renderers_shows_a_renderer_that_failed_and_continues(renderers, monkeypatch, photo):
    calls = []

    def fail(svg, width, height, name):
        calls.append(name)
        if name == "librsvg":
            raise RendererError("out of memory")
        return np.ones((height, width, 3), np.float32)

    monkeypatch.setattr(renderers, "version_of", str)
    monkeypatch.setattr(renderers, "rasterize", fail)
    white = np.ones((8, 8, 3), np.float32)
    plain = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"/>'
    assert renderers.decibels("librsvg", plain, white, white) == ["failed"] * 2
    fits = {"gradient": vectorize(photo[:16, :16], gaussians=3, iterations=2)}
    (row,) = renderers.seconds(fits, ["librsvg", "resvg"])
    assert row["librsvg"] == "failed"
    assert row["resvg"][1] == 1
    assert calls.count("librsvg") == 2


def test_figures_of_the_documentation_are_small(tmp_path, monkeypatch):
    import figures

    monkeypatch.setattr(sys, "argv", ["figures.py", str(tmp_path), "model", "extremes"])
    figures.main()
    for name in ("model", "extremes"):
        data = (tmp_path / "figures" / f"{name}.webp").read_bytes()
        assert len(data) <= figures.MOST_BYTES
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
