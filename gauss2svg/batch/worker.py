"""Vectorise a photo of a batch: write its SVG with the usual pipeline, and then its mark.

The mark is a JSON file in the folder MARKS. It contains the record of the photo. A later run skips
the photo if its mark shows that the SVG would be the same again.
"""

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

from gauss2svg.batch.stores import MARKS, file_system_of, is_url, write
from gauss2svg.errors import ClusterError, Gauss2SvgError, OutputError, error_line, refusal
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.svg.file import file_bytes
from gauss2svg.version import __version__

# Error numbers (errno) of a write that fails because of the file's name. The batch goes on after
# such an error, because files with other names can still be written.
_FILE_NAME_ERRNOS = {errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.EINVAL}


class PhotoRecord(NamedTuple):
    """The record of a photo: its SVG in numbers, or an error.

    input                 path or URL of the photo
    output                name of the SVG, relative to the output folder
    options               hash of the version and the options: BatchSpec.identity
    stamp                 size and date of the photo, or its version in a store. "" after an error
    width, height         size of the photo in px
    gaussians             number of Gaussians
    psnr_svg              PSNR of the SVG in dB, or None if it is infinite
    svg_bytes, svgz_bytes  bytes of the SVG, plain and gzipped
    total_s, cpu_s        seconds that the photo took, and CPU seconds of its worker in that time
    error                 reason why there is no SVG, on one line. None if the SVG was written
    unreached             a line for each target that was missed, such as a PSNR
    ssim_svg              SSIM of the SVG, -1..1
    ssimulacra2_svg, flip_svg  SSIMULACRA2 and FLIP of the SVG if RunOptions.scores is on, else None
    paint_ms              estimated time in ms that a browser takes to paint the SVG
    stop_reason           reason why the fit ended, as in the report
    error_code            class of the error, or "WorkerDied" if the worker died. None if no error
    skipped               True if an earlier run wrote the SVG
    area_count, line_count, node_count  numbers of areas, of lines, and of their nodes
    """

    input: str
    output: str
    options: str = ""
    stamp: str = ""
    width: int | None = None
    height: int | None = None
    gaussians: int | None = None
    psnr_svg: float | None = None
    svg_bytes: int | None = None
    svgz_bytes: int | None = None
    total_s: float | None = None
    cpu_s: float | None = None
    error: str | None = None
    unreached: Sequence[str] = ()
    ssim_svg: float | None = None
    paint_ms: float | None = None
    stop_reason: str | None = None
    error_code: str | None = None
    skipped: bool = False
    ssimulacra2_svg: float | None = None
    flip_svg: float | None = None
    area_count: int | None = None
    line_count: int | None = None
    node_count: int | None = None


Photo = tuple[str, str]  # path or URL of a photo, and the name of its output


def mark_of(output: str) -> str:
    """Return the name of the mark of an SVG, relative to the output folder."""
    return f"{MARKS}/{output}.json"


@cache
def versions() -> dict[str, str]:
    """Return the versions of packages that must be the same for the command and its workers."""
    return {"gauss2svg": __version__, "numpy": version("numpy")}


@dataclass(frozen=True)
class BatchSpec:
    """The settings that all photos of a batch share.

    options     options with which each photo is vectorised
    root        output folder, or its URL
    versions    versions of packages that workers must have
    identity    hash of the version of gauss2svg and of the options on which an SVG depends
    may_reduce  True if a photo that needs too much memory is fitted at a smaller size. If it is
                False, such a photo fails
    run         random name of this run, which its marks contain
    """

    options: Options
    root: str
    versions: dict[str, str]
    identity: str
    may_reduce: bool = False
    run: str = field(default_factory=partial(secrets.token_hex, 8))


def stamp_of(source: str) -> str:
    """Return text that changes when a photo changes, so that marks of the old photo are not used.

    For a local photo, the text holds the file's size and the time of its last change. For a photo
    in a store, the text is the store's identifier of the version. Raise InputError if the photo
    cannot be read.
    """
    with file_system_of(source) as (fs, path):
        return fs.ukey(path)


