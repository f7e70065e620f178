"""Batches on processes: whatever dies, the outputs are those of a quiet run and none is lost."""

import json
import os
import signal
import subprocess
from collections import Counter

import pytest
from batches import left_parts, lines, outputs, save_photos, tiny
from clusters import Cluster, batch, ended, wait_for

from gauss2svg.pipeline.vectorize import vectorize_by

pytestmark = pytest.mark.process

COUNT = 24
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
def cluster(tmp_path_factory):
    with Cluster(tmp_path_factory.mktemp("cluster")) as cluster:
        yield cluster


def check(out, quiet, in_flight):
    """All outputs are there, and only what was in flight was done twice."""
    assert outputs(out) == quiet
    found = Counter(one["output"] for one in map(json.loads, lines(out)) if "output" in one)
    assert set(found) == set(quiet)
    assert sum(found.values()) <= len(quiet) + in_flight


def test_worker_that_is_killed_gives_its_photos_back(cluster, photos, quiet, tmp_path):
    run = batch(photos, "-o", tmp_path / "out", "--scheduler", cluster.address, cwd=tmp_path)
    wait_for(run, tmp_path / "out", 4)
    os.kill(cluster.workers()[0], signal.SIGKILL)
    status, said = ended(run)
    assert (status, len(said)) == (0, 3), said
    assert said[1].startswith(f"gauss2svg: {COUNT} done, 0 skipped, 0 failed in")
    check(tmp_path / "out", quiet, 1)


def test_driver_that_is_killed_is_followed_by_one_that_goes_on(cluster, photos, quiet, tmp_path):
    command = [photos, "-o", tmp_path / "out", "--scheduler", cluster.address]
    run = batch(*command, cwd=tmp_path)
    wait_for(run, tmp_path / "out", 6)
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    status, said = ended(batch(*command, cwd=tmp_path))
    assert status == 0, said
    assert int(said[1].split(" skipped")[0].split()[-1]) >= 4  # of 6, two may be in flight
    check(tmp_path / "out", quiet, 4)


def test_scheduler_that_is_killed_ends_the_driver_and_loses_nothing(photos, quiet, tmp_path):
    out = tmp_path / "out"
    with Cluster(tmp_path) as cluster:
        run = batch(photos, "-o", out, "--scheduler", cluster.address, cwd=tmp_path)
        wait_for(run, out, 6)
        os.kill(cluster.scheduler.pid, signal.SIGKILL)
        status, said = ended(run)
        assert status == 2
        assert said[-1].startswith("gauss2svg: lost the connection to")
        assert len(said) == 2, said
    status, said = ended(batch(photos, "-o", out, "--workers", "1", cwd=tmp_path))
    assert status == 0, said
    assert int(said[1].split(" skipped")[0].split()[-1]) >= 4
    check(out, quiet, 4)


def test_photos_that_exhaust_memory_or_crash_are_isolated(
    cluster, photos, quiet, tmp_path_factory, tmp_path
):
    bad = save_photos(tmp_path / "in", [*NAMES, "crash.png", "greedy.png"])
    out = tmp_path / "out"
    command = [bad, "-o", out, "--scheduler", cluster.address]
    status, said = ended(batch(*command, cwd=tmp_path), 300)
    assert status == 1, said
    assert outputs(out) == quiet
    records = [one for one in map(json.loads, lines(out)) if one.get("error")]
    assert sorted(one["output"] for one in records) == ["crash.svg", "greedy.svg"]
    assert all(one["error"].startswith("2 workers died at it, alone") for one in records)
    status, said = ended(batch(*command, cwd=tmp_path))  # they are not tried again unasked
    assert f"0 done, {COUNT} skipped, 2 failed" in said[1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_batch_ends_and_goes_on(number, photos, quiet, tmp_path):
    out = tmp_path / "out"
    command = [photos, "-o", out, "--gaussians", "30", "--iterations", "150"]
    run = batch(*command, "--workers", "2", cwd=tmp_path, tiny=False)
    wait_for(run, out, 3)
    os.killpg(run.pid, number)  # as at a terminal, which sends it to all processes
    status, said = ended(run)
    assert status == 128 + number
    assert said[1:] == ["gauss2svg: interrupted; every file is whole or untouched"]
    before = outputs(out)
    assert len(before) >= 3
    status, said = ended(batch(*command, cwd=tmp_path, tiny=False))
    assert status == 0, said
    assert len(outputs(out)) == COUNT
    assert before.items() <= outputs(out).items()
    assert len(left_parts(out)) <= 2  # of workers that were killed just then; gone after a minute


@pytest.fixture
def full_disk(tmp_path):
    """A file system of 200 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a small file system")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def test_full_disk_ends_the_batch_in_a_line_and_the_next_run_goes_on(full_disk, tmp_path):
    photos = save_photos(tmp_path / "many", [f"{number:03}.png" for number in range(80)])
    out = full_disk / "out"
    ballast = full_disk / "ballast"
    ballast.write_bytes(bytes(100_000))
    status, said = ended(batch(photos, "-o", out, cwd=tmp_path))
    assert status == 2
    assert len(said) == 2, said
    assert "No space left on device" in said[1]
    written = outputs(out)
    assert 0 < len(written) < 80
    ballast.unlink()
    subprocess.run(["mount", "-o", "remount,size=2m", str(full_disk)], check=True)
    status, said = ended(batch(photos, "-o", out, cwd=tmp_path))
    assert status == 0, said
    assert written.items() <= outputs(out).items()
    assert len(outputs(out)) == 80
    for path in photos.iterdir():
        assert outputs(out)[f"{path.stem}.svg"] == vectorize_by(tiny(), path).svg.encode()
