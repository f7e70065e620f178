"""A web service that answers a photo by an SVG; it needs fastapi and uvicorn.

uvicorn --app-dir examples service:app
curl --data-binary @photo.jpg http://127.0.0.1:8000/vectorize -o out.svg
"""

import asyncio
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request, Response

from gauss2svg import Gauss2SvgError, Goal, RunOptions, vectorize

WORKERS, MOST_BYTES = 2, 20_000_000
# What keeps an upload from taking the machine.
GOAL = Goal(quality="fast", max_bytes="150k", time_limit=20)
LIMITS = RunOptions(max_pixels=25_000_000, max_memory="1G", threads=1)


def svg_of(upload: bytes) -> tuple[int, str]:
    """Status, and the SVG or one line that says what to try."""
    try:
        return 200, vectorize(upload, GOAL, run=LIMITS).svg
    except Gauss2SvgError as error:
        return 422, str(error)


@asynccontextmanager
async def lifespan(app: FastAPI):
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=spawn) as app.state.workers:
        yield


app = FastAPI(lifespan=lifespan)


@app.post("/vectorize")
async def answer(request: Request) -> Response:
    upload = bytearray()
    async for part in request.stream():
        upload += part
        if len(upload) > MOST_BYTES:
            return Response(f"photo must be at most {MOST_BYTES} bytes", 413)
    loop = asyncio.get_running_loop()
    status, text = await loop.run_in_executor(request.app.state.workers, svg_of, bytes(upload))
    return Response(text, status, media_type="image/svg+xml" if status == 200 else "text/plain")
