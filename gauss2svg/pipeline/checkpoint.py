"""Checkpoints: the state of a fit in a file, from which it continues to the same bits.

The file is a .npz of plain arrays and a JSON text that refers to them; nothing in it is executed.
It identifies its run, and any other run refuses it.
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

from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, brief
from gauss2svg.files import check_writable, reading, write_atomically
from gauss2svg.pipeline.options import NOT_OF_PICTURE, Options
from gauss2svg.svg.document import Document
from gauss2svg.version import __version__

ADDITIVE, FIT = "additive", "fit"  # the two fits of a run
_MOST_BYTES = 2_000_000_000  # some four million Gaussians
_FORMAT = 3
_ARRAY = "array:"
# Options that do not change the result, except by arrays whose sizes and hash the identity has.
_NOT_OF_IDENTITY = NOT_OF_PICTURE | {"segments"}

StateDict = dict[str, Any]


class Checkpoint:
    """Writes the state of a fit at intervals, whole or not at all.

    path      of the file, which is replaced every time
    every_s   interval in s; 0: after every step
    identity  of the run, by `identity_of`
    trouble   why the last checkpoint could not be written, else None; the fit continues without
    Raises InputError or OutputError for a path that cannot be written, before the fit.
    """

    def __init__(self, path: str | os.PathLike[str], every_s: float, identity: StateDict) -> None:
        self._path = path
        self._every_s = every_s
        self._identity = identity
        self.trouble: str | None = None
        if Path(path).exists() and not Path(path).is_file():
            raise InputError(
                f"checkpoint must be a regular file; got {os.fspath(path)}, which is not a "
                "regular file. Try another name"
            )
        check_writable(path)
        self._last = time.monotonic()

    def offer(self, state: Callable[[], StateDict], due: bool = False) -> None:
        """Write state() if the interval is over, or if it is due in any case."""
        if not due and time.monotonic() - self._last < self._every_s:
            return
        try:
            write_atomically(self._path, packed({"run": self._identity, "state": state()}))
            self.trouble = None
        except OutputError as error:
            self.trouble = f"checkpoint is not up to date: {error}"
        self._last = time.monotonic()


def identity_of(
    options: Options, document: Document, canvas: tuple[int, int], *images: NDArray[np.float32]
) -> StateDict:
    """What a run must share with that of a checkpoint: version, options, canvas and images."""
    digest = hashlib.sha256()
    for image in (*images, document.labels):
        if image is not None:
            digest.update(repr((image.shape, str(image.dtype))).encode())
            digest.update(np.ascontiguousarray(image).data)
    given = {k: v for k, v in options.flat().items() if k not in _NOT_OF_IDENTITY}
    sizes = [list(image.shape) for image in images]
    given |= {"canvas": list(canvas), "sizes": sizes, "photo": digest.hexdigest()}
    return {"version": __version__, **given}


def resumed(path: str | os.PathLike[str], identity: StateDict) -> StateDict:
    """The state in a checkpoint of the run with this identity.

    Raises InputError for another file, a damaged one, and one of another run.
    """
    name = os.fspath(path)
    with reading(path, "a file of --checkpoint") as file:
        try:
            stored = unpacked(file)
            theirs, state = dict(stored["run"]), dict(stored["state"])
            if state["stage"] not in (ADDITIVE, FIT):
                raise ValueError(f"it has the stage {state['stage']!r}")
        except (Gauss2SvgError, MemoryError):
            raise
        except Exception as error:  # numpy, zipfile and json each raise their own
            raise damaged(name, error) from error
    for key, ours in json.loads(json.dumps(identity)).items():
        if theirs.get(key) != ours:
            wanted, differs = f"with {key} {ours!r}", f"with {key} {theirs.get(key)!r}"
            if key == "photo":
                wanted, differs = "of this photo", "of another photo"
            raise InputError(
                f"{name} must be a checkpoint {wanted}; got {brief(f'one {differs}')}. Try the "
                "command that made it, with --resume"
            )
    return state


def damaged(name: str, error: Exception) -> InputError:
    """The error for a file that is not a checkpoint, or not a valid one."""
    why = " ".join(str(error).split())[:80] or type(error).__name__
    return InputError(
        f"{name} must be a checkpoint; got a damaged one or another file ({why}). Try a file of "
        "--checkpoint, or starting over"
    )


def packed(state: StateDict) -> bytes:
    """The file of nested dictionaries and lists of arrays, numbers and text."""
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
    """The inverse of `packed`; raises InputError for another format, and errors of numpy's.

    Compressed files are refused, so that none unpacks to more than its own size.
    """
    if file.seek(0, os.SEEK_END) > _MOST_BYTES:
        raise InputError(f"checkpoint must be at most {_MOST_BYTES} bytes; got more")
    with zipfile.ZipFile(file) as parts:
        if any(part.compress_type != zipfile.ZIP_STORED for part in parts.infolist()):
            raise InputError("checkpoint must be uncompressed; got a compressed file")
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        if int(stored["format"]) != _FORMAT:
            raise InputError(
                f"format of a checkpoint must be {_FORMAT}; got {int(stored['format'])}. Try "
                "starting over"
            )
        text = stored["text"].tobytes()
        # zipfile verifies the checksum of each part.
        arrays = {name: stored[name] for name in set(stored.files) - {"format", "text"}}

    def whole(value: Any) -> Any:
        if isinstance(value, str) and value.startswith(_ARRAY):
            return arrays[value.removeprefix(_ARRAY)]
        if isinstance(value, dict):
            return {key: whole(inner) for key, inner in value.items()}
        return [whole(inner) for inner in value] if isinstance(value, list) else value

    return whole(json.loads(text))
