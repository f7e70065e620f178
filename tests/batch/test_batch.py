"""Batches: every photo once, as by the command; done ones are skipped, failed ones reported."""

import csv
import errno
import json
import os
import re
import sqlite3

import pytest
from batches import (
    TINY_COMMAND,
    PoolHere,
    left_parts,
    marks,
    outputs,
    save_photo,
    save_photos,
    tiny,
)  # fmt: skip

from gauss2svg.batch import many, worker
from gauss2svg.batch.many import Batch, vectorize_many
from gauss2svg.batch.stores import PARTS, STATE, write
from gauss2svg.batch.table import PARQUET, TABLE, Summary, write_table
from gauss2svg.batch.worker import MARK, PhotoRecord
from gauss2svg.cli.main import main
from gauss2svg.errors import ClusterError, OutputError
from gauss2svg.pipeline import memory_budget
from gauss2svg.pool import WorkerDiedError

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
            found["skipped" if one.skipped else "failed" if one.error else "done"].append(
                one.output
            )
        return {kind: sorted(names) for kind, names in found.items()}

    return run


def rows(out):
    with (out / TABLE).open(newline="", encoding="utf-8") as stream:
        return {row["output"]: row for row in csv.DictReader(stream)}


def test_outputs_are_those_of_the_command_under_relative_names(run, photos, tmp_path):
    assert run(photos)["done"] == GOOD
    made = outputs(tmp_path / "out")
    assert sorted(made) == GOOD
    assert len(set(made.values())) == len(made)
    for name in NAMES:
        single = tmp_path / "single.svg"
        assert main([str(photos / name), "-o", str(single), "--quiet", *TINY_COMMAND]) == 0
        assert made[os.path.splitext(name)[0] + ".svg"] == single.read_bytes()
    assert run(photos / "a.png", gzip=True)["done"] == ["a.svgz"]
    assert (tmp_path / "out/a.svgz").read_bytes()[:2] == b"\x1f\x8b"


def test_output_folder_may_be_in_an_input_one_whose_photos_it_adds_none_to(run, photos, tmp_path):
    run(photos)
    for _ in range(2):
        found = [one.output for one in vectorize_many([photos], photos, tiny())]
        assert sorted(found) == GOOD
    made = outputs(photos)
    assert {name: made[name] for name in GOOD} == outputs(tmp_path / "out")


def test_each_photo_has_a_row_and_each_svg_a_mark_with_all_that_is_asked_for(run, photos, tmp_path):
    (photos / "bad.png").write_bytes(b"no picture")
    run(photos)
    out = tmp_path / "out"
    table = rows(out)
    bad = table["bad.svg"]
    assert table.keys() == {*GOOD, "bad.svg"}
    assert "must be a supported image" in bad["error"]
    assert bad["error_code"] == "InputError"
    assert outputs(out).keys() == marks(out).keys() == set(GOOD)
    for name, one in marks(out).items():
        assert one.keys() == {*table[name], "run"} == {*PhotoRecord._fields, "run"}
        assert (out / STATE / f"options-{one['options']}.json").exists()
        assert one["error"] is one["error_code"] is None
        assert one["bytes"] == (out / name).stat().st_size
        assert (one["width"], one["height"]) == (12, 12)
        assert one["psnr_svg"] > 5
        assert -1 <= one["ssim_svg"] <= 1
        assert min(one["paint_ms"], one["seconds"], one["cpu_seconds"]) > 0
        assert one["stop_reason"] in {"gaussians", "iterations", "enough", "cap", "gain"}
        assert table[name]["psnr_svg"] == str(one["psnr_svg"])
    assert left_parts(out) == []
    parquet = pytest.importorskip("pyarrow.parquet").read_table(out / PARQUET)
    assert parquet.column("output").to_pylist() == list(table)
    assert sorted(filter(None, parquet.column("width").to_pylist())) == [12] * 4


