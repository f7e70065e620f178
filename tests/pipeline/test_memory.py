"""Laws of memory: what a run takes is known before the fit, and kept under a limit."""

import io
import pickle
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from flat import vectorize
from hypothesis import given
from hypothesis import strategies as st
from pictures import encoded, tiff
from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.photo.load import header_of
from gauss2svg.photo.pixels import Header
from gauss2svg.pipeline import budgets as memory
from gauss2svg.pipeline.budgets import Load, free_bytes, load_of, memory_limit, size_that_fits
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import compile_kernels

SIDES, COUNTS = st.integers(1, 20_000), st.integers(0, 50_000)
LOADS = st.builds(
    lambda w, h, share, alpha, **given: Load(
        Plan(Options.from_flat(given)),
        Header(w, h, alpha),
        (max(1, int(w * share)), max(1, int(h * share))),
    ),
    SIDES, SIDES, st.floats(0, 1), st.booleans(), gaussians=COUNTS,
    loss=st.sampled_from(["mse", "l1+ssim"]), blend=st.sampled_from(["over", "add"]),
    full_size=st.booleans(),
)  # fmt: skip
# The sides at which a large photo is measured are rounded to pixels, also downwards.
ROUNDED = 0.98
QUICK = {"gaussians": 3, "iterations": 2}


@given(LOADS)
def test_more_of_anything_takes_no_less(load):
    (width, height), header = load.fit, load.photo
    least = ROUNDED * load.bytes
    assert replace(load, fit=(width + 1, height)).bytes >= least
    assert replace(load, fit=(width, height + 1)).bytes >= least
    for more in ({"width": header.width + 1}, {"height": header.height + 1}, {"has_alpha": True}):
        assert replace(load, photo=replace(header, **more)).bytes >= least
    for less, more in (
        ({"gaussians": 7}, {"gaussians": 8}),
        ({"loss": "mse"}, {"loss": "mse+ssim"}),
        ({"blend": "over"}, {"blend": "add"}),
        ({"inks": None, "blend": "over"}, {"inks": "#000,#fff", "blend": "over"}),
    ):
        few, many = (Plan(load.plan.options.changed(**given)) for given in (less, more))
        assert replace(load, plan=many).bytes >= replace(load, plan=few).bytes


@given(LOADS, st.integers(10**8, 10**11))
def test_size_is_the_largest_that_fits(load, limit):
    try:
        found, note = size_that_fits(load, limit, asked=False)
    except InputError:
        assert replace(load, fit=(1, 1)).bytes > limit
        return
    width, height = found.fit
    assert found == replace(load, fit=(width, height))
    assert found.bytes <= limit
    assert (note is None) == (load.bytes <= limit) == (found == load)
    if note is not None:
        assert f"{width}x{height} px to stay under {limit / 1e6:.0f} MB" in note
        share = max((width + 2) / load.fit[0], (height + 2) / load.fit[1])
        larger = [min(int(share * side) + 2, side) for side in load.fit]
        assert replace(load, fit=(larger[0], larger[1])).bytes > limit
        with pytest.raises(InputError, match="Try a smaller --max-size, or a larger --max-memory"):
            size_that_fits(load, limit, asked=True)


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("size", "given"),
    [
        ((1500, 1000), {"gaussians": 500}),
        ((3600, 2400), {"gaussians": 500}),
        ((2100, 1400), {"gaussians": 100, "max_size": 2100, "inks": "#000,#f00,#fff"}),
    ],
)
def test_estimate_is_over_what_a_process_takes_but_not_by_far(size, given, tmp_path):
    compile_kernels()
    path, options = tmp_path / "photo.png", Options.from_flat({**given, "iterations": 3})
    Image.new("RGB", size, (200, 100, 50)).save(path)
    code = (
        "import pickle, sys; from gauss2svg.pipeline.vectorize import vectorize_by; "
        "vectorize_by(pickle.load(sys.stdin.buffer), sys.argv[1]); "
        "print(next(l for l in open('/proc/self/status') if l.startswith('VmHWM')).split()[1])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, path], input=pickle.dumps(options), capture_output=True,
        check=True,
    )  # fmt: skip
    header = header_of(path)
    assert header is not None
    needed, plain = (
        load_of(Plan(one), header).bytes for one in (options, options.changed(inks=None))
    )
    assert plain + ("inks" in given) <= needed
    assert 1 <= needed / (int(done.stdout) * 1024) <= 1.9


@given(LOADS, st.integers(1, 30))
def test_what_is_measured_reduced_takes_no_more(load, reduced_bytes):
    load = replace(load, plan=Plan(load.plan.options.changed(full_size=False)))
    reduced = replace(load, photo=replace(load.photo, reduced_bytes=reduced_bytes))
    assert reduced.bytes <= load.bytes
    if reduced.measured == load.photo.size:
        assert reduced.bytes == load.bytes


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
    assert vectorize(photo, max_memory="9G", **QUICK).report["fit_width"] == 128


