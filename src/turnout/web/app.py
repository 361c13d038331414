"""HTTP routes of the studio: pass requests to worker processes and return their replies."""

import asyncio
import logging
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib.resources import files
from pathlib import Path
from typing import IO

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from turnout.core.errors import FileError, TurnoutError
from turnout.figures.report.page import plotly_script
from turnout.web.guard import LARGEST_UPLOAD, TooLargeError
from turnout.web.measured import campaign_file, plain_name
from turnout.web.process import without_folders
from turnout.web.question import (
    CHECK_TIME_LIMIT,
    MAP_TIME_LIMIT,
    TIME_LIMIT,
    Reply,
    Superseded,
    Task,
)
from turnout.web.studio import Studio
from turnout.web.tasks import LARGEST_PANEL
from turnout.web.throw import FILES
from turnout.web.worker import ClosedError, Worker

PAGE = str(files("turnout.web").joinpath("page"))
LIVE = "live"
# Of a question in JSON [bytes]: a panel's mark, an object and forty settings take a few thousand.
LARGEST_QUESTION = 200_000
LONGEST_JOB = 40
_log = logging.getLogger("turnout")


def studio_app(studio: Studio, worker: Worker, *, largest: int = LARGEST_UPLOAD) -> Starlette:
    """Return the application that serves a studio, without the guard before it.

    Parameters
    ----------
    studio : Studio
        Settings that it was opened with.
    worker : Worker
        Processes that read and compute.
    largest : int
        Of a recording [bytes].
    """
    desk = _Addresses(studio, worker, largest)

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        desk.worker.start()
        yield
        desk.worker.close()

    return Starlette(
        routes=[
            Route("/", _index),
            Route("/plotly.js", _plotly),
            Route("/api/start", desk.start),
            Route("/api/panel/open", desk.open_panel, methods=["POST"]),
            Route("/api/panel/send", desk.send_panel, methods=["POST"]),
            Route("/api/panel/again", desk.panel_again, methods=["POST"]),
            Route("/api/panel/concerns", desk.concerns, methods=["POST"]),
            Route("/api/run", desk.run, methods=["POST"]),
            Route("/api/map", desk.map, methods=["POST"]),
            Route("/api/wheel", desk.wheel, methods=["POST"]),
            Route("/api/job/{job}", desk.job),
            Route("/api/job/{job}/stop", desk.stop, methods=["POST"]),
            Route("/api/file/{kind}", desk.file, methods=["POST"]),
            Route("/api/recording", desk.recording, methods=["POST"]),
            Route("/api/limit", desk.limit, methods=["POST"]),
            Route("/api/detector", desk.detector, methods=["POST"]),
            Route("/api/judge", desk.judge, methods=["POST"]),
            Route("/api/judge/{detector}", desk.judge_shown, methods=["POST"]),
            Route("/api/measured/{mark}", desk.measured, methods=["POST"]),
            Route("/api/campaign/{name:path}", desk.campaign_file),
            Mount("/page", StaticFiles(directory=PAGE)),
        ],
        exception_handlers={
            TurnoutError: _refused,
            Superseded: _superseded,
            ClosedError: _closed,
            TooLargeError: _too_large,
            Exception: _broken,
        },
        lifespan=lifespan,
    )


async def _index(_request: Request) -> Response:
    return FileResponse(f"{PAGE}/index.html", media_type="text/html")


async def _plotly(_request: Request) -> Response:
    return Response(plotly_script(), media_type="text/javascript")


async def _refused(_request: Request, error: Exception) -> Response:
    return JSONResponse({"message": without_folders(str(error))}, status_code=422)


async def _superseded(_request: Request, _error: Exception) -> Response:
    return JSONResponse({"superseded": True})


async def _closed(_request: Request, _error: Exception) -> Response:
    return JSONResponse({"message": "the studio ends"}, status_code=503)


async def _too_large(_request: Request, error: Exception) -> Response:
    return JSONResponse({"message": str(error)}, status_code=413)


async def _broken(_request: Request, error: Exception) -> Response:
    _log.error("the studio failed", exc_info=error)
    text = f"the studio failed ({type(error).__name__}); see its terminal for details"
    return JSONResponse({"message": text}, status_code=500)