def test_what_is_done_needs_no_worker_and_stays_as_it_is(
    run, photos, tmp_path, capsys, monkeypatch
):
    run(photos)
    out = tmp_path / "out"
    files = {path: path.read_bytes() for path in out.rglob("*.*") if "table" not in path.name}
    monkeypatch.setattr(many, "Pool", None)
    nobody = "tcp://127.0.0.1:9"
    command = ["batch", str(photos), "-o", str(out), "--scheduler", nobody, "--log", "json"]
    assert main([*command, *TINY_COMMAND]) == 0
    printed = capsys.readouterr()
    logged = [json.loads(line) for line in printed.out.splitlines()]
    assert {one["output"]: one["skipped"] for one in logged} == dict.fromkeys(GOOD, True)
    summary, see = printed.err.splitlines()
    assert summary.startswith("gauss2svg: 0 done, 4 skipped, 0 failed in ")
    assert str(out / TABLE) in see
    assert {row["skipped"] for row in rows(out).values()} == {"True"}
    assert files.items() <= {path: path.read_bytes() for path in out.rglob("*.*")}.items()


def damage_marks(folder):
    for number, path in enumerate(sorted((folder / "out").rglob(f"*{MARK}"))):
        text = path.read_text()
        path.write_text([text[:50], "[]", '{"more": 1}', "[" * 100_000][number])


@pytest.mark.parametrize(
    ("change", "options", "again"),
    [
        (lambda at: None, {}, []),
        (lambda at: save_photo(at / "photos/a.png", 9), {}, ["a.svg"]),
        (lambda at: save_photo(at / "photos/n.png", 9), {}, ["n.svg"]),
        (lambda at: os.utime(at / "photos/a.png", ns=(1, 1)), {}, ["a.svg"]),
        (lambda at: (at / "out/e.svg").unlink(), {}, ["e.svg"]),
        (lambda at: (at / "out/e.svg").write_text("cut"), {}, ["e.svg"]),
        (lambda at: (at / f"out/e.svg{MARK}").unlink(), {}, ["e.svg"]),
        (lambda at: None, {"seed": 5}, GOOD),
        (lambda at: None, {"threads": 1}, []),
        (lambda at: None, {"max_pixels": 1000}, []),
        (damage_marks, {}, GOOD),
    ],
)  # fmt: skip
def test_what_changed_alone_is_done_again_and_what_failed(
    change, options, again, run, photos, tmp_path
):
    (photos / "bad.png").write_bytes(b"no picture")
    run(photos)
    change(tmp_path)
    found = run(photos, **options)
    assert found["done"] == again
    assert found["failed"] == ["bad.svg"]
    assert rows(tmp_path / "out").keys() == {*GOOD, *again, "bad.svg"}
    save_photo(photos / "bad.png", 9)
    assert run(photos, **options)["done"] == ["bad.svg"]


def test_fit_is_reduced_for_memory_only_where_that_is_given(run, tmp_path, monkeypatch):
    photo = save_photo(tmp_path / "large.png", 1, 300)
    limit = 254_000_000  # between the estimates of a fit of the preset's size and of one pixel
    monkeypatch.setattr(memory_budget, "free_bytes", lambda: int(limit / many.SHARE))
    monkeypatch.setattr(memory_budget, "held_bytes", lambda: 0)
    assert run(photo)["failed"] == ["large.svg"]
    assert rows(tmp_path / "out")["large.svg"]["error"].startswith("memory must be at least ")
    assert run(photo, max_memory=limit)["done"] == ["large.svg"]


