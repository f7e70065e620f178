"""Laws of child processes: what they say is heard, and none outlives what waits for it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import has_ended

from gauss2svg import processes
from gauss2svg.processes import run

pytestmark = pytest.mark.posix


def test_after_its_time_a_process_and_its_children_end_in_whatever_group_they_are(tmp_path):
    script = (
        "import os, signal, subprocess, sys; from pathlib import Path; "
        "signal.signal(signal.SIGTERM, signal.SIG_IGN); "
        "made = [subprocess.Popen(['sleep', '600'], start_new_session=own) for own in (0, 1)]; "
        "pids = [os.getpid(), *(child.pid for child in made)]; "
        "Path(sys.argv[1]).write_text(' '.join(map(str, pids))); made[0].wait()"
    )
    noted = tmp_path / "pids"
    for timeout_s in (0.4, 8, 32):  # more where the machine is too busy for it to begin
        with pytest.raises(TimeoutError, match=f"not done in {timeout_s} s"):
            run([sys.executable, "-c", script, str(noted)], b"x", timeout_s=timeout_s)
        if noted.exists() and noted.read_text():
            break
    assert all(map(has_ended, map(int, noted.read_text().split())))


def test_an_interrupt_ends_the_process_and_is_raised(monkeypatch):
    begun, script, communicate = [], "exec sleep 600", subprocess.Popen.communicate

    def interrupted(process, *rest):
        # Threads of other tests may still wait for their processes.
        if process.args[-1] != script:
            return communicate(process, *rest)
        begun.append(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess.Popen, "communicate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(["sh", "-c", script])
    assert [process.returncode for process in begun] == [-signal.SIGKILL]


def test_a_module_is_imported_as_here_and_not_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    for folder in (tmp_path, tmp_path / "there"):
        (folder / "some_module.py").write_text(f"print({folder.name!r})")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "there")
    monkeypatch.syspath_prepend("")
    command = processes.module_command("some_module")
    assert run(command, environment=processes.python_environment()).output == b"there\n"
    assert Path(processes.python_environment()["PYTHONPATH"].split(os.pathsep)[-1]).is_dir()
