"""Writing files whole or not at all."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from gauss2svg.errors import OutputError


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise OutputError if a file could not be written there; touches no existing file."""
    target = Path(path)
    try:
        if target.is_dir():
            raise OutputError(f"cannot write {target}: it is a folder; give a file name")
        if target.exists() and not os.access(target, os.W_OK):
            raise OutputError(f"cannot write {target}: it is read-only; choose another name")
        if not target.exists() or target.is_file():
            with tempfile.TemporaryFile(dir=os.path.dirname(os.path.realpath(target))):
                pass
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        raise _cannot_write(target, error) from error


def write_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """Write beside the target and rename: the old file or the whole new one is there.

    Permissions of an existing file are kept. Raises OutputError if it cannot be done.
    """
    target = Path(path)
    check_writable(target)
    beside = None
    try:
        if target.exists() and not target.is_file():  # a pipe or a device: nothing to keep whole
            target.write_bytes(data)
            return
        # Through a link, so that the link stays and its file is replaced.
        target = Path(os.path.realpath(target))
        descriptor, beside = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:40]}.")
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        Path(beside).chmod(target.stat().st_mode if target.exists() else 0o666 & ~_umask())
        os.replace(beside, target)
    except (OSError, ValueError) as error:
        if beside is not None:
            with suppress(FileNotFoundError):
                os.unlink(beside)
        raise _cannot_write(target, error) from error


def _cannot_write(target: Path, error: Exception) -> OutputError:
    reason = getattr(error, "strerror", None) or str(error)
    return OutputError(f"cannot write {target}: {reason}; choose another place")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
