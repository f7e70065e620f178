"""Workers of a gallery: who dies takes only its own work along, and nobody is left behind."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from gauss2svg.errors import InputError
from gauss2svg.gallery import pool as crew_module
from gauss2svg.gallery import worker
from gauss2svg.gallery.pool import WorkerPool

# As gauss2svg.gallery.worker, but without its imports, and with works that misbehave.
_WORKER = """
import json, os, signal, sys, time
from pathlib import Path
for line in sys.stdin:
    work = json.loads(line)
    do = work.get("do")
    if do == "die": os.kill(os.getpid(), signal.SIGKILL)
    if do == "exit": print("first\\nlast words", file=sys.stderr); sys.exit(3)
    if do == "cut": os.write(1, b'{"record": {"pid"'); os._exit(0)
    if do == "close": os.close(1); time.sleep(60)
    if do == "deaf": signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if "mine" in work: Path(work["mine"]).write_text(str(os.getpid()))
    if do in ("deaf", "sleep"): time.sleep(60)
    while "other" in work and not Path(work["other"]).exists(): time.sleep(0.01)
    print(json.dumps({"record": {"pid": os.getpid(), "name": work.get("name")}}), flush=True)
"""


@pytest.fixture(autouse=True)
def command(monkeypatch):
    monkeypatch.setattr(crew_module, "_COMMAND", (sys.executable, "-I", "-S", "-c", _WORKER))


def answers(crew, works):
    """The answer of each piece; every one is begun before it is done, and both once."""
    events = list(crew.run(works))
    begun = [index for index, answer in events if answer is None]
    done = {index: answer for index, answer in events if answer is not None}
    assert sorted(begun) == sorted(done) == list(range(len(works)))
    assert len(events) == 2 * len(works)
    for index in done:
        assert events.index((index, None)) < events.index((index, done[index]))
    return [done[index] for index in range(len(works))]


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


def test_answers_come_to_their_works_and_workers_are_few_and_gone_at_the_end():
    with WorkerPool(3) as crew:
        found = answers(crew, [{"name": str(n)} for n in range(20)])
        pids = {answer["record"]["pid"] for answer in found}
        assert [answer["record"]["name"] for answer in found] == [str(n) for n in range(20)]
        assert 1 <= len(pids) <= 3
        assert pids >= {answers(crew, [{}])[0]["record"]["pid"]}  # it is used again
        assert all(map(lives, pids))
    assert not any(map(lives, pids))


def test_no_work_starts_no_worker_and_many_jobs_start_no_more_than_there_is_work(monkeypatch):
    started = []
    popen = subprocess.Popen

    def counted(*arguments, **keywords):
        started.append(arguments)
        return popen(*arguments, **keywords)

    monkeypatch.setattr(crew_module.subprocess, "Popen", counted)
    with WorkerPool(50) as crew:
        assert list(crew.run([])) == []
        assert started == []
        answers(crew, [{}, {}])
    assert len(started) <= 2


def test_two_jobs_work_at_once(tmp_path):
    one, other = str(tmp_path / "one"), str(tmp_path / "other")
    with WorkerPool(2) as crew:  # each waits for the other to have begun
        found = answers(crew, [{"mine": one, "other": other}, {"mine": other, "other": one}])
    assert len({answer["record"]["pid"] for answer in found}) == 2


@pytest.mark.parametrize(
    ("do", "told"),
    [
        ("die", "worker killed by SIGKILL; was there enough memory?: it said nothing"),
        ("exit", "worker ended with status 3: last words"),
        ("cut", "worker ended with status 0: it said nothing"),
        ("close", "worker killed by SIGKILL; was there enough memory?: it said nothing"),
    ],
)
@pytest.mark.parametrize("jobs", [1, 2])
def test_worker_that_ends_costs_its_own_piece_alone(do, told, jobs, monkeypatch):
    monkeypatch.setattr(crew_module, "_TO_END_S", 0.3)
    works = [{"name": "a"}, {"do": do}, {"name": "b"}, {"name": "c"}]
    with WorkerPool(jobs) as crew:
        found = answers(crew, works)
    assert found[1] == {"error": told}
    assert [found[at]["record"]["name"] for at in (0, 2, 3)] == ["a", "b", "c"]


def test_worker_that_is_killed_while_it_has_nothing_to_do_costs_nothing():
    with WorkerPool(1) as crew:
        (first,) = answers(crew, [{}])
        (idle,) = crew._idle
        os.kill(first["record"]["pid"], signal.SIGKILL)
        idle._process.wait()
        (second,) = answers(crew, [{"name": "next"}])
    assert second["record"]["name"] == "next"
    assert second["record"]["pid"] != first["record"]["pid"]


def test_workers_that_cannot_be_started_are_told_and_hang_nothing(monkeypatch):
    def refuse(*_, **__):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(crew_module.subprocess, "Popen", refuse)
    with WorkerPool(2) as crew:
        found = answers(crew, [{}, {}, {}])
    assert {answer["error"] for answer in found} == {
        "cannot start a worker: [Errno 11] Resource temporarily unavailable; try fewer --jobs"
    }


def test_work_that_cannot_be_told_is_raised_and_hangs_nothing():
    with pytest.raises(TypeError, match="not JSON serializable"), WorkerPool(1) as crew:
        list(crew.run([{"what": object()}]))


@pytest.mark.parametrize("do", ["sleep", "deaf"])
def test_interruption_ends_all_workers_soon(do, tmp_path, monkeypatch):
    monkeypatch.setattr(crew_module, "_TO_END_S", 0.3)
    paths = [tmp_path / "a", tmp_path / "b"]
    works = [{"do": do, "mine": str(path)} for path in paths]
    begun = time.monotonic()
    pids = []

    def interrupted():
        with WorkerPool(2) as crew:
            for count, _ in enumerate(crew.run([*works, {}, {}]), 1):
                if count == 2:
                    pids.extend(map(pid_in, paths))
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - begun < 20
    assert len(pids) == 2
    assert not any(map(lives, pids))


def test_interruption_before_a_thread_is_started_is_told_as_such(monkeypatch):
    def interrupt(thread):
        raise KeyboardInterrupt

    monkeypatch.setattr(crew_module.threading.Thread, "start", interrupt)
    with pytest.raises(KeyboardInterrupt), WorkerPool(2) as crew:
        list(crew.run([{}, {}]))


def test_ctrl_c_at_the_terminal_does_not_reach_the_workers():
    with WorkerPool(1) as crew:
        (answer,) = answers(crew, [{}])
        assert os.getsid(answer["record"]["pid"]) != os.getsid(0)


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (InputError("two\nlines;  try one"), "two lines; try one"),
        (MemoryError("5 GiB"), "out of memory (5 GiB); try a smaller --photo-size"),
        (ZeroDivisionError("a\nfault"), "ZeroDivisionError: a fault"),
    ],
)
def test_every_error_of_a_work_is_one_line(error, told, monkeypatch):
    def fail(_):
        raise error

    monkeypatch.setitem(worker._MAKERS, "photo", fail)
    assert worker.answer_to({"kind": "photo"}) == {"error": told}
    assert "KeyError" in worker.answer_to({"kind": "nothing"})["error"]


def test_what_a_library_prints_is_no_answer_and_sigterm_ends_the_worker():
    code = (
        "import os, time\n"
        "from gauss2svg.gallery import worker\n"
        "def make(work):\n"
        "    print('chatter', flush=True); os.write(1, b'more')\n"
        "    if work['n'] == 2: raise SystemExit('gone')\n"
        "    return {'n': work['n']}\n"
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
