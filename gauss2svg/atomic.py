"""Writing files whole or not at all."""

from __future__ import annotations

import os
import secrets
import stat
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from gauss2svg.errors import OutputError

FileName = str | os.PathLike[str]


def check_writable(path: FileName) -> None:
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


def write_atomically(path: FileName, data: bytes) -> None:
    """Write beside the target and rename: the old file or the whole new one is there.

    Permissions of an existing file are kept, a symbolic link stays one. Of several hard links the
    others keep the old file. Raises OutputError if it cannot be done.
    """
    write_all_atomically({path: data})


def write_all_atomically(files: Mapping[FileName, bytes]) -> None:
    """Write each as write_atomically does; none is renamed before all are on the disk.

    A full disk, or an interruption before the renames, thus leaves every old file as it was.
    Pipes and devices, which cannot be renamed, are written just before these.
    Raises OutputError, for the first that cannot be written.
    """
    for path in files:
        check_writable(path)
    beside: list[tuple[Path, Path]] = []  # where each regular file is written at first, and goes
    target = Path()
    try:
        streams = []
        for path, data in files.items():
            target = Path(path)
            if target.exists() and not target.is_file():
                streams.append((target, data))
                continue
            real = Path(os.path.realpath(target))  # through a link, so that the link stays
            name = f".{real.name[:40]}.{secrets.token_hex(6)}"
            # Known before it is made, so that no moment is without a name to remove.
            beside.append((real.parent / name, real))
            _write_new(beside[-1][0], data, _mode_of(real))
        for target, data in streams:
            with target.open("wb", buffering=0) as stream:
                _write_all(stream.fileno(), data)
        for made, target in beside:
            os.replace(made, target)
    except (OSError, ValueError) as error:
        raise _cannot_write(target, error) from error
    finally:
        for made, _ in beside:  # those that were renamed are no longer there
            with suppress(OSError):
                os.unlink(made)


def _mode_of(target: Path) -> int | None:
    """Permissions of a file, None where there is none."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except FileNotFoundError:
        return None


def _write_new(path: Path, data: bytes, mode: int | None) -> None:
    """A new file on the disk; with the usual permissions if mode is None."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    # Nobody else reads it before it has the permissions that it is to have.
    descriptor = os.open(path, flags, 0o666 if mode is None else 0o600)
    try:
        _write_all(descriptor, data)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    if mode is not None:
        os.chmod(path, mode)


def _write_all(descriptor: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def folds_case(folder: FileName) -> bool:
    """Whether names in a folder that differ by case alone are one file; OutputError if unknown."""
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".aA") as probe:
            place, name = os.path.split(probe.name)
            return os.path.exists(os.path.join(place, name.swapcase()))
    except OSError as error:
        raise _cannot_write(Path(folder), error) from error


def _cannot_write(target: Path, error: Exception) -> OutputError:
    reason = getattr(error, "strerror", None) or str(error)
    return OutputError(f"cannot write {target}: {reason}; choose another place")
