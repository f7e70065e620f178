"""Laws of the kernels on disk: whatever several processes do at once, none gets another's code."""

import os
import subprocess
import sys
import tempfile
import threading
from itertools import permutations
from pathlib import Path

import numba
import pytest
from numba.core.caching import CacheImpl

import gauss2svg
from gauss2svg import kernel_cache
from gauss2svg.cli import summary
from gauss2svg.kernel_cache import KernelFiles, cached, temporary_folder

_STEPS = ("_load_index", "_save_index", "_save_data")


class _Stepwise(KernelFiles):
    """Takes each of its steps on the disk when it is let."""

    def __init__(self, folder):
        super().__init__(str(folder), "kernel", "stamp")
        self.may, self.has = threading.Semaphore(0), threading.Semaphore(0)

    def __getattribute__(self, name):
        found = super().__getattribute__(name)
        return self._when_let(found) if name in _STEPS else found

    def _when_let(self, step):
        def waited(*given):
            assert self.may.acquire(timeout=10)
            try:
                return step(*given)
            finally:
                self.has.release()

        return waited


@pytest.mark.parametrize("order", sorted(set(permutations((0, 0, 0, 1, 1, 1)))))
def test_what_two_processes_save_at_once_is_never_mixed_up(tmp_path, order):
    both = [_Stepwise(tmp_path), _Stepwise(tmp_path)]
    threads = [
        threading.Thread(target=files.save, args=(key, f"code of {key}"))
        for key, files in enumerate(both)
    ]
    for thread in threads:
        thread.start()
    for turn in order:
        both[turn].may.release()
        assert both[turn].has.acquire(timeout=10)
    for thread in threads:
        thread.join()
    found = [KernelFiles(str(tmp_path), "kernel", "stamp").load(key) for key in (0, 1)]
    assert found[0] in ("code of 0", None)
    assert found[1] in ("code of 1", None)
    assert any(found)  # the list that was written last


def test_code_is_listed_only_once_it_is_whole(tmp_path, monkeypatch):
    files = KernelFiles(str(tmp_path), "kernel", "new stamp")
    KernelFiles(str(tmp_path), "kernel", "old stamp").save("types", "old code")

    def interrupted(*_):
        raise KeyboardInterrupt

    for step in ("_save_data", "_save_index"):
        monkeypatch.setattr(files, step, interrupted)
        with pytest.raises(KeyboardInterrupt):
            files.save("types", "new code")
        assert files.load("types") is None
        monkeypatch.undo()
    files.save("types", "new code")
    assert files.load("types") == "new code"


def test_a_disk_that_cannot_be_written_stops_no_run(tmp_path):
    files = KernelFiles(str(tmp_path / "gone"), "kernel", "stamp")
    files.save("types", "code")
    assert files.load("types") is None


def test_code_is_listed_while_another_process_reads_the_list(tmp_path):
    files = KernelFiles(str(tmp_path), "kernel", "stamp")
    files.save("types", "code")
    with (tmp_path / "kernel.nbi").open("rb") as read:
        closing = threading.Timer(0.1, read.close)
        closing.start()
        files.save("others", "other code")
        closing.join()
    assert (files.load("types"), files.load("others")) == ("code", "other code")


@pytest.fixture
def no_home(monkeypatch, tmp_path):
    """A module in a folder that cannot be written, and a user whose home is not known."""
    module = tmp_path / "read only"
    module.mkdir()
    (module / "kernel.py").write_text("def twice(number):\n    return 2 * number\n")
    found = {}
    exec(compile((module / "kernel.py").read_text(), module / "kernel.py", "exec"), found)
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != module and access(path, mode))
    # The superuser, which tests may run as, can write anywhere.
    makedirs = os.makedirs

    def made(path, *given, **named):
        if str(path).startswith(str(module)):
            raise PermissionError(path)
        return makedirs(path, *given, **named)

    monkeypatch.setattr(os, "makedirs", made)
    for name in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    # numba reads its variables again only when it compiles, which is after it chose the folder.
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(kernel_cache, "_lost", False)
    monkeypatch.chdir(tmp_path)
    makedirs(tmp_path / "temporary", mode=0o700)
    found["twice"].__module__ = "kernel"
    return found["twice"]


def machine_code(folder):
    return sorted(path.name for path in folder.rglob("*.nbc"))


def test_without_a_home_kernels_are_kept_among_the_temporary_files(no_home, tmp_path):
    assert cached()(no_home)(2) == 4
    assert len(machine_code(tmp_path / "temporary")) == 1
    again = cached()(no_home)
    assert again(2) == 4
    assert sum(again.stats.cache_hits.values()) == 1
    assert kernel_cache.are_kept()
    assert not (tmp_path / "~").exists()


