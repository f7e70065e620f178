"""Workers of a gallery: one that dies fails its own request only, and none is left behind."""

import time

import psutil
import pytest
from conftest import has_ended

from gauss2svg.compare.pages.artifacts import answer_to
from gauss2svg.compare.pages.build import WorkerPool
from gauss2svg.compare.records import answered
from gauss2svg.errors import InputError, OutputError


@pytest.fixture
def misbehave():
    """Answers requests that die, fail, or tell where they are answered."""

    def answer(request):
        import os
        import signal
        import time

        do = request.get("do")
        if do == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if do == "raise":
            raise ZeroDivisionError("a fault of ours")
        if do == "sleep":
            time.sleep(60)
        if do == "nap":
            time.sleep(0.3)
        return {"pid": os.getpid(), "name": request.get("name")}

    return answer  # pickled by value, as it is local


def answers(pool, requests):
    """The answer to each request; each begins once, before it is done."""
    begun, done = [], {}
    for index, answer in pool.run(requests, begun.append):
        assert index in begun
        done[index] = answer
    assert sorted(begun) == sorted(done) == list(range(len(requests)))
    return [done[index] for index in range(len(requests))]


@pytest.mark.process
def test_worker_that_dies_fails_its_own_request_alone_and_none_is_left(misbehave):
    requests = [{"name": "a"}, {"do": "die"}, *({"name": str(n)} for n in range(20))]
    with WorkerPool(2, misbehave) as pool:
        found = answers(pool, requests)
        (again,) = answers(pool, [{"name": "again"}])
    assert found[1] == {"error": "its worker died; was there enough memory? Try fewer --jobs"}
    assert [one["name"] for one in (found[0], *found[2:])] == [
        "a", *map(str, range(20)),
    ]  # fmt: skip
    assert again["name"] == "again"
    pids = {one["pid"] for one in (found[0], *found[2:])}
    assert 1 <= len(pids) <= 3  # two, and one in place of the dead
    assert all(map(has_ended, pids))


@pytest.mark.process
def test_fault_is_raised_and_an_interruption_ends_all_workers_soon(misbehave):
    pids, begun_at = [], []

    def interrupted(pool):
        with pytest.raises(ZeroDivisionError, match="a fault of ours"):
            answers(pool, [{"do": "raise"}])
        (first,) = answers(pool, [{}])
        naps = answers(pool, [{"do": "nap"}] * 2)  # more at once start more
        pids.extend({one["pid"] for one in (first, *naps)})
        assert len(pids) == 2
        begun = []

        def begin(index):
            begun.append(index)
            if len(begun) == 2:
                begun_at.append(time.monotonic())
                raise KeyboardInterrupt

        list(pool.run([{"do": "sleep"}] * 3, begin))

    with pytest.raises(KeyboardInterrupt), WorkerPool(2, misbehave) as pool:
        interrupted(pool)
    assert time.monotonic() - begun_at[0] < 30
    assert all(map(has_ended, pids))


def test_no_request_starts_no_worker():
    before = psutil.Process().children()
    with WorkerPool(50, answered) as pool:
        assert answers(pool, []) == []
        assert psutil.Process().children() == before


@pytest.mark.parametrize(
    ("error", "line", "more"),
    [
        (InputError("two\nlines.  Try one"), "two lines. Try one", {}),
        (MemoryError("5 GiB"), "out of memory (5 GiB). Try smaller photos or fewer Gaussians", {}),
        (ZeroDivisionError("a\nfault"), "ZeroDivisionError: a fault", {}),
        (OutputError("the disk is full"), "the disk is full", {"fatal": True}),  # for all others
    ],
)
def test_every_error_of_a_request_is_one_line(error, line, more):
    def fail(_):
        raise error

    assert answered(fail, {}) == {"error": line, **more}
    assert "KeyError" in answer_to({"kind": "nothing"})["error"]
