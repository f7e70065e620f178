"""The service as an ASGI application: photos in, progress and SVGs out."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, Response
from fastapi.routing import APIRoute
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from starlette.exceptions import HTTPException

from gauss2svg.errors import Gauss2SvgError, on_one_line
from gauss2svg.measure.heatmap import MOST, legend
from gauss2svg.photo.formats import SUFFIXES
from gauss2svg.studio import photos
from gauss2svg.studio.answers import ERRORS, Sample
from gauss2svg.studio.fits import add_fits
from gauss2svg.studio.form import form
from gauss2svg.studio.guard import Bounded
from gauss2svg.studio.jobs import Jobs
from gauss2svg.studio.results import add_results
from gauss2svg.studio.share import workers_and_threads
from gauss2svg.version import __version__

_SVG = "image/svg+xml"


class Studio(Bounded):
    """The ASGI application, and its jobs."""

    def __init__(self, app: FastAPI, jobs: Jobs) -> None:
        super().__init__(app)
        self.api, self.jobs = app, jobs


def create_app(
    jobs: int | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    *,
    is_local: bool = False,
) -> Studio:
    """The ASGI application.

    jobs     fits that run at once; None: by the cores
    threads  of each; None: the cores, shared out
    folder   whose photos can be picked; None: pictures of scikit-image
    is_local  whether it is served to its own machine only, which the page then says
    Raises InputError for more than the machine has, and for a folder without photos.
    """
    queue = Jobs(*workers_and_threads(jobs, threads))
    samples = {sample.name: sample for sample in photos.samples_in(folder)}

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        queue.start()
        try:
            yield
        finally:
            await queue.close()

    app = FastAPI(
        title="gauss2svg studio",
        version=__version__,
        description="Photos in, SVGs of Gaussians out. Errors are {'error': one line}.",
        lifespan=lifespan,
        openapi_url="/api/openapi.json",
        responses=ERRORS,
        generate_unique_id_function=lambda route: route.name.strip("_"),
        # These pages load scripts from other sites.
        docs_url=None,
        redoc_url=None,
    )
    _add_errors(app)
    _add_pages(app, queue, is_local)
    _add_photos(app, samples)
    add_fits(app, queue, samples)
    add_results(app, queue)
    for route in app.routes:
        if isinstance(route, APIRoute):
            route.summary = route.description.partition(".")[0].partition(":")[0]
    return Studio(app, queue)


def _add_errors(app: FastAPI) -> None:
    def line(status: int, text: str, headers: Any = None) -> JSONResponse:
        return JSONResponse({"error": on_one_line(text)}, status, headers)

    @app.exception_handler(HTTPException)
    async def _http(_: Request, error: HTTPException) -> Response:
        return line(error.status_code, error.detail, error.headers)

    @app.exception_handler(Gauss2SvgError)
    async def _ours(_: Request, error: Gauss2SvgError) -> Response:
        return line(422, str(error))

    @app.exception_handler(RequestValidationError)
    async def _invalid(_: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        return line(422, f"{'.'.join(map(str, first['loc']))}: {first['msg']}")

    @app.exception_handler(Exception)
    async def _bug(_: Request, error: Exception) -> Response:
        # Without the path of a file, which is private.
        what = error.strerror if isinstance(error, OSError) else error
        return line(500, f"{type(error).__name__}: {what}")


def _add_pages(app: FastAPI, queue: Jobs, is_local: bool) -> None:
    static = {
        file.name: file
        for package in ("gauss2svg.compare.pages", "gauss2svg.studio")
        for file in files(package).joinpath("static").iterdir()
    }
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(f"gauss2svg.{p}") for p in ("studio", "compare")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    kinds = {".css": "text/css", ".js": "text/javascript", ".svg": _SVG, ".txt": "text/plain"}

    @app.get("/", include_in_schema=False)
    async def _page() -> Response:
        template = environment.get_template("studio.html.jinja")
        html = template.render(
            version=__version__,
            workers=queue.workers,
            legend=legend(),
            most_levels=MOST,
            suffixes=(*SUFFIXES, *photos.REFUSED),
            is_local=is_local,
        )
        return HTMLResponse(html)

    @app.get("/static/{name}", include_in_schema=False)
    async def _static(name: str) -> Response:
        if name not in static:
            raise HTTPException(404, f"no static file {name}")
        kind = kinds.get(Path(name).suffix, "application/octet-stream")
        return Response(static[name].read_bytes(), media_type=kind)

    @app.get("/api/options")
    async def _options() -> dict[str, Any]:
        """Options by groups, with domains, defaults and help; presets; scores."""
        return form()


def _add_photos(app: FastAPI, samples: dict[str, photos.Sample]) -> None:
    @app.get("/api/samples")
    async def _samples() -> list[Sample]:
        """Pictures that can be picked in place of an upload."""
        return [
            {
                "name": sample.name,
                "url": f"api/samples/{quote(sample.name, safe='')}",
                "width": sample.width,
                "height": sample.height,
            }
            for sample in samples.values()
        ]

    @app.get("/api/samples/{name}", response_class=FileResponse)
    async def _sample(name: str) -> Response:
        """The file of a picture."""
        if name not in samples:
            raise HTTPException(404, f"no sample {name}")
        return FileResponse(samples[name].path)
