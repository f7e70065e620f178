"""Shares of the kernels' work: each is done once, by threads that live where they are used."""

import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from flat import vectorize

from gauss2svg.render import tiles
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.render.tiles import in_shares

pytestmark = pytest.mark.filterwarnings("default::DeprecationWarning")  # of forks beside threads


@pytest.mark.parametrize("failing", [0, 1])
def test_shares_are_done_at_the_same_time_and_an_exception_is_raised_at_the_end(
    threads_given_back, failing
):
    tiles.threads = 2
    both, done = threading.Barrier(2, timeout=20), []

    def work(share, shares):
        both.wait()
        if share == failing:
            raise ZeroDivisionError
        done.append((share, shares))

    with pytest.raises(ZeroDivisionError):
        in_shares(work, 9)
    assert done == [(1 - failing, 2)]


def forked(holds):
    """Whether a fork of this process finds that holds() is true, within a minute."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            signal.alarm(60)
            status = 0 if holds() else 1
        finally:
            os._exit(status)
    return os.waitpid(child, 0)[1] == 0


@pytest.mark.posix
def test_a_process_that_is_forked_while_another_thread_fits_can_fit(photo):
    options = {"gaussians": 3, "iterations": 2}
    svg = vectorize(photo[:9, :9], **options).svg
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(kernel_lock.acquire).result(timeout=60)
        try:
            assert forked(lambda: vectorize(photo[:9, :9], **options).svg == svg)
        finally:
            pool.submit(kernel_lock.release).result()
