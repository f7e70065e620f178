"""Read regular files only. Write each file completely or not at all, and never over an input.

This module also handles standard streams and patterns of file names.
"""

from __future__ import annotations

import codecs
import errno
import glob
import io
import json
import os
import re
import secrets
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO

from gauss2svg.errors import InputError, OutputError, brief, on_one_line, quoted, refusal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

STANDARD_STREAM = "-"
SVG_ENDINGS = (".svg", ".svgz")
FILE_ENDINGS = (*SVG_ENDINGS, ".json", ".html", ".htm", ".csv", ".png", ".npz", ".pdf", ".zip")
PATTERN = re.compile(r"[*?\[]")  # a wildcard in a file name
UTF16_MARKS = codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE
FileName = str | os.PathLike[str]
_BINARY = getattr(os, "O_BINARY", 0)


def expanded(names: Iterable[str]) -> list[str]:
    """Return file names, with each pattern such as *.jpg replaced by the files that match it.

    This is needed on Windows, where shells pass patterns to programs unchanged. A name with
    wildcards is not a pattern if there is a file of exactly that name. Raise InputError for a
    pattern that matches nothing.
    """
    paths: list[str] = []
    for name in names:
        matches = sorted(glob.glob(name, recursive=True)) if is_pattern(name) else [name]
        if not matches:
            got, advice = f"none in {brief(name)}", "the name of a file that exists"
            raise refusal("files", "one or more", got, advice)
        paths += matches
    return paths


def is_pattern(name: str) -> bool:
    """Return whether a name has wildcards and there is no file with exactly this name."""
    return PATTERN.search(name) is not None and not os.path.lexists(name)


def standard_stream(stream: Any, name: str) -> IO[bytes]:
    """Return the binary stream of sys.stdin or sys.stdout. Raise InputError if it is closed."""
    if stream is None:  # Python sets sys.stdin or sys.stdout to None if its descriptor is closed
        raise refusal(f"standard {name}", "open", "a closed stream", "a file name instead of -")
    return stream.buffer


def read_input() -> bytes:
    """Read standard input. Raise InputError if it is closed or empty."""
    data = standard_stream(sys.stdin, "input").read()
    if not data:
        raise InputError("standard input is empty. Try a file name instead of -")
    return data


def write_output(data: bytes) -> None:
    """Write to standard output. Raise InputError if it is closed."""
    stdout = standard_stream(sys.stdout, "output")
    stdout.write(data)
    stdout.flush()


@contextmanager
def reading(path: FileName, advice: str) -> Iterator[io.BufferedReader]:
    """Open a regular file for reading. Raise InputError, with advice, if it cannot be read.

    Pipes and devices are refused, because reading a pipe without a writer would wait for ever.
    """
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise OSError(errno.EINVAL, "it is not a regular file")
        descriptor = os.open(path, os.O_RDONLY | _BINARY)
    except (OSError, ValueError) as error:
        name = os.fsdecode(path)
        raise InputError(f"cannot read {name}: {reason_of(error)}. Try {advice}") from error
    with open(descriptor, "rb") as file:
        yield file


def text_of(data: bytes, name: str) -> str:
    """Return the text of a file that a user wrote, without its byte order mark.

    The text is in UTF-16 if it begins with the mark of UTF-16, as PowerShell writes it, and in
    UTF-8 otherwise. Raise InputError if it is neither.

    name  name of the file in the error message
    """
    encoding = "utf-16" if data.startswith(UTF16_MARKS) else "utf-8-sig"
    try:
        text = data.decode(encoding)
        got = "null characters" if "\0" in text else ""
    except UnicodeDecodeError as error:
        text, got = "", f"another encoding at byte {error.start + 1}"
    if got:
        raise refusal(name, "a text in UTF-8", got, "saving it as UTF-8")
    return text


def check_writable(path: FileName) -> None:
    """Raise OutputError if no file can be written at `path`. No existing file is changed."""
    target = Path(path)
    with writing(target):
        if target.is_dir():
            raise OSError(errno.EISDIR, "it is a folder")
        if target.exists() and not os.access(target, os.W_OK):
            raise OSError(errno.EACCES, "it is read-only")
        if not target.exists() or target.is_file():
            with tempfile.TemporaryFile(dir=os.path.dirname(os.path.realpath(target))):
                pass


@contextmanager
def writing(target: Path, verb: str = "write") -> Iterator[None]:
    """Turn an OSError or ValueError of the with block into an OutputError.

    The message says "cannot `verb` `target`", then the reason and advice.
    """
    try:
        yield
    except (OSError, ValueError) as error:
        message = f"cannot {verb} {target}: {reason_of(error)}. Try another name or folder"
        raise OutputError(message) from error


def make_folder(folder: Path) -> None:
    """Create a folder and its parents. Raise OutputError if they cannot be created."""
    with writing(folder, "create"):
        folder.mkdir(parents=True, exist_ok=True)


def write_atomically(path: FileName, data: bytes) -> None:
    """Write a file so that an interruption leaves either the old file or the complete new one.

    The new file is written beside the target and then renamed. The permissions of an existing file
    are kept, and a symbolic link stays a link. If the old file has other hard links, these still
    lead to the old content. Raise OutputError if the file cannot be written.
    """
    write_all_atomically({path: data})


