"""The addresses of the page: each reads what was sent, asks the studio, and tells in JSON."""

import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from turnout.errors import FileError, TurnoutError
from turnout.plot.sheet import sheet_record
from turnout.plot.throw_sheet import throw_sheet
from turnout.report.script import plotly_script
from turnout.study.panel_check import concern_lines, panel_concerns
from turnout.web.answer import answer
from turnout.web.download import FILES, made_file
from turnout.web.guard import TooLargeError
from turnout.web.measured import (
    campaign_file,
    channel_map_of,
    listing,
    recorded_movements,
    sent_recording,
    shifted,
)
from turnout.web.request import AskedFile, AskedMark, AskedPanel, AskedRun, read_asked
from turnout.web.studio import Studio, measured_record
from turnout.web.worker import Question, Superseded, Worker

PAGE = str(files("turnout.web").joinpath("page"))
LIVE = "live"
_log = logging.getLogger("turnout")
Endpoint = Callable[[Request], Awaitable[Response]]


def studio_app(studio: Studio, worker: Worker) -> Starlette:
    """Return the application that serves a studio, without the guard before it.

    Parameters
    ----------
    studio : Studio
        What it remembers.
    worker : Worker
        Where throws are computed.
    """
    desk = _Desk(studio, worker)

    @asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
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
            Route("/api/file/{kind}", desk.file, methods=["POST"]),
            Route("/api/recording", desk.recording, methods=["POST"]),
            Route("/api/measured/{mark}", desk.measured, methods=["POST"]),
            Route("/api/campaign/{name:path}", desk.campaign_file),
            Mount("/page", StaticFiles(directory=PAGE)),
        ],
        exception_handlers={
            TurnoutError: _refused,
            Superseded: _superseded,
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
    return JSONResponse({"message": str(error)}, status_code=422)


async def _superseded(_request: Request, _error: Exception) -> Response:
    return JSONResponse({"superseded": True})


async def _too_large(_request: Request, error: Exception) -> Response:
    return JSONResponse({"message": str(error)}, status_code=413)


async def _broken(_request: Request, error: Exception) -> Response:
    _log.error("the studio failed", exc_info=error)
    text = f"the studio failed ({type(error).__name__}: {error}); its window tells more"
    return JSONResponse({"message": text}, status_code=500)


class _Desk:
    """The addresses that need the studio."""

    def __init__(self, studio: Studio, worker: Worker) -> None:
        self.studio, self.worker = studio, worker

    async def start(self, _request: Request) -> Response:
        return JSONResponse(self.studio.start())

    async def open_panel(self, request: Request) -> Response:
        asked = read_asked(AskedPanel, await request.body())
        return JSONResponse(self.studio.described(self.studio.open_panel(asked.name)))

    async def panel_again(self, request: Request) -> Response:
        asked = read_asked(AskedMark, await request.body())
        return JSONResponse(self.studio.described(asked.panel))

    async def send_panel(self, request: Request) -> Response:
        name = request.query_params.get("name", "panel.toml")
        content = await request.body()
        mark = await self.worker.answer(lambda _: self.studio.sent_panel(content, name))
        return JSONResponse(self.studio.described(mark))

    async def concerns(self, request: Request) -> Response:
        """Throw a panel alone and warn of what `turnout panel check` warns of."""
        asked = read_asked(AskedMark, await request.body())

        def work(question: Question) -> list[str]:
            panel, dataset = self.studio.run(AskedRun(panel=asked.panel), question)
            return concern_lines(panel, panel_concerns(panel, dataset))

        return JSONResponse({"lines": await self.worker.answer(work)})

    async def run(self, request: Request) -> Response:
        asked = read_asked(AskedRun, await request.body())

        def work(question: Question) -> str:
            panel, dataset = self.studio.run(asked, question)
            return json.dumps(answer(panel, dataset, preview=asked.preview), allow_nan=False)

        text = await self.worker.answer(work, kind=LIVE)
        if not asked.preview:
            self.worker.ahead(self.studio.ahead(asked))
        return Response(text, media_type="application/json")

    async def file(self, request: Request) -> Response:
        """Make a file of a throw; it is computed again where it is not among the last ones."""
        kind = request.path_params["kind"]
        if kind not in FILES:
            message = f"{kind}: no such file; there are {', '.join(FILES)}"
            raise FileError(message)
        asked = read_asked(AskedFile, await request.body())

        def work(question: Question) -> bytes:
            _, dataset = self.studio.run(asked.run, question)
            behind = self.studio.run(asked.behind, question)[1] if asked.behind else None
            return made_file(kind, dataset, behind=behind)

        content = await self.worker.answer(work)
        return Response(content, media_type=FILES[kind])

    async def recording(self, request: Request) -> Response:
        """List a recording, or, where a channel map is named, cut it into movements."""
        name = request.query_params.get("name", "recording")
        chosen = request.query_params.get("map", "")
        content = await request.body()
        folder = self.studio.opened.folder if self.studio.opened else None

        def work(_question: Question) -> dict[str, Any]:
            recording, kind = sent_recording(content, name)
            if not chosen:
                return {"lines": listing(recording, kind), "movements": []}
            found, lines = recorded_movements(recording, channel_map_of(chosen, folder))
            marks = [(self.studio.add_measured(item), item) for item in found]
            return {"lines": lines, "movements": [measured_record(*pair) for pair in marks]}

        return JSONResponse(await self.worker.answer(work))

    async def measured(self, request: Request) -> Response:
        """Return a measured movement on the time of a run."""
        asked = read_asked(AskedRun, await request.body())
        measured = self.studio.measured(request.path_params["mark"])

        def work(question: Question) -> dict[str, Any]:
            _, dataset = self.studio.run(asked, question)
            return sheet_record(throw_sheet(shifted(measured, dataset)))

        return JSONResponse(await self.worker.answer(work))

    async def campaign_file(self, request: Request) -> Response:
        """Hand out a recording of the campaign."""
        if self.studio.opened is None:
            message = "no campaign is open; start with `turnout studio --campaign DIR`"
            raise FileError(message)
        path = campaign_file(self.studio.opened.folder, request.path_params["name"])
        return FileResponse(path, filename=path.name)
