"""Properties of kernels on disk: whole, the same, and where nobody else can write."""

import os
import subprocess
import sys
import tempfile

import numba
import pytest

from gauss2svg import kernel_cache
from gauss2svg.cli import summary
from gauss2svg.kernel_cache import cached, folder


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


def test_code_that_is_not_whole_is_compiled_again(home):
    assert cached()(_twice)(2) == 4
    (kept,) = kept_below(home)
    for part in (0, 1, kept.stat().st_size // 2, -1):
        os.truncate(kept, part % kept.stat().st_size)
        again, later = cached()(_twice), cached()(_twice)
        assert again(2) == later(2) == 4
        assert not again.stats.cache_hits
        assert later.stats.cache_hits
    assert kernel_cache.are_kept()


@pytest.mark.parametrize("is_set", [False, True])
def test_where_kernels_cannot_be_kept_they_are_compiled_and_said_to_be_lost(
    is_set, no_home, tmp_path, monkeypatch
):
    monkeypatch.setattr(tempfile, "tempdir", str(no_home))
    if is_set:
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(no_home))
    assert cached()(_twice)(2) == 4
    assert not kept_below(tmp_path)
    assert not kernel_cache.are_kept()
    assert "NUMBA_CACHE_DIR" in summary._compilation(5.0)
    assert summary._compilation(0.0) == ""


@pytest.mark.posix
def test_without_a_home_kernels_are_kept_where_no_other_user_may_write(no_home, tmp_path):
    assert cached()(_twice)(2) == 4
    assert kernel_cache.are_kept()
    assert len(kept_below(tmp_path / "temporary")) == 1
    private = folder()
    assert private.stat().st_mode & 0o777 == 0o700
    for mode in (0o720, 0o702, 0o750):
        private.chmod(mode)
        kernel_cache._folder_of_user.cache_clear()
        again = cached()(_twice)
        assert again(2) == 4
        assert not again.stats.cache_hits
    private.chmod(0o700)
    private.rename(tmp_path / "elsewhere")
    private.symlink_to(tmp_path / "elsewhere")
    kernel_cache._folder_of_user.cache_clear()
    assert kernel_cache._temporary_folder() is None


def _twice(number):
    return 2 * number


@pytest.fixture
def room(tmp_path):
    """A package with a kernel that inlines a function of another file; and its runs."""
    room = tmp_path / "room"
    room.mkdir()
    (room / "__init__.py").write_text("")
    (room / "inner.py").write_text("from numba import njit\n@njit\ndef one(): return 1\n")
    (room / "outer.py").write_text(
        "from gauss2svg.kernel_cache import cached\nfrom room.inner import one\n"
        "@cached()\ndef kernel(of): return of + one()\n"
    )

    def answers(*values):
        """What runs at the same time print: a result, and how often kept code was found."""
        code = "import sys; sys.path.insert(0, '.'); from room.outer import kernel; "
        code += "print(kernel(complex(sys.argv[1])), sum(kernel.stats.cache_hits.values()))"
        runs = [
            subprocess.Popen(
                [sys.executable, "-c", code.replace("complex", kind.__name__), repr(kind(1))],
                cwd=tmp_path, stdout=subprocess.PIPE, text=True,
                env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")},
            )
            for kind in values
        ]  # fmt: skip
        return [run.communicate(timeout=120)[0].split() for run in runs]

    return answers


@pytest.mark.process
def test_code_kept_of_a_kernel_is_not_used_where_another_file_of_its_room_changed(room, tmp_path):
    assert room(int) == [["2", "0"]]
    inner = tmp_path / "room" / "inner.py"
    inner.write_text(inner.read_text().replace("return 1", "return 23"))
    assert room(int) == [["24", "0"]]


@pytest.mark.process
def test_what_processes_compile_at_once_is_all_kept(room):
    assert all(room(int, int, float))
    assert room(int, float) == [["2", "1"], ["2.0", "1"]]
