"""Files: read only if they are regular, written whole or not at all, never over an input."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import secrets
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

from gauss2svg.errors import InputError, OutputError, on_one_line, refusal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

STANDARD_STREAM = "-"
FileName = str | os.PathLike[str]
_Name = TypeVar("_Name", str, Path, FileName)
# Devices of Windows, also with a suffix; Microsoft, "Naming Files, Paths, and Namespaces".
_DEVICE = re.compile(
    r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]) *([.:]|$)", re.IGNORECASE
)
# s between tries to rename on Windows: scanners for viruses hold a new file open for moments.
_PAUSES_S = (0.01, 0.03, 0.1, 0.3, 1.0)
_NOT_BLOCKING, _BINARY = getattr(os, "O_NONBLOCK", 0), getattr(os, "O_BINARY", 0)


@contextmanager
def reading(path: FileName, advice: str) -> Iterator[BinaryIO]:
    """A regular file open for reading; raises InputError, with advice on what to try.

    Pipes and devices are refused unread: a pipe that nobody writes to would block for ever.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | _NOT_BLOCKING | _BINARY)
    except (OSError, ValueError) as error:
        # Windows, which opens no folder, says that permission was denied.
        is_folder = os.path.isdir(path)
        reason = "it is a folder, not a regular file" if is_folder else reason_of(error)
        raise _cannot_read(path, reason, advice) from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        kind = "a folder" if stat.S_ISDIR(mode) else "a pipe or a device"
        raise _cannot_read(path, f"it is {kind}, not a regular file", advice)
    with open(descriptor, "rb") as file:
        yield file


def check_writable(path: FileName) -> None:
    """Raise OutputError if no file can be written there; change no existing file."""
    target = Path(path)
    try:
        _refuse_device(target)
        _mode_of(target)  # raises for links in a circle, which neither exist nor can be made
        if target.is_dir():
            raise OutputError(f"cannot write {target}: it is a folder. Try a file name")
        if target.exists() and not os.access(target, os.W_OK):
            raise OutputError(f"cannot write {target}: it is read-only. Try another name")
        if sys.platform == "win32" and target.is_file():
            replace(target, target)  # changes nothing, but fails while a program holds it open
        if not target.exists() or target.is_file():
            with tempfile.TemporaryFile(dir=os.path.dirname(os.path.realpath(target))):
                pass
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        raise _cannot_write(target, error) from error


def make_folder(folder: Path) -> None:
    """Create a folder and those above it; raises OutputError where that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        message = f"cannot create {folder}: {reason_of(error)}. Try another folder"
        raise OutputError(message) from error


def write_atomically(path: FileName, data: bytes) -> None:
    """Write beside the target and rename, which leaves either the old file or the whole new one.

    Permissions of an existing file are kept, and a symbolic link stays one; other hard links keep
    the old file. Raises OutputError if it cannot be written.
    """
    write_all_atomically({path: data})


def write_all_atomically(files: Mapping[_Name, bytes]) -> None:
    """Write each file as write_atomically does, and rename none before all are on the disk.

    A full disk thus leaves every old file as it was. The files are renamed one by one: where one
    cannot be, or an interruption comes between two, the earlier ones are new and the others old.
    Pipes and devices, which cannot be renamed, are written just before. Raise OutputError for the
    first that cannot be written.
    """
    for path in files:
        check_writable(path)
    parts: dict[Path, Path] = {}  # where each regular file is written at first, and goes
    target = Path()
    try:
        for target, data in zip(map(Path, files), files.values(), strict=True):
            if not target.exists() or target.is_file():
                real = Path(os.path.realpath(target))  # what a link points to is replaced
                part = real.with_name(f".{real.name[:40]}.{secrets.token_hex(6)}")
                parts[part] = real  # before it is made, so that an interruption leaves no part
                _write_new(part, data, _mode_of(real))
        for target, data in zip(map(Path, files), files.values(), strict=True):
            if target.exists() and not target.is_file():
                with target.open("wb", buffering=0) as stream:
                    _write_all(stream.fileno(), data)
        for part, target in parts.items():
            replace(part, target)
    except (OSError, ValueError) as error:
        raise _cannot_write(target, error) from error
    finally:
        for part in parts:
            with suppress(OSError):  # it was renamed
                os.unlink(part)


def replace(made: FileName, target: FileName) -> None:
    """Rename a file over another; on Windows try for 1.4 s while a program holds that one open."""
    if sys.platform == "win32":
        for pause in _PAUSES_S:
            try:
                return os.replace(made, target)
            except PermissionError:
                time.sleep(pause)
    return os.replace(made, target)


def is_device(name: str) -> bool:
    """Whether Windows takes a name for that of a device, such as con, aux.svg and COM1.txt."""
    return _DEVICE.match(name) is not None


def _refuse_device(path: Path) -> None:
    # Output to nul is discarded, which users ask for on purpose.
    if sys.platform == "win32" and is_device(path.name) and path.name.lower() != "nul":
        raise OSError(errno.EINVAL, "Windows takes the name for that of a device")


def write_whole(path: Path, data: bytes, part: Path, sync: bool = True) -> None:
    """Write to `part`, on the same disk, and rename it: one file of many that are known to be ours.

    Unlike write_atomically it tries nothing beforehand. Raise OutputError.
    """
    try:
        _refuse_device(path)
        _write_new(part, data, None, sync)
        replace(part, path)
    except BaseException as error:
        with suppress(OSError, ValueError):  # it may not be there
            part.unlink()
        if isinstance(error, (OSError, ValueError)):
            raise _cannot_write(path, error) from error
        raise


def _mode_of(target: Path) -> int | None:
    """Return the permissions of a file, None where there is none."""
    try:
        return stat.S_IMODE(target.stat().st_mode)
    except FileNotFoundError:
        return None


def _write_new(path: Path, data: bytes, mode: int | None, sync: bool = True) -> None:
    """Create a file, on the disk with `sync`, with the usual permissions if mode is None."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY
    # Private until it has its final permissions.
    descriptor = os.open(path, flags, 0o666 if mode is None else 0o600)
    try:
        _write_all(descriptor, data)
        if sync:
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
    """Whether the file system of a folder ignores case in names; raises OutputError if unknown."""
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".aA") as probe:
            place, name = os.path.split(probe.name)
            return os.path.exists(os.path.join(place, name.swapcase()))
    except OSError as error:
        raise _cannot_write(Path(folder), error) from error


