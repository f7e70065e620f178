"""The JSON of the service, and the fields of its form, as its OpenAPI document describes them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import UploadFile
from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, computed_field


class PhotoForm(BaseModel):
    """A photo, given in one of three ways, and the options of its run."""

    photo: Annotated[UploadFile | None, WithJsonSchema({"type": "string", "format": "binary"})] = (
        Field(None, description="the file of a photo")
    )
    sample: str = Field("", description="or a name of /api/samples")
    of: str = Field("", description="or the id of a job, whose photo is taken again")
    options: str = Field("{}", description="JSON of options of /api/options")
    keep: bool = Field(False, description="run on when nobody reads its events any more")


class JobState(BaseModel):
    """A job; lines are the command and the Python that make the same file."""

    model_config = ConfigDict(from_attributes=True)

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


class Sample(BaseModel):
    """A picture that can be picked; width and height in px."""

    name: str
    path: Path = Field(exclude=True)
    width: int
    height: int

    @computed_field
    @property
    def url(self) -> str:
        """Address of its file, relative to the page."""
        return f"api/samples/{quote(self.name, safe='')}"


class Error(BaseModel):
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
