"""Other tools: programs on PATH, a Python that a variable names, and modules."""

import json
import math
import os

import numpy as np
import pytest
from galleries import BLANK, program, save

from gauss2svg.cli.main import main
from gauss2svg.compare.records import record_or_error
from gauss2svg.compare.run import make_svg, measure_alone
from gauss2svg.photo.load import load_image

pytestmark = [pytest.mark.process, pytest.mark.posix]  # stand-ins are shell scripts


def test_a_program_is_measured_or_an_error_of_a_gallery_and_of_a_benchmark(
    photo, tmp_path, monkeypatch, capsys, asked
):
    picture = save(photo[:40, :48], tmp_path / "in.png")
    monkeypatch.setattr("galleries.canned", make_svg)
    drawn = f"[ $6 = 100 ] && echo '{BLANK}' > \"$4\" && exit\necho no luck >&2; exit 3\n"
    program(tmp_path / "bin" / "primitive", drawn)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), os.pathsep)
    out, peers = tmp_path / "out", ["--variants", "", "--peers", "primitive,primitive:500"]
    assert main(["gallery", str(picture), "-o", str(out), *peers]) == 1
    failed = capsys.readouterr().err.splitlines()[0]
    assert failed.startswith("gauss2svg: failed: in.png, primitive 500: ")
    assert "status 3: no luck" in failed
    (row,) = json.loads((out / "gallery.json").read_text())["rows"]
    error = np.mean((1 - load_image(picture).pixels.astype(np.float64)) ** 2)  # against white
    assert row["psnr_svg"] == pytest.approx(-10 * math.log10(error), abs=1e-4)
    assert row["svg_bytes"] == len(BLANK) + 1
    assert str(tmp_path) not in (out / row["files"]["report"]).read_text()
    request = {"tool": "primitive", "settings": {"shapes": 3}, "source": str(picture)}
    request["options"] = {"seed": 0, "threads": 1, "max_pixels": 10**6}
    for body, seconds, line in (
        ("exit 0", 60, "primitive wrote no file. Try running it by hand"),
        ("exec sleep 600", 0.5, "timed out after 0.5 s"),
    ):
        program(tmp_path / "bin" / "primitive", body)
        found = record_or_error(measure_alone, request | {"peer_timeout": seconds})
        assert line in found["error"]