def test_fault_of_a_library_costs_its_photo_alone(run, photos, tmp_path, monkeypatch):
    vectorize_by = worker.vectorize_by
    faults = {"e.tif": ZeroDivisionError("a\nfault"), "a.jpg": MemoryError("5 GiB")}

    def failing(options, image, **given):
        if (fault := faults.get(os.path.basename(image))) is not None:
            raise fault
        return vectorize_by(options, image, **given)

    monkeypatch.setattr(worker, "vectorize_by", failing)
    assert run(photos) == {
        "done": ["a.svg", "b/c d.svg"],
        "skipped": [],
        "failed": ["b/a.svg", "e.svg"],
    }
    errors = {name: row["error"] for name, row in rows(tmp_path / "out").items()}
    assert errors["e.svg"] == "ZeroDivisionError: a fault"
    assert errors["b/a.svg"].startswith("out of memory (5 GiB). Try")
    faults.clear()
    assert run(photos)["done"] == ["b/a.svg", "e.svg"]


@pytest.mark.parametrize("of_mark", [False, True])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EIO])
def test_disk_that_cannot_be_written_ends_the_batch_and_loses_nothing(
    of_mark, number, run, photos, tmp_path, monkeypatch
):
    def failing(root, name, data, sync=True):
        if name == "b/c d.svg" + MARK * of_mark:
            why = os.strerror(number)
            raise OutputError(f"cannot write it: {why}") from OSError(number, why)
        write(root, name, data)

    monkeypatch.setattr(worker, "write", failing)
    with pytest.raises(OutputError, match=os.strerror(number)):
        run(photos)
    assert "b/c d.svg" not in marks(tmp_path / "out")
    monkeypatch.undo()
    monkeypatch.setattr(many, "Pool", PoolHere)
    found = run(photos)
    assert set(found["skipped"]) >= {"a.svg", "e.svg"}
    assert "b/c d.svg" in found["done"]


def test_name_that_cannot_be_written_costs_its_photo_alone(run, photos, tmp_path):
    save_photo(photos / "e.svg/x.png", 5)
    long = [
        save_photo(tmp_path / "x.png", 6).rename(tmp_path / ("n" * length)) for length in (252, 250)
    ]
    found = run(photos, *long)
    failed = ["e.svg/x.svg", "n" * 250 + ".svg", "n" * 252 + ".svg"]
    assert found["failed"] == failed
    assert found["done"] == GOOD
    table = rows(tmp_path / "out")
    assert [name for name in failed if "cannot " not in table[name]["error"]] == []
    assert not left_parts(tmp_path / "out")


@pytest.mark.parametrize("single", [3, 50_000])
def test_photo_that_kills_its_workers_is_found_and_costs_no_other(
    single, run, tmp_path, monkeypatch
):
    photos = save_photos(tmp_path / "many", [f"{number}.png" for number in range(10)])
    vectorized, deaths = worker.vectorized, []

    def deadly(spec, photo):
        if photo[1] in ("3.svg", "7.svg"):
            deaths.append(photo[1])
            raise WorkerDiedError("killed by SIGKILL")
        return vectorized(spec, photo)

    monkeypatch.setattr(worker, "vectorized", deadly)
    monkeypatch.setattr(many, "_SINGLE", single)
    found = run(photos)
    assert found["failed"] == ["3.svg", "7.svg"]
    others = [f"{number}.svg" for number in range(10) if number not in (3, 7)]
    assert sorted(found["done"] + found["skipped"]) == others
    assert sorted(set(deaths)) == found["failed"]
    assert max(map(deaths.count, deaths)) == 2
    killed = rows(tmp_path / "out")["3.svg"]
    assert killed["error_code"] == "WorkerDied"
    assert killed["error"].startswith("its workers died; was there enough memory? Try")
    monkeypatch.setattr(worker, "vectorized", vectorized)
    assert run(photos) == {"done": ["3.svg", "7.svg"], "skipped": others, "failed": []}


def test_worker_of_another_version_is_refused_in_a_line(run, photos, tmp_path, monkeypatch):
    monkeypatch.setattr(many, "versions", lambda: {"numpy": "1"})
    with pytest.raises(ClusterError, match=r"workers must have {'numpy': '1'}; got .*\. Try"):
        run(photos)
    assert outputs(tmp_path / "out") == {}


