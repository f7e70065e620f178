"""Batches in processes, on both engines: whatever dies, the files are those of a quiet run."""

import csv
import os
import signal
from contextlib import closing

import pytest
from batches import marks, outputs, save_photo, save_photos, tiny
from clusters import Cluster, Local, ended
from conftest import has_ended

from gauss2svg.batch.stores import TABLE
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


@pytest.fixture(scope="module")
def of_module(tmp_path_factory):
    with closing(Cluster(tmp_path_factory.mktemp("cluster"))) as cluster:
        yield cluster


@pytest.fixture
def cluster(of_module):
    """A cluster, anew if a test has killed it."""
    if of_module.scheduler.poll() is not None:
        of_module.close()
        of_module.start()
    return of_module


@pytest.fixture(params=[Local, Cluster])
def engine(request, tmp_path):
    return Local(tmp_path) if request.param is Local else request.getfixturevalue("cluster")


def check_whole(out, quiet):
    """What is there is whole, and a photo that is marked has its SVG."""
    assert outputs(out).items() <= quiet.items()
    assert marks(out).keys() <= outputs(out).keys()


def errors_in(out):
    """The codes of errors in the table, "" of those that are done, by outputs."""
    with (out / TABLE).open(newline="") as table:
        return {row["output"]: row["error_code"] for row in csv.DictReader(table)}


def test_interrupted_and_killed_and_run_again_is_run_once(engine, photos, quiet, tmp_path):
    """The command by a signal, then at once, then a worker; a photo may crash its workers."""
    out, is_local = tmp_path / "out", type(engine) is Local
    engine.hold("06")
    command = engine.batch(out, photos)
    engine.wait_held("06", command)
    number = signal.SIGINT if is_local else signal.SIGTERM
    os.killpg(command.pid, number)  # as at a terminal, which sends it to all processes
    status, (see, interrupted) = ended(command)
    assert status == 128 + number
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
    assert all(map(has_ended, workers)) or not is_local
    assert ended(command)[0] == -signal.SIGKILL
    check_whole(out, quiet)
    # Not in a cluster: a worker that dies there may not have told yet that a photo is done.
    crashing = [save_photo(tmp_path / "crash.png", 0)] * is_local
    engine.hold("10")
    command = engine.batch(out, photos, *crashing)
    engine.wait_held("10", command)
    os.kill(engine.workers(command)[0], signal.SIGKILL)
    engine.hold("none")
    assert ended(command)[0] == len(crashing)
    assert outputs(out) == quiet
    died = dict.fromkeys(["crash.svg"] * is_local, "WorkerDied")
    assert errors_in(out) == dict.fromkeys(quiet, "") | died


def test_two_runs_at_once_lose_nothing(cluster, photos, quiet, tmp_path):
    cluster.hold("00")
    runs = [cluster.batch(tmp_path / "out", photos, local=one) for one in (False, True)]
    cluster.wait_held("00", *runs)  # both have begun
    cluster.hold("none")
    found = [ended(command) for command in runs]
    assert [status for status, _ in found] == [0, 0], found
    assert outputs(tmp_path / "out") == quiet
    assert marks(tmp_path / "out").keys() == quiet.keys()


def test_scheduler_that_is_killed_ends_the_batch_and_loses_nothing(
    cluster, photos, quiet, tmp_path
):
    cluster.hold("04")
    command = cluster.batch(tmp_path / "out", photos)
    cluster.wait_held("04", command)
    os.kill(cluster.scheduler.pid, signal.SIGKILL)
    status, (line,) = ended(command)
    assert status == 2
    assert line.startswith("gauss2svg: --scheduler must be the address of a Dask scheduler")
    check_whole(tmp_path / "out", quiet)
    assert outputs(tmp_path / "out")
