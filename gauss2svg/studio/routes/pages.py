"""Routes of the page: itself, its files, its options, the pictures that it offers, its chart."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request
from fastapi.responses import FileResponse, HTMLResponse, Response
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from gauss2svg.compare.chart import BESIDE, COSTS, Point, scatter, template_environment
from gauss2svg.errors import InputError
from gauss2svg.measure.heatmap import MOST, legend
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.formats import SUFFIXES
from gauss2svg.studio.options import form
from gauss2svg.studio.routes import AllJobs, KnownSample, Samples, parsed, validated
from gauss2svg.studio.uploads import REFUSED, Sample
from gauss2svg.version import __version__

router = APIRouter()
_STATIC = {
    file.name: file
    for package in ("gauss2svg.compare.pages", "gauss2svg.studio")
    for file in files(package).joinpath("static").iterdir()
}
# Not Python's own, which systems can change: a browser runs no script of another kind.
_KINDS = {
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
_TEMPLATES = template_environment("gauss2svg.compare.pages", "gauss2svg.studio")
_MOST_POINTS = 10_000  # of a chart
_MOST_CHART = 4_000_000  # bytes of what it is drawn of
_AXES = {axis.key: axis for axis in SCORES}
_COSTS = {key: (title, at_tick) for key, _, title, _, at_tick in COSTS}


@router.get("/", include_in_schema=False)
async def page(request: Request, jobs: AllJobs) -> HTMLResponse:
    """The studio's page."""
    html = _TEMPLATES.get_template("studio.html.jinja").render(
        version=__version__,
        workers=jobs.workers,
        legend=legend(),
        most_levels=MOST,
        suffixes=(*SUFFIXES, *REFUSED),
        is_local=request.app.state.is_local,
    )
    return HTMLResponse(html)


@router.get("/static/{name}", include_in_schema=False)
async def static(name: str) -> Response:
    """A style sheet, a script, or a licence."""
    if name not in _STATIC:
        raise HTTPException(404, f"no static file {name}")
    kind = _KINDS.get(Path(name).suffix, "application/octet-stream")
    return Response(_STATIC[name].read_bytes(), media_type=kind)


@router.get("/api/options")
async def options() -> dict[str, Any]:
    """Options by groups, with domains, defaults and help; presets; scores."""
    return form()


@router.get("/api/samples", name="samples", response_model=list[Sample])
async def listed_samples(samples: Samples) -> Collection[Sample]:
    """Pictures that can be picked in place of an upload."""
    return samples.values()


@router.get("/api/samples/{name}", response_class=FileResponse)
async def sample(sample: KnownSample) -> FileResponse:
    """The file of a picture."""
    return FileResponse(sample.path)


class PointAsked(BaseModel):
    """A run: its cost, its score, None where the pictures are equal, its series and tooltip."""

    cost: Annotated[float, Field(ge=1e-9, le=1e15)]
    score: Annotated[float, Field(ge=-1e6, le=1e6)] | None
    series: Annotated[int, Field(ge=0, le=1e6)]
    text: Annotated[str, Field(max_length=1000)]


class ChartAsked(BaseModel):
    """What a chart is drawn of: the names of a report for its two axes, and runs."""

    score: Literal[tuple(_AXES)]  # pyright: ignore[reportInvalidTypeForm]
    cost: Literal[tuple(_COSTS)]  # pyright: ignore[reportInvalidTypeForm]
    points: Annotated[list[PointAsked], Field(min_length=1, max_length=_MOST_POINTS)]


def _body_of_chart() -> dict[str, Any]:
    schema = ChartAsked.model_json_schema()
    # In place: a reference would be looked for in the whole document.
    schema["properties"]["points"]["items"] = schema.pop("$defs")[PointAsked.__name__]
    content = {"application/json": {"schema": schema}}
    return {"requestBody": {"required": True, "content": content}}


async def _object_of_body(request: Request) -> dict[str, Any]:
    """Return the JSON object of a body; raise InputError for one over _MOST_CHART bytes."""
    read = bytearray()
    async for chunk in request.stream():
        read += chunk
        if len(read) > _MOST_CHART:
            raise InputError(f"the body must be at most {_MOST_CHART} bytes; got more. Try less")
    text = read.decode(errors="replace")
    found = await asyncio.to_thread(parsed, "the body", text, _MOST_CHART)
    if not isinstance(found, dict):
        raise InputError(f"the body must be an object; got {type(found).__name__}")
    return found


@router.post("/api/chart", response_class=Response, openapi_extra=_body_of_chart())
def draw_chart(
    given: Annotated[dict[str, Any], Depends(_object_of_body)],
) -> Response:
    """A chart of a score over a cost as SVG, its points in their order."""
    asked = validated(ChartAsked, given)
    axis, (title, at_tick) = _AXES[asked.score], _COSTS[asked.cost]
    points = [
        Point(one.cost, one.score, one.series, group=one.series, text=one.text)
        for one in asked.points
    ]
    svg = _TEMPLATES.get_template("chart.svg.jinja").render(
        chart=scatter(points, at_tick, axis, BESIDE), axis=axis, cost=title
    )
    return Response(svg, media_type="image/svg+xml")
