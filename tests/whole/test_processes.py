"""Laws of child processes: what they say is heard, and none outlives what waits for it."""

import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import psutil
import pytest
from conftest import has_ended
from galleries import program

from gauss2svg import processes
from gauss2svg.compare.worker import in_own_process
from gauss2svg.processes import Ended, run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="a shell stands in for a program")


def shell(script, data=None, **options):
    return run(["sh", "-c", script], data, **options)


def noted_in_time(noted, seconds, call):
    """The ids that a process writes to a file before its time is up; `call` runs it for seconds."""
    for timeout_s in seconds:  # more where the machine is too busy for it to begin
        with pytest.raises(TimeoutError, match=f"not done in {timeout_s:g} s"):
            call(timeout_s=timeout_s)
        if noted.exists() and noted.read_text():
            break
    return map(int, noted.read_text().split())


@pytest.mark.parametrize(
    ("script", "ended"),
    [
        ("cat; echo no >&2; echo ' why ' >&2; exit 3", Ended(3, b"said", "why")),
        ("cat >&2", Ended(0, b"", "said")),
        ("exit 4", Ended(4, b"", "")),
        ("kill -9 $$", Ended(-9, b"", "")),
        ("printf '\\n\\n' >&2", Ended(0, b"", "")),
        ("printf '\\377' >&2", Ended(0, b"", "\ufffd")),
        ("yes 0123456789 | head -n 9000 >&2; echo end >&2", Ended(0, b"", "end")),
    ],
)
@pytest.mark.parametrize("timeout_s", [None, 60])
def test_a_process_is_told_by_its_status_its_output_and_the_last_line_of_its_errors(
    script, ended, timeout_s
):
    assert shell(script, b"said", timeout_s=timeout_s) == ended


def test_input_that_nobody_reads_is_no_error():
    for timeout_s in (None, 60):
        assert shell("exit 3", bytes(10**6), timeout_s=timeout_s).status == 3


def test_a_process_runs_where_and_with_what_it_is_given(tmp_path):
    ended = shell("pwd; echo $THIS; echo ${HOME:+home}", folder=tmp_path, environment={"THIS": "1"})
    assert ended.output.decode().splitlines() == [str(tmp_path.resolve()), "1", "home"]
    with pytest.raises(FileNotFoundError):
        run([str(tmp_path / "none")])


def test_without_data_input_is_empty_and_of_a_tied_process_open_until_it_ends():
    assert shell("cat").output == b""
    tied = "read line < /dev/stdin && echo read || echo ended"
    with pytest.raises(TimeoutError):
        shell(tied, tied=True, timeout_s=0.3)
    assert shell("echo said", tied=True).output == b"said\n"


@pytest.mark.parametrize("options", [{}, {"tied": True}, {"ending_s": 0.2}, {"data": b"x"}])
def test_after_its_time_a_process_and_its_children_end(options, tmp_path):
    pids = tmp_path / "pids"
    script = f"trap '' TERM; sleep 600 & echo $$ $! > {pids}; wait; wait"
    found = noted_in_time(pids, (0.5, 4, 32), partial(shell, script, **options))
    assert all(map(has_ended, found))


def test_a_process_that_is_asked_to_end_may_end_what_leads_another_group(tmp_path):
    child = tmp_path / "child"
    script = (
        "import signal, subprocess, sys, time; signal.signal(15, lambda *_: sys.exit(2)); "
        "child = subprocess.Popen(['sleep', '600'], start_new_session=True)\n"
        f"open({str(child)!r}, 'w').write(str(child.pid))\n"
        "try: time.sleep(600)\n"
        "finally: child.kill()\n"
    )
    call = partial(run, [sys.executable, "-c", script], ending_s=30)
    assert all(map(has_ended, noted_in_time(child, (2, 8, 32), call)))


@pytest.mark.parametrize("apart", [True, False])
def test_an_interrupt_ends_the_process_and_is_raised(apart, monkeypatch):
    begun = []

    class Interrupted(subprocess.Popen):
        def __init__(self, *given, **named):
            super().__init__(*given, **named)
            begun.append(self.pid)

        def communicate(self, *_):
            raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        shell("exec sleep 600", apart=apart)
    assert has_ended(begun[0])


def test_a_process_leads_a_group_unless_it_is_to_end_with_this_one():
    script = "import os; print(os.getpgrp())"
    found = [run([sys.executable, "-c", script], apart=apart).output for apart in (True, False)]
    assert int(found[0]) != os.getpgrp() == int(found[1])


@pytest.mark.parametrize("opened", ["> /dev/null", "2> /dev/null", ""])
@pytest.mark.parametrize("timeout_s", [None, 30])
def test_what_a_process_leaves_behind_with_its_pipes_open_is_not_waited_for(opened, timeout_s):
    begun = time.monotonic()
    pid = int(shell(f"sleep 60 {opened} & echo $!", timeout_s=timeout_s).output)
    assert time.monotonic() - begun < 30
    psutil.Process(pid).kill()


@pytest.mark.parametrize("ending_s", [0.0, 5.0])
def test_an_exception_ends_the_group_of_a_process_that_has_ended(ending_s, tmp_path, monkeypatch):
    class Interrupted(subprocess.Popen):
        def communicate(self, *_):
            self.wait()
            raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        shell(f"sleep 60 & echo $! > {tmp_path}/pid", ending_s=ending_s)
    assert has_ended(int((tmp_path / "pid").read_text()))


def test_what_a_process_that_ends_when_it_is_asked_leaves_in_its_group_ends(tmp_path):
    pids = tmp_path / "pid"
    script = f"trap 'exit 2' TERM; (trap '' TERM; exec sleep 60) & echo $! > {pids}; wait"
    found = noted_in_time(pids, (0.5, 4, 32), partial(shell, script, ending_s=30))
    assert all(map(has_ended, found))


def test_a_worker_that_is_dead_before_it_reads_is_told_by_its_status(tmp_path, monkeypatch):
    worker = program(tmp_path / "worker", "echo no memory >&2\nexit 3")
    monkeypatch.setattr(sys, "executable", str(worker))
    assert in_own_process({}, 60) == {"error": "ended with status 3: no memory"}


def test_a_module_is_imported_as_here_and_not_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    for folder in (tmp_path, tmp_path / "there"):
        (folder / "some_module.py").write_text(f"print({folder.name!r})")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "there")
    monkeypatch.syspath_prepend("")
    command = processes.module_command("some_module", "word")
    assert run(command, environment=processes.module_path()).output == b"there\n"
    assert Path(processes.module_path()["PYTHONPATH"].split(os.pathsep)[-1]).is_dir()
    # As `python -m` puts it first; a folder that was asked for stays.
    monkeypatch.syspath_prepend(tmp_path)
    assert run(command, environment=processes.module_path()).output == b"there\n"
    monkeypatch.syspath_prepend(tmp_path / "none")
    assert run(command, environment=processes.module_path()).output == f"{tmp_path.name}\n".encode()
