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


def answer_of(app: Any, method: str, path: str, base: str = "http://studio", **more: Any) -> Any:
    """The answer of an application in this process, whose errors are raised here."""

    async def asked() -> Any:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=base, timeout=60) as client:
            return await client.request(method, path, **more)

    return asyncio.run(asked())


class Server:
    """Its process, its address and a client with the token."""

    def __init__(self, process: subprocess.Popen, address: str, scratch: Path) -> None:
        self.process, self.scratch = process, scratch
        self.address = address
        self.home, _, self.token = address.partition("/?token=")
        self.client = httpx.Client(
            base_url=self.home, headers={"Authorization": f"Bearer {self.token}"}, timeout=60
        )

    def submit(self, photo: bytes, **options) -> dict:
        """The answer to a photo."""
        data, files = {"options": json.dumps(options)}, {"photo": ("p.png", photo)}
        answer = self.client.post("/api/jobs", data=data, files=files)
        assert answer.status_code == 201, answer.text
        return answer.json()

    def get(self, path: str) -> bytes:
        """What the service answers to a page."""
        return self.client.get(path).raise_for_status().content

    def state(self, job: dict) -> dict:
        """Of a job now."""
        return self.client.get(f"/api/jobs/{job['id']}").json()

    def wait(self, job: dict) -> dict:
        """The state of a job once it is over, which it is in ten minutes on any machine."""
        end = time.monotonic() + 600
        while (found := self.state(job))["state"] in ("queued", "running"):
            assert time.monotonic() < end, found
            time.sleep(0.01)
        return found

    def fitting(self, job: dict) -> None:
        """Wait until the fit of a job has made a step."""
        while not ((found := self.state(job))["progress"] or {}).get("iteration"):
            assert found["state"] in ("queued", "running"), found
            time.sleep(0.005)

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
