"""Batches that are run again: the driver finds what is unchanged, and workers get the rest."""

import csv
import itertools
import json
import os
from pathlib import Path

import pytest
from batches import lines, outputs, save_photo, save_photos, tiny
from clusters import NOBODY, batch_here

from gauss2svg.batch import driver, records, worker
from gauss2svg.batch.many import Batch, vectorize_many
from gauss2svg.batch.options import BatchOptions
from gauss2svg.batch.records import (
    NOT_OF_LIMITS,
    RECORDS,
    PhotoRecord,
    identity_of,
    record_of,
)
from gauss2svg.batch.table import PARQUET, TABLE
from gauss2svg.errors import OutputError

NAMES = ["a.png", "b/a.jpg", "b/c d.png", "e.tif"]


@pytest.fixture
def photos(tmp_path):
    """Four photos and one that fails."""
    folder = save_photos(tmp_path / "photos", NAMES)
    (folder / "bad.png").write_bytes(b"no picture")
    return folder


@pytest.fixture
def run(dask_client, photos, tmp_path, monkeypatch):
    """Run a batch to out/; returns the outputs that were sent to workers, and all records."""
    answers, sent = driver.answers, []

    def seen(client, function, next_request, *rest):
        def noted():
            shard = next_request()
            sent.extend(photo.output for photo in shard.photos) if shard else None
            return shard

        return answers(client, function, noted, *rest)

    def run(retry_failed=False, **options):
        sent.clear()
        batch = BatchOptions(retry_failed=retry_failed)
        given = [photos], tmp_path / "out", tiny(**options)
        found = list(vectorize_many(*given, batch=batch, client=dask_client))
        assert sorted(one.output for one in found) == sorted({one.output for one in found})
        return sorted(sent), {one.output: one for one in found}

    monkeypatch.setattr(driver, "answers", seen)
    return run


def rows(out):
    with (out / TABLE).open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_unchanged_photos_need_no_worker_and_leave_all_as_it_was(
    run, photos, dask_client, tmp_path, capsys, monkeypatch
):
    out = tmp_path / "out"
    sent, first = run()
    assert sent == sorted(first)
    files = {path: path.read_bytes() for path in (out / RECORDS).iterdir()} | outputs(out)
    with Batch([photos], out, tiny()) as batch:
        by_workers = list(batch.records(dask_client))
        batch.finish()
    expected = (out / TABLE).read_bytes()
    sent, second = run()
    assert sent == []
    assert second == {one.output: one for one in by_workers}
    assert all(one.skipped and one.line() == first[name].line() for name, one in second.items())
    assert (out / TABLE).read_bytes() == expected

    monkeypatch.setattr(Batch, "connected", None)
    assert {one.output: one for one in vectorize_many([photos], out, tiny())} == second
    assert batch_here(photos, "-o", out, "--scheduler", NOBODY, "--log", "json") == 1
    printed = capsys.readouterr()
    summary, advice, reason, names, see = printed.err.splitlines()
    logged = [json.loads(line) for line in printed.out.splitlines()]
    assert {line["output"]: (line["error"], line["skipped"]) for line in logged} == {
        one.output: (one.error, True) for one in second.values()
    }
    assert summary.startswith("gauss2svg: 0 done, 4 skipped, 0 failed, 1 failed earlier in ")
    assert "--retry-failed" in advice
    assert reason.startswith("gauss2svg: failed, 1: photo must be a supported image")
    assert names.startswith("gauss2svg: failed photos: ")
    assert str(out / TABLE) in see
    assert (out / TABLE).read_bytes() == expected
    after = {path: path.read_bytes() for path in (out / RECORDS).iterdir()} | outputs(out)
    assert after == files


def damage_records(folder: Path) -> None:
    for path in (folder / "out" / RECORDS).iterdir():
        path.write_text(path.read_text().replace('"width": 12', '"width": -1'))


GOOD = ["a.svg", "b/a.svg", "b/c d.svg", "e.svg"]
ALL = sorted([*GOOD, "bad.svg"])


@pytest.mark.parametrize(
    ("change", "options", "sent", "done"),
    [
        (lambda at: save_photo(at / "photos/a.png", 9), {}, ["a.svg"], ["a.svg"]),
        (lambda at: save_photo(at / "photos/n.png", 9), {}, ["n.svg"], ["n.svg"]),
        (lambda at: os.utime(at / "photos/a.png", ns=(1, 1)), {}, ["a.svg"], []),
        (lambda at: (at / "out/e.svg").unlink(), {}, ["e.svg"], ["e.svg"]),
        (lambda at: (at / "out/e.svg").write_text("cut"), {}, ["e.svg"], ["e.svg"]),
        (lambda at: save_photo(at / "photos/bad.png", 9), {}, ["bad.svg"], ["bad.svg"]),
        (lambda at: None, {"seed": 5}, ALL, GOOD),
        (lambda at: None, {"threads": 1}, [], []),
        (lambda at: None, {"max_pixels": 1000}, ["bad.svg"], []),  # at which it may have failed
        (lambda at: None, {"retry_failed": True}, ["bad.svg"], []),
        (damage_records, {}, GOOD, GOOD),
    ],
    ids=[
        "photo", "new photo", "date", "no output", "cut output", "failed photo", "option",
        "threads", "limit", "retry failed", "records",
    ],
)  # fmt: skip
def test_what_changed_alone_is_sent_to_workers(change, options, sent, done, run, tmp_path):
    run()
    change(tmp_path)
    found, records = run(**options)
    assert found == sent
    assert sorted(name for name, one in records.items() if not (one.skipped or one.error)) == done
    assert [row["output"] for row in rows(tmp_path / "out")] == sorted(records)
    assert [row["skipped"] for row in rows(tmp_path / "out")] == [
        str(records[name].skipped) for name in sorted(records)
    ]
    again = {"retry_failed"} & options.keys()
    assert run(**options)[0] == (["bad.svg"] if again else [])


