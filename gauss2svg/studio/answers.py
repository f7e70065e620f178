"""The JSON that the service answers with, as its OpenAPI document describes it."""

from __future__ import annotations

from typing import Any, Literal

from typing_extensions import TypedDict  # pydantic's condition before Python 3.12


class State(TypedDict):
    """A job; lines are the command and the Python that make the same file."""

    id: str
    state: str  # queued, running, done, stopped, failed or canceled
    place: int
    progress: dict[str, Any] | None
    report: dict[str, Any] | None
    error: str | None
    name: str
    width: int | None
    height: int | None
    options: dict[str, Any]
    lines: dict[str, str]


class Estimate(TypedDict):
    """What a run will give; psnr in dB, None without Gaussians."""

    gaussians: int
    bytes: int
    gzip_bytes: int
    seconds: float
    psnr: float | None
    based_on: Literal["rule", "runs"]


class Sample(TypedDict):
    """A picture to pick; width and height in px."""

    name: str
    url: str
    width: int
    height: int


class Error(TypedDict):
    """Why a request was refused, in one line."""

    error: str


_STATUSES = {
    400: "a body that is no form with a file",
    401: "no token",
    403: "a page of another site",
    404: "no such job, or forgotten",
    408: "an upload that came too slowly",
    409: "a job without an SVG",
    413: "too many bytes",
    421: "another name of the machine",
    422: "a photo or options that cannot be used",
    429: "the line is full; Retry-After has the seconds",
    507: "no room on the disk",
}
ERRORS: dict[int | str, dict[str, Any]] = {
    status: {"model": Error, "description": why} for status, why in _STATUSES.items()
}
