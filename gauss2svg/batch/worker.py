"""What becomes of a photo: its SVG by the same pipeline as the command's, and its mark."""

from __future__ import annotations

import errno
import json
import os
import secrets
import sys
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.metadata import version
from typing import Any, NamedTuple

from gauss2svg.batch.stores import is_url, reached, write
from gauss2svg.errors import ClusterError, Gauss2SvgError, OutputError, error_line, refusal
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.svg.file import file_bytes
from gauss2svg.version import __version__

MARK = ".gauss2svg.json"  # after the name of an SVG: the name of its mark
_OF_REPORT = {"width", "height", "gaussians", "psnr_svg", "ssim_svg", "paint_ms", "stop_reason"}
# Why a file of one name cannot be written where others can.
_OF_ITS_NAME = {errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.EINVAL}


class PhotoRecord(NamedTuple):
    """What became of a photo.

    input                 path or URL of the photo
    output                name of the SVG, relative to the output folder
    options               identity of the version and the options
    stamp                 size and date of the photo, or what the store says; empty of a failure
    width, height         px of the photo
    gaussians, bytes      of the SVG
    psnr_svg              dB, None where it is infinite
    seconds, cpu_seconds  that the photo took, of the clock and of its worker's cores
    error                 why there is no SVG, one line; None where it is written
    unreached             targets that were missed
    ssim_svg              -1..1
    paint_ms              estimate of what a browser takes to paint it
    stop_reason           why the fit ended, as in the report
    error_code            class of the error, such as InputError, or WorkerDied; None without
    skipped               True where an earlier run wrote it
    """

    input: str
    output: str
    options: str = ""
    stamp: str = ""
    width: int | None = None
    height: int | None = None
    gaussians: int | None = None
    psnr_svg: float | None = None
    bytes: int | None = None
    seconds: float | None = None
    error: str | None = None
    unreached: Sequence[str] = ()
    ssim_svg: float | None = None
    paint_ms: float | None = None
    stop_reason: str | None = None
    cpu_seconds: float | None = None
    error_code: str | None = None
    skipped: bool = False


Photo = tuple[str, str]  # its path or URL, and the name of its output


@cache
def versions() -> dict[str, str]:
    """Return the versions that workers must have as the command has them."""
    return {"gauss2svg": __version__} | {name: version(name) for name in ("numba", "numpy")}


@dataclass(frozen=True)
class BatchSpec:
    """What all photos share: options, the output folder, and versions that workers must have.

    identity    hash of the version and of the options on which an SVG depends
    may_reduce  whether a photo is fitted smaller where memory is short, else it fails
    run         random name of this run, which is in its marks
    """

    options: Options
    root: str
    versions: dict[str, str]
    identity: str
    may_reduce: bool = False
    run: str = field(default_factory=partial(secrets.token_hex, 8))


def stamp_of(source: str) -> str:
    """Return what changes with a photo: size and date, or what a store says. Raise InputError."""
    with reached(source) as (fs, path):
        return fs.ukey(path)


def kept(spec: BatchSpec, photo: Photo) -> PhotoRecord | None:
    """Return the record of a photo that would become the same again; None of any other."""
    # An error is a mark that is not there or none of ours: the photo is done again.
    with suppress(Gauss2SvgError), reached(f"{spec.root}/{photo[1]}") as (fs, path):
        mark = json.loads(fs.cat_file(path + MARK))
        # A photo of this run whose answer was lost with its worker is done, and not skipped.
        is_old = mark.pop("run") != spec.run
        record = PhotoRecord(**mark)
        as_now = (*photo, spec.identity, stamp_of(photo[0]))
        if record[:4] == as_now and record.bytes == fs.size(path):
            return record._replace(skipped=is_old)
    return None


def work(spec: BatchSpec, photos: Sequence[Photo]) -> list[PhotoRecord]:
    """Return what becomes of photos. Raise OutputError where no output can be written."""
    if (here := versions()) != spec.versions:
        advice = "installing the same there"
        raise ClusterError(f"workers must have {spec.versions}; got {here}. Try {advice}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of decoders; nobody would read them
        return [kept(spec, photo) or vectorized(spec, photo) for photo in photos]


def vectorized(spec: BatchSpec, photo: Photo) -> PhotoRecord:
    """Write the SVG of a photo, then its mark, and return what became of it."""
    begun, cpu_begun = time.perf_counter(), time.process_time()
    try:
        stamp = stamp_of(photo[0])
        record = PhotoRecord(
            *photo, spec.identity, stamp, **_written(spec, photo),
            seconds=round(time.perf_counter() - begun, 3),
            cpu_seconds=round(time.process_time() - cpu_begun, 3),
        )  # fmt: skip
        mark = json.dumps({"run": spec.run, **record._asdict()})
        write(spec.root, photo[1] + MARK, mark.encode(), sync=False)
        return record
    except Exception as error:  # a fault of ours or of a library costs no other photo
        cause = error.__cause__
        is_of_name = getattr(cause, "errno", None) in _OF_ITS_NAME
        if sys.platform == "win32":  # by a rename: its path is too long, or the old file is open
            is_of_name = is_of_name or getattr(cause, "filename2", None) is not None
        if isinstance(error, OutputError) and not is_of_name:
            raise
        line, code = str(error), type(error).__name__
        if isinstance(error, MemoryError):
            line = f"out of memory ({line}). Try --max-size, or workers with more memory"
        elif not isinstance(error, Gauss2SvgError):
            line = f"{code}: {line}"
        return PhotoRecord(*photo, spec.identity, error=error_line(line), error_code=code)


def _written(spec: BatchSpec, photo: Photo) -> dict[str, Any]:
    """Write the SVG of a photo, and return entries of its record."""
    options, (source, output) = spec.options, photo
    target = f"{spec.root}/{output}"
    if os.path.realpath(source) == os.path.realpath(target):
        raise refusal("output", "a file of its own", f"{target}, the photo", "another folder")
    image: Any = source
    if is_url(source):
        with reached(source) as (fs, path):
            image = fs.cat_file(path)
    result = vectorize_by(options, image, may_reduce=spec.may_reduce)
    data = file_bytes(result.svg, options.svg.gzip)
    with reached(target) as (fs, path):
        # A run that was killed may have left its SVG without a mark.
        is_ours = fs.exists(path + MARK) or not fs.exists(path) or fs.cat_file(path) == data
    if not is_ours:
        raise refusal("output", "a new file, or one of a batch", target, "another folder")
    write(spec.root, output, data)
    of_report = {name: result.report[name] for name in _OF_REPORT}
    return of_report | {"bytes": len(data), "unreached": result.report["unreached"]}
