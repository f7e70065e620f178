"""Batches in processes, on both engines: whatever dies, the files are those of a quiet run."""

import csv
import os
import random
import signal
import time
from contextlib import closing

import pytest
from batches import left_parts, marks, outputs, save_photos, tiny
from clusters import Cluster, Local, batch, ended, wait_for

from gauss2svg.batch.table import TABLE
from gauss2svg.pipeline.vectorize import vectorize_by

pytestmark = pytest.mark.process
NAMES = [f"{number:02}.png" for number in range(12)]


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    return save_photos(tmp_path_factory.mktemp("batch") / "photos", NAMES)


@pytest.fixture(scope="module")
def quiet(photos):
    """The outputs of a run without a fault."""
    return {
        f"{path.stem}.svg": vectorize_by(tiny(), path).svg.encode() for path in photos.iterdir()
    }


@pytest.fixture(scope="module", params=[Local, Cluster])
def engine(request, tmp_path_factory):
    made = request.param(tmp_path_factory.mktemp("engine"))
    yield made
    if request.param is Cluster:
        made.close()


@pytest.fixture
def run(engine, photos, tmp_path):
    """Begin a batch to out/."""
    return lambda source=photos: batch(source, tmp_path / "out", *engine.options, cwd=engine.folder)


def check_whole(out, quiet):
    """What is there is whole, and a photo that is marked has its SVG."""
    assert outputs(out).items() <= quiet.items()
    assert marks(out).keys() <= outputs(out).keys()


def test_killed_at_any_moment_and_run_again_is_run_once(run, engine, quiet, tmp_path):
    """The command and the workers in turn."""
    out, rng = tmp_path / "out", random.Random(0)
    for turn in range(6):
        command = run()
        wait_for(command, out, min(turn + 1, 10))
        time.sleep(rng.uniform(0, 0.3))
        pids = [command.pid] if turn % 2 else engine.workers(command)[:1]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        if turn % 2 == 0:
            os.kill(command.pid, signal.SIGTERM)
        command.communicate()
        check_whole(out, quiet)
    status, said = ended(run())
    assert (status, "0 failed" in said[0]) == (0, True), said
    assert outputs(out) == quiet
    table = (out / TABLE).read_text().splitlines()
    assert sorted(line.split(",")[1] for line in table[1:]) == sorted(quiet)


def test_a_photo_that_crashes_its_worker_costs_no_other(run, quiet, tmp_path):
    status, said = ended(run(save_photos(tmp_path / "in", [*NAMES[:4], "crash.png"])))
    assert status == 1, said
    assert outputs(tmp_path / "out") == {name: quiet[name] for name in sorted(quiet)[:4]}
    with (tmp_path / "out" / TABLE).open(newline="") as table:
        codes = [row["error_code"] for row in csv.DictReader(table) if row["error"]]
    assert codes == ["WorkerDied"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_batch_ends_and_goes_on(number, run, quiet, tmp_path):
    out = tmp_path / "out"
    command = run()
    wait_for(command, out, 3)
    os.killpg(command.pid, number)  # as at a terminal, which sends it to all processes
    status, (see, interrupted) = ended(command)
    assert status == 128 + number
    assert see.startswith(f"gauss2svg: see {out / TABLE}")
    assert interrupted == "gauss2svg: interrupted; every file is whole or untouched"
    table = (out / TABLE).read_text().splitlines()
    assert 0 < len(table) - 1 <= len(outputs(out)) < len(NAMES)
    check_whole(out, quiet)
    assert ended(run())[0] == 0
    assert outputs(out) == quiet
    assert len(left_parts(out)) <= 2  # of those that were killed just then


def test_two_runs_at_once_lose_nothing(run, quiet, tmp_path):
    found = [ended(command) for command in (run(), run())]
    assert [status for status, _ in found] == [0, 0], found
    assert outputs(tmp_path / "out") == quiet
    assert marks(tmp_path / "out").keys() == quiet.keys()


def test_scheduler_that_is_killed_ends_the_batch_and_loses_nothing(photos, quiet, tmp_path):
    with closing(Cluster(tmp_path)) as cluster:
        command = batch(photos, tmp_path / "out", *cluster.options, cwd=tmp_path)
        wait_for(command, tmp_path / "out", 4)
        os.kill(cluster.scheduler.pid, signal.SIGKILL)
        status, (line,) = ended(command)
    assert status == 2
    assert line.startswith("gauss2svg: --scheduler must be the address of a Dask scheduler")
    check_whole(tmp_path / "out", quiet)
