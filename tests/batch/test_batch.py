"""Batches: every photo once, as by the command; done ones are skipped, failed ones reported."""

import csv
import errno
import json
import os
from collections import Counter
from datetime import datetime, timedelta

import pytest
from batches import TINY_COMMAND, left_parts, lines, outputs, save_photo, save_photos, spec_of, tiny

from gauss2svg.batch import driver, worker
from gauss2svg.batch.many import Batch, vectorize_many
from gauss2svg.batch.options import BatchOptions
from gauss2svg.batch.records import RECORDS, PhotoRecord
from gauss2svg.batch.stores import STATE
from gauss2svg.batch.table import PARQUET, TABLE, Summary, write_table
from gauss2svg.cli.main import main
from gauss2svg.errors import ClusterError, OutputError

NAMES = ["a.png", "b/a.jpg", "b/c d.png", "e.tif"]


@pytest.fixture
def photos(tmp_path):
    return save_photos(tmp_path / "photos", NAMES)


@pytest.fixture
def run(dask_client, tmp_path):
    """Run a batch to out/; returns the outputs that were done, skipped, and failed."""

    def run(*sources, retry_failed=False, **options):
        found = {"done": [], "skipped": [], "failed": []}
        batch = BatchOptions(retry_failed=retry_failed)
        for record in vectorize_many(
            sources, tmp_path / "out", tiny(**options), batch=batch, client=dask_client
        ):
            kind = "failed" if record.error else "skipped" if record.skipped else "done"
            found[kind].append(record.output)
        return {kind: sorted(names) for kind, names in found.items()}

    return run


def test_outputs_are_those_of_the_command_under_relative_names(run, photos, tmp_path):
    assert run(photos)["done"] == ["a.svg", "b/a.svg", "b/c d.svg", "e.svg"]
    made = outputs(tmp_path / "out")
    assert sorted(made) == ["a.svg", "b/a.svg", "b/c d.svg", "e.svg"]
    assert len(set(made.values())) == len(made)
    for name in NAMES:
        single = tmp_path / "single.svg"
        assert main([str(photos / name), "-o", str(single), "--quiet", *TINY_COMMAND]) == 0
        assert made[os.path.splitext(name)[0] + ".svg"] == single.read_bytes()


def test_gzipped_outputs_are_named_so(run, photos, tmp_path):
    run(photos / "a.png", gzip=True)
    (name,) = outputs(tmp_path / "out")
    assert name == "a.svgz"
    assert outputs(tmp_path / "out")[name][:2] == b"\x1f\x8b"


def test_each_photo_has_a_line_and_a_row_with_all_that_is_asked_for(run, photos, tmp_path):
    (photos / "bad.png").write_bytes(b"no picture")
    run(photos)
    out = tmp_path / "out"
    found = {one["output"]: one for one in map(json.loads, lines(out))}
    assert len(found) == len(lines(out)) == 5
    for name, one in found.items():
        assert one["versions"].keys() == {"gauss2svg", "numba", "numpy", "python"}
        assert len(one["sha256"]) == 64
        assert one["seconds"] >= 0
        assert one["cpu_seconds"] >= 0
        assert datetime.fromisoformat(one["time"]).utcoffset() == timedelta(0)
        assert one["options"] == found["a.svg"]["options"]
        assert (out / STATE / f"options-{one['options']}.json").exists()
        if name == "bad.svg":
            assert "must be a supported image" in one["error"]
            assert one["error_code"] == "InputError"
            assert not (out / name).exists()
            continue
        assert one["error"] is one["error_code"] is None
        assert one["bytes"] == (out / name).stat().st_size
        assert (one["width"], one["height"]) == (12, 12)
        assert one["psnr_svg"] > 5
        assert -1 <= one["ssim_svg"] <= 1
        assert one["paint_ms"] > 0
        assert one["stop_reason"] in {"gaussians", "iterations", "enough", "cap", "gain"}
    with (out / TABLE).open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["output"] for row in rows] == sorted(found)
    for name in ("psnr_svg", "ssim_svg", "paint_ms", "stop_reason"):
        assert rows[0][name] == str(found["a.svg"][name])
    assert left_parts(out) == []


