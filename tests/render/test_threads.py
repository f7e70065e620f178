"""Shares of the kernels' work: each is done once, by threads that live where they are used."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest
from flat import vectorize

from gauss2svg.render.cpu import kernel_lock

pytestmark = pytest.mark.filterwarnings("default::DeprecationWarning")  # of forks beside threads


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
