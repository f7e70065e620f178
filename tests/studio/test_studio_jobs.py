"""The line of the studio and what it keeps, by a pool whose calls end when a test says so."""

from __future__ import annotations

import asyncio
import json
import os
from concurrent.futures import CancelledError, Future

import pytest
from starlette.exceptions import HTTPException

from gauss2svg.studio import jobs
from gauss2svg.studio.jobs import Job, Jobs, wait_until


class Waiting:
    """Stands in for a pool of one process."""

    def __init__(self, _workers: int) -> None:
        self.calls: list[Future] = []

    def __enter__(self) -> Waiting:
        return self

    def __exit__(self, *_: object) -> None:
        for call in self.calls:
            if not call.done() and not call.cancel():
                call.set_exception(CancelledError())

    def submit(self, *_: object) -> Future:
        self.calls.append(Future())
        self.calls[-1].add_done_callback(lambda _: self.begin())
        self.begin()
        return self.calls[-1]

    def begin(self) -> None:
        """Let the first call that waits run if no other does."""
        left = [call for call in self.calls if not call.done()]
        if left and not left[0].running():
            left[0].set_running_or_notify_cancel()


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(jobs, "Pool", Waiting)


def with_queue(story) -> None:
    """Run a story, after which nothing is left."""

    queue = Jobs(1, 1)
    assert os.name == "nt" or queue.folder.stat().st_mode & 0o077 == 0
    asyncio.run(asyncio.wait_for(story(queue), 20))
    assert not list(queue.folder.iterdir())
    assert not queue.by_id


def new_job(queue: Jobs, photo: bytes = b"photo") -> Job:
    queue.make_space()
    job = Job(queue.new_folder(), "a.png", {}, 4, 4, {})
    (job.folder / "photo").write_bytes(photo)
    queue.submit(job)
    return job


def finish(job: Job, reason: str = "gain") -> None:
    (job.folder / "report.json").write_text(json.dumps({"stop_reason": reason}))
    job.call.set_result({})


def test_jobs_run_one_after_the_other_and_a_line_has_an_end(monkeypatch):
    monkeypatch.setattr(jobs, "MOST_WAITING", 3)

    async def story(queue):
        first, second, third, fourth = (new_job(queue) for _ in range(4))
        assert [job.state for job in (first, second)] == ["running", "queued"]
        assert queue.queue() == [second, third, fourth]
        with pytest.raises(HTTPException, match="3 photos are waiting"):
            new_job(queue)
        queue.cancel(third)
        assert queue.queue() == [second, fourth]
        finish(first)
        assert (first.state, second.state, third.state) == ("done", "running", "canceled")
        finish(second, "interrupted")
        queue.stop(fourth)  # it runs: its process is asked
        assert (second.state, fourth.state) == ("stopped", "running")
        assert (fourth.folder / "stop").exists()

    with_queue(story)


def test_a_fit_that_does_not_end_when_it_is_asked_is_ended_and_a_forgotten_one_leaves_no_file():
    async def story(queue):
        running, waiting, done = new_job(queue), new_job(queue), new_job(queue)
        killed = []

        def kill():  # as the pool does, any number of times
            if not running.call.done():
                killed.append(running.call.set_exception(CancelledError()))

        running.call.cancel = kill
        queue.forget(waiting)
        assert not waiting.folder.exists()
        queue.forget(running)
        assert (running.folder / "cancel").exists()
        assert running.state == "canceled"
        await wait_until(lambda: not running.folder.exists())
        assert killed
        finish(done)
        queue.forget(done)
        assert not done.folder.exists()
        assert not queue.by_id

    with_queue(story)


def test_a_fit_is_canceled_when_the_last_of_its_readers_leaves():
    async def story(queue):
        job = new_job(queue)
        with queue.reading(job):
            with queue.reading(job):
                pass
            assert job.state == "running"
        assert job.state == "canceled"

    with_queue(story)


@pytest.mark.parametrize(("bound", "size"), [("MOST_KEPT", 3), ("MOST_BYTES", 1200)])
def test_the_oldest_finished_jobs_are_forgotten_and_those_that_wait_never(bound, size, monkeypatch):
    monkeypatch.setattr(jobs, bound, size)

    async def story(queue):
        made = []
        for _ in range(5):
            made.append(new_job(queue, bytes(400)))
            finish(made[-1])
        waits = new_job(queue)
        kept = [job.id in queue.by_id for job in made]
        assert kept == sorted(kept)
        assert 1 < sum(kept) < 4
        assert [job.folder.exists() for job in made] == kept
        if bound == "MOST_BYTES":
            (waits.folder / "photo").write_bytes(bytes(size))
            with pytest.raises(HTTPException, match="room"):
                new_job(queue)
        assert waits.id in queue.by_id

    with_queue(story)
