"""A studio as its users have it: `gauss2svg studio` in a process of its own."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import psutil


def answer_of(
    app: Any, method: str, path: str, base: str = "http://studio", raises: bool = True, **more
) -> httpx.Response:
    """The answer of an application in this process, whose errors are raised here if `raises`."""

    async def one() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=raises)
        async with httpx.AsyncClient(transport=transport, base_url=base) as client:
            return await client.request(method, path, **more)

    return asyncio.run(one())


class Server:
    """Its process, its address and a client with the token."""

    def __init__(self, process: subprocess.Popen, address: str, scratch: Path) -> None:
        self.process, self.scratch = process, scratch
        self.address = address
        self.home, _, self.token = address.partition("/?token=")
        self.client = httpx.Client(
            base_url=self.home, headers={"Authorization": f"Bearer {self.token}"}, timeout=60
        )

    def submit(self, photo: bytes | str, **options) -> dict:
        """The answer to a photo, or to the name of a sample."""
        data = {"options": json.dumps(options)}
        if isinstance(photo, str):
            answer = self.client.post("/api/jobs", data={**data, "sample": photo}, files={"x": b""})
        else:
            answer = self.client.post("/api/jobs", data=data, files={"photo": ("p.png", photo)})
        assert answer.status_code == 201, answer.text
        return answer.json()

    def get(self, path: str) -> bytes:
        """What the service answers to a page."""
        return self.client.get(path).raise_for_status().content

    def state(self, job: dict) -> dict:
        """Of a job now."""
        return self.client.get(f"/api/jobs/{job['id']}").json()

    def wait(self, job: dict, *states: str, seconds: float = 120) -> dict:
        """The state of a job once it is one of these, or over."""
        until = time.monotonic() + seconds
        wanted = {*states, "done", "stopped", "failed", "canceled"}
        while time.monotonic() < until:
            found = self.state(job)
            if found["state"] in wanted:
                return found
            time.sleep(0.01)
        raise AssertionError(found)

    def fitting(self, job: dict) -> dict:
        """The state of a job once its fit has made a step."""
        until = time.monotonic() + 60
        while not ((found := self.state(job))["progress"] or {}).get("iteration"):
            assert time.monotonic() < until, found
            time.sleep(0.005)
        return found

    def workers(self) -> list[psutil.Process]:
        """The processes in which fits run."""
        return [
            child
            for child in psutil.Process(self.process.pid).children()
            if "gauss2svg.pool" in child.cmdline()
        ]


@contextmanager
def running(*arguments: str) -> Iterator[Server]:
    """A server on a free port whose temporary files are in a folder of their own; ended after."""
    with tempfile.TemporaryDirectory() as scratch:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "gauss2svg", "studio", "--no-browser", "--port", "0",
             *arguments],
            stderr=subprocess.PIPE,
            env={**os.environ, "TMPDIR": scratch},
            text=True,
        )  # fmt: skip
        assert process.stderr is not None
        try:
            said = ""
            while "the studio is at" not in said:
                line = process.stderr.readline()
                assert line, said
                said += line
            address = re.search(r"http://\S+", said)
            assert address is not None
            server = Server(process, address[0], Path(scratch))
            with server.client:
                yield server
        finally:
            process.kill()
            process.wait()
            process.stderr.close()
