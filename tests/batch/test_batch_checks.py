"""Batches: workers that cannot do the work, stores, and what is wrong with disks, in one line."""

import csv
import json
import sqlite3
import sys
import time

import distributed
import fsspec
import pytest
from batches import outputs, save_photos, tiny
from clusters import under_way
from fsspec.implementations.local import LocalFileSystem
from fsspec.implementations.memory import MemoryFileSystem

from gauss2svg.batch import inputs, records, stores, table, worker
from gauss2svg.batch.cluster import answers, local_client
from gauss2svg.batch.inputs import photos_of
from gauss2svg.batch.many import Batch, vectorize_many
from gauss2svg.batch.records import (
    FOLDER,
    PhotoRecord,
    identity_of,
    record_of,
)
from gauss2svg.batch.stores import PARTS, Store
from gauss2svg.errors import ClusterError, InputError, OutputError


@pytest.fixture
def photos(tmp_path):
    return save_photos(tmp_path / "photos", ["a.png", "b/c.png"])


@pytest.fixture
def cluster_of(monkeypatch):
    """Starts clusters in this process."""
    clusters = []

    def start(**given):
        given = {"processes": False, "dashboard_address": ":0", "threads_per_worker": 1, **given}
        clusters.append(distributed.LocalCluster(**given))
        return clusters[-1]

    yield start
    for cluster in clusters:
        cluster.close()


@pytest.mark.parametrize("is_late", [False, True])
def test_output_folder_that_a_worker_does_not_share_is_told(
    is_late, dask_client, photos, tmp_path, monkeypatch
):
    if is_late:  # it joined after the check
        monkeypatch.setattr("gauss2svg.batch.cluster.check_workers", lambda *_: None)
    monkeypatch.setattr(worker, "FOLDER", "gauss2svg-batch/another")
    with pytest.raises(
        ClusterError,
        match=r"output must be a folder that all workers see; got another .*/out at worker .* Try",
    ):
        list(vectorize_many([photos], tmp_path / "out", tiny(), client=dask_client))
    assert outputs(tmp_path / "out") == {}
    monkeypatch.undo()
    assert len(list(vectorize_many([photos], tmp_path / "out", tiny(), client=dask_client))) == 2
    assert len((tmp_path / "out" / FOLDER).read_bytes()) == 32


def test_batch_without_workers_says_that_it_waits_and_works_once_they_come(
    cluster_of, photos, tmp_path, capsys
):
    cluster = cluster_of(n_workers=0)
    with under_way(photos, "-o", tmp_path / "out", "--scheduler", cluster.scheduler_address) as run:
        heard = ""
        while "waiting for them" not in heard:
            heard += capsys.readouterr().err
            assert not run.done()
            time.sleep(0.05)
        cluster.scale(1)
    assert run.result() == 0
    assert len(outputs(tmp_path / "out")) == 2


def test_worker_of_several_threads_is_refused_by_name(cluster_of, photos, tmp_path):
    client = distributed.Client(cluster_of(n_workers=1, threads_per_worker=2))
    needed = r"threads of worker inproc.* must be 1; got 2. Try"
    with client, pytest.raises(ClusterError, match=needed):
        list(vectorize_many([photos], tmp_path / "out", tiny(), client=client))


def test_worker_that_fails_at_no_photo_is_told_in_a_line(
    dask_client, photos, tmp_path, monkeypatch
):
    def missing(*_):
        raise ModuleNotFoundError("No module named\n'gauss2svg'")

    monkeypatch.setattr("gauss2svg.batch.driver.work", missing)
    with pytest.raises(ClusterError, match=r"a worker cannot run gauss2svg: Module.*Try install"):
        list(vectorize_many([photos], tmp_path / "out", tiny(), client=dask_client))


def test_workers_that_cannot_start_are_told_in_a_line(monkeypatch):
    def refused(**_):
        try:
            raise FileNotFoundError(2, "No usable folder")
        except OSError as error:
            raise RuntimeError("Cluster failed to start: Status.init") from error

    monkeypatch.setattr("gauss2svg.batch.cluster.LocalCluster", refused)
    with pytest.raises(ClusterError, match=r"got No usable folder. Try TMPDIR=.* tmpfs at /tmp"):
        local_client(1).__enter__()


def test_nobody_without_the_certificate_connects_to_the_workers_of_this_machine():
    with local_client(0, dashboard=False) as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        own = {"timeout": 2, "set_as_default": False}
        with pytest.raises(OSError, match=r"."):
            distributed.Client(address.replace("tls", "tcp"), **own)
        with pytest.raises(OSError, match=r"TLS certificate does not match"):
            distributed.Client(address, security=distributed.Security.temporary(), **own)