def test_photo_that_never_fits_is_refused_before_the_fit(photo, tmp_path, monkeypatch, refusal):
    monkeypatch.setattr("gauss2svg.pipeline.by_count.ByCount", None)
    path, out = tmp_path / "photo.png", tmp_path / "o.svg"
    path.write_bytes(as_png(photo))
    line = refusal(path, "-o", out, "--gaussians", 3, "--max-memory", "100M")
    assert "and up to 3 Gaussians; got 100 MB. Try a smaller photo, or a larger" in line
    assert list(tmp_path.iterdir()) == [path]
    monkeypatch.setattr(memory, "MEMORY_SHARE", 0.001)
    with pytest.raises(InputError, match="Try a smaller photo"):
        vectorize(photo, **QUICK)


def test_a_budget_has_bounded_memory_and_a_target_beside_it_the_same_fit():
    def of(width, height, **given):
        return load_of(Plan(Options.from_flat(given)), Header(width, height, False))

    for limit in ({"time_limit": 60}, {"max_bytes": "10M"}):
        assert of(3000, 2000, **limit).bytes < 3e9
    alone, both = (of(4000, 3000, max_bytes="5M", **more) for more in ({}, {"target_psnr": 90}))
    assert both.fit == alone.fit
    assert both.bytes >= alone.bytes


def test_a_share_of_what_is_free_and_its_own_is_allowed(monkeypatch):
    monkeypatch.setattr(memory, "free_bytes", lambda: 10**8)
    own = psutil.Process().memory_info().rss
    assert memory_limit(None) == pytest.approx(memory.MEMORY_SHARE * (10**8 + own), rel=0.02)
    assert memory_limit(2 * 10**9) == 2 * 10**9


def group(folder, most, used, idle, version=2):
    """Write the files of a control group."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ("memory.max", "memory.current", "inactive_file")
    if version == 1:
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
    (folder / names[0]).write_text(f"{most}\n")
    (folder / names[1]).write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 5\n{names[2]} {idle}\n")


@pytest.mark.parametrize(
    ("version", "row", "place"),
    [(2, "0::/a/b\n", ""), (1, "4:cpu:/x\n3:memory,hugetlb:/a/b\n0::/\n", "memory")],
)
def test_control_groups_bound_what_is_free(version, row, place, tmp_path):
    process, groups = tmp_path / "self", tmp_path / "groups"
    process.mkdir()
    (process / "cgroup").write_text(row)
    assert free_bytes(process, groups) > 10**6
    unlimited = "max" if version == 2 else 2**63 - 4096
    for name, most, used, idle, free in (
        ("a/b", unlimited, 700, 0, None), ("a", 1000, 700, 100, 400), (".", 800, 900, 200, 100),
        ("a/b", 500, 900, 0, 0),
    ):  # fmt: skip
        group(groups / place / name, most, used, idle, version)
        found = free_bytes(process, groups)
        assert found > 10**6 if free is None else found == free
    # In a container the host's path is not there, and the root is the container's own.
    (process / "cgroup").write_text(row.replace("/a/b", "/of/the/host"))
    assert free_bytes(process, groups) == 100


@pytest.mark.posix
def test_limits_of_the_process_bound_what_is_free(monkeypatch):
    import resource

    none = resource.RLIM_INFINITY, resource.RLIM_INFINITY
    for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA):
        held = psutil.Process().memory_info()
        limit = (held.vms if kind == resource.RLIMIT_AS else held.rss) + 50_000_000
        bounds = {kind: (limit, resource.RLIM_INFINITY)}
        monkeypatch.setattr(resource, "getrlimit", lambda k, b=bounds: b.get(k, none))
        assert 0 < free_bytes() <= 50_000_000


LARGE = Image.new("L", (3000, 2000))
LARGE_FILES = {
    "PNG": encoded(LARGE, "PNG"),
    "JPEG": encoded(LARGE, "JPEG"),
    "RGBA PNG": encoded(LARGE.convert("RGBA"), "PNG"),
    "float TIFF": tiff(np.zeros((2000, 3000), np.float16), photometric="minisblack"),
    "image": LARGE,
}


@pytest.mark.parametrize("kind", LARGE_FILES)
def test_what_cannot_fit_is_refused_by_its_header(kind, monkeypatch):
    monkeypatch.setattr("gauss2svg.pipeline.run.load_image", None)
    with pytest.raises(InputError, match=r"memory must be .* for a photo of 3000x2000 px.*300 MB"):
        vectorize(LARGE_FILES[kind], max_memory="300M", **QUICK)


def test_a_stream_that_is_read_once_is_still_read(photo):
    once = SimpleNamespace(read=io.BytesIO(as_png(photo)).read)
    assert vectorize(once, **QUICK).report["width"] == 128
