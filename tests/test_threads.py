"""Shares of the kernels' work: each is done once, by threads that live where they are used."""

import os
import signal
import threading

import numba
import numpy as np
import pytest
from conftest import random_scene
from flat import vectorize

from gauss2svg.errors import InputError
from gauss2svg.render import render
from gauss2svg.render.threads import in_shares
from gauss2svg.render.walk import add_pairs


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


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("default::DeprecationWarning")
def test_a_forked_process_renders_and_fits_with_threads_of_its_own(threads_given_back, photo):
    numba.set_num_threads(2)
    scene = random_scene(800, 200, 160, 1)  # enough for two shares
    expected, svg = render(scene), vectorize(photo[:40, :40], gaussians=9, iterations=9).svg
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        again = vectorize(photo[:40, :40], gaussians=9, iterations=9).svg
        os._exit(0 if (render(scene) == expected).all() and again == svg else 1)
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("default::DeprecationWarning")
def test_a_forked_process_refuses_what_torch_would_wait_for(photo):
    options = {"gaussians": 4, "iterations": 5, "loss": "l1"}
    vectorize(photo[:40, :40], **options)
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        try:
            vectorize(photo[:40, :40], **options)
        except InputError as error:
            os._exit(0 if "Try multiprocessing's start method spawn" in str(error) else 1)
        os._exit(2)
    assert os.waitpid(child, 0)[1] == 0
