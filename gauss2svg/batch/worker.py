"""Vectorise a photo of a batch: write its SVG with the usual pipeline, and then its mark.

The mark is a JSON file in the folder MARKS. It contains the record of the photo. A later run skips
the photo if its mark shows that the SVG would be the same again.
"""

from __future__ import annotations

import errno
import json
import os
import threading
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

from gauss2svg.batch.stores import STATE, file_system_of, is_url, write
from gauss2svg.errors import ClusterError, Gauss2SvgError, OutputError, error_line, refusal
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.svg.file import file_bytes
from gauss2svg.version import __version__

MARKS = f"{STATE}/marks"  # folder of the marks
# The kernels must not be called by several threads of a process, which a worker of Dask may have.
_one_at_a_time = threading.Lock()


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
    sketch                colours of paper and ink if the photo was drawn as a sketch, else None
    psnr_photo            PSNR in dB against the photo. For a sketch, psnr_svg leaves out its paper
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
    sketch: str | None = None
    psnr_photo: float | None = None


Photo = tuple[str, str]  # path or URL of a photo, and the name of its output


@dataclass(frozen=True)
class BatchSpec:
    """The settings that all photos of a batch share.

    options     options with which each photo is vectorised
    root        output folder, or its URL
    identity    hash of the version of gauss2svg and of the options on which an SVG depends
    may_reduce  True if a photo that needs too much memory is fitted at a smaller size. If it is
                False, such a photo fails
    version     version of gauss2svg, which each worker must have
    """

    options: Options
    root: str
    identity: str
    may_reduce: bool = False
    version: str = __version__


def work(spec: BatchSpec, photo: Photo) -> PhotoRecord:
    """Vectorise a photo unless it is finished, and return its record.

    Raise OutputError if the disk is full. Raise ClusterError if this worker has another version or
    does not see the output folder.
    """
    if spec.version != __version__:
        raise ClusterError(f"workers must have gauss2svg {spec.version}; got {__version__}")
    if not (is_url(spec.root) or os.path.isdir(spec.root)):
        raise ClusterError(f"workers must see the folder {spec.root}. Try a folder that all mount")
    with _one_at_a_time, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nobody reads the warnings of image decoders in a worker
        return finished_record(spec, photo) or vectorize_photo(spec, photo)


def finished_record(spec: BatchSpec, photo: Photo) -> PhotoRecord | None:
    """Return the record in a photo's mark if the photo's SVG is up to date, or else None."""
    # An error means that there is no mark, or that a batch did not write it.
    with (
        suppress(Gauss2SvgError),
        file_system_of(f"{spec.root}/{photo[1]}") as (fs, path),
        file_system_of(_mark_of(spec, photo)) as (_, mark),
    ):
        record = PhotoRecord(**json.loads(fs.cat_file(mark)))
        size = record.svgz_bytes if spec.options.svg.gzip else record.svg_bytes
        expected = (*photo, spec.identity, _stamp_of(photo[0]))
        if record[:4] == expected and size == fs.size(path):
            return record._replace(skipped=True)
    return None


def vectorize_photo(spec: BatchSpec, photo: Photo) -> PhotoRecord:
    """Write the SVG of a photo, then its mark, and return the record of the photo.

    If one photo fails, its record has the error, so that the batch can go on. But if the disk is
    full, raise OutputError, because the other photos would fail too.
    """
    begun, cpu_begun = time.perf_counter(), time.process_time()
    try:
        stamp = _stamp_of(photo[0])
        record = PhotoRecord(
            *photo, spec.identity, stamp, **_write_svg(spec, photo),
            total_s=round(time.perf_counter() - begun, 3),
            cpu_s=round(time.process_time() - cpu_begun, 3),
        )  # fmt: skip
        mark = json.dumps(record._asdict())
        write(spec.root, f"{MARKS}/{photo[1]}.json", mark.encode())
        return record
    except Exception as error:  # a bug here or in a library must not stop the other photos
        is_full = getattr(error.__cause__, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
        if isinstance(error, OutputError) and is_full:
            raise
        line = error_line(error, "--max-size, or workers with more memory")
        code = type(error).__name__
        return PhotoRecord(*photo, spec.identity, error=line, error_code=code)


def _mark_of(spec: BatchSpec, photo: Photo) -> str:
    return f"{spec.root}/{MARKS}/{photo[1]}.json"


def _stamp_of(source: str) -> str:
    """Return text that changes when a photo changes, so that marks of the old photo are not used.

    For a local photo, the text holds the file's size and the time of its last change. For a photo
    in a store, the text is the store's identifier of the version. Raise InputError if the photo
    cannot be read.
    """
    with file_system_of(source) as (fs, path):
        return fs.ukey(path)


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
    with (
        file_system_of(target) as (fs, path),
        file_system_of(_mark_of(spec, photo)) as (_, mark),
    ):
        # An SVG without a mark may be the user's own file, so it is not overwritten. But if its
        # content equals the new SVG, it is from a run that was killed before it wrote the mark.
        may_write = fs.exists(mark) or not fs.exists(path) or fs.cat_file(path) == data
    if not may_write:
        raise refusal("output", "a new file, or one of a batch", target, "another folder")
    write(spec.root, output, data)
    own = {"input", "output", "options", "stamp", "total_s", "cpu_s", "error", "error_code"}
    names = {*PhotoRecord._fields} - own - {"skipped"}
    return {name: result.report[name] for name in names}