def test_table_is_also_parquet(run, photos, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    run(photos)
    table = parquet.read_table(tmp_path / "out" / PARQUET)
    assert table.column("output").to_pylist() == ["a.svg", "b/a.svg", "b/c d.svg", "e.svg"]
    assert table.column("width").to_pylist() == [12] * 4


def test_another_photo_of_the_same_size_and_date_is_no_photo_that_is_done(run, photos, tmp_path):
    other = tmp_path / "other"
    for folder, seed in ((photos, 0), (other, 50)):
        path = save_photo(folder / "a.bmp", seed)  # all of one size
        os.utime(path, ns=(1, 1))
    (photos / "a.png").unlink()
    (other / "e.tif").write_bytes((photos / "e.tif").read_bytes())
    run(photos)
    assert run(other) == {"done": ["a.svg"], "skipped": ["e.svg"], "failed": []}
    records = lines(tmp_path / "out")
    found = {one["output"]: one["input"] for one in map(json.loads, records)}
    assert found["e.svg"] == str(other / "e.tif")  # by its bytes
    assert run(other)["skipped"] == ["a.svg", "e.svg"]
    assert lines(tmp_path / "out") == records


def test_photo_that_is_replaced_by_one_of_its_size_and_date_is_done_again(run, photos):
    path = save_photo(photos / "a.bmp", 0)
    (photos / "a.png").unlink()
    os.utime(path, ns=(1, 1))
    run(path)
    os.utime(save_photo(path, 1), ns=(1, 1))
    assert run(path)["done"] == ["a.svg"]


@pytest.mark.parametrize("info", [{"name": "x", "size": 5, "type": "file"}, {"name": "x"}])
def test_photo_of_which_a_server_says_no_date_is_read(
    info, run, dask_client, tmp_path, monkeypatch
):
    import fsspec
    from fsspec.implementations.memory import MemoryFileSystem

    fs, url = fsspec.filesystem("memory"), f"memory://{tmp_path.name}/a.bmp"
    fs.pipe_file(f"/{tmp_path.name}/a.bmp", save_photo(tmp_path / "a.bmp", 0).read_bytes())
    monkeypatch.setattr(MemoryFileSystem, "isfile", lambda _, path: path.endswith(".bmp"))
    monkeypatch.setattr(MemoryFileSystem, "info", lambda *_, **__: info)
    assert worker.stamp_of(url) == ""
    assert run(url)["done"] == ["a.svg"]
    assert run(url)["skipped"] == ["a.svg"]
    fs.pipe_file(f"/{tmp_path.name}/a.bmp", save_photo(tmp_path / "a.bmp", 1).read_bytes())
    assert run(url)["done"] == ["a.svg"]


def test_photo_that_failed_at_a_limit_is_taken_up_at_another(run, photos):
    assert len(run(photos, max_pixels=100)["failed"]) == 4
    assert len(run(photos, max_pixels=100)["failed"]) == 4
    assert len(run(photos, max_memory="1M")["failed"]) == 4
    assert len(run(photos, max_pixels=1000)["done"]) == 4
    assert len(run(photos, max_pixels=100)["skipped"]) == 4


def test_fit_is_reduced_for_memory_only_where_that_is_given(run, tmp_path, monkeypatch):
    photo = save_photo(tmp_path / "large.png", 1, 300)
    limit = 254_000_000  # between the estimates of a fit of the preset's size and of one pixel
    monkeypatch.setattr(worker, "allowed", lambda _: limit)
    assert run(photo)["failed"] == ["large.svg"]
    (line,) = lines(tmp_path / "out")
    assert json.loads(line)["error"].startswith("memory must be at least ")
    assert run(photo, max_memory=limit)["done"] == ["large.svg"]


def test_fault_of_a_library_costs_its_photo_alone(run, photos, monkeypatch):
    vectorize_by = worker.vectorize_by

    def failing(options, image, **given):
        if str(image).endswith("e.tif"):
            raise ZeroDivisionError("a\nfault")
        if str(image).endswith("a.jpg"):
            raise MemoryError("5 GiB")
        return vectorize_by(options, image, **given)

    monkeypatch.setattr(worker, "vectorize_by", failing)
    found = run(photos)
    assert found == {"done": ["a.svg", "b/c d.svg"], "skipped": [], "failed": ["b/a.svg", "e.svg"]}
    monkeypatch.setattr(worker, "vectorize_by", vectorize_by)
    assert run(photos, retry_failed=True)["done"] == ["b/a.svg", "e.svg"]


def test_shard_that_takes_long_is_handed_back(run, photos, tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "SHARD_S", 0.0)
    monkeypatch.setattr(driver, "_SHARDS_A_WORKER", 1)
    assert len(run(photos)["done"]) == 4
    assert len(lines(tmp_path / "out")) == 4


def test_output_that_cannot_be_written_ends_the_batch_and_loses_nothing(
    run, photos, tmp_path, monkeypatch
):
    write, calls = worker.Store.write, Counter()

    def full(store, name, data):
        calls[name] += 1
        if name == "b/c d.svg":
            raise OutputError("cannot write it: No space left on device. Try another folder")
        write(store, name, data)

    monkeypatch.setattr(worker.Store, "write", full)
    with pytest.raises(OutputError, match="No space left"):
        run(photos)
    assert calls["b/c d.svg"] == 3
    monkeypatch.setattr(worker.Store, "write", write)
    found = run(photos)
    assert set(found["skipped"]) >= {"a.svg", "b/a.svg"}
    assert "b/c d.svg" in found["done"]


def test_name_that_cannot_be_written_costs_its_photo_alone(run, photos, tmp_path):
    save_photo(photos / "e.svg/x.png", 5)
    long = save_photo(tmp_path / "x.png", 6).rename(tmp_path / ("n" * 252))
    found = run(photos, long)
    assert found["failed"] == ["e.svg/x.svg", "n" * 252 + ".svg"]
    assert len(found["done"]) == 4
    errors = [one["error"] for one in map(json.loads, lines(tmp_path / "out")) if one["error"]]
    assert all("cannot " in error for error in errors)
    assert not left_parts(tmp_path / "out")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EIO])
