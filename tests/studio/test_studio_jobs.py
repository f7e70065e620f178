"""The queue of the studio, by workers that only pretend."""

import asyncio
import json
import types
from pathlib import Path
from typing import ClassVar

import psutil
import pytest
from galleries import program

from gauss2svg.studio import jobs as module
from gauss2svg.studio.jobs import (
    CANCELED,
    DONE,
    FAILED,
    RUNNING,
    STOPPED,
    Job,
    Jobs,
    QueueFullError,
    Worker,
    WorkerDiedError,
)
from gauss2svg.studio.routes.jobs import _stream


class Pretender:
    """A worker whose fit ends when the test says so."""

    made: ClassVar[list] = []

    def __init__(self) -> None:
        self.is_alive, self.killed = True, 0
        self.sent, self.inbox = [], asyncio.Queue()
        self.obeys = True
        Pretender.made.append(self)

    @classmethod
    async def started(cls, folder):
        return cls()

    def send(self, message) -> None:
        self.sent.append(message)
        if "cancel" in message and self.obeys:
            self.say(message["job"], "ended")

    def say(self, job: str, kind: str, data: bytes = b"", **more) -> None:
        self.inbox.put_nowait(({"job": job, "kind": kind, **more}, data))

    def finish(self, job: Job, reason: str = "gain") -> None:
        (job.folder / "report.json").write_text(json.dumps({"stop_reason": reason}))
        self.say(job.id, "done")
        self.say(job.id, "ended")

    async def messages(self, job: str):
        while True:
            item = await self.inbox.get()
            if item is None:
                self.is_alive = False
                raise WorkerDiedError("killed by SIGKILL; was there enough memory?")
            if item[0]["job"] == job:
                if item[0]["kind"] == "ended":
                    return
                yield item

    def kill(self) -> None:
        self.killed += 1
        self.inbox.put_nowait(None)

    async def end(self) -> None:
        self.is_alive = False


@pytest.fixture(autouse=True)
def pretended(monkeypatch):
    Pretender.made = []
    monkeypatch.setattr(module, "Worker", Pretender)
    monkeypatch.setattr(module, "_CANCEL_S", 0.02)
    monkeypatch.setattr(module, "UNWATCHED_S", 0.02)


def with_queue(story, workers: int = 1, most_waiting: int = 3) -> None:
    async def run():
        queue = Jobs(workers, 1, most_waiting)
        folder = queue.folder
        try:
            await asyncio.wait_for(story(queue), 20)
        finally:
            await queue.close()
        assert not folder.exists()

    asyncio.run(run())


def new_job(queue: Jobs, keep: bool = True, photo: bytes = b"photo") -> Job:
    job = Job(queue.new_folder(), "a.png", {}, 4, 4, keep=keep)
    job.photo.write_bytes(photo)
    queue.submit(job)
    return job


async def until(true) -> None:
    while not true():
        await asyncio.sleep(0.001)


def test_jobs_run_one_after_the_other_and_know_their_place():
    async def story(queue):
        first, second, third = (new_job(queue) for _ in range(3))
        await until(lambda: first.state == RUNNING)
        assert [j.place for j in (first, second, third)] == [0, 1, 2]
        (worker,) = Pretender.made
        worker.finish(first)
        await until(lambda: second.state == RUNNING)
        assert (first.state, third.place) == (DONE, 1)
        worker.finish(second, "interrupted")
        await until(lambda: third.state == RUNNING)
        assert second.state == STOPPED

    with_queue(story)


def test_past_its_bound_the_queue_takes_none_and_afterwards_it_does():
    async def story(queue):
        running = new_job(queue)
        await until(lambda: running.state == RUNNING)
        waiting = [new_job(queue) for _ in range(3)]
        with pytest.raises(QueueFullError, match="3 photos are waiting"):
            new_job(queue)
        queue.cancel(waiting[1])
        assert [job.place for job in waiting] == [1, 0, 2]
        assert new_job(queue).place == 3

    with_queue(story)


def test_who_is_sent_away_is_told_to_come_again_after_a_share_of_what_fits_take(monkeypatch):
    clock = types.SimpleNamespace(monotonic=lambda: now)
    monkeypatch.setattr(module, "time", clock)
    now = 0.0

    async def story(queue):
        nonlocal now
        assert queue.wait_s == 2  # until a fit is over they are thought to take 5 s
        for _ in range(30):
            job = new_job(queue)
            await until(lambda job=job: job.state == RUNNING)
            now += 60
            job.worker.finish(job)
            await until(lambda job=job: job.ready)
        assert queue.wait_s == 30

    with_queue(story, workers=2)


