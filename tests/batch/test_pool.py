"""The pool of processes: what ends a job fails that job alone, and no process is left behind."""

import os
import time
from concurrent.futures import CancelledError
from copy import copy
from functools import partial

import pytest
from conftest import has_ended
from psutil import Process

from gauss2svg.pool import Pool, WorkerDiedError, completed

pytestmark = pytest.mark.process


def test_each_end_of_a_job_fails_it_alone_and_nothing_is_left():
    before = {child.pid for child in Process().children()}
    with Pool(2) as pool:
        failures = {
            pool.submit(os.abort): WorkerDiedError,
            pool.submit(os._exit, 3): WorkerDiedError,
            pool.submit(time.sleep, 60, timeout=0.3): TimeoutError,
            pool.submit(int, "x"): ValueError,
            pool.submit(os.listdir, "/none"): FileNotFoundError,
        }
        others = [pool.submit(abs, -number) for number in range(20)]
        cancelled = pool.submit(time.sleep, 60), pool.submit(time.sleep, 60)
        assert [job.result(300) for job in others] == list(range(20))
        while not any(job.running() for job in cancelled):
            time.sleep(0.01)
        assert all(job.cancel() for job in cancelled)
        for job in cancelled:
            with pytest.raises(CancelledError):
                job.result(300)
        for job, kind in failures.items():
            assert isinstance(job.exception(300), kind)
        assert pool.submit(print, "not an answer").result(300) is None
        left = [pool.submit(time.sleep, 600) for _ in range(3)]
        while not all(job.running() for job in left[:2]):
            time.sleep(0.01)
        processes = {child.pid for child in Process().children()} - before
    assert all(job.cancelled() or isinstance(job.exception(0), CancelledError) for job in left)
    assert len(processes) == 2
    assert all(map(has_ended, processes))


def test_completed_hands_out_no_more_than_the_width_and_cancels_what_is_left():
    with Pool(4) as pool:
        requests = iter([0.01] * 20 + [60] * 4)
        ended = completed(partial(pool.submit, time.sleep), requests, 3)
        for number in range(1, 19):
            next(ended)
            assert len(list(copy(requests))) >= 24 - number - 3
        ended.close()
