"""Laws of the kernels on disk: whatever several processes do at once, none gets another's code."""

import threading
from itertools import permutations
from pathlib import Path

import pytest
from numba.core.caching import CacheImpl

import gauss2svg
from gauss2svg.render.cache import KernelFiles, cached

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


def test_kernels_are_compiled_also_where_no_folder_can_be_written(monkeypatch):
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    assert cached()(_twice)(2) == 4


def _twice(number):
    return 2 * number


def test_every_kernel_on_disk_is_kept_that_way():
    package = Path(gauss2svg.__file__).parent
    found = [path.name for path in package.rglob("*.py") if "cache=True" in path.read_text()]
    assert found == ["cache.py"]
    assert isinstance(cached()(_twice)._cache._cache_file, KernelFiles)
