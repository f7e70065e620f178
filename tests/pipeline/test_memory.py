"""Laws of memory: what a run takes is known before the fit, and kept under a limit."""

import pickle
import subprocess
import sys
from dataclasses import replace

import pytest
from flat import vectorize
from pictures import encoded
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.photo.pixels import Header
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import free_bytes, load_of

QUICK = {"gaussians": 3, "iterations": 2}


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("given", [{}, {"max_size": 2100, "inks": "#000,#f00,#fff"}])
def test_estimate_is_over_what_a_process_takes_but_not_by_far(given, tmp_path):
    options = Options.from_flat({**given, "gaussians": 300, "iterations": 3})
    path = tmp_path / "photo.png"
    Image.new("RGB", (2100, 1400), (200, 100, 50)).save(path)
    code = (
        "import pickle, sys; from gauss2svg.pipeline.vectorize import vectorize_by; "
        "vectorize_by(pickle.load(sys.stdin.buffer), sys.argv[1]); "
        "print(next(l for l in open('/proc/self/status') if l.startswith('VmHWM')).split()[1])"
    )
    command = [sys.executable, "-c", code, path]
    done = subprocess.run(command, input=pickle.dumps(options), capture_output=True, check=True)
    needed = load_of(Plan(options), Header(2100, 1400, has_alpha=False)).bytes
    assert 1 <= needed / (int(done.stdout) * 1024) <= 1.9


def test_fit_runs_on_fewer_pixels_under_a_limit_and_says_so(photo):
    load = load_of(Plan(Options.from_flat(QUICK)), Header(128, 128, has_alpha=False))
    limit = (replace(load, fit=(1, 1)).bytes + load.bytes) // 2
    report = vectorize(photo, max_memory=limit, **QUICK).report
    assert (report["width"], report["height"]) == (128, 128)
    assert 60 < report["fit_width"] == report["fit_height"] < 128
    size = f"{report['fit_width']}x{report['fit_width']} px"
    assert report["notes"] == [f"fitted at {size} to stay under {limit / 1e6:.0f} MB of memory"]
    with pytest.raises(InputError, match=r"at least \d+ MB for a fit on 128x128 px; got \d+ MB"):
        vectorize(photo, max_memory=limit, max_size=128, **QUICK)
    assert vectorize(photo, max_memory=limit, max_size=32, **QUICK).report["notes"] == []


def group(folder, most, used, idle):
    """Write the files of a control group."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "memory.max").write_text(f"{most}\n")
    (folder / "memory.current").write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 5\ninactive_file {idle}\n")


def test_control_groups_bound_what_is_free(tmp_path):
    process, groups = tmp_path / "self", tmp_path / "groups"
    process.mkdir()
    (process / "cgroup").write_text("0::/a/b\n")
    assert free_bytes(process, groups) > 10**6
    for name, most, used, idle, free in (
        ("a/b", "max", 700, 0, None), ("a", 1000, 700, 100, 400), (".", 800, 900, 200, 100),
        ("a/b", 500, 900, 0, 0),
    ):  # fmt: skip
        group(groups / name, most, used, idle)
        found = free_bytes(process, groups)
        assert found > 10**6 if free is None else found == free
    # In a container the host's path is not there, and the root is the container's own.
    (process / "cgroup").write_text("0::/of/the/host\n")
    assert free_bytes(process, groups) == 100


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "image"])
def test_what_cannot_fit_is_refused_by_its_header(kind, monkeypatch):
    large = Image.new("L", (2200, 2000))
    monkeypatch.setattr("gauss2svg.pipeline.run.load_image", None)
    with pytest.raises(InputError, match=r"memory must be .* for a photo of 2200x2000 px.*220 MB"):
        vectorize(large if kind == "image" else encoded(large, kind), max_memory="220M", **QUICK)
