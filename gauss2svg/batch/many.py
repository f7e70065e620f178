"""Vectorise many photos: list them, submit the unfinished ones to workers, and write a table.

A worker writes the SVG of a photo with the usual pipeline, and then its mark. The mark is a JSON
file in the folder MARKS. It contains the record of the photo. A later run skips the photo if its
mark shows that the SVG would be the same again.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import json
import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from gauss2svg import errors
from gauss2svg.batch.inputs import STATE, file_system_of, is_url, passed_over, photos_of, write
from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, error_line, quoted, refusal
from gauss2svg.files import STANDARD_STREAM, as_json
from gauss2svg.options import Field, file_name
from gauss2svg.photo.pixels import Header
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.progress_display import counting
from gauss2svg.pipeline.run import memory_limit
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.pool import Pool, WorkerDiedError, completed
from gauss2svg.svg.file import file_bytes
from gauss2svg.version import __version__

TABLE = f"{STATE}/table.csv"
MARKS = f"{STATE}/marks"  # folder of the marks
# The kernels must not be called by several threads of a process, which a worker of Dask may have.
_one_at_a_time = threading.Lock()
_LOST = (WorkerDiedError, BrokenExecutor, CancelledError)  # exceptions of jobs without a worker
_EXECUTOR = "an executor of concurrent.futures"
_EXECUTORS = "ProcessPoolExecutor(), or get_executor(pure=False) of a Client of Dask"
_FORMULA = re.compile(r"'*[=+\-@\t\r]")  # beginning of text that a spreadsheet runs as a formula


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
    sketch                colours of paper and inks if the photo was drawn as a sketch, else None
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


def vectorize_many(
    sources: Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    options: Options | None = None,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = False,
    **named: Any,
) -> Iterator[PhotoRecord]:
    """Vectorise many photos, and yield the record of each when it is finished.

    sources   folders, globs, lists (.txt, .lst) and photos, as local paths or as URLs for fsspec
    output    folder for the SVGs, and the table gauss2svg-batch/table.csv
    options   options for every photo, such as Options(goal=Goal(quality="draft"))
    workers   number of processes of this machine, 1..1024. If it is None, there is one for each
              core, or as many as the memory allows
    executor  executor whose workers vectorise the photos, such as that of a cluster. If it is None,
              processes of this machine do. A worker must do one photo at a time. `workers` must
              be None then.
    progress  whether to show a bar on a terminal or in a notebook
    named     options by their names, as in `vectorize`: vectorize_many(photos, "out", seed=7)

    Photos that an earlier run has finished are skipped. Workers are started only if other photos
    are left. If a photo fails, its record has an error. Raise InputError for bad arguments, before
    any photo is read, and for an executor that takes no more jobs. Also raise it for a worker that
    has another version of gauss2svg or does not see the output folder. Raise OutputError if no file
    can be written.
    """
    if executor is not None:
        if not callable(getattr(executor, "submit", None)):
            raise refusal("executor", _EXECUTOR, quoted(executor), _EXECUTORS)
        if workers is not None:
            got = f"workers {quoted(workers)}"
            raise refusal("executor", "given without workers", got, "one of them")
    options = errors.instance(options, "options", Options).changed(**named)
    show_progress = Field("progress", bool).checked(progress)
    return Batch(sources, output, options, workers).run(executor, quiet=not show_progress)


class Batch:
    """The photos to vectorise, and the folder for their SVGs.

    summary  counts of the photos
    table    path of the table of the photos that are finished. It is written when a run ends

    The constructor checks its arguments, lists the photos, and creates the folder. It raises
    InputError if an argument is invalid, if a source has no photos, or if two photos would write
    the same file. It raises OutputError if the folder cannot be written.
    """

    def __init__(
        self,
        sources: Iterable[str | os.PathLike[str]],
        output: str | os.PathLike[str],
        options: Options,
        workers: int | None = None,
    ) -> None:
        self.options = options
        # Few machines have 1024 cores, so a larger number is probably a mistake.
        self._workers = Field("workers", int, 1, 1024, is_optional=True).checked(workers)
        Plan(options).check_renderer()
        # Marks could not tell that the code of a function has changed.
        if callable(loss := options.fit.loss):
            raise refusal("loss", "a name in a batch", quoted(loss), "vectorize for each photo")
        if isinstance(sources, (str, bytes, os.PathLike)):
            raise refusal("sources", "a sequence", quoted(sources), f"[{sources!r}]")
        names = [file_name("sources", name) for name in sources]
        root = file_name("output", output, "the name or the URL of a folder")
        if root == STANDARD_STREAM:
            raise refusal("output", "a folder", quoted(root), "-o out/")
        root = root.rstrip("/") if is_url(root) else os.path.abspath(root)
        self.table = f"{root}/{TABLE}" if is_url(root) else os.path.join(root, *TABLE.split("/"))
        text = json.dumps([__version__, options.of_picture()], sort_keys=True)
        identity = hashlib.sha256(text.encode()).hexdigest()[:16]
        # If max_memory is not set, the limit is the memory that is free now. A photo that needs
        # more fails then. It is not fitted at a smaller size, because its SVG would depend on how
        # much memory happens to be free.
        may_reduce = options.run.max_memory is not None
        self._spec = BatchSpec(options, root, identity, may_reduce)
        self._photos = self._listed(names)
        self.summary = Summary(len(self._photos), passed_over(names))
        described = as_json({"gauss2svg": __version__, "options": options.flat()})
        write(root, f"{STATE}/options-{identity}.json", described)

    def _listed(self, sources: list[str]) -> list[Photo]:
        """Return each photo once. Raise InputError if two photos would write the same file.

        Names that differ only by case are the same, because they are one file on some disks.
        """
        photos: dict[str, Photo] = {}
        clashes = list[str]()
        for path, name in photos_of(sources):
            output = name + (".svgz" if self.options.svg.gzip else ".svg")
            parts = PurePosixPath(output).parts
            if ".." in parts or parts[0] in ("/", STATE):
                needed = f"in the output folder and outside of its {STATE}"
                raise refusal("output", needed, f"{output}, of {path}", "another folder")
            # The path is made absolute, because workers may have another current folder.
            photo = path if is_url(path) else os.path.abspath(path), output
            if (other := photos.setdefault(output.casefold(), photo)) != photo:
                clashes.append(f"{other[0]} and {photo[0]}, which would both write {output}")
        if clashes:
            more = len(clashes) - 1
            got = clashes[0] + f", and {errors.several(more, 'other pair')}" * bool(more)
            advice = "renaming one, or a run with an output folder of its own for each"
            raise refusal("photos", "with outputs of their own", got, advice)
        return [*photos.values()]

    def run(self, executor: Executor | None = None, quiet: bool = True) -> Generator[PhotoRecord]:
        """Yield the records of all photos, and finally write the table.

        Workers are started only if a photo is left to vectorise.

        quiet  whether to show no progress
        """
        rows = io.StringIO()
        table = csv.writer(rows)
        table.writerow(PhotoRecord._fields)
        try:
            with counting(quiet) as update:
                update("", 0, self.summary.count)
                for record in self._records(executor):
                    row = record._replace(unreached="; ".join(record.unreached))
                    table.writerow(map(as_cell, row))
                    self.summary.add(record)
                    update(self.summary.progress_text(), self.summary.total, self.summary.count)
                    yield record
        finally:
            write(self._spec.root, TABLE, rows.getvalue().encode())

    def _records(self, executor: Executor | None) -> Iterator[PhotoRecord]:
        left: list[Photo] = []
        for photo in self._photos:
            # If the photo or the SVG is in a store, a worker makes this check, because many workers
            # can wait for the store at the same time.
            is_local = not (is_url(photo[0]) or is_url(self._spec.root))
            if is_local and (record := finished_record(self._spec, photo)):
                yield record
            else:
                left.append(photo)
        if not left:
            return
        if executor is None:
            engine = _on_this_machine(self.options, self._workers, len(left))
        else:
            # The width is larger than the number of workers, so that workers may come later.
            options = self.options.changed(threads=self.options.run.threads or 1)
            engine = nullcontext((partial(_submit, executor), 1000, options))
        with engine as (submit, width, options):
            spec = replace(self._spec, options=options)
            for photo, job in completed(partial(submit, work, spec), iter(left), width):
                try:
                    yield job.result()
                except (InputError, OutputError):
                    raise
                except Exception as error:  # not from `work`, which returns most errors
                    advice = "--max-size or fewer --workers, which take less memory"
                    line, code = error_line(error, advice), type(error).__name__
                    # KilledWorker is Dask's exception, which may not be installed.
                    if isinstance(error, _LOST) or code == "KilledWorker":
                        line, code = f"its worker died ({line}). Try {advice}", "WorkerDied"
                    start: Any = (*photo, spec.identity)
                    yield PhotoRecord(*start, error=line, error_code=code)


def _submit(executor: Executor, *job: Any) -> Future[Any]:
    """Submit a job, and return its future. Raise InputError if the executor does not take it."""
    try:
        future = executor.submit(*job)
    except Exception as error:  # a shut-down or broken executor, or one with another interface
        got, advice = error_line(error, ""), "a new one, which continues the batch"
        raise refusal("executor", "able to take jobs", got, advice) from error
    if not isinstance(future, Future):
        got = f"one with futures of {type(future).__module__}"
        raise refusal("executor", _EXECUTOR, got, _EXECUTORS)
    return future


# A method that submits a job, the number of photos that are submitted at the same time, and the
# options of the workers.
_Workers = tuple[Callable[..., Future[Any]], int, Options]


@contextmanager
def _on_this_machine(options: Options, workers: int | None, photos: int) -> Iterator[_Workers]:
    """Yield worker processes of this machine.

    If `workers` is None, there are as many processes as cores. There are fewer if the options set
    a number of threads for each, if there are fewer photos, or if the memory is not enough. A
    process is assumed to need the memory for a photo of usual size, or the value of max_memory if
    that is larger. If max_memory is not set, the processes share the memory equally.
    """
    from gauss2svg.pipeline.run import load_of, thread_count

    usual = Header(4000, 3000, has_alpha=False)  # 12 megapixels, like a photo from a camera
    cores, free = thread_count(None), memory_limit(None)
    threads, memory = options.run.threads, options.run.max_memory
    needed = max(load_of(Plan(options), usual).bytes, int(memory or 0))
    workers = workers or max(1, min(cores // (threads or 1), free // needed, photos))
    memory = memory or free // workers
    threads = threads or max(1, cores // workers)
    with Pool(workers) as pool:
        job_options = options.changed(threads=threads, max_memory=memory)
        # Two jobs are submitted for each process, so that one waits while the other runs.
        yield pool.submit, 2 * workers, job_options


class Summary:
    """Counts of the photos of a batch: all, and those done, skipped and failed so far."""

    def __init__(self, count: int, passed_over: str = "") -> None:
        self.count, self._passed_over = count, passed_over
        self.total = self.done = self.skipped = self.failed = 0
        self._failures: list[str] = []  # lines about the first five photos that failed
        self._begun = time.monotonic()

    def add(self, record: PhotoRecord) -> None:
        """Count the photo of a record as done, skipped or failed."""
        self.total += 1
        self.done += not (record.error or record.skipped)
        self.skipped += record.skipped
        self.failed += record.error is not None
        if record.error and len(self._failures) < 5:
            self._failures.append(f"failed: {errors.of_file(record.input, record.error)}")

    def progress_text(self) -> str:
        """Return text with the speed, the failures and the remaining time."""
        seconds = (time.monotonic() - self._begun) / max(1, self.done + self.failed)
        left = timedelta(seconds=round(seconds * (self.count - self.total)))
        return f"{seconds:.3g} s a photo, {self.failed:,} failed, {left} left"

    def lines(self) -> Iterator[str]:
        """Yield the lines of the final summary."""
        counts = f"{self.done:,} done, {self.skipped:,} skipped, {self.failed:,} failed"
        yield f"{counts} in {time.monotonic() - self._begun:.1f} s"
        if self._passed_over:
            yield self._passed_over
        yield from self._failures
        if more := self.failed - len(self._failures):
            yield f"and {more:,} more"


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

    Raise OutputError if the disk is full. Raise InputError if this worker has another version or
    does not see the output folder.
    """
    if spec.version != __version__:
        raise InputError(f"workers must have gauss2svg {spec.version}; got {__version__}")
    if not (is_url(spec.root) or os.path.isdir(spec.root)):
        raise InputError(f"workers must see the folder {spec.root}. Try a folder that all mount")
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
        report = _write_svg(spec, photo)
        report["total_s"] = round(time.perf_counter() - begun, 3)
        report["cpu_s"] = round(time.process_time() - cpu_begun, 3)
        numbers = {name: report[name] for name in PhotoRecord._fields if name in report}
        record = PhotoRecord(*photo, spec.identity, stamp, **numbers)
        write(spec.root, f"{MARKS}/{photo[1]}.json", json.dumps(record._asdict()).encode())
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
    """Write the SVG of a photo, and return its report."""
    source, output = photo
    target = f"{spec.root}/{output}"
    if os.path.realpath(source) == os.path.realpath(target):
        raise refusal("output", "a file of its own", f"{target}, the photo", "another folder")
    image: Any = source
    if is_url(source):
        with file_system_of(source) as (fs, path):
            image = fs.cat_file(path)
    result = vectorize_by(spec.options, image, may_reduce=spec.may_reduce)
    data = file_bytes(result.svg, spec.options.svg.gzip)
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
    return result.report


def as_cell(value: Any) -> Any:
    """Return a value as a CSV cell, which `text_of_cell` turns back into the text.

    An apostrophe is put before text that begins like a formula, so that no spreadsheet runs it.
    Source: OWASP, "CSV Injection".
    """
    if not isinstance(value, str):
        return value
    # A file name may have bytes that are not valid Unicode. They are escaped.
    text = value if value.isascii() else value.encode(errors="backslashreplace").decode()
    return f"'{text}" if _FORMULA.match(text) else text


def text_of_cell(cell: str) -> str:
    """Return the text of a CSV cell without the apostrophe that `as_cell` puts before it."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
