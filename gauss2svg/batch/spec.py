"""What all photos of a batch share, and whether what an earlier run made of one still holds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec

from gauss2svg.batch.records import PhotoRecord, all_versions, limits_of
from gauss2svg.batch.stores import Store, is_url, stamp_of
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline.options import Options


class BatchPhoto(msgspec.Struct, frozen=True):
    """A photo of a batch: its path or URL, its output's name, and what an earlier run recorded."""

    path: str
    output: str
    prior: PhotoRecord | None = None


@dataclass(frozen=True)
class BatchSpec:
    """What all photos share.

    identity  of the options; folder: content of FOLDER, by which workers know the output folder
    """

    options: Options
    store: Store
    versions: dict[str, str]
    identity: str
    folder: bytes | None = None
    retry_failed: bool = False

    @cached_property
    def limits(self) -> str:
        """Identity of all options, which a failure depends on."""
        return limits_of(self.options)

    def record(self, photo: BatchPhoto, **found: Any) -> PhotoRecord:
        """The record of a photo that was worked on, with what became of it."""
        return PhotoRecord(
            input=photo.path,
            output=photo.output,
            options=self.identity,
            limits=self.limits if "error" in found else "",
            versions=all_versions(),
            **found,
        )


def kept(spec: BatchSpec, photo: BatchPhoto, stamp: str, digest: str = "") -> PhotoRecord | None:
    """The earlier record of a photo, where the photo would become the same again; else None.

    stamp  of its file now; digest: SHA-256 of its bytes, which tells where the stamp does not
    The record must be of the same options and its output there. One of a failure must be of the
    same limits too, and is not kept where failures are taken up.
    """
    prior = photo.prior
    if prior is None or prior.options != spec.identity:
        return None
    is_named = prior.input == photo.path
    is_same = digest == prior.sha256 if digest else is_named and stamp == prior.stamp != ""
    if not is_same:
        return None
    if prior.error is not None:
        holds = is_named and prior.limits == spec.limits and not spec.retry_failed
    else:
        holds = spec.store.size(photo.output) == prior.bytes is not None
    if not holds:
        return None
    return msgspec.structs.replace(prior, input=photo.path, stamp=stamp, skipped=True)


def unchanged(spec: BatchSpec, photo: BatchPhoto) -> PhotoRecord | None:
    """The earlier record of a photo of this machine that holds by its stamp, unread; else None.

    A worker decides about all others, and where the photo or its output cannot be looked at.
    """
    if photo.prior is None or is_url(photo.path) or not spec.store.is_local:
        return None
    try:
        return kept(spec, photo, stamp_of(photo.path))
    except (InputError, OutputError):
        return None