def write_all_atomically(files: Mapping[Any, bytes]) -> None:
    """Write files as write_atomically does, but rename none of them before all are on the disk.

    If the disk is full, all old files are therefore unchanged. The files are renamed one by one.
    If a rename fails or is interrupted, the files that were renamed before are new, and the others
    are old. Pipes and devices cannot be replaced by a rename, so they are written before the
    renames. Raise OutputError for the first file that cannot be written.
    """
    for path in files:
        check_writable(path)
    parts: dict[Path, Path] = {}  # {temporary path of a regular file: its final path}
    try:
        for target, data in ((Path(name), data) for name, data in files.items()):
            with writing(target):
                if target.exists() and not target.is_file():
                    target.write_bytes(data)
                    continue
                # If the target is a symbolic link, the file to which it leads is replaced, and the
                # link stays.
                real = Path(os.path.realpath(target))
                part = real.with_name(f".{real.name[:40]}.{secrets.token_hex(6)}")
                # The part is added to `parts` before it exists, so that it is removed even if
                # writing it fails.
                parts[part] = real
                _write_new(part, data, stat.S_IMODE(real.stat().st_mode) if real.exists() else None)
        for part, target in parts.items():
            with writing(target):
                replace(part, target)
    finally:
        for part in parts:
            with suppress(OSError):  # a part that was renamed no longer exists
                os.unlink(part)


def replace(source: FileName, target: FileName) -> None:
    """Rename a file over another. On Windows, retry for 1.4 s if a program has one of them open."""
    if sys.platform == "win32":
        for pause in (0.01, 0.03, 0.1, 0.3, 1.0):  # virus scanners keep new files open for a while
            try:
                return os.replace(source, target)
            except PermissionError:
                time.sleep(pause)
    return os.replace(source, target)


def _write_new(path: Path, data: bytes, mode: int | None) -> None:
    """Create a file on the disk with the permissions `mode`, or with the usual ones for None."""
    # The permissions `mode` are set only when the file is complete. Until then, only this user can
    # read the file.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY
    with open(os.open(path, flags, 0o666 if mode is None else 0o600), "wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    if mode is not None:
        os.chmod(path, mode)


def reason_of(error: BaseException) -> str:
    """Return the reason why a file cannot be read or written, as one line of text."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return on_one_line(text).strip().rstrip(".")[:300]


def in_folder(path: FileName, name: str) -> str:
    """Return the name of an output: `path`, or the file `name` in it if it is a folder."""
    text = os.fspath(path)
    return os.path.join(text, name) if os.path.isdir(text) else text


def check_ending(name: str, path: FileName, endings: Sequence[str]) -> None:
    """Raise InputError if the name of an output has none of the endings, as in (".svg", ".svgz").

    Pipes and devices may have any name. The option in the error message is `name`.
    """
    text = os.fspath(path)
    is_device = os.path.exists(text) and not os.path.isfile(text)
    if not is_device and not text.lower().endswith(tuple(endings)):
        needed = f"a name that ends in {' or '.join(endings)}, or a folder that exists"
        advice = os.path.splitext(text.rstrip("/\\"))[0] + endings[0]
        raise refusal(name, needed, quoted(text), brief(advice))


def check_folder(path: FileName) -> None:
    """Raise InputError if the output, which becomes a folder, has the name of a file."""
    stem, ending = os.path.splitext(os.fspath(path))
    if ending.lower() in FILE_ENDINGS and not os.path.exists(path):
        raise refusal("--output", "the name of a folder", quoted(os.fspath(path)), brief(stem))


def check_outputs(inputs: Mapping[str, str], targets: Sequence[Path]) -> None:
    """Raise InputError if an output is the same file as an input or as another output.

    Raise OutputError if an output cannot be written.

    inputs   {file name: its description in error messages}, such as {"photo.jpg": "the photo"}. The
             name - stands for standard input.
    targets  paths of the outputs
    """
    descriptions = dict(inputs)
    for target in map(os.fspath, targets):
        for name, description in descriptions.items():
            if _is_same_file(name, target):
                got = f"{target}, which is also {description}"
                raise refusal("output", "a file of its own", got, "another name")
        descriptions[target] = "another output"
    for target in targets:
        check_writable(target)


def _is_same_file(name: str, other: str) -> bool:
    """Return whether two names stand for the same file, for example because of links."""
    try:
        if name == STANDARD_STREAM:  # standard input may be a file, as after `< photo.png`
            return os.path.samestat(os.fstat(sys.stdin.fileno()), os.stat(other))
        first, second = (os.path.realpath(path) for path in (name, other))
        return first == second or os.path.samefile(first, second)
    except (AttributeError, OSError, ValueError):
        return False  # one of them does not exist, or standard input is closed


def saved(save: Callable[[BinaryIO], object]) -> bytes:
    """Return the bytes that `save` writes to a stream."""
    stream = io.BytesIO()
    save(stream)
    return stream.getvalue()


def as_png(pixels: NDArray[np.floating]) -> bytes:
    """Return an image (h, w, 3) or (h, w, 4) in 0..1 as a PNG with 8 bits per channel."""
    import numpy as np
    from PIL import Image

    picture = Image.fromarray(np.round(pixels * 255).astype(np.uint8))
    return saved(lambda stream: picture.save(stream, "PNG"))


def as_json(report: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> bytes:
    """Return a report, or a list of them, as indented JSON.

    Raise ValueError if it has infinity or NaN.
    """
    return (json.dumps(report, indent=2, allow_nan=False) + "\n").encode()
