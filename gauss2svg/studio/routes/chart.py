"""The route that draws the trade of a page's runs, with the axes of all other charts."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter
from fastapi.responses import Response
from pydantic import BaseModel, Field

from gauss2svg.compare.chart import BESIDE, Point, scatter, template_environment
from gauss2svg.compare.pages.pages import COSTS
from gauss2svg.measure.scores import SCORES

_MOST_POINTS = 10_000
_AXES = {axis.key: axis for axis in SCORES}
_COSTS = {key: (title, at_tick) for key, _, title, _, at_tick in COSTS}

router = APIRouter()


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


@router.post("/api/chart", response_class=Response, summary="A chart of a score over a cost")
def draw_chart(asked: ChartAsked) -> Response:
    """A chart of a score over a cost as SVG, its points in their order."""
    axis, (title, at_tick) = _AXES[asked.score], _COSTS[asked.cost]
    points = [
        Point(one.cost, one.score, one.series, group=one.series, text=one.text)
        for one in asked.points
    ]
    svg = (
        template_environment("gauss2svg.studio")
        .get_template("chart.svg.jinja")
        .render(chart=scatter(points, at_tick, axis, BESIDE), axis=axis, cost=title)
    )
    return Response(svg, media_type="image/svg+xml")
