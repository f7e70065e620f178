"""Batches on processes: whatever dies, the outputs are those of a quiet run and none is lost."""

import json
import os
import signal
import subprocess
from collections import Counter
from contextlib import ExitStack

import pytest
from batches import left_parts, lines, outputs, save_photos, tiny
from clusters import NOBODY, Cluster, batch, batch_here, ended, preload, under_way, wait_for

from gauss2svg.batch.table import TABLE
from gauss2svg.pipeline.vectorize import vectorize_by

pytestmark = pytest.mark.process

COUNT = 12
NAMES = [f"{number:02}.png" for number in range(COUNT)]


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    return save_photos(tmp_path_factory.mktemp("batch") / "photos", NAMES)


@pytest.fixture(scope="module")
def quiet(photos):
    """The outputs of a run without a fault."""
    return {
        f"{path.stem}.svg": vectorize_by(tiny(), path).svg.encode() for path in photos.iterdir()
    }


@pytest.fixture(scope="module")
def clusters(tmp_path_factory):
    """Gives the cluster, or another where the scheduler of that one was killed."""
    with ExitStack() as stack:
        made = []

        def cluster():
            if not made or made[-1].scheduler.poll() is not None:
                made.append(stack.enter_context(Cluster(tmp_path_factory.mktemp("cluster"))))
            return made[-1]

        yield cluster


@pytest.fixture
def cluster(clusters):
    return clusters()


@pytest.fixture
def said(capsys):
    """The lines of standard error but for the address of the dashboard, which bokeh adds."""
    return lambda: _without_dashboard(capsys.readouterr().err.splitlines())


def _without_dashboard(lines):
    return [line for line in lines if "dashboard" not in line]


def skipped(line):
    return int(line.split(" skipped")[0].split()[-1])


def check(out, quiet, in_flight):
    """All outputs are there, and only what was in flight was done twice."""
    assert outputs(out) == quiet
    found = Counter(one["output"] for one in map(json.loads, lines(out)) if "output" in one)
    assert set(found) == set(quiet)
    assert sum(found.values()) <= len(quiet) + in_flight


def test_worker_that_is_killed_gives_its_photos_back(cluster, photos, quiet, tmp_path, said):
    out = tmp_path / "out"
    with under_way(photos, "-o", out, "--scheduler", cluster.address) as run:
        wait_for(run.done, out, 4)
        os.kill(cluster.workers()[0], signal.SIGKILL)
    assert run.result() == 0
    summary, *rest = said()
    assert len(rest) == 1
    assert summary.startswith(f"gauss2svg: {COUNT} done, 0 skipped, 0 failed in")
    check(out, quiet, 1)


def test_driver_that_is_killed_is_followed_by_one_that_goes_on(
    cluster, photos, quiet, tmp_path, said
):
    out = tmp_path / "out"
    command = [photos, "-o", out, "--scheduler", cluster.address]
    run = batch(*command, cwd=tmp_path)
    wait_for(run.poll, out, 6)
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    assert batch_here(*command) == 0
    assert skipped(said()[0]) >= 4  # of 6, two may be in flight
    check(out, quiet, 4)
    assert batch_here(photos, "-o", out, "--scheduler", NOBODY) == 0
    assert skipped(said()[0]) == COUNT


def test_photos_that_exhaust_memory_or_crash_are_isolated(cluster, quiet, tmp_path, said):
    good = NAMES[:4]
    bad = save_photos(tmp_path / "in", [*good, "crash.png", "greedy.png"])
    out = tmp_path / "out"
    command = [bad, "-o", out, "--scheduler", cluster.address]
    assert batch_here(*command) == 1
    assert outputs(out) == {name: quiet[name] for name in (f"{one[:2]}.svg" for one in good)}
    records = [one for one in map(json.loads, lines(out)) if one.get("error")]
    assert sorted(one["output"] for one in records) == ["crash.svg", "greedy.svg"]
    assert all(one["error"].startswith("2 workers died at it, alone") for one in records)
    assert {one["error_code"] for one in records} == {"WorkerDied"}
    said()
    assert batch_here(*command) == 1  # they are not tried again unasked
    assert f"0 done, {len(good)} skipped, 0 failed, 2 failed earlier" in said()[0]


def test_scheduler_that_is_killed_ends_the_driver_and_loses_nothing(
    cluster, dask_client, photos, quiet, tmp_path, said
):
    out = tmp_path / "out"
    with under_way(photos, "-o", out, "--scheduler", cluster.address) as run:
        wait_for(run.done, out, 6)
        os.kill(cluster.scheduler.pid, signal.SIGKILL)
    assert run.result() == 2
    (line,) = said()
    assert line.startswith("gauss2svg: lost the connection to")
    assert batch_here(photos, "-o", out, "--scheduler", dask_client.scheduler.address) == 0
    assert skipped(said()[0]) >= 4
    check(out, quiet, 4)


@pytest.mark.parametrize(("number", "workers"), [(signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_interrupted_batch_ends_and_goes_on(
    number, workers, dask_client, photos, quiet, tmp_path, said
):
    out = tmp_path / "out"
    variables = {"DASK_DISTRIBUTED__WORKER__PRELOAD": preload(tmp_path)}
    run = batch(photos, "-o", out, "--workers", workers, cwd=tmp_path, **variables)
    wait_for(run.poll, out, 3)
    os.killpg(run.pid, number)  # as at a terminal, which sends it to all processes
    status, heard = ended(run)
    assert status == 128 + number
    see, *heard = _without_dashboard(heard)
    assert see.startswith(f"gauss2svg: see {out / TABLE}")
    assert heard == ["gauss2svg: interrupted; every file is whole or untouched"]
    table = (out / TABLE).read_text().splitlines()
    assert 0 < len(table) - 1 <= len(outputs(out))
    before = outputs(out)
    assert 3 <= len(before) < COUNT
    assert batch_here(photos, "-o", out, "--scheduler", dask_client.scheduler.address) == 0
    assert skipped(said()[0]) >= len(before) - workers
    check(out, quiet, 2 * workers)
    assert len(left_parts(out)) <= workers  # of those that were killed just then


@pytest.fixture
def full_disk(tmp_path):
    """A file system of 100 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a small file system")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def test_full_disk_ends_the_batch_in_a_line_and_the_next_run_goes_on(
    full_disk, dask_client, photos, quiet, tmp_path, said
):
    out, ballast = full_disk / "out", full_disk / "ballast"
    ballast.write_bytes(bytes(60_000))
    command = [photos, "-o", out, "--scheduler", dask_client.scheduler.address]
    assert batch_here(*command) == 2
    (line,) = said()
    assert "No space left on device" in line
    written = outputs(out)
    assert 0 < len(written) < COUNT
    assert written.items() <= quiet.items()
    ballast.unlink()
    subprocess.run(["mount", "-o", "remount,size=2m", str(full_disk)], check=True)
    assert batch_here(*command) == 0
    assert outputs(out) == quiet
