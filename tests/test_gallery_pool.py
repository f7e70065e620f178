"""Workers of a gallery: one that dies fails its own request only, and none is left behind."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from gauss2svg.errors import InputError
from gauss2svg.gallery import pool as pool_module
from gauss2svg.gallery import worker
from gauss2svg.gallery.pool import WorkerPool

# As gauss2svg.gallery.worker, but without its imports, and with requests that misbehave.
_WORKER = """
import json, os, signal, sys, time
from pathlib import Path
for line in sys.stdin:
    request = json.loads(line)
    do = request.get("do")
    if do == "die": os.kill(os.getpid(), signal.SIGKILL)
    if do == "exit": print("first\\nlast words", file=sys.stderr); sys.exit(3)
    if do == "cut": os.write(1, b'{"record": {"pid"'); os._exit(0)
    if do == "close": os.close(1); time.sleep(60)
    if do == "deaf": signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if "mine" in request: Path(request["mine"]).write_text(str(os.getpid()))
    if do in ("deaf", "sleep"): time.sleep(60)
    while "other" in request and not Path(request["other"]).exists(): time.sleep(0.01)
    print(json.dumps({"record": {"pid": os.getpid(), "name": request.get("name")}}), flush=True)
"""


@pytest.fixture(autouse=True)
def command(monkeypatch):
    monkeypatch.setattr(pool_module, "_COMMAND", (sys.executable, "-I", "-S", "-c", _WORKER))


def answers(pool, requests):
    """The answer to each request; each begins before it is done, and does both once."""
    events = list(pool.run(requests))
    begun = [index for index, answer in events if answer is None]
    done = {index: answer for index, answer in events if answer is not None}
    assert sorted(begun) == sorted(done) == list(range(len(requests)))
    assert len(events) == 2 * len(requests)
    for index in done:
        assert events.index((index, None)) < events.index((index, done[index]))
    return [done[index] for index in range(len(requests))]


def lives(pid):
    with suppress(OSError):
        os.kill(pid, 0)
        return True
    return False


def pid_in(path):
    for _ in range(1000):
        if path.exists() and path.read_text():
            return int(path.read_text())
        time.sleep(0.01)
    raise AssertionError(f"{path} was never written")


def test_answers_belong_to_their_requests_and_workers_are_few_and_gone_at_the_end():
    with WorkerPool(3) as pool:
        found = answers(pool, [{"name": str(n)} for n in range(20)])
        pids = {answer["record"]["pid"] for answer in found}
        assert [answer["record"]["name"] for answer in found] == [str(n) for n in range(20)]
        assert 1 <= len(pids) <= 3
        assert pids >= {answers(pool, [{}])[0]["record"]["pid"]}  # it is used again
        assert all(map(lives, pids))
    assert not any(map(lives, pids))


def test_no_request_starts_no_worker_and_there_are_never_more_workers_than_requests(monkeypatch):
    started = []
    popen = subprocess.Popen

    def counted(*arguments, **keywords):
        started.append(arguments)
        return popen(*arguments, **keywords)

    monkeypatch.setattr(pool_module.subprocess, "Popen", counted)
    with WorkerPool(50) as pool:
        assert list(pool.run([])) == []
        assert started == []
        answers(pool, [{}, {}])
    assert len(started) <= 2


def test_two_jobs_work_at_once(tmp_path):
    one, other = str(tmp_path / "one"), str(tmp_path / "other")
    with WorkerPool(2) as pool:  # each waits for the other to have begun
        found = answers(pool, [{"mine": one, "other": other}, {"mine": other, "other": one}])
    assert len({answer["record"]["pid"] for answer in found}) == 2


@pytest.mark.parametrize(
    ("do", "error"),
    [
        ("die", "worker killed by SIGKILL; was there enough memory?: no message"),
        ("exit", "worker ended with status 3: last words"),
        ("cut", "worker ended with status 0: no message"),
        ("close", "worker killed by SIGKILL; was there enough memory?: no message"),
    ],
)
@pytest.mark.parametrize("jobs", [1, 2])
def test_worker_that_ends_fails_its_own_request_alone(do, error, jobs, monkeypatch):
    monkeypatch.setattr(pool_module, "_GRACE_S", 0.3)
    requests = [{"name": "a"}, {"do": do}, {"name": "b"}, {"name": "c"}]
    with WorkerPool(jobs) as pool:
        found = answers(pool, requests)
    assert found[1] == {"error": error}
    assert [found[at]["record"]["name"] for at in (0, 2, 3)] == ["a", "b", "c"]


def test_idle_worker_that_is_killed_costs_nothing():
    with WorkerPool(1) as pool:
        (first,) = answers(pool, [{}])
        (idle,) = pool._idle
        os.kill(first["record"]["pid"], signal.SIGKILL)
        idle._process.wait()
        (second,) = answers(pool, [{"name": "next"}])
    assert second["record"]["name"] == "next"
    assert second["record"]["pid"] != first["record"]["pid"]


def test_workers_that_cannot_be_started_are_errors_and_hang_nothing(monkeypatch):
    def refuse(*_, **__):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(pool_module.subprocess, "Popen", refuse)
    with WorkerPool(2) as pool:
        found = answers(pool, [{}, {}, {}])
    assert {answer["error"] for answer in found} == {
        "cannot start a worker: [Errno 11] Resource temporarily unavailable. Try fewer --jobs"
    }


def test_request_that_is_not_json_is_raised_and_hangs_nothing():
    with pytest.raises(TypeError, match="not JSON serializable"), WorkerPool(1) as pool:
        list(pool.run([{"what": object()}]))


@pytest.mark.parametrize("do", ["sleep", "deaf"])
def test_interruption_ends_all_workers_soon(do, tmp_path, monkeypatch):
    monkeypatch.setattr(pool_module, "_GRACE_S", 0.3)
    paths = [tmp_path / "a", tmp_path / "b"]
    requests = [{"do": do, "mine": str(path)} for path in paths]
    begun = time.monotonic()
    pids = []

    def interrupted():
        with WorkerPool(2) as pool:
            for count, _ in enumerate(pool.run([*requests, {}, {}]), 1):
                if count == 2:
                    pids.extend(map(pid_in, paths))
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - begun < 20
    assert len(pids) == 2
    assert not any(map(lives, pids))


def test_interruption_before_a_thread_is_started_is_raised(monkeypatch):
    def interrupt(thread):
        raise KeyboardInterrupt

    monkeypatch.setattr(pool_module.threading.Thread, "start", interrupt)
    with pytest.raises(KeyboardInterrupt), WorkerPool(2) as pool:
        list(pool.run([{}, {}]))


def test_ctrl_c_at_the_terminal_does_not_reach_the_workers():
    with WorkerPool(1) as pool:
        (answer,) = answers(pool, [{}])
        assert os.getsid(answer["record"]["pid"]) != os.getsid(0)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("two\nlines.  Try one"), "two lines. Try one"),
        (MemoryError("5 GiB"), "out of memory (5 GiB). Try a smaller --photo-size"),
        (ZeroDivisionError("a\nfault"), "ZeroDivisionError: a fault"),
    ],
)
def test_every_error_of_a_request_is_one_line(error, line, monkeypatch):
    def fail(_):
        raise error

    monkeypatch.setitem(worker._MAKERS, "photo", fail)
    assert worker.answer_to({"kind": "photo"}) == {"error": line}
    assert "KeyError" in worker.answer_to({"kind": "nothing"})["error"]


def test_what_a_library_prints_is_no_answer_and_sigterm_ends_the_worker():
    code = (
        "import os, time\n"
        "from gauss2svg.gallery import worker\n"
        "def make(request):\n"
        "    print('chatter', flush=True); os.write(1, b'more')\n"
        "    if request['n'] == 2: raise SystemExit('gone')\n"
        "    return {'n': request['n']}\n"
        "worker._MAKERS['photo'] = make\n"
        "worker.main()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        for n in (0, 1):
            process.stdin.write(json.dumps({"kind": "photo", "n": n}) + "\n")
            process.stdin.flush()
            assert json.loads(process.stdout.readline()) == {"record": {"n": n}}
        process.terminate()
        assert process.stdout.read() == ""
        assert process.wait() == 128 + signal.SIGTERM
