"""What a batch reads and how outputs are named; what it refuses, in one line, before it runs."""

import io
import itertools
import os
import sys
from functools import partial
from pathlib import PurePosixPath

import pytest
from batches import save_photo, save_photos

from gauss2svg.batch import inputs, many
from gauss2svg.batch.inputs import local_photos, photos_of
from gauss2svg.batch.options import BatchOptions
from gauss2svg.batch.records import PhotoIndex
from gauss2svg.batch.stores import Store, stamp_of
from gauss2svg.cli.main import main
from gauss2svg.errors import ClusterError, InputError, OutputError


def names(*sources):
    return sorted(source.name for source in photos_of(map(str, sources)))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.jpg", "b/c.PNG", "b/d/e.jpeg", ".hidden.png", ".d/f.png", "note.md", "g.svg"):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"12345")
    return tmp_path / "in"


def test_folder_gives_its_pictures_but_no_hidden_ones(folder):
    assert names("in") == names("in/") == names(folder) == ["a", "b/c", "b/d/e"]
    assert {source.size for source in photos_of(["in"])} == {5}


def test_source_without_photos_is_refused_beside_others(folder):
    (folder / "none").mkdir()
    (folder / "none.txt").write_text("# nothing\n")
    for source in ("nothing/*", "in/none", "in/none.txt", "memory://nothing/*"):
        with pytest.raises(InputError, match="must be one or more; got none in "):
            names("in", source)


def test_other_commands_take_what_a_batch_takes(folder, tmp_path, refusal):
    sources = [str(folder), f"{folder}/**/*.jpg", f"{folder}/a*"]
    for source in sources:
        paths = local_photos([source])
        assert paths == sorted(photo.path for photo in photos_of([source]))
        assert paths
    listed = tmp_path / "list.txt"
    listed.write_text("b.jpg\na.jpg\n")
    assert local_photos([str(listed)]) == ["b.jpg", "a.jpg"]
    # Reading says what is the matter with these.
    stay = [f"{folder}/none*.jpg", str(folder / "none.jpg"), "s3://bucket/*.jpg"]
    assert local_photos(stay) == stay
    # A gallery's own pictures would be photos of its next run.
    assert refusal("gallery", folder, "-o", folder / "site")
    assert not (folder / "site").exists()


def test_broken_links_and_files_that_are_gone_are_photos(folder, monkeypatch):
    os.symlink("gone", folder / "b/z.png")
    assert names("in") == ["a", "b/c", "b/d/e", "b/z"]
    assert names("in/b/*.png", "in/b/z.png") == ["z", "z"]
    stat = os.stat

    def gone(path, **given):
        if str(path).endswith("a.jpg"):
            raise FileNotFoundError(2, "No such file or directory")
        return stat(path, **given)

    monkeypatch.setattr(inputs.os, "stat", gone)
    assert names("in") == ["a", "b/c", "b/d/e", "b/z"]


def test_links_to_folders_are_not_followed(folder):
    os.symlink(folder, folder / "b/circle")
    assert names("in") == ["a", "b/c", "b/d/e"]


def test_glob_is_relative_to_its_part_without_wildcards(folder):
    assert names("in/*.jpg", "in/b/*") == ["a", "c"]
    assert names("in/**/*.jp*g") == ["a", "b/d/e"]


def test_suffix_of_a_name_is_what_pathlib_says():
    names = map("".join, itertools.product("a./", repeat=5))
    for name in (n.rstrip("/") for n in names if n[0] != "/"):
        if not name.endswith("."):  # of which versions of Python differ
            assert inputs._stem(name) == os.fspath(PurePosixPath(name).with_suffix(""))


def test_photo_keeps_its_last_part_whatever_its_suffix(folder):
    assert names("in/b/d/e.jpeg", "in/note.md") == ["e", "note"]
    odd = folder / "[a]*.jpg"
    odd.write_bytes(b"")
    assert names(odd) == ["[a]*"]


def test_list_keeps_whole_names_without_root_and_steps_upwards(folder, monkeypatch):
    lines = "\ufeffin/a.jpg\n# not/this.png\r\n\n/x y/b.png\n../up/./c.png\ns3://bucket/d/e.png\nno.picture\n"
    expected = ["bucket/d/e", "in/a", "no", "up/c", "x y/b"]
    (folder / "list.txt").write_text(lines)
    assert names("in/list.txt") == expected
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(lines.encode())))
    assert names("-") == expected


def test_a_list_is_read_line_by_line():
    def endless():
        while True:
            yield b"a.png\n"

    assert next(inputs._listed(endless())).name == "a"