class _Addresses:
    """The addresses that need the studio."""

    def __init__(self, studio: Studio, worker: Worker, largest: int) -> None:
        self.studio, self.worker, self.largest = studio, worker, largest

    async def start(self, _request: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self.studio.start))

    async def open_panel(self, request: Request) -> Response:
        return await self._forward("panel/open", request)

    async def panel_again(self, request: Request) -> Response:
        return await self._forward("panel/again", request)

    async def send_panel(self, request: Request) -> Response:
        name = request.query_params.get("name", "")
        return await self._forward("panel/send", request, most=LARGEST_PANEL, name=name)

    async def concerns(self, request: Request) -> Response:
        return await self._forward("panel/concerns", request, seconds=CHECK_TIME_LIMIT)

    async def map(self, request: Request) -> Response:
        return await self._forward("map", request, seconds=MAP_TIME_LIMIT)

    async def wheel(self, request: Request) -> Response:
        return await self._forward("wheel", request, seconds=CHECK_TIME_LIMIT)

    async def job(self, request: Request) -> Response:
        return JSONResponse({"share": self.worker.share(request.path_params["job"])})

    async def stop(self, request: Request) -> Response:
        self.worker.stop(request.path_params["job"])
        return JSONResponse({})

    async def run(self, request: Request) -> Response:
        return await self._forward("run", request, kind=LIVE)

    async def file(self, request: Request) -> Response:
        kind = request.path_params["kind"]
        if kind not in FILES:
            message = f"{kind}: no such file; there are {', '.join(FILES)}"
            raise FileError(message)
        return await self._forward("file", request, file=kind)

    async def measured(self, request: Request) -> Response:
        return await self._forward("measured", request, mark=request.path_params["mark"])

    async def recording(self, request: Request) -> Response:
        """Have a recording read."""
        return await self._read("recording", request)

    async def limit(self, request: Request) -> Response:
        return await self._read("limit", request)

    async def detector(self, request: Request) -> Response:
        return await self._read("detector", request)

    async def judge(self, request: Request) -> Response:
        return await self._read("judge", request)

    async def judge_shown(self, request: Request) -> Response:
        mark = request.path_params["detector"]
        return await self._forward("judge shown", request, detector=mark)

    async def _read(self, task: str, request: Request) -> Response:
        """Put the sent content in a file, under the name that the page gives, and have it read."""
        name = plain_name(request.query_params.get("name", ""), task)
        chosen = request.query_params.get("map", "")
        if len(chosen) > LARGEST_QUESTION:
            raise TooLargeError(LARGEST_QUESTION)
        with tempfile.TemporaryDirectory(dir=self.worker.folder) as folder:
            path = Path(folder) / name
            with _created(path) as file:
                await _received(request, self.largest, file.write)
            detector = request.query_params.get("detector", "")[:LONGEST_JOB]
            options = {"path": str(path), "map": chosen, "detector": detector}
            return _response(await self.worker.answer(Task(task, options=options)))

    async def campaign_file(self, request: Request) -> Response:
        """Hand out a recording of the campaign."""
        if self.studio.opened is None:
            message = "no campaign is open; start with `turnout studio --campaign DIR`"
            raise FileError(message)
        folder, name = self.studio.opened.folder, request.path_params["name"]
        path = await asyncio.to_thread(campaign_file, folder, name)
        return FileResponse(path, filename=path.name)

    async def _forward(
        self,
        name: str,
        request: Request,
        /,
        *,
        kind: str | None = None,
        most: int = LARGEST_QUESTION,
        seconds: float | None = None,
        **options: str,
    ) -> Response:
        """Hand the content sent to a process as it is."""
        parts: list[bytes] = []
        await _received(request, most, parts.append)
        limit = TIME_LIMIT if seconds is None else seconds
        job = request.query_params.get("job", "")[:LONGEST_JOB]
        task = Task(name, b"".join(parts), options, limit, job=job)
        return _response(await self.worker.answer(task, kind=kind))


async def _received(request: Request, most: int, take: Callable[[bytes], object]) -> None:
    """Take the content sent, piece by piece; if too large, no more of it than may be."""
    seen = 0
    async for part in request.stream():
        seen += len(part)
        if seen <= most:
            take(part)
    if seen > most:
        raise TooLargeError(most)


def _created(path: Path) -> IO[bytes]:
    try:
        return path.open("xb")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no name of a file"
        message = f"{path.name}: cannot be taken ({reason}); send it under another name"
        raise FileError(message) from None


def _response(reply: Reply) -> Response:
    return Response(reply.content, reply.status, media_type=reply.media_type)