def test_machine_that_does_not_see_the_output_folder_writes_nothing(
    run, photos, tmp_path, monkeypatch
):
    def elsewhere(root, name, data, sync=True):
        write(str(tmp_path / "elsewhere"), name, data)

    monkeypatch.setattr(worker, "write", elsewhere)
    with pytest.raises(OutputError, match="No such file or directory"):
        run(photos)
    assert outputs(tmp_path / "elsewhere") == {}


def test_stores_of_fsspec_are_read_and_written(tmp_path):
    fs = pytest.importorskip("fsspec").filesystem("memory")
    for seed, name in enumerate(("in/a.png", "in/sub/b.png", "in/.hidden/c.png", "in/note.md")):
        fs.pipe_file(f"/{tmp_path.name}/{name}", save_photo(tmp_path / "x.png", seed).read_bytes())
    fs.pipe_file(f"/{tmp_path.name}/list.txt", f"memory://{tmp_path.name}/in/a.png\n".encode())
    root = f"memory://{tmp_path.name}"

    def go(sources, output):
        found = vectorize_many(sources, output, tiny())
        return {one.output: (one.skipped, one.error) for one in found}

    assert go([f"{root}/in"], f"{root}/out") == dict.fromkeys(("a.svg", "sub/b.svg"), (False, None))
    assert go([f"{root}/in"], f"{root}/out") == dict.fromkeys(("a.svg", "sub/b.svg"), (True, None))
    fs.pipe_file(f"/{tmp_path.name}/in/a.png", save_photo(tmp_path / "x.png", 9).read_bytes())
    assert go([f"{root}/in/"], f"{root}/out")["a.svg"] == (False, None)
    globbed = go([f"{root}/in/a.png", f"{root}/in/*/*.png"], tmp_path / "out")
    assert globbed.keys() == {"a.svg", "sub/b.svg", ".hidden/c.svg"}
    assert go([f"{root}/list.txt"], tmp_path / "out").keys() == {f"{tmp_path.name}/in/a.svg"}
    made = fs.cat_file(f"/{tmp_path.name}/out/a.svg")
    assert made == (tmp_path / "out/a.svg").read_bytes()
    assert fs.exists(f"/{tmp_path.name}/out/{TABLE}")


@pytest.mark.posix
def test_names_that_are_no_unicode_or_have_control_characters_are_told(run, tmp_path, capsys):
    odd = os.fsdecode(b"\xff\xfe \xc3\xbc\n\x1b.png")
    photo = save_photo(tmp_path / "in/x.png", 0)
    os.rename(photo, photo.with_name(odd))
    assert run(tmp_path / "in")["done"] == [odd.replace("png", "svg")]
    assert run(tmp_path / "in")["skipped"] == [odd.replace("png", "svg")]
    assert rows(tmp_path / "out").keys() == {"\\udcff\\udcfe ü\n\x1b.svg"}
    parquet = pytest.importorskip("pyarrow.parquet").read_table(tmp_path / "out" / PARQUET)
    assert parquet.column("output").to_pylist() == ["\\udcff\\udcfe ü\n\x1b.svg"]
    (tmp_path / "in" / odd).write_bytes(b"no picture")
    main(["batch", str(tmp_path / "in"), "-o", str(tmp_path / "out"), *TINY_COMMAND])
    lines = capsys.readouterr().err.splitlines()
    assert all(line.isprintable() for line in lines)
    assert any("\\x1b.png" in line for line in lines)


def test_unfinished_files_of_killed_runs_are_removed(run, photos, tmp_path):
    run(photos / "a.png")
    parts = tmp_path / "out" / PARTS
    for name in ("old", "new"):
        (parts / name).write_bytes(b"half")
    (parts / "folder").mkdir()
    for name in ("old", "folder"):
        os.utime(parts / name, (1, 1))
    run(photos)
    assert left_parts(tmp_path / "out") == ["new"]