def test_photo_that_cannot_be_looked_at_is_sent(run, photos):
    os.symlink("gone", photos / "z.png")
    run()
    sent, found = run()
    assert sent == ["z.svg"]
    assert "No such file" in found["z.svg"].error


class ReadError(BaseException):
    """The photo was read."""


def without_reading(given, photo):
    """What a worker answers, None where it would read the photo or fails at looking at it."""
    try:
        found = worker.vectorize_photo(given, given.options, photo)
    except (ReadError, OutputError):
        return None
    return found if found.skipped else None


def test_rule_of_the_driver_is_that_of_workers_in_all_cases(tmp_path, monkeypatch):
    def read(_):
        raise ReadError

    monkeypatch.setattr(worker, "_digest", read)
    path = str(save_photo(tmp_path / "a.png", 0))
    stamp, options = worker.stamp_of(path), tiny()
    same_limits = identity_of(options, NOT_OF_LIMITS)
    store = worker.Store(str(tmp_path))
    for size in (1, 2):
        (tmp_path / f"{size}.svg").write_bytes(bytes(size))
    (tmp_path / "file").write_bytes(b"")
    cases = itertools.product(
        (path, str(tmp_path / "gone.png"), "memory://none.png"),
        ("1.svg", "2.svg", "none.svg", "file/x.svg", "x\0.svg"),
        (path, "other.png"), (stamp, "", "other"), ("same", "other"),
        (None, "it failed"), (same_limits, "other"), (1, None), (False, True),
    )  # fmt: skip
    kept = 0
    for now, output, input_, stamped, identity, error, limits, size, retry in cases:
        prior = PhotoRecord(
            input=input_, output=output, options=identity, stamp=stamped, sha256="0" * 64,
            error=error, limits=limits, bytes=size,
        )  # fmt: skip
        given = worker.BatchSpec(options, store, {}, "same", retry_failed=retry)
        photo = worker.BatchPhoto(now, output, prior)
        found = records.unchanged(given, photo)
        assert found == without_reading(given, photo)
        holds = (
            (now, input_, stamped, identity) == (path, path, stamp, "same")
            and (output == "1.svg" and size == 1 if error is None
                 else limits == same_limits and not retry)
        )  # fmt: skip
        assert (found is not None) == holds
        if found is not None:
            assert found.skipped
            assert found.line() == prior.line()
            kept += 1
    assert kept == 1 * 2 * 2 + 5 * 2
    assert records.unchanged(given, worker.BatchPhoto(path, "1.svg")) is None


def test_the_driver_looks_at_nothing_of_stores(tmp_path, dask_client, monkeypatch):
    import fsspec

    url = f"memory://{tmp_path.name}"
    photo = save_photo(tmp_path / "in/a.png", 0)
    fsspec.filesystem("memory").pipe_file(f"/{tmp_path.name}/in/a.png", photo.read_bytes())
    for inputs, out in ((f"{url}/in", tmp_path / "out"), (photo, f"{url}/out")):
        list(vectorize_many([inputs], out, tiny(), client=dask_client))
        with Batch([inputs], out, tiny()) as batch:
            assert list(batch.unchanged()) == []
            assert batch.index.left == 1
            assert [one.skipped for one in batch.records(dask_client)] == [True]


def test_a_driver_that_ends_while_it_compares_loses_nothing(run, photos, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run()
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    save_photo(photos / "e.tif", 9)
    monkeypatch.setattr("gauss2svg.batch.many._COMPARED", 1)
    ended = vectorize_many([photos], out, tiny())
    next(ended)
    ended.close()
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    sent, found = run()
    assert sent == ["e.svg"]
    assert len(found) == 5


def test_a_record_of_names_that_are_no_unicode_is_one(tmp_path, dask_client):
    odd = os.fsdecode(b"\xff\xfe \xc3\xbc.png")
    photo = save_photo(tmp_path / "in/x.png", 0)
    os.rename(photo, photo.with_name(odd))
    run = [tmp_path / "in"], tmp_path / "out", tiny()
    (first,) = vectorize_many(*run, client=dask_client)
    (line,) = lines(tmp_path / "out")
    assert first.output == odd.replace("png", "svg")
    assert record_of(line) == record_of(json.dumps(first.line(), ensure_ascii=True)) == first
    assert [one.skipped for one in vectorize_many(*run)] == [True]
    ((row,), told) = rows(tmp_path / "out"), "\\udcff\\udcfe ü.svg"
    assert row["output"] == told
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "out" / PARQUET).column("output").to_pylist() == [told]