def _cannot_write(target: Path, error: Exception) -> OutputError:
    return OutputError(f"cannot write {target}: {reason_of(error)}. Try another folder")


def reason_of(error: BaseException) -> str:
    """Return why a file cannot be read or written, on one line."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return on_one_line(text).strip().rstrip(".")[:300]


def _cannot_read(path: FileName, reason: str, advice: str) -> InputError:
    return InputError(f"cannot read {os.fsdecode(path)}: {reason}. Try {advice}")


def check_outputs(inputs: Mapping[str, str], targets: Sequence[Path]) -> None:
    """Refuse outputs that cannot be written or would overwrite an input or each other.

    inputs  what each input file is, by its name: {"photo.jpg": "the photo"}; - is standard input
    Raises InputError for a clash, OutputError for a target that cannot be written.
    """
    taken = dict(inputs)
    for target in map(os.fspath, targets):
        for name, what in taken.items():
            if _are_one(name, target):
                got = f"{target}, which is also {what}"
                raise refusal("output", "a file of its own", got, "another name")
        taken[target] = "another output"
    for target in targets:
        check_writable(target)


def _are_one(name: str, other: str) -> bool:
    """Whether two names are of one file: by links, or by case where the file system ignores it."""
    if name == STANDARD_STREAM:
        return _is_standard_input(other)
    try:
        first, second = (os.path.realpath(path) for path in (name, other))
        if first == second:
            return True
        if os.path.lexists(first) and os.path.lexists(second):
            return os.path.samefile(first, second)
    except (OSError, ValueError):
        return False  # reading or writing it raises the error
    # At most one exists; a file system that ignores case would find it by both names.
    return first.casefold() == second.casefold() and folds_case(os.path.dirname(second))


def _is_standard_input(path: str) -> bool:
    """Whether a file is what standard input reads, as by `< photo.png`."""
    try:
        read = os.fstat(sys.stdin.fileno())
        return stat.S_ISREG(read.st_mode) and os.path.samestat(read, os.stat(path))
    except (AttributeError, OSError, ValueError):  # it is closed or no file, or nothing is there
        return False


def saved(save: Callable[[BinaryIO], object]) -> bytes:
    """What a function writes to a stream."""
    stream = io.BytesIO()
    save(stream)
    return stream.getvalue()


def as_png(pixels: NDArray[np.floating]) -> bytes:
    """PNG of 8 bits per channel of an image (h, w, 3) or (h, w, 4) in 0..1."""
    import numpy as np
    from PIL import Image

    picture = Image.fromarray(np.round(pixels * 255).astype(np.uint8))
    return saved(lambda stream: picture.save(stream, "PNG"))


def as_json(report: Mapping[str, Any]) -> bytes:
    """A report as indented JSON; raises ValueError for infinity and NaN."""
    return (json.dumps(report, indent=2, allow_nan=False) + "\n").encode()
