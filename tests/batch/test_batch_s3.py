"""Batches from and to S3, by moto's server: in, out, going on, and puts that fail."""

import logging
import threading

import pytest
from batches import save_photo, tiny

from gauss2svg.batch.many import vectorize_many
from gauss2svg.batch.stores import STATE
from gauss2svg.batch.table import TABLE
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.pool import Pool

pytestmark = [
    pytest.mark.process,
    pytest.mark.usefixtures("pool_here"),
    # Of the server's sockets, and of s3fs's, which are closed when they are collected.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
NAMES = ["a.png", "b/a.png", "b/c d.png"]


class Refusing:
    """A server's application that refuses to put some names."""

    def __init__(self, application):
        self.application = application
        self.refused: set[str] = set()
        self.puts: list[str] = []

    def __call__(self, environ, start_response):
        path = environ["PATH_INFO"]
        if environ["REQUEST_METHOD"] == "PUT":
            self.puts.append(path)
            if path in self.refused:
                start_response("403 Forbidden", [("Content-Type", "application/xml")])
                return [b"<Error><Code>AccessDenied</Code><Message>no room</Message></Error>"]
        return self.application(environ, start_response)


@pytest.fixture(scope="module")
def server():
    pytest.importorskip("s3fs")
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    application = Refusing(DomainDispatcherApplication(create_backend_app))
    served = make_server("127.0.0.1", 0, application, threaded=True)
    thread = threading.Thread(target=served.serve_forever)
    thread.start()
    application.url = f"http://127.0.0.1:{served.port}"
    yield application
    served.shutdown()
    thread.join()
    served.server_close()


@pytest.fixture
def bucket(server, tmp_path, monkeypatch):
    """A bucket of a test's own with photos under in/."""
    import s3fs

    for name, value in {
        "AWS_ENDPOINT_URL": server.url, "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "word",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    fs = s3fs.S3FileSystem(use_listings_cache=False)
    name = tmp_path.name.replace("_", "-").lower()[:60]
    fs.mkdir(name)
    for seed, photo in enumerate(NAMES):
        fs.put_file(str(save_photo(tmp_path / "in" / photo, seed)), f"{name}/in/{photo}")
    server.puts.clear()
    server.refused.clear()
    yield name, fs
    s3fs.S3FileSystem.clear_instance_cache()


def run(bucket, **options):
    found = vectorize_many([f"s3://{bucket}/in"], f"s3://{bucket}/out", tiny(**options))
    return {one.output: "skipped" if one.skipped else one.error for one in found}


def test_photos_of_a_bucket_become_svgs_of_a_bucket_and_are_skipped_then(bucket, server, tmp_path):
    name, fs = bucket
    expected = {photo.replace(".png", ".svg"): None for photo in NAMES}
    assert run(name) == expected
    for photo in NAMES:
        svg = fs.cat_file(f"{name}/out/{photo.replace('.png', '.svg')}")
        assert svg == vectorize_by(tiny(), tmp_path / "in" / photo).svg.encode()
        # One put each, so that it appears whole.
        assert server.puts.count(f"/{name}/out/{photo.replace('.png', '.svg')}") == 1
    assert fs.cat_file(f"{name}/out/{TABLE}").count(b"\n") == 4
    server.puts.clear()
    assert run(name) == dict.fromkeys(expected, "skipped")
    assert all(f"/{STATE}/" in path for path in server.puts)
    fs.put_file(str(save_photo(tmp_path / "x.png", 9)), f"{name}/in/a.png")
    assert run(name) == {**dict.fromkeys(expected, "skipped"), "a.svg": None}


def test_put_that_fails_ends_the_batch_and_the_next_run_goes_on(bucket, server):
    name, fs = bucket
    server.refused.add(f"/{name}/out/b/c d.svg")
    with pytest.raises(OutputError, match=r"cannot write s3://.*/out/b/c d.svg: "):
        run(name)
    assert not fs.exists(f"{name}/out/b/c d.svg")
    server.refused.clear()
    found = run(name)
    assert found == {"a.svg": "skipped", "b/a.svg": "skipped", "b/c d.svg": None}


@pytest.mark.parametrize("engine", ["processes", "cluster"])
def test_both_engines_read_and_write_a_bucket(engine, bucket, monkeypatch, request):
    name, fs = bucket
    monkeypatch.setattr("gauss2svg.batch.many.Pool", Pool)
    client = request.getfixturevalue("dask_client") if engine == "cluster" else None
    found = vectorize_many([f"s3://{name}/in"], f"s3://{name}/out", tiny(), client=client)
    assert [one.error for one in found] == [None] * 3
    assert len(fs.find(f"{name}/out")) == 2 * 3 + 4  # marks; two tables, options, a probe


def test_bucket_that_is_not_there_is_refused_before_anything_runs(bucket):
    name, _ = bucket
    with pytest.raises(OutputError, match="cannot write s3://none-of-it/out"):
        vectorize_many([f"s3://{name}/in"], "s3://none-of-it/out", tiny())
    with pytest.raises(InputError, match="cannot read s3://none-of-it/in: The specified bucket"):
        vectorize_many(["s3://none-of-it/in"], f"s3://{name}/out", tiny())