def test_no_cell_of_a_table_begins_a_formula(tmp_path):
    texts = ["=1+1", "+1", "-1", "@a", "\tx", "\rx", "a=1", "'a"]
    found = [PhotoRecord(text, text, psnr_svg=-1.5, error=text) for text in texts]
    (tmp_path / PARTS).mkdir(parents=True)
    write_table(str(tmp_path), [*found, PhotoRecord("b", "b", unreached=["=1", "a"])])
    table = rows(tmp_path)
    assert table.keys() == {"'=1+1", "'+1", "'-1", "'@a", "'\tx", "'\rx", "a=1", "'a", "b"}
    assert table["'=1+1"]["error"] == table["'=1+1"]["input"] == "'=1+1"
    assert table["b"]["unreached"] == "'=1; a"
    assert table["a=1"]["psnr_svg"] == "-1.5"  # a number stays one


def test_summary_counts_photos_and_names_few_of_those_that_failed():
    summary = Summary()
    for number in range(8):
        summary.add(PhotoRecord(f"/{number}.jpg", "", error="broken"))
    summary.add(PhotoRecord("a", "a"))
    summary.add(PhotoRecord("b", "b", skipped=True))
    counts, *failures = summary.lines()
    assert re.match(r"1 done, 1 skipped, 8 failed in .* s: .* photos a second", counts)
    assert failures == [f"failed: /{number}.jpg: broken" for number in range(5)]
    assert summary.total == 10
    assert re.search(r"photos/s, 8 failed, 0:0\d:\d\d left", summary.state(20))


def test_two_runs_at_once_make_each_file_whole_and_the_same_table(photos, tmp_path):
    out = tmp_path / "out"
    one, other = (Batch([photos], out, tiny()) for _ in range(2))
    first, second = one.run(), other.run()
    found = [next(first), next(second), *first, *second]
    assert sorted(record.output for record in found) == sorted(GOOD * 2)
    assert one.tables == other.tables
    assert rows(out).keys() == set(GOOD)
    assert left_parts(out) == []


def test_the_table_of_an_interrupted_run_has_what_is_known(photos, tmp_path):
    batch = Batch([photos], tmp_path / "out", tiny())
    records = batch.run()
    known = {next(records).output, next(records).output}
    records.close()
    batch.finish()
    assert rows(tmp_path / "out").keys() == known


def test_only_an_svg_with_a_mark_or_of_a_killed_run_is_replaced(run, photos, tmp_path):
    run(photos)
    out = tmp_path / "out"
    (out / f"e.svg{MARK}").unlink()  # as if the run had been killed between both
    (out / "a.svg").write_text("drawn by hand")
    (out / f"a.svg{MARK}").unlink()
    found = run(photos)
    assert (found["done"], found["failed"]) == (["e.svg"], ["a.svg"])
    assert (out / "a.svg").read_text() == "drawn by hand"
    assert "a.svg" in rows(out)["a.svg"]["error"]


def test_full_temporary_folder_is_told_in_a_line(photos, tmp_path, monkeypatch):
    database = sqlite3.connect("", check_same_thread=False)
    database.execute("PRAGMA max_page_count = 1")
    monkeypatch.setattr(sqlite3, "connect", lambda *_, **__: database)
    with pytest.raises(OutputError, match=r"cannot write a temporary file: .* full\. Try TMPDIR="):
        Batch([photos], tmp_path / "out", tiny())


@pytest.mark.posix
def test_photo_is_not_overwritten_by_its_output(run, photos, tmp_path, monkeypatch):
    (tmp_path / "out" / STATE).mkdir(parents=True)
    os.symlink(tmp_path / "out/a.svg", photos / "f.png")
    listed = tmp_path / "list.txt"
    photo = save_photo(tmp_path / "x.png", 1).rename(tmp_path / "out/x.svg")
    listed.write_text("x.svg\n")
    monkeypatch.chdir(tmp_path / "out")
    data = photo.read_bytes()
    assert run(listed)["failed"] == ["x.svg"]
    assert photo.read_bytes() == data
