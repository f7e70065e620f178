"""What a worker does with a shard: every photo by the same pipeline as the command's.

A worker process of this machine imports this module by name before it takes up work.
"""

from __future__ import annotations

import errno
import hashlib
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from gauss2svg.batch.records import (
    FOLDER,
    BatchPhoto,
    BatchSpec,
    PhotoRecord,
    ShardRecord,
    kept,
    versions,
)
from gauss2svg.batch.stores import Store, is_url, opened, reason_of, stamp_of
from gauss2svg.errors import (
    ClusterError,
    Gauss2SvgError,
    InputError,
    OutputError,
    RendererError,
    error_line,
)
from gauss2svg.measure.memory import SHARE
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.svg.file import file_bytes

_OF_REPORT = (
    "width", "height", "gaussians", "psnr_svg", "ssim_svg", "paint_ms", "stop_reason",
)  # fmt: skip
# Why a file of one name cannot be written where others can.
_OF_ITS_NAME = {
    errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.EXDEV, errno.EINVAL,
}  # fmt: skip
# Seconds after which a shard's other photos are handed back, so that progress is seen and no worker
# is alone at the end with many photos.
SHARD_S = 15.0
# Output folders for which this worker is as it must be.
_checked: set[tuple[Store, bytes | None]] = set()


@dataclass(frozen=True)
class Shard:
    """Photos that one task works on, and the key of their record.

    deaths   workers that died at a photo which is alone here
    refusals times that an output could not be written; losses: that a worker died before it began
    """

    key: str
    photos: tuple[BatchPhoto, ...]
    deaths: int = 0
    refusals: int = 0
    losses: int = 0


@dataclass(frozen=True)
class ShardResult:
    """What became of a shard.

    records   of its photos so far
    has_died  whether another worker has died at it, and nothing was done here
    refused   why an output could not be written
    Photos without a record are to be worked on again.
    """

    records: tuple[PhotoRecord, ...]
    has_died: bool = False
    refused: str | None = None


def dask_setup(_: Any) -> None:
    """Ignore Ctrl-C, and Ctrl-Break of Windows: at a terminal they reach all its processes.

    Dask calls it in workers of this machine, which the driver ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "win32":
        signal.signal(signal.SIGBREAK, signal.SIG_IGN)


def work(spec: BatchSpec, shard: Shard) -> ShardResult:
    """Vectorise the photos of a shard in order, until time is up; write their SVGs and records.

    A shard that was begun and neither ended nor handed back has killed its worker: it is not begun
    again, but answered with what was recorded. Raises ClusterError where this process cannot do it.
    """
    check_worker(spec)
    begun = time.monotonic()
    found: list[PhotoRecord] = []
    record = None
    try:
        record = ShardRecord(spec.store, shard.key)
        if record.begun:
            return ShardResult(tuple(record.done.values()), has_died=True)
        earlier = set(record.done)
        found += [r for photo in shard.photos if (r := record.done.get(photo.output)) is not None]
        options = _within_memory(spec.options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of decoders; nobody would read them
            for photo in shard.photos:
                if photo.output in earlier:
                    continue
                found.append(vectorize_photo(spec, options, photo, record.begin))
                if photo.prior is None or found[-1].line() != photo.prior.line():
                    record.add(found[-1])
                if time.monotonic() - begun > SHARD_S:
                    break
        record.end()
    except OutputError as error:
        if record is not None:
            # It is begun no more, and lines held back are kept. The first error says why.
            with suppress(OutputError):
                record.end()
        return ShardResult(tuple(found), refused=str(error))
    return ShardResult(tuple(found))


def check_worker(spec: BatchSpec, dask_worker: Any = None) -> None:
    """Raise ClusterError, once for each output folder, where this worker cannot do the work.

    It must have the versions of the driver, one thread, the renderer, and see the output folder.
    dask_worker  given by Dask outside of tasks
    """
    from distributed import get_worker

    if (spec.store, spec.folder) in _checked:
        return
    worker, found = dask_worker or get_worker(), versions()
    where = f"worker {worker.address}"
    for name, wanted in spec.versions.items():
        if found.get(name) != wanted:
            raise ClusterError(
                f"{name} of {where} must be {wanted}, as here; got {found.get(name)}. Try "
                f"installing {name} {wanted} there"
            )
    if (threads := worker.state.nthreads) != 1:
        raise ClusterError(
            f"threads of {where} must be 1; got {threads}. Try dask worker --nthreads 1"
        )
    try:
        Plan(spec.options).check_renderer()
    except RendererError as error:
        raise ClusterError(f"{where}: {error}") from error
    if spec.store.read(FOLDER) != spec.folder:
        raise ClusterError(
            f"output must be a folder that all workers see; got another {spec.store.root} at "
            f"{where}. Try a shared folder or a store"
        )
    _checked.add((spec.store, spec.folder))


def cannot_run(where: str, error: BaseException, spec: BatchSpec) -> ClusterError:
    """The error for a worker that failed at what is no photo's fault."""
    return ClusterError(
        f"{where} cannot run gauss2svg: {type(error).__name__}: {reason_of(error)}. "
        f"Try installing gauss2svg {spec.versions['gauss2svg']} there and for the scheduler"
    )