def test_a_canceled_fit_frees_its_worker_which_stays():
    async def story(queue):
        first, second = new_job(queue), new_job(queue)
        await until(lambda: first.state == RUNNING)
        queue.cancel(first)
        await until(lambda: second.state == RUNNING)
        assert first.state == CANCELED
        await asyncio.sleep(0.05)
        (worker,) = Pretender.made
        assert not worker.killed

    with_queue(story)


def test_a_worker_that_does_not_listen_is_killed_and_replaced():
    async def story(queue):
        first, second = new_job(queue), new_job(queue)
        await until(lambda: first.state == RUNNING)
        Pretender.made[0].obeys = False
        queue.cancel(first)
        await until(lambda: second.state == RUNNING)
        assert first.state == CANCELED
        assert [worker.killed for worker in Pretender.made] == [1, 0]

    with_queue(story)


def test_a_worker_that_dies_costs_its_own_fit_and_says_so():
    async def story(queue):
        first, second = new_job(queue), new_job(queue)
        await until(lambda: first.state == RUNNING)
        Pretender.made[0].kill()
        await until(lambda: second.state == RUNNING)
        assert first.state == FAILED
        assert "SIGKILL" in first.error

    with_queue(story)


def test_a_worker_that_dies_idle_costs_no_fit():
    async def story(queue):
        queue.start()
        await until(lambda: Pretender.made)
        await asyncio.sleep(0.01)
        Pretender.made[0].is_alive = False
        job = new_job(queue)
        await until(lambda: job.state == RUNNING)
        assert len(Pretender.made) == 2

    with_queue(story)


@pytest.mark.parametrize(("keep", "state"), [(False, CANCELED), (True, RUNNING)])
def test_a_fit_without_readers_is_canceled_unless_it_is_to_be_kept(keep, state):
    async def story(queue):
        job = new_job(queue, keep=keep)
        await until(lambda: job.state == RUNNING)
        with queue.reading(job), queue.reading(job):
            pass
        await asyncio.sleep(0.1)
        assert job.state == state

    with_queue(story)


def test_a_reader_that_comes_back_in_time_keeps_it():
    async def story(queue):
        job = new_job(queue, keep=False)
        await until(lambda: job.state == RUNNING)
        with queue.reading(job):
            pass
        with queue.reading(job):
            await asyncio.sleep(0.1)
            assert job.state == RUNNING

    with_queue(story)


def test_a_forgotten_job_leaves_no_file():
    async def story(queue):
        running, waiting = new_job(queue), new_job(queue)
        await until(lambda: running.state == RUNNING)
        for job in (running, waiting):
            queue.forget(job)
            await until(lambda job=job: not job.folder.exists())
        assert not queue.known

    with_queue(story)


def test_finished_jobs_are_bounded_in_number(monkeypatch):
    monkeypatch.setattr(module, "MOST_KEPT", 3)

    async def story(queue):
        made = []
        for _ in range(6):
            made.append(new_job(queue))
            await until(lambda: made[-1].state == RUNNING)
            Pretender.made[0].finish(made[-1])
            await until(lambda: made[-1].ready)
        new_job(queue)
        kept = [job.id in queue.known for job in made]
        assert kept == [False] * 4 + [True] * 2
        assert [job.folder.exists() for job in made] == kept

    with_queue(story)


def test_older_jobs_keep_their_results_and_lose_what_is_looked_at(monkeypatch):
    monkeypatch.setattr(module, "MOST_WHOLE", 1)

    async def story(queue):
        made = []
        for _ in range(3):
            made.append(new_job(queue))
            await until(lambda: made[-1].state == RUNNING)
            (made[-1].folder / "photo.png").write_bytes(b"large")
            Pretender.made[0].say(made[-1].id, "progress", b"frame", progress={})
            Pretender.made[0].finish(made[-1])
            await until(lambda: made[-1].ready)
        new_job(queue)
        assert [(job.folder / "photo.png").exists() for job in made] == [False, False, True]
        assert all((job.folder / "report.json").exists() for job in made)
        assert [bool(job.frame) for job in made] == [False, False, True]
        assert ["forgotten" in job.flaw for job in made] == [True, True, False]

    with_queue(story)


def test_jobs_are_bounded_in_bytes_and_those_that_wait_are_never_dropped(monkeypatch):
    monkeypatch.setattr(module, "MOST_BYTES", 1000)

    async def story(queue):
        done = new_job(queue, photo=bytes(600))
        await until(lambda: done.state == RUNNING)
        Pretender.made[0].finish(done)
        await until(lambda: done.ready)
        waits = new_job(queue, photo=bytes(990))
        new_job(queue, photo=b"")
        assert done.id not in queue.known
        new_job(queue, photo=bytes(20))
        with pytest.raises(QueueFullError, match="room"):
            new_job(queue)
        assert waits.id in queue.known

    with_queue(story, most_waiting=9)


