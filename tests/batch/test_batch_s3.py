"""Batches from and to stores of fsspec: its own in memory, and S3 by moto's server."""

import pytest
from batches import PoolHere, outputs, save_photo, tiny

from gauss2svg.batch.many import TABLE, vectorize_many
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline.vectorize import vectorize_by

pytestmark = [
    # Of the server's sockets, and of s3fs's, which are closed when they are collected.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
NAMES = ["a.png", "b/a.png", "b/c d.png"]


@pytest.fixture(scope="module")
def s3():
    """The address of a server."""
    pytest.importorskip("s3fs")
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture(params=["memory", pytest.param("s3", marks=pytest.mark.process)])
def store(request, tmp_path, monkeypatch):
    """A file system, and the address of a folder of the test's own in it."""
    fsspec = pytest.importorskip("fsspec")
    if request.param == "memory":
        request.getfixturevalue("pool_here")  # no other process has this memory
    else:
        for name, value in {
            "AWS_ENDPOINT_URL": request.getfixturevalue("s3"), "AWS_ACCESS_KEY_ID": "key",
            "AWS_SECRET_ACCESS_KEY": "word", "AWS_DEFAULT_REGION": "us-east-1",
        }.items():  # fmt: skip
            monkeypatch.setenv(name, value)
    fs = fsspec.filesystem(request.param, use_listings_cache=False)
    folder = tmp_path.name.replace("_", "-").lower()[:60]
    fs.mkdir(folder)
    yield fs, f"{request.param}://{folder}"
    fs.clear_instance_cache()


def test_photos_of_a_store_become_svgs_of_it_and_are_skipped_then(store, tmp_path, monkeypatch):
    fs, root = store
    for seed, name in enumerate([*NAMES, ".hidden/x.png"]):
        fs.pipe_file(f"{root}/in/{name}", save_photo(tmp_path / "in" / name, seed).read_bytes())

    def run() -> dict:
        found = vectorize_many([f"{root}/in"], f"{root}/out", tiny(), workers=1)
        return {one.output: "skipped" if one.skipped else one.error for one in found}

    expected = {name.replace(".png", ".svg"): None for name in NAMES}
    assert run() == expected
    for name, svg in zip(NAMES, expected, strict=True):
        wanted = vectorize_by(tiny(), tmp_path / "in" / name).svg.encode()
        assert fs.cat_file(f"{root}/out/{svg}") == wanted
    assert fs.exists(f"{root}/out/{TABLE}")
    monkeypatch.setattr("gauss2svg.batch.many.Pool", PoolHere)  # the first run had a process
    for name in ("a.png", "new.png"):
        fs.pipe_file(f"{root}/in/{name}", save_photo(tmp_path / "x.png", 9).read_bytes())
    assert run() == dict.fromkeys(expected, "skipped") | dict.fromkeys(("a.svg", "new.svg"))
    fs.pipe_file(f"{root}/list.txt", f"{root}/in/a.png\n".encode())
    list(vectorize_many([f"{root}/list.txt"], tmp_path / "out", tiny()))
    assert [*outputs(tmp_path / "out").values()] == [fs.cat_file(f"{root}/out/a.svg")]
    if root.startswith("s3"):
        with pytest.raises(OutputError, match="cannot write s3://none-of-it/out"):
            vectorize_many([f"{root}/in"], "s3://none-of-it/out", tiny())
        with pytest.raises(InputError, match="cannot read s3://none-of-it/in: The specified buck"):
            vectorize_many(["s3://none-of-it/in"], f"{root}/out", tiny())