def test_stamp_of_a_store_is_all_that_it_says(monkeypatch):
    from fsspec.implementations.memory import MemoryFileSystem

    def stamp(**info):
        monkeypatch.setattr(MemoryFileSystem, "info", lambda *_, **__: info)
        return stamp_of("memory://x")

    stamps = [
        stamp(size=5, ETag="a"), stamp(size=5, ETag="b"), stamp(size=6, ETag="a"),
        stamp(size=5, LastModified="a"), stamp(size=5, md5Hash="a"), stamp(size=5, other=1),
    ]  # fmt: skip
    assert len(set(stamps)) == 6
    assert stamps[-1] == ""


def test_index_holds_any_name_and_each_photo_once():
    index = PhotoIndex()
    odd = os.fsdecode(b"/x/\xff\xfe\n.png")
    index.add([inputs.Source(odd, os.fsdecode(b"\xff\xfe\n"), 7)] * 2, ".svg")
    ((photo, size),) = index.photos()
    assert (photo.path, os.fsencode(photo.output)) == (odd, b"\xff\xfe\n.svg")
    assert (photo.prior, size) == (None, 7)
    assert index.count == 1


def test_names_that_differ_by_case_are_one_where_the_disk_folds_it():
    sources = [inputs.Source("/a/X.png", "X", 1), inputs.Source("/a/x.png", "x", 1)]
    PhotoIndex().add(sources, ".svg")
    with pytest.raises(InputError, match="would both write x"):
        PhotoIndex(folds_case=True).add(sources, ".svg")


@pytest.mark.parametrize(
    "name", ["../x", "a/../../x", "..", "", "/x", "a//x", "./x", "gauss2svg-batch/records/x"]
)
def test_outputs_outside_of_the_folder_or_among_its_records_are_refused(name, tmp_path):
    with pytest.raises(InputError, match="output must be in the output folder and outside of its"):
        PhotoIndex().add([inputs.Source("/a/x.png", name, 1)], ".svg")
    PhotoIndex().add([inputs.Source("/a/x.png", "gauss2svg-batch", 1)], ".svg")
    if "gauss2svg" not in name:
        with pytest.raises(OutputError, match="it is not in"):
            Store(str(tmp_path / "out")).write(name, b"")
        assert list(tmp_path.iterdir()) == []


def test_globs_and_keys_that_step_upwards_are_refused(folder, tmp_path):
    import fsspec

    (folder.parent / "x.png").write_bytes(b"")
    (name,) = names("in/*/../../x.png")[:1]
    assert name == "../x"
    fs = fsspec.filesystem("memory")
    fs.store[f"/{tmp_path.name}/in/../../../evil.png"] = fs.open("/x", "wb")
    with pytest.raises(InputError, match="output must be in the output folder"):
        PhotoIndex().add(photos_of([f"memory://{tmp_path.name}/in/**"]), ".svg")


def test_case_is_asked_about_before_the_output_folder_exists(tmp_path, monkeypatch):
    save_photos(tmp_path / "in", ["X.png", "x.png"])
    asked = []
    monkeypatch.setattr(many, "folds_case", lambda folder: not asked.append(folder))
    with pytest.raises(InputError, match="would both write"):
        many.Batch([tmp_path / "in"], tmp_path / "out/new")
    assert asked == [str(tmp_path)]