def vectorize_photo(
    spec: BatchSpec, options: Options, photo: BatchPhoto, begin: Callable[[], None] = lambda: None
) -> PhotoRecord:
    """What becomes of a photo; raises OutputError alone, where no output can be written.

    begin  called before anything at which a worker may die
    """
    begun, cpu_begun = time.perf_counter(), time.process_time()
    stamp = digest = ""
    made: dict[str, Any]
    try:
        stamp = stamp_of(photo.path)
        if (record := kept(spec, photo, stamp)) is not None:
            return record
        digest = _digest(photo.path)
        if (record := kept(spec, photo, stamp, digest)) is not None:
            return record
        begin()
        made = _vectorized(spec, options, photo)
    except Gauss2SvgError as error:
        is_of_its_name = getattr(error.__cause__, "errno", None) in _OF_ITS_NAME
        if isinstance(error, OutputError) and not (spec.store.is_local and is_of_its_name):
            raise
        made = _failure(error, str(error))
    except MemoryError as error:
        advice = "Try --max-size, or workers with more memory"
        made = _failure(error, f"out of memory ({error}). {advice}")
    except Exception as error:  # a fault of ours or of a library costs no other photo
        made = _failure(error, f"{type(error).__name__}: {error}")
    made["seconds"] = round(time.perf_counter() - begun, 3)
    made["cpu_seconds"] = round(time.process_time() - cpu_begun, 3)
    return spec.record(photo, stamp=stamp, sha256=digest, **made)


def _failure(error: Exception, line: str) -> dict[str, Any]:
    return {"error": error_line(line), "error_code": type(error).__name__}


def _digest(path: str) -> str:
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()  # pyright: ignore[reportArgumentType]


def _vectorized(spec: BatchSpec, options: Options, photo: BatchPhoto) -> dict[str, Any]:
    """Write the SVG of a photo; returns entries of its record."""
    store = spec.store
    # Memory that happens to be free now must not change a file.
    may_reduce = spec.options.run.max_memory is not None
    target = store.path(photo.output)
    if photo.path == target or (store.is_local and os.path.realpath(photo.path) == target):
        raise InputError(
            f"output must be a file of its own; got {target}, which is also the photo. Try "
            "another folder"
        )
    if is_url(photo.path):
        with opened(photo.path) as file:
            result = vectorize_by(options, file, may_reduce=may_reduce)
    else:
        result = vectorize_by(options, photo.path, may_reduce=may_reduce)
    data, report = file_bytes(result.svg, options.svg.gzip), result.report
    store.write(photo.output, data)
    return {
        **{name: report[name] for name in _OF_REPORT},
        "unreached": report["unreached"],
        "bytes": len(data),
    }


def _within_memory(options: Options) -> Options:
    """The options, with the memory that this worker may take where none is given."""
    from distributed import get_worker

    if options.run.max_memory is not None:
        return options
    most = allowed(None)
    limit = getattr(get_worker().memory_manager, "memory_limit", None)
    return options.changed(max_memory=min(most, int(SHARE * limit)) if limit else most)
