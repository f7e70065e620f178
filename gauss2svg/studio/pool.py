"""A worker process as the server sees it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from gauss2svg.processes import end_of, end_tree, module_command, module_path, own_group

_LONGEST_LINE = 1 << 20


class WorkerDiedError(Exception):
    """The worker process ended by itself, or was killed; the message says how."""


class Worker:
    """A process that fits one photo at a time; made by `started`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def started(cls, folder: Path) -> Worker:
        """A worker that is warm: kernels loaded, one tiny fit done. Raises WorkerDiedError."""
        try:
            process = await asyncio.create_subprocess_exec(
                *module_command("gauss2svg.studio.worker_process", str(folder)),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_LONGEST_LINE,
                env={**os.environ, **module_path()},
                # A Ctrl-C at the terminal is the server's; what a worker starts is killed with it.
                **own_group(),
            )
        except NotImplementedError as error:  # a selector's loop on Windows, where it is mounted
            line = "this asyncio loop starts no processes; on Windows its ProactorEventLoop does"
            raise WorkerDiedError(f"could not begin ({line})") from error
        except OSError as error:
            raise WorkerDiedError(f"could not begin ({error.strerror or error})") from error
        worker = cls(process)
        try:
            await worker.receive()
        except BaseException:
            await worker.end()
            raise
        return worker

    @property
    def is_alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.returncode is None

    def send(self, message: dict[str, Any]) -> None:
        """Send a request; a worker that is dead is found by `receive`."""
        stdin = self._process.stdin
        assert stdin is not None
        with contextlib.suppress(ConnectionError, RuntimeError):
            stdin.write(json.dumps(message).encode() + b"\n")

    async def receive(self) -> tuple[dict[str, Any], bytes]:
        """The next message and its bytes; raises WorkerDiedError where none can come."""
        stdout = self._process.stdout
        assert stdout is not None
        try:
            head = json.loads(await stdout.readuntil(b"\n"))
            return head, await stdout.readexactly(head["bytes"])
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            raise WorkerDiedError(end_of(await self._process.wait())) from error
        except (asyncio.LimitOverrunError, ValueError) as error:
            # What comes next cannot be told from what is left of this.
            await self.end()
            raise WorkerDiedError("sent what is no message") from error

    async def messages(self, job: str) -> AsyncIterator[tuple[dict[str, Any], bytes]]:
        """Messages about a job, until it has ended; raises WorkerDiedError."""
        while True:
            head, data = await self.receive()
            if head["job"] == job:
                if head["kind"] == "ended":
                    return
                yield head, data

    def kill(self) -> None:
        """End the process, and what it has started, at once."""
        if self.is_alive:
            end_tree(self._process.pid)

    async def end(self) -> None:
        """Kill it and wait for its end."""
        self.kill()
        transport = getattr(self._process, "_transport", None)
        # So that none is left for a loop that is closed; and a pipe that is full has no end.
        if transport is not None:
            transport.close()
        await self._process.wait()