def test_kernels_are_kept_in_the_users_cache_before_the_temporary_files(
    no_home, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cached()(no_home)(2) == 4
    assert len(machine_code(tmp_path / "cache")) == 1
    assert not machine_code(tmp_path / "temporary")


@pytest.mark.parametrize("place", ["temporary", None])
def test_kernels_beside_a_module_are_read_where_they_cannot_be_written(
    no_home, tmp_path, monkeypatch, place
):
    with monkeypatch.context() as patch:
        patch.setattr(os, "makedirs", lambda path, exist_ok: Path(path).mkdir(exist_ok=exist_ok))
        patch.setattr(os, "access", lambda *_: True)
        assert cached()(no_home)(2) == 4
    assert len(machine_code(tmp_path / "read only")) == 1
    if place is None:
        monkeypatch.setattr(kernel_cache, "temporary_folder", lambda: None)
    again = cached()(no_home)
    assert again(2) == 4
    assert sum(again.stats.cache_hits.values()) == 1
    assert len(machine_code(tmp_path)) == 1
    assert kernel_cache.are_kept()


def test_where_no_folder_can_be_written_kernels_are_compiled_and_said_to_be_lost(
    no_home, tmp_path, monkeypatch
):
    monkeypatch.setattr(kernel_cache, "temporary_folder", lambda: None)
    monkeypatch.setattr(KernelFiles, "_open_for_write", _refused)
    assert cached()(no_home)(2) == 4
    assert not machine_code(tmp_path)
    assert not kernel_cache.are_kept()
    assert "NUMBA_CACHE_DIR" in summary._compilation(5.0)
    assert summary._compilation(0.0) == ""


def _refused(*_):
    raise PermissionError


def test_kernels_are_compiled_also_where_numba_knows_no_folder(monkeypatch):
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    monkeypatch.setattr(kernel_cache, "_lost", False)
    assert cached()(_twice)(2) == 4
    assert not kernel_cache.are_kept()


def test_the_current_folder_is_no_folder_for_temporary_files(tmp_path, monkeypatch):
    # Python takes it where no other can be written.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert temporary_folder() is None
    assert not list(tmp_path.iterdir())
    tmp_path.chmod(0o1777)  # as /tmp is
    assert temporary_folder() is not None


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="the folder's parent is the user's own there")
def test_no_kernel_is_read_from_a_folder_that_another_user_may_write(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = Path(temporary_folder())
    assert folder.stat().st_mode & 0o777 == 0o700
    for mode in (0o720, 0o702, 0o777, 0o750):
        folder.chmod(mode)
        assert temporary_folder() is None
    folder.chmod(0o700)
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    folder.rename(tmp_path / f"gauss2svg-kernels-{user + 1}")
    assert temporary_folder() is None
    monkeypatch.undo()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to("elsewhere")
    assert temporary_folder() is None


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="permissions are others there")
def test_no_kernel_is_read_where_another_user_may_exchange_its_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for mode in (0o770, 0o707, 0o777, 0o722):
        tmp_path.chmod(mode)
        assert temporary_folder() is None
    assert not list(tmp_path.iterdir())
    for mode in (0o700, 0o755, 0o1777):
        tmp_path.chmod(mode)
        assert temporary_folder() is not None
    # Of another user, who may rename all that is in it; only the system's is trusted.
    real, user = os.stat, os.getuid()
    for owner in (user + 1, user, 0):
        found = os.stat_result([*real(tmp_path)[:4], owner, *real(tmp_path)[5:10]])
        monkeypatch.setattr(
            os, "stat", lambda path, *, found=found, **named: (
                found if path == str(tmp_path) else real(path, **named)
            )
        )  # fmt: skip
        assert (temporary_folder() is not None) == (owner in (user, 0))


def test_on_windows_kernels_are_kept_only_inside_of_the_users_own_folders(tmp_path, monkeypatch):
    # Windows has no users of such numbers; each home is closed to the others.
    monkeypatch.delattr(os, "getuid", raising=False)
    for name in ("home", "home of another"):
        (tmp_path / name / "Temp").mkdir(parents=True)
    for variable in ("LOCALAPPDATA", "USERPROFILE"):
        monkeypatch.delenv("LOCALAPPDATA", raising=False)
        monkeypatch.delenv("USERPROFILE", raising=False)
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "home" / "Temp"))
        assert temporary_folder() is None  # no home is known
        monkeypatch.setenv(variable, str(tmp_path / "home"))
        assert temporary_folder() is not None
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "home of another" / "Temp"))
        assert temporary_folder() is None


def _twice(number):
    return 2 * number


def test_every_kernel_on_disk_is_kept_that_way():
    package = Path(gauss2svg.__file__).parent
    found = [path.name for path in package.rglob("*.py") if "cache=True" in path.read_text()]
    assert found == ["kernel_cache.py"]
    assert isinstance(cached()(_twice)._cache._cache_file, KernelFiles)


def test_code_kept_of_a_kernel_is_not_used_where_another_file_of_its_room_changed(tmp_path):
    """Kernels inline those of other files."""
    room = tmp_path / "room"
    room.mkdir()
    (room / "__init__.py").write_text("")
    (room / "inner.py").write_text("from numba import njit\n@njit\ndef one(): return 1\n")
    (room / "outer.py").write_text(
        "from gauss2svg.kernel_cache import cached\nfrom room.inner import one\n"
        "@cached()\ndef kernel(): return one()\n"
    )
    command = [sys.executable, "-c", "from room.outer import kernel; print(kernel())"]
    given = {"cwd": tmp_path, "capture_output": True, "text": True, "check": True}
    assert subprocess.run(command, **given).stdout == "1\n"
    (room / "inner.py").write_text("from numba import njit\n@njit\ndef one(): return 23\n")
    assert subprocess.run(command, **given).stdout == "23\n"
