"""Batches: every photo once, as by the command; done ones are skipped, failed ones reported."""

import errno
import json
import os
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import pytest
from batches import TINY_COMMAND, marks, outputs, rows, save_photo, save_photos, tiny

from gauss2svg.batch import many
from gauss2svg.batch.inputs import write
from gauss2svg.batch.many import MARKS, STATE, PhotoRecord, Summary, vectorize_many
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pool import WorkerDiedError
from gauss2svg.svg.file import file_bytes

pytestmark = pytest.mark.usefixtures("pool_here")
NAMES = ["a.png", "b/a.jpg", "b/c d.png", "e.tif"]
GOOD = ["a.svg", "b/a.svg", "b/c d.svg", "e.svg"]


@pytest.fixture
def photos(tmp_path):
    return save_photos(tmp_path / "photos", NAMES)


@pytest.fixture
def run(tmp_path):
    """Run a batch to out/; returns the outputs that were done, skipped, and failed."""

    def run(*sources, **options):
        found = {"done": [], "skipped": [], "failed": []}
        for one in vectorize_many(sources, tmp_path / "out", tiny(**options)):
            kind = "skipped" if one.skipped else "failed" if one.error else "done"
            found[kind].append(one.output)
        return {kind: sorted(names) for kind, names in found.items()}

    return run


def test_outputs_are_those_of_the_command_under_relative_names(run, photos, tmp_path):
    assert run(photos)["done"] == GOOD
    made = outputs(tmp_path / "out")
    assert sorted(made) == GOOD
    assert len(set(made.values())) == len(made)
    for name in NAMES[1:3]:
        single = tmp_path / "single.svg"
        assert main([str(photos / name), "-o", str(single), "--quiet", *TINY_COMMAND]) == 0
        assert made[os.path.splitext(name)[0] + ".svg"] == single.read_bytes()
    assert run(photos / "a.png", gzip=True)["done"] == ["a.svgz"]
    assert (tmp_path / "out/a.svgz").read_bytes()[:2] == b"\x1f\x8b"


def test_each_photo_has_a_row_and_each_svg_a_mark_with_all_that_is_asked_for(run, photos, tmp_path):
    (photos / "bad.png").write_bytes(b"no picture")
    run(photos)
    out = tmp_path / "out"
    table = rows(out)
    assert table.keys() == {*GOOD, "bad.svg"}
    assert "must be a supported image" in table["bad.svg"]["error"]
    assert outputs(out).keys() == marks(out).keys() == set(GOOD)
    for name, one in marks(out).items():
        assert one.keys() == table[name].keys() == {*PhotoRecord._fields}
        assert (out / STATE / f"options-{one['options']}.json").exists()
        data = (out / name).read_bytes()
        assert (one["svg_bytes"], one["svgz_bytes"]) == (len(data), len(file_bytes(data, True)))
        assert (one["width"], one["height"]) == (12, 12)
        assert min(one["psnr_svg"], one["paint_ms"], one["total_s"], one["cpu_s"]) > 0
        assert table[name]["psnr_svg"] == str(one["psnr_svg"])
        assert (one["sketch"], one["psnr_photo"]) == (None, one["psnr_svg"])


def test_what_is_done_needs_no_worker_and_stays_as_it_is(
    run, photos, tmp_path, capsys, monkeypatch
):
    run(photos)
    out = tmp_path / "out"
    files = {path: path.read_bytes() for path in out.rglob("*.*") if "table" not in path.name}
    monkeypatch.setattr(many, "Pool", None)
    command = ["batch", str(photos), "-o", str(out), "--log", "json"]
    assert main([*command, *TINY_COMMAND]) == 0
    printed = capsys.readouterr()
    logged = [json.loads(line) for line in printed.out.splitlines()]
    assert {one["output"]: one["skipped"] for one in logged} == dict.fromkeys(GOOD, True)
    assert printed.err.startswith("gauss2svg: 0 done, 4 skipped, 0 failed in ")
    assert files.items() <= {path: path.read_bytes() for path in out.rglob("*.*")}.items()


def damage_marks(folder):
    for number, path in enumerate(sorted((folder / "out" / MARKS).rglob("*.json"))):
        text = path.read_text()
        path.write_text([text[:50], "[]", '{"more": 1}', "[" * 100_000][number])


