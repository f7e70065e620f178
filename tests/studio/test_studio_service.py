"""What the studio serves of a folder, and to whom while others hold connections; all in process."""

import asyncio
import contextlib
import io
import os
import socket
import sys
import time

import pytest
from PIL import Image
from studio_server import answer_of

from gauss2svg.batch.inputs import photos_of
from gauss2svg.errors import InputError
from gauss2svg.photo.formats import SUFFIXES
from gauss2svg.studio import jobs, service, uploads
from gauss2svg.studio.service import create_app

ASK = b"GET / HTTP/1.1\r\nHost: here\r\n\r\n"


async def application(_scope, _receive, send):
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body", "body": b""})


@contextlib.asynccontextmanager
async def listening():
    """The port of a server that answers 204."""
    config = service._config(application)
    config.lifespan = "off"
    one = service._Server(config, lambda: asyncio.sleep(0), lambda: None)
    taken = service._socket("127.0.0.1", 0)
    listens = asyncio.Event()
    one._ready = listens.set
    serving = asyncio.create_task(one.serve([taken]))
    await listens.wait()
    yield taken.getsockname()[1]
    one.should_exit = True
    await serving


@pytest.mark.parametrize("asked", [False, True])
def test_connections_that_send_nothing_more_shut_nobody_out(monkeypatch, asked):
    monkeypatch.setattr(service, "_MOST_CONNECTIONS", 10)
    monkeypatch.setattr(service, "_MOST_WAITING", 5)

    async def visited():
        async with listening() as port:
            idle = []
            for _ in range(30):
                idle.append(await asyncio.open_connection("127.0.0.1", port))
                if asked:  # and is kept alive
                    idle[-1][1].write(ASK)
                    await idle[-1][0].readuntil(b"\r\n\r\n")
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(ASK)
            answer = await reader.readline()
            # Those that came first have gone; the last ones may still send their request.
            assert await idle[0][0].read() == b""
            idle[-1][1].write(ASK)
            late = await idle[-1][0].readline()
        for _, opened in [*idle, (reader, writer)]:
            opened.close()
        return answer, late

    assert asyncio.run(visited()) == (b"HTTP/1.1 204 No Content\r\n",) * 2


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: x\r\n", ASK])
def test_a_request_whose_head_never_ends_is_given_up(monkeypatch, sent):
    monkeypatch.setattr(service, "_HEAD_S", 0.2)

    async def waited():
        async with listening() as port:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            begun = time.monotonic()
            writer.write(sent)
            answer = await asyncio.wait_for(reader.read(), 5)
            writer.close()
            return answer, time.monotonic() - begun

    answer, seconds = asyncio.run(waited())
    assert answer.startswith(b"HTTP/1.1 204") == (sent == ASK)
    assert seconds > 0.15


@pytest.mark.parametrize(
    ("host", "warns"), [("127.0.0.1", False), ("localhost", False), ("0.0.0.0", True)]
)
def test_a_host_that_others_reach_warns(monkeypatch, host, warns):
    monkeypatch.setattr(service._Server, "run", lambda self, sockets: self._ready())
    said = []
    service.serve(None, host, 0, 1, 1, browser=False, say=said.append)
    warning = f"warning: anyone who reaches {host} and knows the token"
    assert [line.startswith(warning) for line in said] == [True, False][not warns :]
    assert "http://127.0.0.1:" in said[-1] or "http://localhost:" in said[-1]


def test_a_sample_whose_name_is_no_utf_8_is_listed_and_served(tmp_path):
    picture = io.BytesIO()
    Image.new("RGB", (3, 2)).save(picture, "PNG")
    names = [b"caf\xe9.png", b"plain.png", "größe.JFIF".encode(), b".hidden.png", b"note.md"]
    for name in names:
        (tmp_path / os.fsdecode(name)).write_bytes(picture.getvalue())
    studio = create_app(folder=tmp_path)
    samples = answer_of(studio, "GET", "/api/samples").json()
    files = [answer_of(studio, "GET", f"/{sample['url']}") for sample in samples]
    assert {sample["name"] for sample in samples} == {"caf%E9.png", "plain.png", "größe.JFIF"}
    assert {file.content for file in files} == {picture.getvalue()}


def test_the_studio_and_batches_take_the_same_files_of_a_folder_for_photos(tmp_path):
    picture = io.BytesIO()
    Image.new("RGB", (3, 2)).save(picture, "PNG")
    for suffix in (*SUFFIXES, ".svg", ".txt", ""):
        (tmp_path / f"a{suffix}").write_bytes(picture.getvalue())
        (tmp_path / f".a{suffix}").write_bytes(picture.getvalue())
    found = {path for path, _ in photos_of([str(tmp_path)])}
    assert found == {str(sample.path) for sample in uploads.samples_in(tmp_path)}
    assert len(found) == len(SUFFIXES)


def test_a_port_is_the_studios_alone_while_it_listens_and_free_at_once_afterwards():
    with service._socket("127.0.0.1", 0) as first:
        first.listen()
        port = first.getsockname()[1]
        with pytest.raises(InputError, match=f"got 127.0.0.1:{port}"):
            service._socket("127.0.0.1", port)
        # This side closes first, whose port then waits.
        with socket.create_connection(("127.0.0.1", port)):
            first.accept()[0].close()
    service._socket("127.0.0.1", port).close()


@pytest.mark.skipif(sys.platform != "win32", reason="loops of other systems start processes")
def test_a_loop_that_starts_no_processes_is_told_with_one_that_does(tmp_path):
    with (
        asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner,
        pytest.raises(jobs.WorkerDiedError, match="ProactorEventLoop"),
    ):
        runner.run(jobs.Worker.started(tmp_path))
