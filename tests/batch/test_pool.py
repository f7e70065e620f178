"""The pool of processes: what ends a job fails that job alone, and no process is left behind."""

import os
import signal
import time
from concurrent.futures import CancelledError, wait
from copy import copy
from functools import partial

import psutil
import pytest
from conftest import has_ended

from gauss2svg.pool import Pool, WorkerDiedError, completed

pytestmark = pytest.mark.process


def processes():
    # Windows refuses the words of a process that just begins: None.
    words = {c.pid: c.as_dict(["cmdline"])["cmdline"] or () for c in psutil.Process().children()}
    return {pid for pid in words if "gauss2svg.pool" in words[pid]}


def numbers(jobs):
    return [job.result(300) for job in jobs]


@pytest.mark.parametrize("at_s", [0.0, 0.05, 0.4])
def test_killed_process_fails_its_job_alone_among_a_hundred(at_s):
    with Pool(2) as pool:
        pool.submit(abs, 0).result(300)
        jobs = [pool.submit(time.sleep, 0.01) for _ in range(100)]
        time.sleep(at_s)
        killed = processes().pop()
        psutil.Process(killed).kill()
        wait(jobs, 300)
        errors = [error for job in jobs if (error := job.exception(300)) is not None]
        assert len(errors) <= 1  # none if it was between two jobs
        assert all(isinstance(error, WorkerDiedError) for error in errors)
        end = "SIGKILL" if os.name == "posix" else f"status {signal.SIGTERM:d}"
        assert all(end in str(error) for error in errors)
        assert numbers(pool.submit(abs, -number) for number in range(5)) == list(range(5))
        left = processes()
        assert len(left) <= 2
        assert killed not in left
    assert all(map(has_ended, left))


def test_each_end_of_a_job_fails_it_alone():
    with Pool(2, memory=400_000_000) as pool:
        failures = {
            pool.submit(os.abort): WorkerDiedError,
            pool.submit(os._exit, 3): WorkerDiedError,
            pool.submit(time.sleep, 60, timeout=0.3): TimeoutError,
            pool.submit(hold, 2_000_000_000): WorkerDiedError,
            pool.submit(int, "x"): ValueError,
            pool.submit(os.listdir, "/none"): FileNotFoundError,
        }
        others = [pool.submit(abs, -number) for number in range(20)]
        cancelled = pool.submit(time.sleep, 60), pool.submit(time.sleep, 60)
        assert numbers(others) == list(range(20))
        while not any(job.running() for job in cancelled):
            time.sleep(0.01)
        assert all(job.cancel() for job in cancelled)
        for job in cancelled:
            with pytest.raises(CancelledError):
                job.result(300)
        for job, kind in failures.items():
            assert isinstance(job.exception(300), kind)
        assert pool.submit(print, "not an answer").result(300) is None


def hold(count):
    held = bytearray(b"x") * count
    time.sleep(60)
    return len(held)


def test_with_statement_ends_all_jobs_and_processes_soon():
    begun = time.monotonic()
    with Pool(2) as pool:
        jobs = [pool.submit(time.sleep, 60) for _ in range(5)]
        while len(processes()) < 2:
            time.sleep(0.01)
        left = processes()
    assert all(map(has_ended, left))
    assert all(job.done() for job in jobs)
    assert time.monotonic() - begun < 50


def test_completed_hands_out_no_more_than_the_width_and_cancels_what_is_left():
    with Pool(4) as pool:
        requests = iter([0.01] * 20 + [60] * 4)
        ended = completed(partial(pool.submit, time.sleep), requests, lambda: 3)
        for number in range(1, 19):
            next(ended)
            assert len(list(copy(requests))) >= 24 - number - 3
        ended.close()