CHANGES = [
    (lambda at: save_photo(at / "photos/a.png", 9), {}, ["a.svg"]),
    (lambda at: os.utime(at / "photos/a.png", ns=(1, 1)), {}, ["a.svg"]),
    (lambda at: (at / "out/e.svg").unlink(), {}, ["e.svg"]),
    (lambda at: (at / "out/e.svg").write_text("cut"), {}, ["e.svg"]),
    (lambda at: None, {"threads": 1}, []),
    (damage_marks, {}, GOOD),
    (lambda at: None, {"seed": 5}, GOOD),
]


def test_what_changed_alone_is_done_again_and_what_failed(run, photos, tmp_path):
    (photos / "bad.png").write_bytes(b"no picture")
    run(photos)
    for number, (change, options, again) in enumerate(CHANGES):
        change(tmp_path)
        found = run(photos, **options)
        assert found["done"] == again, number
        assert found["failed"] == ["bad.svg"]
        assert rows(tmp_path / "out").keys() == {*GOOD, "bad.svg"}
    save_photo(photos / "bad.png", 9)
    assert run(photos, seed=5)["done"] == ["bad.svg"]


def test_disk_that_cannot_be_written_ends_the_batch_and_loses_nothing(
    run, photos, tmp_path, monkeypatch
):
    def failing(root, name, data):
        if name.startswith("b/c d.svg"):
            error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            raise OutputError("cannot write it: no space") from error
        write(root, name, data)

    monkeypatch.setattr(many, "write", failing)
    with pytest.raises(OutputError, match="no space"):
        run(photos)
    monkeypatch.setattr(many, "write", write)
    found = run(photos)
    assert set(found["skipped"]) >= {"a.svg", "e.svg"}
    assert "b/c d.svg" in found["done"]


def test_a_fault_a_lost_worker_or_a_name_that_is_taken_costs_its_photo_alone(
    run, photos, tmp_path, monkeypatch
):
    save_photo(photos / "e.svg/x.png", 5)  # e.svg is a folder then, or that is a file
    vectorize_by, vectorize_photo = many.vectorize_by, many.vectorize_photo
    faults = {"c d.png": ZeroDivisionError("a\nfault"), "a.jpg": MemoryError("5 GiB")}

    def failing(options, image, **given):
        if (fault := faults.get(os.path.basename(image))) is not None:
            raise fault
        return vectorize_by(options, image, **given)

    def deadly(spec, photo):
        if photo[1] == "a.svg":
            raise WorkerDiedError("killed by SIGKILL")
        return vectorize_photo(spec, photo)

    monkeypatch.setattr(many, "vectorize_by", failing)
    monkeypatch.setattr(many, "vectorize_photo", deadly)
    found = run(photos)
    assert found["done"] == ["e.svg"]
    assert found["failed"] == ["a.svg", "b/a.svg", "b/c d.svg", "e.svg/x.svg"]
    errors = {name: row["error"] for name, row in rows(tmp_path / "out").items()}
    assert errors["b/c d.svg"] == "ZeroDivisionError: a fault"
    assert errors["b/a.svg"].startswith("out of memory (5 GiB). Try")
    assert errors["a.svg"].startswith("its worker died (killed by SIGKILL). Try --max-size or")


def test_the_threads_of_an_executor_write_the_files_of_the_pool(run, photos, tmp_path):
    run(photos)
    with ThreadPoolExecutor(2) as executor:
        found = vectorize_many([photos], tmp_path / "other", tiny(), executor=executor)
        assert sorted(record.output for record in found if not record.error) == GOOD
    assert outputs(tmp_path / "other") == outputs(tmp_path / "out")


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (ImportError("no gauss2svg"), "ImportError", "ImportError: no gauss2svg"),
        (BrokenProcessPool("ended"), "WorkerDied", "its worker died (BrokenProcessPool: ended). "),
        (type("KilledWorker", (Exception,), {})(), "WorkerDied", "its worker died (KilledWorker)"),
        (CancelledError(), "WorkerDied", "its worker died (CancelledError). Try --max-size or "),
    ],
)
def test_what_an_executor_says_of_a_photo_is_in_its_record(error, code, line, photos, tmp_path):
    job = Future()
    job.set_exception(error)
    executor = SimpleNamespace(submit=lambda *_: job)
    [record] = vectorize_many([photos / "a.png"], tmp_path / "out", tiny(), executor=executor)
    assert (record.output, record.error_code) == ("a.svg", code)
    assert record.error.startswith(line)
    assert ("memory" in record.error) == (code == "WorkerDied")