def finished_record(spec: BatchSpec, photo: Photo) -> PhotoRecord | None:
    """Return the record in a photo's mark if the photo's SVG is up to date, or else None."""
    # The block raises an error if there is no mark, or if a file has the name of a mark but was not
    # written by a batch. In both cases the photo must be vectorised.
    with suppress(Gauss2SvgError), file_system_of(f"{spec.root}/{photo[1]}") as (fs, path):
        with file_system_of(f"{spec.root}/{mark_of(photo[1])}") as (_, mark_path):
            mark = json.loads(fs.cat_file(mark_path))
        # If a worker dies, its job is run again. So the mark may have been written in this run,
        # before the worker died. In this case the photo counts as done and not as skipped.
        is_old = mark.pop("run") != spec.run
        record = PhotoRecord(**mark)
        expected = (*photo, spec.identity, stamp_of(photo[0]))
        size = record.svgz_bytes if spec.options.svg.gzip else record.svg_bytes
        if record[:4] == expected and size == fs.size(path):
            return record._replace(skipped=is_old)
    return None


def work(spec: BatchSpec, photos: Sequence[Photo]) -> list[PhotoRecord]:
    """Vectorise the unfinished photos of a job, and return the records of all its photos.

    Raise OutputError if no file can be written. Raise ClusterError if this worker's versions of
    packages differ from `spec.versions`.
    """
    if (installed := versions()) != spec.versions:
        advice = "installing the same there"
        raise ClusterError(f"workers must have {spec.versions}; got {installed}. Try {advice}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nobody reads the warnings of image decoders in a worker
        return [finished_record(spec, photo) or vectorize_photo(spec, photo) for photo in photos]


def vectorize_photo(spec: BatchSpec, photo: Photo) -> PhotoRecord:
    """Write the SVG of a photo, then its mark, and return the record of the photo.

    If one photo fails, its record has the error, so that the batch can go on. But if no file can be
    written any more, for example because the disk is full, raise OutputError.
    """
    begun, cpu_begun = time.perf_counter(), time.process_time()
    try:
        stamp = stamp_of(photo[0])
        record = PhotoRecord(
            *photo, spec.identity, stamp, **_write_svg(spec, photo),
            total_s=round(time.perf_counter() - begun, 3),
            cpu_s=round(time.process_time() - cpu_begun, 3),
        )  # fmt: skip
        mark = json.dumps({"run": spec.run, **record._asdict()})
        write(spec.root, mark_of(photo[1]), mark.encode(), sync=False)
        return record
    except Exception as error:  # a bug here or in a library must not stop the other photos
        cause = error.__cause__
        is_of_name = getattr(cause, "errno", None) in _FILE_NAME_ERRNOS
        # On Windows a rename fails if a path is too long, or if a program has the old file open.
        # This is a failure of one file, so the batch goes on. The attribute filename2 shows that
        # the error comes from a rename.
        if sys.platform == "win32":
            is_of_name = is_of_name or getattr(cause, "filename2", None) is not None
        if isinstance(error, OutputError) and not is_of_name:
            raise
        line = error_line(error, "--max-size, or workers with more memory")
        code = type(error).__name__
        return PhotoRecord(*photo, spec.identity, error=line, error_code=code)


def _write_svg(spec: BatchSpec, photo: Photo) -> dict[str, Any]:
    """Write the SVG of a photo, and return the entries of its record that describe the SVG."""
    options, (source, output) = spec.options, photo
    target = f"{spec.root}/{output}"
    if os.path.realpath(source) == os.path.realpath(target):
        raise refusal("output", "a file of its own", f"{target}, the photo", "another folder")
    image: Any = source
    if is_url(source):
        with file_system_of(source) as (fs, path):
            image = fs.cat_file(path)
    result = vectorize_by(options, image, may_reduce=spec.may_reduce)
    data = file_bytes(result.svg, options.svg.gzip)
    mark_url = f"{spec.root}/{mark_of(output)}"
    with file_system_of(target) as (fs, path), file_system_of(mark_url) as (_, mark):
        # An SVG without a mark may be the user's own file, so it is not overwritten. But if its
        # content equals the new SVG, it is from a run that was killed after it wrote the SVG and
        # before it wrote the mark.
        may_write = fs.exists(mark) or not fs.exists(path) or fs.cat_file(path) == data
    if not may_write:
        raise refusal("output", "a new file, or one of a batch", target, "another folder")
    write(spec.root, output, data)
    own = {"input", "output", "options", "stamp", "total_s", "cpu_s", "error", "error_code"}
    names = {*PhotoRecord._fields} - own - {"skipped"}
    return {name: result.report[name] for name in names}
