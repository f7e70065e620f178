"""Checkpoints: where a fit stands, in a file from which it goes on to the same bits.

The file is a .npz of plain arrays and one text of JSON, which refers to them; nothing in it is
ever executed. It says which run it is of, and is refused by any other.
"""

from __future__ import annotations

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

from gauss2svg.errors import Gauss2SvgError, InputError, OutputError
from gauss2svg.files import check_writable, reading, write_atomically
from gauss2svg.pipeline.options import Options
from gauss2svg.svg.document import Document
from gauss2svg.version import __version__

ADDITIVE, FIT = "additive", "fit"  # which of the fits of a run it is in
_MOST_BYTES = 2_000_000_000  # some four million Gaussians
_FORMAT = 1
_ARRAY = "array:"
# What of a run changes nothing of its result, or is told by the size of the working picture.
_NOT_OF_IDENTITY = {
    "threads", "max_memory", "max_pixels", "checkpoint", "checkpoint_every", "resume", "segments",
}  # fmt: skip

StateDict = dict[str, Any]


class Checkpoint:
    """Writes where a fit stands, every so many seconds, whole or not at all.

    path      of the file, which is replaced every time
    every_s   seconds between two; 0: after every step
    identity  of the run, by `identity_of`
    trouble   why the last one could not be written, None if it could: the fit is worth more
    Raises InputError or OutputError for a path that cannot be one's, before there is a fit.
    """

    def __init__(self, path: str | os.PathLike[str], every_s: float, identity: StateDict) -> None:
        self._path = path
        self._every_s = every_s
        self._identity = identity
        self.trouble: str | None = None
        if Path(path).exists() and not Path(path).is_file():
            raise InputError(
                f"checkpoint must be a regular file, which is replaced every time; got "
                f"{os.fspath(path)}. Try the name of a file"
            )
        check_writable(path)
        self._last = time.monotonic()

    def offer(self, state: Callable[[], StateDict], due: bool = False) -> None:
        """Write what state() tells if it is time, or if it is due in any case."""
        if not due and time.monotonic() - self._last < self._every_s:
            return
        try:
            write_atomically(self._path, packed({"run": self._identity, "state": state()}))
            self.trouble = None
        except OutputError as error:
            self.trouble = f"checkpoint is not up to date: {error}"
        self._last = time.monotonic()


def identity_of(options: Options, document: Document, *pictures: NDArray[np.float32]) -> StateDict:
    """What a run must share with the one of a checkpoint: version, options, the pictures."""
    digest = hashlib.sha256()
    for picture in (*pictures, document.labels):
        if picture is not None:
            digest.update(repr((picture.shape, str(picture.dtype))).encode())
            digest.update(np.ascontiguousarray(picture).data)
    given = {k: v for k, v in options.flat().items() if k not in _NOT_OF_IDENTITY}
    sizes = [list(picture.shape) for picture in pictures]
    return {"version": __version__, **given, "sizes": sizes, "photo": digest.hexdigest()}


def resumed(path: str | os.PathLike[str], identity: StateDict) -> StateDict:
    """The state in a checkpoint of the run with this identity.

    Raises InputError for a file that is none, is damaged, or is of another run.
    """
    name = os.fspath(path)
    with reading(path, "give a file of --checkpoint") as file:
        try:
            stored = unpacked(file)
            theirs, state = dict(stored["run"]), dict(stored["state"])
            if state["stage"] not in (ADDITIVE, FIT):
                raise ValueError(f"it has no stage {state['stage']!r}")
        except (Gauss2SvgError, MemoryError):
            raise
        except Exception as error:  # numpy, zipfile and json each raise their own
            raise damaged(name, error) from error
    for key, ours in json.loads(json.dumps(identity)).items():
        if theirs.get(key) != ours:
            was = "another" if key == "photo" else f"{theirs.get(key)!r}, now {ours!r}"
            raise InputError(
                f"{name} must be a checkpoint of this run; got one of another, whose {key} was {was}. "
                "Try the command that it was made by, with --resume"
            )
    return state


def damaged(name: str, error: Exception) -> InputError:
    """The error of a file that is no checkpoint of this program, or no longer one."""
    why = " ".join(str(error).split())[:80] or type(error).__name__
    return InputError(
        f"{name} must be a checkpoint; got one that is damaged, or another file ({why}). Try a file "
        "of --checkpoint, or start over"
    )


def packed(state: StateDict) -> bytes:
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

    text = json.dumps(plain(state)).encode()
    stream = io.BytesIO()
    fields: dict[str, Any] = {
        "format": np.array(_FORMAT),
        "text": np.frombuffer(text, np.uint8),
        **arrays,
    }
    np.savez(stream, **fields)
    return stream.getvalue()


def unpacked(file: BinaryIO) -> StateDict:
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
