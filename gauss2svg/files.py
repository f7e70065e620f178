"""Files that are written: whole or not at all, and never over what was read."""

from __future__ import annotations

import io
import json
import os
import secrets
import stat
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gauss2svg.errors import InputError, OutputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

STANDARD_STREAM = "-"
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


def refuse_option_like(*names: str) -> None:
    """Raise InputError for a name that begins with -, unless it is the standard stream."""
    for name in names:
        if name.startswith("-") and name != STANDARD_STREAM:
            raise InputError(f"{name} reads like an option; for a file of that name give ./{name}")


def check_outputs(inputs: Mapping[str, str], targets: Sequence[Path]) -> None:
    """Refuse outputs that could not be written or would overwrite an input or each other.

    inputs  what each file that is read is, by its name: {"photo.jpg": "the photo"}
    Raises InputError for a clash, OutputError for a target that cannot be written.
    """
    taken = {name: what for name, what in inputs.items() if name != STANDARD_STREAM}
    for target in map(os.fspath, targets):
        for name, what in taken.items():
            if _are_one(name, target):
                raise InputError(
                    f"{target} is also {what}; give each its own name so that nothing is lost"
                )
        taken[target] = "another output"
    for target in targets:
        check_writable(target)  # told now, not after the work


def _are_one(name: str, other: str) -> bool:
    """Whether two names are one file's: by links of either kind, or by case where it is folded."""
    first, second = (os.path.realpath(path) for path in (name, other))
    if first == second:
        return True
    try:
        if os.path.lexists(first) and os.path.lexists(second):
            return os.path.samefile(first, second)
    except (OSError, ValueError):
        return False  # told where it is read or written
    # Neither is there, or one alone is: a file system that folds case would know both.
    return first.casefold() == second.casefold() and folds_case(os.path.dirname(second))


def as_png(pixels: NDArray[np.floating]) -> bytes:
    """PNG of a picture (h, w, 3), or (h, w, 4) with alpha, in 0..1, on 8 bits a channel."""
    import numpy as np
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def as_json(report: Mapping[str, Any]) -> bytes:
    """A report as indented JSON; a ValueError where it has an infinity or NaN."""
    return (json.dumps(report, indent=2, allow_nan=False) + "\n").encode()