@pytest.fixture
def refused(tmp_path, monkeypatch, refusal):
    """The line of a command that is refused before any worker is started."""
    monkeypatch.chdir(tmp_path)
    save_photos(tmp_path / "in", ["a.png", "b/c.png"])
    monkeypatch.setattr(many.Batch, "connected", None)
    return partial(refusal, "batch")


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (["empty", "-o", "out"], "photos must be one or more; got none in empty. Try"),
        (["in/*.gif", "-o", "out"], "photos must be one or more; got none in in/*.gif. Try"),
        (["gone.png", "-o", "out"], "cannot read gone.png: No such file or directory. Try"),
        (["gone.txt", "-o", "out"], "cannot read gone.txt: No such file or directory. Try"),
        (["in", "in/b/c.png", "-o", "in/out"], "output must be outside of the inputs; got "),
        (["in", "-o", "in"], "output must be outside of the inputs; got "),
        (["in/**/*.png", "-o", "in/b/x"], "output must be outside of the inputs; got "),
        (["in", "in2", "-o", "out"], "in/a.png and in2/a.png, which would both write a.svg. Try"),
        (["in", "-o", "in/a.png"], "output must be outside of the inputs; got "),
        (["in", "-o", "file"], "cannot create "),
        (["in", "-o", "-"], "output must be a folder; got '-'"),
        (["in", "-o", "what://x/y"], "cannot open what://x/y"),
        (["in", "-o", "out", "--workers", "0"], "workers must be a whole number in 1.."),
        (["in", "-o", "out", "--portable"], "blend must be add with portable"),
        (["in", "-o", "out", "--options", "gone.toml"], "cannot read gone.toml: No such file"),
        (["in", "-o", "out", "--options", "bad.toml"], "the options of bad.toml: Invalid"),
        (["in", "-o", "out", "--options", "key.toml"], "key.toml: option must be one of"),
        (["in", "-o", "out", "--options", "list.toml"], "list.toml: stops must be one of 5,"),
        (["in", "-o", "out", "--options", "high.toml"], "stops must be one of 5, 6, 8, 10, 12"),
    ],
)  # fmt: skip
def test_what_cannot_work_is_refused_in_one_line(command, line, refused, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    save_photo(tmp_path / "in2/a.png", 3)
    for name, text in {
        "bad": "quality =", "key": "speed = 1", "list": "stops = [5]", "high": "stops = 99",
    }.items():  # fmt: skip
        (tmp_path / f"{name}.toml").write_text(text)
    assert line in refused(*command).replace(f"{tmp_path}/", "")
    assert not (tmp_path / "out").exists()


def test_folder_that_is_read_only_is_refused(refused, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/gauss2svg-batch").write_text("")
    assert "cannot create " in refused("in", "-o", "out")


NO_ADDRESSES = [
    "", " ", "nonsense", "host", "tcp://host", "host:", "host:port", "host:8786x", "host:0",
    "host:65536", ":8786", "tcp://", "tcp://:8786", "ftp://host:8786", "http://host:8786",
    "tcp:/host:8786", "tcp://[::1:8786", "a b:8786", "tcp://host:8786/page", "tcp://host:8786?a",
    "inproc://host:8786", 8786,
]  # fmt: skip


@pytest.mark.parametrize("address", NO_ADDRESSES)
def test_what_cannot_be_an_address_of_a_scheduler_is_refused_before_anything_runs(address):
    with pytest.raises(InputError, match="scheduler must be HOST:PORT, or one of tcp://"):
        BatchOptions(scheduler=address)


@pytest.mark.parametrize(
    "address",
    ["host:8786", "10.0.0.1:8786", "tcp://host:1", "tls://a.b.example:65535", "tcp://[::1]:8786",
     "ws://host:80", "wss://host:443/", "ucx://host:8786", "inproc://10.0.0.1/12/1"],
)  # fmt: skip
def test_every_kind_of_address_of_dask_is_one(address):
    assert BatchOptions(scheduler=address).scheduler == address


def test_a_client_that_cannot_connect_is_not_heard_of_again(monkeypatch):
    from gauss2svg.batch import cluster

    made = []

    class Kept(cluster._Connecting):
        def start(self, **options):
            made.append(self)
            super().start(**options)

    monkeypatch.setattr(cluster, "_Connecting", Kept)
    # Dask refuses TLS without certificates after its client has begun.
    address = "tls://127.0.0.1:1"
    with pytest.raises(ClusterError, match="ssl_context"), cluster.remote_client(address):
        pass
    # Its finaliser would wait for 20 s for any other.
    assert [client.status for client in made] == ["closed"]


def test_scheduler_that_does_not_answer_is_reported(tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gauss2svg.batch.cluster._CONNECT_S", 0.3)
    save_photos(tmp_path / "in", ["a.png"])
    line = refusal("batch", "in", "-o", "out", "--scheduler", "tcp://127.0.0.1:9")
    assert "scheduler must be the address of a running Dask scheduler; got 'tcp://127.0" in line


def test_options_of_a_file_count_unless_they_are_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_photos(tmp_path / "in", ["a.png"])
    (tmp_path / "o.toml").write_text(
        'quality = "draft"\nmax-bytes = "60k"\ngzip = true\nstops = 8\nrelocate = false\n'
    )
    seen = []

    class StoppedError(Exception):
        pass

    def stop(sources, output, options, batch):
        seen.append(options.flat())
        raise StoppedError

    monkeypatch.setattr(many, "Batch", stop)
    with pytest.raises(StoppedError):
        main(["batch", "in", "-o", "out", "--options", "o.toml", "--stops", "6"])
    assert seen[0]["quality"] == "draft"
    assert seen[0]["max_bytes"] == 60_000
    assert seen[0]["gzip"] is True
    assert seen[0]["relocate"] is False
    assert seen[0]["stops"] == 6
    with pytest.raises(StoppedError):
        main(["batch", "in", "-o", "out", "--options", "o.toml", "--quality", "balanced"])
    assert seen[1]["quality"] == "balanced"  # also where it is the default