class Slow(LocalFileSystem):
    """A store whose puts are seen half done, and whose folders must be made."""

    protocol = "sftp"
    fails = False

    def __init__(self):  # any other option is its connection's, which does not know it
        super().__init__()

    @classmethod
    def _strip_protocol(cls, path):
        return super()._strip_protocol(str(path).removeprefix("sftp://host"))

    def pipe_file(self, path, value, **_):
        for half in (value[: len(value) // 2], value):
            with open(self._strip_protocol(path), "wb") as file:
                file.write(half)
            assert not path.endswith(("a.svg", ".jsonl")), "it is seen half done"
            if self.fails and value.startswith(b"<?xml"):
                raise TimeoutError


def test_store_whose_puts_are_seen_half_done_is_written_by_renames(
    dask_client, photos, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules["fsspec.registry"]._registry, "sftp", Slow)
    root = tmp_path / "out"

    def run():
        return list(
            vectorize_many(
                [f"sftp://host{photos}"], f"sftp://host{root}", tiny(), client=dask_client
            )
        )

    monkeypatch.setattr(Slow, "fails", True)
    with pytest.raises(OutputError, match=r"cannot write sftp://.*/out/.*: TimeoutError. Try"):
        run()
    assert outputs(root) == {}
    assert [p for p in (root / PARTS).iterdir() if p.name != "writable"] == []
    monkeypatch.setattr(Slow, "fails", False)
    expected = {f"sftp://host{photos}/{name}": None for name in ("a.png", "b/c.png")}
    assert {one.input: one.error for one in run()} == expected
    assert outputs(root).keys() == {"a.svg", "b/c.svg"}
    assert all(one.skipped for one in run())


@pytest.mark.parametrize("url", ["ftp://host/out", "zip://out::/x.zip"])
def test_store_on_which_files_would_be_seen_half_written_is_refused(url, photos, monkeypatch):
    class Other(MemoryFileSystem):
        protocol = url.partition(":")[0]

    monkeypatch.setattr(stores, "filesystem", lambda _: (Other(), "/out"))
    with pytest.raises(InputError, match=r"output must be a folder, or on one of abfs.*; got .*T"):
        Batch([photos], url, tiny())


def test_url_of_a_folder_of_this_machine_is_that_folder(dask_client, photos, tmp_path):
    urls = [f"file://{photos}"], f"file://{tmp_path}/new/out"
    found = list(vectorize_many(*urls, tiny(), client=dask_client))
    assert [one.error for one in found] == [None, None]
    assert outputs(tmp_path / "new/out").keys() == {"a.svg", "b/c.svg"}
    with pytest.raises(InputError, match=r"outside of the inputs"):
        Batch([photos], f"file://{photos}/out", tiny())


@pytest.mark.parametrize("error", [TypeError("no host"), ConnectionRefusedError(111, "refused")])
def test_store_that_does_not_answer_is_told_in_a_line(error, photos, monkeypatch):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("fsspec.core.url_to_fs", fail)
    for call in (
        lambda: list(photos_of(["sftp://host/in"])),
        lambda: worker.stamp_of("sftp://host/in.png"),
        lambda: Batch([photos], "s3://bucket/out", tiny()),
    ):
        with pytest.raises(InputError, match=r"cannot open .*: (no host|refused). Try"):
            call()


def test_what_a_store_cannot_read_is_told_with_advice(tmp_path):
    store = Store(str(tmp_path))
    (tmp_path / "x").mkdir()
    for call in (lambda: store.read("x"), lambda: store.names("x\0"), lambda: store.size("x\0")):
        with pytest.raises(OutputError, match=r"cannot read .*Try the same"):
            call()


RECORD = {
    "input": "/a.png", "output": "a.svg", "options": "0", "width": 3, "psnr_svg": 20.5,
    "unreached": ["x"], "versions": {"numpy": "2"}, "error": None, "seconds": 1,
}  # fmt: skip


@pytest.mark.parametrize(
    "edited",
    [
        {"input": None}, {"output": 5}, {"output": ["a.svg"]}, {"width": "3"}, {"width": True},
        {"width": 2**70}, {"bytes": -1}, {"psnr_svg": "inf"}, {"unreached": None},
        {"unreached": [1]}, {"versions": {"numpy": 2}}, {"versions": []}, {"error": 1},
        {"skipped": "yes"}, {"more": 1},
    ],
)  # fmt: skip
def test_line_of_a_record_whose_entries_are_of_other_types_is_none(edited):
    for whole in (RECORD, RECORD | {"input": "/\udcff.png"}):  # a name that is no valid Unicode
        assert record_of(json.dumps(whole)) is not None
        assert record_of(json.dumps(whole | edited)) is None
    assert record_of("[" * 100_000) is None


def test_index_on_a_full_disk_is_told_in_a_line():
    photos = records.PhotoIndex()
    photos._base.execute("PRAGMA max_page_count = 8")
    with pytest.raises(OutputError, match=r"cannot write the index .*disk is full. Try TMPDIR="):
        photos.add((inputs.Source(f"/{n:0999}", f"{n}", 1) for n in range(99)), ".svg")
    with pytest.raises(sqlite3.ProgrammingError):  # a fault of ours is none of the disk's
        list(photos._rows("SELECT ?"))


@pytest.mark.parametrize("error", [OSError("full"), OSError(28, "full"), ValueError("full")])
def test_table_that_cannot_be_written_is_told_in_a_line(error, tmp_path, monkeypatch):
    def fail(*_):
        raise error

    store = Store(str(tmp_path))
    store.prepare()
    monkeypatch.setattr(table, "_csv", fail)
    with pytest.raises(OutputError, match=r"cannot write .*table\.csv: full\. Try"):
        table.write_table(store, records.PhotoIndex())


def test_folders_that_vanish_while_they_are_listed_have_no_photos(photos, monkeypatch):
    scandir = inputs.os.scandir

    def gone(path):
        if str(path).endswith("b"):
            raise FileNotFoundError(2, "No such file or directory")
        return scandir(path)

    monkeypatch.setattr(inputs.os, "scandir", gone)
    assert [one.name for one in photos_of([str(photos)])] == ["a"]
    with pytest.raises(InputError, match=r"cannot read .*b: No such file"):
        list(photos_of([str(photos / "b")]))


def test_folders_of_a_store_that_vanish_while_they_are_listed_have_no_photos(tmp_path, monkeypatch):
    fs, root, ls = fsspec.filesystem("memory"), f"/{tmp_path.name}", MemoryFileSystem.ls
    for name in ("a.png", "b/c.png"):
        fs.pipe_file(f"{root}/{name}", b"")

    def failing(error):
        def gone(self, path, *given, **options):
            if path.endswith("b"):
                raise error
            return ls(self, path, *given, **options)

        monkeypatch.setattr(MemoryFileSystem, "ls", gone)

    failing(FileNotFoundError("b"))
    assert [one.name for one in photos_of([f"memory:/{root}"])] == ["a"]
    with pytest.raises(InputError, match=r"cannot read memory:"):
        list(photos_of([f"memory:/{root}/b"]))
    failing(PermissionError("not yours"))  # is no folder without photos
    with pytest.raises(InputError, match=r"cannot read memory:.*: not yours. Try"):
        list(photos_of([f"memory:/{root}"]))


def test_list_at_a_url_is_not_held_whole(tmp_path, monkeypatch):
    fs = fsspec.filesystem("memory")
    fs.pipe_file(f"/{tmp_path.name}/list.txt", b"x.png\ny.png\n")
    monkeypatch.delattr(MemoryFileSystem, "cat_file")
    monkeypatch.setattr("fsspec.spec.AbstractFileSystem.cat_file", None)
    url = f"memory://{tmp_path.name}/list.txt"
    assert [one.path for one in photos_of([url])] == ["x.png", "y.png"]
    with pytest.raises(InputError, match=r"cannot read memory://none.txt: .*Try"):
        list(photos_of(["memory://none.txt"]))


def test_an_interrupt_that_was_lost_is_raised_again(dask_client, monkeypatch):
    def lost():
        raise KeyboardInterrupt

    def next_request():
        monkeypatch.setattr("gauss2svg.batch.pending", lost)
        return next(requests, None)

    requests = iter([0.0])  # seconds of a task, after which all would be done
    with pytest.raises(KeyboardInterrupt):
        list(answers(dask_client, time.sleep, next_request, lambda: 1))


def test_no_cell_of_a_table_begins_a_formula(tmp_path):
    made = records.PhotoIndex()
    texts = ["=1+1", "+1", "-1", "@a", "\tx", "\rx", "a=1", "'a"]
    for text in texts:
        made.add_record(
            PhotoRecord(input=text, output=text, options="x", psnr_svg=-1.5, error=text)
        )
    made.add_record(PhotoRecord(input="b", output="b", options="x", unreached=["=1", "a"]))
    store = Store(str(tmp_path))
    store.prepare()
    table.write_table(store, made)
    made.close()
    with (tmp_path / table.TABLE).open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    by_output = {row["output"]: row for row in rows}
    assert set(by_output) == {
        "'=1+1", "'+1", "'-1", "'@a", "'\tx", "'\rx", "a=1", "'a", "b",
    }  # fmt: skip
    assert by_output["'=1+1"]["error"] == by_output["'=1+1"]["input"] == "'=1+1"
    assert by_output["b"]["unreached"] == "'=1; a"
    assert by_output["a=1"]["psnr_svg"] == "-1.5"  # a number stays one


@pytest.mark.parametrize("changed", [
    {"threads": 2}, {"max_memory": "1G"}, {"scores": True}, {"max_pixels": 9}, {"seed": 1},
    {"gaussians": 9}, {"renderer": "cairo"},
])  # fmt: skip
def test_only_what_changes_a_picture_changes_the_identity_of_its_options(changed):
    changes = identity_of(tiny()) != identity_of(tiny().changed(**changed))
    assert changes == bool(changed.keys() & {"seed", "gaussians", "renderer"})
