"""Batches from and to S3, by moto's server."""

import logging
import threading

import pytest
from batches import save_photo, tiny

from gauss2svg.batch.many import vectorize_many
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline.vectorize import vectorize_by

pytestmark = [
    pytest.mark.process,
    # Of the server's sockets, and of s3fs's, which are closed when they are collected.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
NAMES = ["a.png", "b/a.png", "b/c d.png"]


@pytest.fixture(scope="module")
def server():
    pytest.importorskip("s3fs")
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    application = DomainDispatcherApplication(create_backend_app)
    served = make_server("127.0.0.1", 0, application, threaded=True)
    thread = threading.Thread(target=served.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{served.port}"
    served.shutdown()
    thread.join()
    served.server_close()


@pytest.fixture
def bucket(server, tmp_path, monkeypatch):
    """A bucket of a test's own with photos under in/."""
    import s3fs

    for name, value in {
        "AWS_ENDPOINT_URL": server, "AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "word",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    fs = s3fs.S3FileSystem(use_listings_cache=False)
    name = tmp_path.name.replace("_", "-").lower()[:60]
    fs.mkdir(name)
    for seed, photo in enumerate(NAMES):
        fs.put_file(str(save_photo(tmp_path / "in" / photo, seed)), f"{name}/in/{photo}")
    yield name, fs
    s3fs.S3FileSystem.clear_instance_cache()


def test_photos_of_a_bucket_become_svgs_of_a_bucket_and_are_skipped_then(bucket, tmp_path):
    name, fs = bucket

    def run() -> dict:
        found = vectorize_many([f"s3://{name}/in"], f"s3://{name}/out", tiny())
        return {one.output: "skipped" if one.skipped else one.error for one in found}

    expected = {photo.replace(".png", ".svg"): None for photo in NAMES}
    assert run() == expected
    for photo, svg in zip(NAMES, expected, strict=True):
        wanted = vectorize_by(tiny(), tmp_path / "in" / photo).svg.encode()
        assert fs.cat_file(f"{name}/out/{svg}") == wanted
    assert len(fs.find(f"{name}/out")) == 2 * 3 + 4  # marks; two tables, options, a probe
    fs.put_file(str(save_photo(tmp_path / "x.png", 9)), f"{name}/in/a.png")
    assert run() == dict.fromkeys(expected, "skipped") | {"a.svg": None}
    with pytest.raises(OutputError, match="cannot write s3://none-of-it/out"):
        vectorize_many([f"s3://{name}/in"], "s3://none-of-it/out", tiny())
    with pytest.raises(InputError, match="cannot read s3://none-of-it/in: The specified bucket"):
        vectorize_many(["s3://none-of-it/in"], f"s3://{name}/out", tiny())
