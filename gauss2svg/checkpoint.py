"""Checkpoints: where a fit stands, in a file from which it goes on to the same bits.

The file is a .npz of plain arrays and one text of JSON, which refers to them; nothing in it is
ever executed. It says which run it is of, and is refused by any other.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import os
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gauss2svg.atomic import check_writable, write_atomically
from gauss2svg.errors import Gauss2SvgError, InputError, OutputError
from gauss2svg.photo.files import reading
from gauss2svg.request import Request
from gauss2svg.version import __version__

EVERY_S = 30.0  # a second of a fit is soon done again, and a file of 5000 Gaussians has 3 MB
LONGEST_S = 86400.0  # between two
SUM, FIT = "sum", "fit"  # which of the fits of a run it is in
_MOST_BYTES = 2_000_000_000  # some four million Gaussians
_FORMAT = 1
_ARRAY = "array:"

Memory = dict[str, Any]


class Checkpoint:
    """Writes where a fit stands, every so many seconds, whole or not at all.

    path      of the file, which is replaced every time
    every_s   seconds between two; 0: after every step
    identity  of the run, by `identity_of`
    trouble   why the last one could not be written, None if it could: the fit is worth more
    Raises InputError or OutputError for a path that cannot be one's, before there is a fit.
    """

    def __init__(self, path: str | os.PathLike[str], every_s: float, identity: Memory) -> None:
        self._path = path
        self._every_s = every_s
        self._identity = identity
        self.trouble: str | None = None
        if Path(path).exists() and not Path(path).is_file():
            raise InputError(
                f"checkpoint {os.fspath(path)} is no regular file, and is replaced every time; "
                "give the name of a file"
            )
        check_writable(path)
        self._last = time.monotonic()

    def offer(self, memory: Callable[[], Memory], due: bool = False) -> None:
        """Write what memory() tells if it is time, or if it is due in any case."""
        if not due and time.monotonic() - self._last < self._every_s:
            return
        try:
            write_atomically(self._path, packed({"run": self._identity, "memory": memory()}))
            self.trouble = None
        except OutputError as error:
            self.trouble = f"checkpoint is not up to date: {error}"
        self._last = time.monotonic()


def identity_of(request: Request, *pictures: NDArray[np.float32]) -> Memory:
    """What a run must share with the one of a checkpoint: version, options, the pictures."""
    digest = hashlib.sha256()
    for picture in (*pictures, request.page.segments):
        if picture is not None:
            digest.update(repr((picture.shape, str(picture.dtype))).encode())
            digest.update(np.ascontiguousarray(picture).data)
    options = {
        f.name: getattr(request, f.name) for f in dataclasses.fields(request) if f.name != "page"
    }
    options["targets"] = dataclasses.asdict(request.targets)
    sizes = [list(picture.shape) for picture in pictures]
    return {"version": __version__, **options, "sizes": sizes, "photo": digest.hexdigest()}


def resumed(path: str | os.PathLike[str], identity: Memory) -> Memory:
    """The memory in a checkpoint of the run with this identity.

    Raises InputError for a file that is none, is damaged, or is of another run.
    """
    name = os.fspath(path)
    with reading(path, "give a file of --checkpoint") as file:
        try:
            stored = unpacked(file)
            theirs, memory = dict(stored["run"]), dict(stored["memory"])
            if memory["stage"] not in (SUM, FIT):
                raise ValueError(f"it has no stage {memory['stage']!r}")
        except (Gauss2SvgError, MemoryError):
            raise
        except Exception as error:  # numpy, zipfile and json each raise their own
            raise damaged(name, error) from error
    for key, ours in json.loads(json.dumps(identity)).items():
        if theirs.get(key) != ours:
            was = "another" if key == "photo" else f"{theirs.get(key)!r}, now {ours!r}"
            raise InputError(
                f"{name} is a checkpoint of another run: its {key} was {was}; give the command "
                "that it was made by, with --resume"
            )
    return memory


def damaged(name: str, error: Exception) -> InputError:
    """The error of a file that is no checkpoint of this program, or no longer one."""
    why = " ".join(str(error).split())[:80] or type(error).__name__
    return InputError(
        f"{name} is no checkpoint, or is damaged: {why}; give a file of --checkpoint, or begin anew"
    )


def packed(memory: Memory) -> bytes:
    """A file of nested dictionaries and lists of arrays, numbers and text."""
    arrays: dict[str, NDArray[Any]] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            key = f"{len(arrays)}"
            arrays[key] = value
            return _ARRAY + key
        if isinstance(value, dict):
            return {key: plain(inner) for key, inner in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(inner) for inner in value]
        return value.item() if isinstance(value, np.generic) else value

    text = json.dumps(plain(memory)).encode()
    stream = io.BytesIO()
    fields: dict[str, Any] = {
        "format": np.array(_FORMAT),
        "text": np.frombuffer(text, np.uint8),
        **arrays,
    }
    np.savez(stream, **fields)
    return stream.getvalue()


def unpacked(file: BinaryIO) -> Memory:
    """What was packed; raises InputError for another format, and what numpy raises for no .npz.

    Only what is not compressed is read, and so no more than the file itself has.
    """
    if file.seek(0, os.SEEK_END) > _MOST_BYTES:
        raise InputError(f"checkpoint has more than {_MOST_BYTES} bytes; begin anew")
    with zipfile.ZipFile(file) as parts:
        if any(part.compress_type != zipfile.ZIP_STORED for part in parts.infolist()):
            raise InputError("checkpoint is compressed, which none is; begin anew")
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        if int(stored["format"]) != _FORMAT:
            raise InputError(
                f"checkpoint has format {int(stored['format'])}; needed is {_FORMAT}: begin anew"
            )
        text = stored["text"].tobytes()
        # Each part has a checksum of its own, which zipfile compares.
        arrays = {name: stored[name] for name in set(stored.files) - {"format", "text"}}

    def whole(value: Any) -> Any:
        if isinstance(value, str) and value.startswith(_ARRAY):
            return arrays[value.removeprefix(_ARRAY)]
        if isinstance(value, dict):
            return {key: whole(inner) for key, inner in value.items()}
        return [whole(inner) for inner in value] if isinstance(value, list) else value

    return whole(json.loads(text))