def test_news_of_any_number_of_steps_are_one_for_a_slow_reader():
    async def story(queue):
        job = new_job(queue)
        await until(lambda: job.state == RUNNING)
        seen = job.version
        for number in range(10_000):
            Pretender.made[0].say(job.id, "progress", progress={"iteration": number})
        await until(lambda: (job.progress or {}).get("iteration") == 9999)
        assert await job.news(seen) == job.version

    with_queue(story)


def test_a_reader_that_does_not_read_stops_no_fit_and_then_gets_the_newest():
    async def story(queue):
        job = new_job(queue)
        stream = _stream(job, queue)
        assert '"state": "queued"' in await anext(stream)
        await until(lambda: job.state == RUNNING)
        for number in range(1000):
            Pretender.made[0].say(job.id, "progress", progress={"iteration": number})
        await until(lambda: (job.progress or {}).get("iteration") == 999)
        assert '"iteration": 999' in await anext(stream)
        Pretender.made[0].finish(job)
        await job.when()
        assert [event.count('"state": "done"') for event in [e async for e in stream]] == [1]

    with_queue(story)


@pytest.mark.parametrize("at_first", [True, False])
def test_workers_that_cannot_start_fail_every_fit_in_a_line(at_first, monkeypatch):
    async def broken(folder):
        raise WorkerDiedError("ended with status 1")

    async def story(queue):
        if not at_first:
            first = new_job(queue)
            await until(lambda: first.state == RUNNING)
        monkeypatch.setattr(Pretender, "started", broken)
        job = new_job(queue)
        if not at_first:
            Pretender.made[0].kill()
        await job.when()
        assert "no worker could be started: one ended with status 1" in job.error

    with_queue(story)


async def done_but_writing(queue) -> Job:
    job = new_job(queue)
    await until(lambda: job.state == RUNNING)
    (job.folder / "report.json").write_text('{"stop_reason": "gain"}')
    Pretender.made[0].say(job.id, "done")  # and now it writes the other files
    await until(lambda: job.state == DONE)
    return job


@pytest.mark.parametrize("obeys", [True, False])
def test_forgetting_a_job_whose_files_are_written_frees_its_core(obeys):
    async def story(queue):
        job = await done_but_writing(queue)
        (worker,) = Pretender.made
        worker.obeys = obeys
        queue.forget(job)
        await until(lambda: not job.folder.exists())
        assert worker.killed == (not obeys)
        assert job.state == DONE

    with_queue(story)


def test_a_worker_whose_files_cannot_be_read_is_replaced():
    async def story(queue):
        first, second = new_job(queue), new_job(queue)
        await until(lambda: first.state == RUNNING)
        (first.folder / "report.json").write_text("{")
        Pretender.made[0].say(first.id, "done")
        await until(lambda: second.state == RUNNING)
        assert first.state == FAILED
        assert "its files were lost" in first.error
        assert [worker.is_alive for worker in Pretender.made] == [False, True]

    with_queue(story)


@pytest.mark.parametrize("way", ["incomplete", "failed", "killed"])
def test_what_fails_after_a_fit_is_done_costs_no_fit(way):
    async def story(queue):
        job = await done_but_writing(queue)
        (worker,) = Pretender.made
        if way == "killed":
            worker.kill()
        else:
            worker.say(job.id, way, error="no room SIGKILL")
            worker.say(job.id, "ended")
        await job.when(ready=True)
        assert (job.state, job.error) == (DONE, None)
        assert "SIGKILL" in job.flaw

    with_queue(story)


@pytest.mark.parametrize("said", ["rubbish\\n", "x" * 99])
def test_a_worker_that_sends_no_messages_is_ended_as_one_that_died(monkeypatch, said, tmp_path):
    monkeypatch.setattr(module, "_LONGEST_LINE", 20)
    noted = tmp_path / "pid"
    python = program(tmp_path / "python", f"echo $$ > {noted}; printf '{said}'; exec sleep 99")
    monkeypatch.setattr("sys.executable", str(python))
    with pytest.raises(WorkerDiedError, match="no message"):
        asyncio.run(Worker.started(tmp_path))
    assert not psutil.pid_exists(int(noted.read_text()))


def test_a_worker_that_cannot_begin_is_one_that_died(monkeypatch, tmp_path):
    monkeypatch.setattr("sys.executable", str(tmp_path / "none"))
    with pytest.raises(WorkerDiedError, match="could not begin"):
        asyncio.run(Worker.started(tmp_path))


def test_the_folder_is_private():
    async def story(queue):
        assert Path(queue.folder).stat().st_mode & 0o077 == 0

    with_queue(story)
