"""Laws of the kernels on disk: whatever several processes do at once, none gets another's code."""

import os
import subprocess
import sys
import tempfile
import threading
from itertools import permutations

import numba
import pytest

from gauss2svg import kernel_cache
from gauss2svg.cli import summary
from gauss2svg.kernel_cache import KernelFiles, cached, folder

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
def home(monkeypatch, tmp_path):
    """A user without caches whose home is `home`, and whose temporary files are in `temporary`."""
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")  # which numba read when it was imported
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("USERPROFILE", str(home))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(kernel_cache, "_lost", False)
    kernel_cache._folder_of_user.cache_clear()
    yield home
    kernel_cache._folder_of_user.cache_clear()


@pytest.fixture
def no_home(home):
    """A user whose home can be made by nobody, not even by the superuser of tests."""
    home.rmdir()
    home.write_text("a file")
    return home


def kept_below(path):
    return sorted(path.rglob("*.nbc"))


def test_kernels_are_kept_in_one_folder_of_the_user(home, tmp_path):
    assert cached()(_twice)(2) == 4
    again = cached()(_twice)
    assert again(2) == 4
    assert sum(again.stats.cache_hits.values()) == 1
    assert kernel_cache.are_kept()
    kept = kept_below(tmp_path)
    assert kept == kept_below(folder())
    assert len(kept) == 1
    assert kept[0].is_relative_to(home)


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the variable is of Linux")
def test_the_variable_of_the_system_moves_the_users_folder(home, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert folder() == tmp_path / "caches" / "gauss2svg"


@pytest.mark.skipif(sys.platform == "win32", reason="temporary files are beside the caches there")
def test_without_a_home_kernels_are_kept_among_the_temporary_files(no_home, tmp_path):
    assert cached()(_twice)(2) == 4
    assert len(kept_below(tmp_path / "temporary")) == 1
    assert kernel_cache.are_kept()


def test_kernels_of_a_folder_that_cannot_be_written_are_read(home, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "named"))
    assert cached()(_twice)(2) == 4
    assert len(kept_below(tmp_path / "named")) == 1
    monkeypatch.setattr(KernelFiles, "_open_for_write", _refused)
    again = cached()(_twice)
    assert again(2) == 4
    assert sum(again.stats.cache_hits.values()) == 1
    assert kernel_cache.are_kept()
    assert again(2.5) == 5.0  # of another type, which has to be compiled
    assert not kernel_cache.are_kept()


@pytest.mark.parametrize("place", ["none", "a file in its place"])
def test_where_kernels_cannot_be_kept_they_are_compiled_and_said_to_be_lost(
    place, no_home, tmp_path, monkeypatch
):
    if place == "none":
        monkeypatch.setattr(tempfile, "tempdir", str(no_home))
    else:
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(no_home))
    assert cached()(_twice)(2) == 4
    assert not kept_below(tmp_path)
    assert not kernel_cache.are_kept()
    assert "NUMBA_CACHE_DIR" in summary._compilation(5.0)
    assert summary._compilation(0.0) == ""


def _refused(*_):
    raise PermissionError


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="there is no such folder")
def test_no_kernel_is_read_from_a_folder_that_another_user_may_write(
    no_home, tmp_path, monkeypatch
):
    private = kernel_cache._temporary()
    assert private.parent == tmp_path / "temporary"
    assert private.stat().st_mode & 0o777 == 0o700
    for mode in (0o720, 0o702, 0o777, 0o750):
        private.chmod(mode)
        assert kernel_cache._temporary() is None
    private.chmod(0o700)
    user = os.getuid()
    private.rename(private.with_name(f"gauss2svg-{user + 1}"))
    with monkeypatch.context() as patch:
        patch.setattr(os, "getuid", lambda: user + 1)
        assert kernel_cache._temporary() is None
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    private.symlink_to(tmp_path / "elsewhere")
    assert kernel_cache._temporary() is None


def _twice(number):
    return 2 * number


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
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    given = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True}
    given |= {"check": True}
    assert subprocess.run(command, **given).stdout == "1\n"
    (room / "inner.py").write_text("from numba import njit\n@njit\ndef one(): return 23\n")
    assert subprocess.run(command, **given).stdout == "23\n"