CLOSED = ThreadPoolExecutor(1)
CLOSED.shutdown()


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"executor": "tcp://x"}, "executor must be an executor of concurrent.futures; got 'tcp"),
        ({"executor": CLOSED, "workers": 3}, "executor must be given without workers; got workers"),
        ({"executor": CLOSED}, "executor must be able to take jobs; got RuntimeError: cannot sch"),
        (
            {"executor": SimpleNamespace(submit=lambda *_: None)},
            "futures; got one with futures of builtins",
        ),
    ],
)
def test_executors_that_cannot_work_are_refused_in_a_line(given, line, photos, tmp_path):
    with pytest.raises(InputError, match=f"{line}.* Try "):
        list(vectorize_many([photos], tmp_path / "out", tiny(), **given))


def test_worker_of_another_version_is_refused_in_a_line(run, photos, tmp_path, monkeypatch):
    monkeypatch.setattr(many, "__version__", "0")
    with pytest.raises(InputError, match=r"workers must have gauss2svg .*; got 0"):
        run(photos)
    assert outputs(tmp_path / "out") == {}


def test_no_cell_of_a_table_begins_a_formula_and_every_name_is_unicode():
    for text in ("=1+1", "+1", "-1", "@a", "\tx", "\rx"):
        assert many.as_cell(text) == f"'{text}"
        assert many.text_of_cell(many.as_cell(text)) == text
    for text in ("a=1", "'a", "ü"):
        assert many.as_cell(text) == many.text_of_cell(text) == text
    assert (many.as_cell("\udcff"), many.as_cell(-1.5)) == ("\\udcff", -1.5)


@pytest.mark.posix  # Windows forbids most of these names
def test_every_name_that_the_system_allows_is_read_and_written(run, tmp_path):
    names = ["12:30:05", "a::b", "#", "a?b", "%41", "*", "--quality", "new\nline", "\udcff", "a\\b"]
    for name in names:
        save_photo(tmp_path / "in/photo.png", 6).rename(tmp_path / f"in/{name}.png")
    made = sorted(f"{name}.svg" for name in names)
    assert run(tmp_path / "in") == {"done": made, "skipped": [], "failed": []}
    assert run(*(tmp_path / "in").iterdir())["skipped"] == made
    assert sorted(outputs(tmp_path / "out")) == made


def test_the_summary_has_the_time_left_at_the_speed_so_far(monkeypatch):
    now = iter((0.0, 10.0, 10.0, 10.0))
    monkeypatch.setattr("gauss2svg.batch.many.time", SimpleNamespace(monotonic=now.__next__))
    summary = Summary(13, "2 files passed over: .pdf, none")
    for given in ({}, {"error": "x"}, {"skipped": True}):
        summary.add(PhotoRecord("a.png", "a.svg", **given))
    assert summary.progress_text() == "5 s a photo, 1 failed, 0:00:50 left"
    counts, passed_over, failure = summary.lines()
    assert counts == "1 done, 1 skipped, 1 failed in 10.0 s"
    assert passed_over == "2 files passed over: .pdf, none"
    assert failure == "failed: a.png: x"
    for _ in range(5):
        summary.add(PhotoRecord("a.png", "a.svg", error="x"))
    assert [*summary.lines()][2:] == 5 * [failure] + ["and 1 more"]


def test_only_an_svg_with_a_mark_or_of_a_killed_run_is_replaced(run, photos, tmp_path):
    run(photos)
    out = tmp_path / "out"
    (out / MARKS / "e.svg.json").unlink()  # as if the run had been killed between both
    (out / "a.svg").write_text("drawn by hand")
    (out / MARKS / "a.svg.json").unlink()
    found = run(photos)
    assert (found["done"], found["failed"]) == (["e.svg"], ["a.svg"])
    assert (out / "a.svg").read_text() == "drawn by hand"
    assert "a.svg" in rows(out)["a.svg"]["error"]


def test_workers_share_the_memory_equally(photos, tmp_path, monkeypatch):
    whole, asked, write_svg = 8 << 30, [], many.vectorize_by
    monkeypatch.setattr(many, "memory_limit", lambda _: whole)

    def watched(options, *source, **given):
        asked.append(options.run.max_memory)
        return write_svg(options, *source, **given)

    monkeypatch.setattr(many, "vectorize_by", watched)
    for workers in (1, 3):
        found = vectorize_many([photos], tmp_path / f"{workers}", tiny(), workers=workers)
        assert not any(one.error for one in found)
    assert asked == [whole] * len(NAMES) + [whole // 3] * len(NAMES)
