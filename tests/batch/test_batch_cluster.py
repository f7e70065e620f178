"""Batches in processes here and in a cluster: whatever dies, files are those of a quiet run."""

import csv
import os
import signal
from contextlib import closing

import pytest
from batches import marks, outputs, save_photos, tiny
from clusters import Cluster, Local, ended
from conftest import has_ended

from gauss2svg.batch.many import TABLE
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


@pytest.fixture
def cluster(tmp_path):
    with closing(Cluster(tmp_path)) as cluster:
        yield cluster


def check_whole(out, quiet):
    """What is there is whole, and a photo that is marked has its SVG."""
    assert outputs(out).items() <= quiet.items()
    assert marks(out).keys() <= outputs(out).keys()


def errors_in(out):
    """The codes of errors in the table, "" of those that are done, by outputs."""
    with (out / TABLE).open(newline="") as table:
        return {row["output"]: row["error_code"] for row in csv.DictReader(table)}


def test_interrupted_and_killed_and_run_again_is_run_once(photos, quiet, tmp_path):
    """The command by a signal, then at once, then a worker."""
    engine, out = Local(tmp_path), tmp_path / "out"
    engine.hold("06")
    command = engine.batch(out, photos)
    engine.wait_held("06", command)
    os.killpg(command.pid, signal.SIGINT)  # as at a terminal, which sends it to all processes
    status, (see, interrupted) = ended(command)
    assert status == 128 + signal.SIGINT
    assert see.startswith(f"gauss2svg: see {out / TABLE}")
    done = sum(not code for code in errors_in(out).values())
    begins = f"gauss2svg: interrupted; {done} of {len(NAMES)} photos are done, and the same command"
    assert interrupted.startswith(begins)
    assert 0 < len(errors_in(out)) <= len(outputs(out)) < len(NAMES)
    check_whole(out, quiet)
    engine.hold("08")
    command = engine.batch(out, photos)
    engine.wait_held("08", command)
    workers = engine.workers(command)
    command.kill()
    engine.hold("none")  # workers end once they have their photo
    assert ended(command)[0] == -signal.SIGKILL
    assert all(map(has_ended, workers))
    check_whole(out, quiet)
    engine.hold("10")
    command = engine.batch(out, photos)
    engine.wait_held("10", command)
    os.kill(engine.workers(command)[0], signal.SIGKILL)
    engine.hold("none")
    assert ended(command)[0] == 1
    assert sorted(errors_in(out).values()) == [*[""] * (len(quiet) - 1), "WorkerDied"]
    assert ended(engine.batch(out, photos))[0] == 0
    assert outputs(out) == quiet
    assert errors_in(out) == dict.fromkeys(quiet, "")


def test_two_runs_at_once_and_a_scheduler_that_is_killed_lose_nothing(
    cluster, photos, quiet, tmp_path
):
    out = tmp_path / "out"
    cluster.hold("04")
    runs = [cluster.batch(out, photos, local=one) for one in (False, True)]
    cluster.wait_held("04", *runs)  # both have begun
    os.kill(cluster.scheduler.pid, signal.SIGKILL)
    status, (line,) = ended(runs[0])
    assert status == 2
    assert line.startswith("gauss2svg: --scheduler must be the address of a Dask scheduler")
    check_whole(out, quiet)
    cluster.hold("none")
    assert ended(runs[1])[0] == 0
    assert outputs(out) == quiet
    assert marks(out).keys() == quiet.keys()