def test_disk_that_cannot_be_written_ends_the_batch(number, photos, tmp_path, monkeypatch):
    def failing(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("gauss2svg.files.os.replace", failing)
    spec = spec_of(tmp_path / "out")
    with pytest.raises(OutputError, match=os.strerror(number)):
        worker.vectorize_photo(
            spec, spec.options, worker.BatchPhoto(str(photos / "a.png"), "a.svg")
        )


@pytest.mark.parametrize("refused", [None, "0.svg", "3.svg"])
def test_output_that_is_refused_for_a_while_is_no_death_and_keeps_all_lines(
    refused, run, tmp_path, monkeypatch
):
    """Photos in more shards than are submitted at once."""
    write, calls = worker.Store.write, Counter()
    photos = save_photos(tmp_path / "many", [f"{number}.png" for number in range(10)])

    def failing(store, name, data):
        calls[name] += 1
        if name == (refused or "6.svg") and (refused or calls[name] < 3):
            raise OutputError("cannot write it: No space left on device. Try another folder")
        write(store, name, data)

    monkeypatch.setattr(worker.Store, "write", failing)
    monkeypatch.setattr(driver, "MOST_PHOTOS", 2)
    monkeypatch.setattr(driver, "_SHARDS_A_WORKER", 1)
    monkeypatch.setattr("gauss2svg.batch.records._SHARE", 1e-9)  # lines are held back
    if refused:
        with pytest.raises(OutputError, match="No space left"):
            run(photos)
    else:
        assert len(run(photos)["done"]) == 10
    assert calls[refused or "6.svg"] == 3
    # Where the batch ended, another shard may still be worked on.
    found = [one for one in map(json.loads, lines(tmp_path / "out")) if "output" in one]
    expected = {None: outputs(tmp_path / "out").keys(), "0.svg": set(), "3.svg": {"2.svg"}}
    assert {one["output"] for one in found} >= expected[refused]
    assert [one["output"] for one in found if one["error"]] == []


def test_record_that_cannot_be_written_does_not_hide_why(
    dask_client, photos, tmp_path, monkeypatch
):
    write, calls = worker.Store.write, Counter()

    def full(store, name, data):
        calls[name] += 1
        if name == "a.svg" or calls[name] > 1:
            raise OutputError(f"cannot write {name}")
        write(store, name, data)

    monkeypatch.setattr(worker.Store, "write", full)
    shard = worker.Shard("run-1", (worker.BatchPhoto(str(photos / "a.png"), "a.svg"),))
    spec = spec_of(tmp_path / "out")
    answer = dask_client.submit(worker.work, spec, shard, pure=False).result()
    assert answer == worker.ShardResult((), refused="cannot write a.svg")


def test_worker_of_another_version_is_reported_before_anything_is_done(
    run, photos, tmp_path, monkeypatch
):
    monkeypatch.setattr("gauss2svg.batch.many.versions", lambda: {"numpy": "1"})
    with pytest.raises(ClusterError, match=r"numpy of worker inproc.* must be 1, .*; got .*Try"):
        run(photos)
    monkeypatch.setattr("gauss2svg.batch.cluster.check_workers", lambda *_: None)
    with pytest.raises(ClusterError, match=r"numpy of worker inproc.* must be 1, .*; got .*Try"):
        run(photos)  # one that joined later
    assert outputs(tmp_path / "out") == {}


def test_shard_whose_worker_died_is_not_begun_again(dask_client, photos, tmp_path):
    spec = spec_of(tmp_path / "out")
    shard = worker.Shard("run-1", (worker.BatchPhoto(str(photos / "a.png"), "a.svg"),))
    driver.ShardRecord(spec.store, "run-1").write(working=True)
    answer = dask_client.submit(worker.work, spec, shard, pure=False).result()
    assert answer == worker.ShardResult((), has_died=True)
    assert outputs(tmp_path / "out") == {}


def test_cut_and_foreign_lines_of_records_are_no_records(run, photos, tmp_path):
    run(photos)
    for path in (tmp_path / "out" / RECORDS).iterdir():
        text = path.read_text()
        path.write_text(text[: len(text) // 2] + '\n[]\n{"output": "a.svg"}\nnull\n')
    assert len(run(photos)["done"]) == 4


def test_stores_of_fsspec_are_read_and_written(run, dask_client, tmp_path):
    import fsspec

    fs = fsspec.filesystem("memory")
    for seed, name in enumerate(("in/a.png", "in/sub/b.png", "in/.hidden/c.png", "in/note.md")):
        data = save_photo(tmp_path / "x.png", seed).read_bytes()
        fs.pipe_file(f"/{tmp_path.name}/{name}", data)
    root = f"memory://{tmp_path.name}"

    def go(sources, output):
        found = vectorize_many(sources, output, tiny(), client=dask_client)
        return {one.output: (one.skipped, one.error) for one in found}

    assert go([f"{root}/in"], f"{root}/out") == dict.fromkeys(("a.svg", "sub/b.svg"), (False, None))
    assert go([f"{root}/in"], f"{root}/out") == dict.fromkeys(("a.svg", "sub/b.svg"), (True, None))
    globbed = go([f"{root}/in/a.png", f"{root}/in/*/*.png"], tmp_path / "out")
    assert globbed.keys() == {"a.svg", "sub/b.svg", ".hidden/c.svg"}
    made = fs.cat_file(f"/{tmp_path.name}/out/a.svg")
    assert made == (tmp_path / "out/a.svg").read_bytes()
    assert fs.exists(f"/{tmp_path.name}/out/{TABLE}")


def test_summary_counts_photos_and_reasons(photos, tmp_path, dask_client):
    for name in ("x1.png", "x22.png"):
        (photos / name).write_bytes(b"no picture")
    summary = Summary()
    with Batch([photos], tmp_path / "out", tiny()) as batch:
        for record in batch.records(dask_client):
            summary.add(record)
        write_table(batch.store, batch.index)
    assert (summary.done, summary.skipped, summary.failed, summary.total) == (4, 0, 2, 6)
    assert summary.pixels == 4 * 144
    first, *reasons = summary.lines()
    assert first.startswith("4 done, 0 skipped, 2 failed in ")
    assert len(reasons) == 2
    assert reasons[0].startswith("failed, 2: photo must be a supported image")
    assert reasons[1] == f"failed photos: {photos / 'x1.png'}, {photos / 'x22.png'}"


def test_a_summary_names_at_most_five_failed_photos():
    summary = Summary()
    for number in range(8):
        name = f"{number}.jpg"
        summary.add(PhotoRecord(input=name, output="", options="", error="broken"))
    assert list(summary.lines())[-1] == (
        "failed photos: 0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg and 3 more"
    )
