"""Shares of the kernels' work: each is done once, by threads that live where they are used."""

import os
import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest
from conftest import random_scene
from flat import vectorize
from numba import njit
from numba.core.compiler_lock import global_compiler_lock

from gauss2svg.render import render
from gauss2svg.render.cpu import add_pairs, kernel_lock
from gauss2svg.render.threads import in_shares

pytestmark = pytest.mark.filterwarnings("default::DeprecationWarning")  # of forks beside threads


@pytest.mark.parametrize(
    ("threads", "most", "expected"), [(1, 9, 1), (2, 9, 2), (2, 1, 1), (2, 0, 1)]
)
def test_each_share_is_done_once(threads_given_back, threads, most, expected):
    numba.set_num_threads(threads)
    done = []
    in_shares(lambda share, shares: done.append((share, shares)), most)
    assert sorted(done) == [(share, expected) for share in range(expected)]


def test_shares_run_at_the_same_time(threads_given_back):
    numba.set_num_threads(2)
    both = threading.Barrier(2, timeout=20)
    in_shares(lambda share, shares: both.wait(), 2)


@pytest.mark.parametrize("failing", [0, 1])
def test_an_exception_is_raised_when_all_shares_have_ended(threads_given_back, failing):
    numba.set_num_threads(2)
    ended = []

    def work(share, shares):
        if share == failing:
            raise ZeroDivisionError
        ended.append(share)

    with pytest.raises(ZeroDivisionError):
        in_shares(work, 2)
    assert ended == [1 - failing]


@pytest.mark.parametrize("shares", [1, 3, 50])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_pairs_are_added_to_their_gaussian(dtype, shares):
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 5, 40)
    values = rng.normal(size=(counts.sum(), 10)).astype(dtype)
    totals, expected = np.zeros((40, 10)), np.zeros((40, 10))
    np.add.at(expected, np.repeat(np.arange(40), counts), values)
    offset = np.concatenate([[0], np.cumsum(counts)])
    for share in range(shares):
        add_pairs(share, shares, offset, values, totals)
    np.testing.assert_array_equal(totals, expected)


@pytest.mark.posix
@pytest.mark.parametrize("loss", ["mse", "l1+ssim"])
def test_a_forked_process_renders_and_fits_with_threads_of_its_own(loss, threads_given_back, photo):
    numba.set_num_threads(2)
    scene = random_scene(800, 200, 160, 1)  # enough for two shares
    options = {"gaussians": 9, "iterations": 9, "loss": loss}
    expected, svg = render(scene), vectorize(photo[:40, :40], **options).svg
    assert forked(
        lambda: (
            vectorize(photo[:40, :40], **options).svg == svg and (render(scene) == expected).all()
        )
    )


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


class HeldElsewhere:
    """A thread that holds a lock, as while it fits or compiles."""

    def __init__(self, lock):
        self.held, self.let = threading.Event(), threading.Event()
        self.thread = threading.Thread(target=self.hold, args=(lock,))

    def hold(self, lock):
        with lock:
            self.held.set()
            assert self.let.wait(timeout=60)

    def __enter__(self):
        self.thread.start()
        assert self.held.wait(timeout=60)
        return self

    def __exit__(self, *_):
        self.let.set()
        self.thread.join()


@pytest.mark.posix
def test_a_process_that_is_forked_while_another_thread_fits_can_fit(photo):
    options = {"gaussians": 3, "iterations": 2}
    svg = vectorize(photo[:9, :9], **options).svg
    with HeldElsewhere(kernel_lock):
        assert forked(lambda: vectorize(photo[:9, :9], **options).svg == svg)


@pytest.mark.posix
def test_a_process_that_is_forked_inside_of_a_fit_keeps_its_lock_and_can_give_it_back():
    def taken_by_another_thread():
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(kernel_lock.acquire, blocking=False).result()

    def own_lock_is_still_held():
        refused = not taken_by_another_thread()
        kernel_lock.release()
        return refused and taken_by_another_thread()

    with kernel_lock:
        assert forked(own_lock_is_still_held)


@pytest.mark.posix
def test_a_process_that_is_forked_while_another_thread_compiles_can_compile():
    with HeldElsewhere(global_compiler_lock) as other:
        threading.Timer(0.2, other.let.set).start()
        assert forked(lambda: njit(lambda x: x + 1)(1) == 2)
