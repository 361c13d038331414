"""Serve the studio on this machine until Ctrl-C."""

import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType

import uvicorn

from turnout.core.errors import FileError
from turnout.web.app import studio_app
from turnout.web.guard import LARGEST_UPLOAD, Guard
from turnout.web.studio import Studio
from turnout.web.worker import Worker

HOST = "127.0.0.1"
MOST_CONNECTIONS = 1000


class _Server(uvicorn.Server):
    """A server that ends its processes as soon as it receives a stop signal."""

    def __init__(self, config: uvicorn.Config, worker: Worker) -> None:
        super().__init__(config)
        self._worker = worker

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Hear Ctrl-C, or SIGTERM."""
        self._worker.close()
        super().handle_exit(sig, frame)


@dataclass(frozen=True, slots=True, eq=False)
class Served:
    """A server that is ready to run.

    Attributes
    ----------
    address : str
        To be opened once.
    server : uvicorn.Server
        Runs with ``server.run(sockets=[listener])``.
    listener : socket.socket
        Bound to 127.0.0.1.
    """

    address: str
    server: uvicorn.Server
    listener: socket.socket


def prepared(studio: Studio, *, port: int = 0, largest: int = LARGEST_UPLOAD) -> Served:
    """Bind a port of this machine and set up the server.

    Parameters
    ----------
    studio : Studio
        Studio to serve.
    port : int
        0 for any that is free.
    largest : int
        Of an upload [bytes].

    Raises
    ------
    FileError
        When the port is taken.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen()
    except (OSError, OverflowError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or str(error)
        message = f"--port {port}: cannot be used ({reason}); leave it out for any free one"
        raise FileError(message) from None
    port = listener.getsockname()[1]
    token = secrets.token_urlsafe(24)
    hosts = (f"{HOST}:{port}", f"localhost:{port}")
    worker = Worker(studio.opening)
    app = studio_app(studio, worker, largest=largest)
    guard = Guard(app, hosts=hosts, token=token, largest=largest)
    config = uvicorn.Config(
        guard,
        log_level="warning",
        access_log=False,
        timeout_graceful_shutdown=1,
        limit_concurrency=MOST_CONNECTIONS,
        ws="none",
    )
    return Served(f"http://{HOST}:{port}/?token={token}", _Server(config, worker), listener)


def serve(studio: Studio, *, port: int, browser: bool, announce: Callable[[str], None]) -> None:
    """Serve until Ctrl-C, which raises KeyboardInterrupt.

    Parameters
    ----------
    studio : Studio
        Studio to serve.
    port : int
        0 for any that is free.
    browser : bool
        Whether to open the page.
    announce : callable
        Takes lines for the screen.
    """
    served = prepared(studio, port=port)
    announce(f"studio: {served.address}")
    announce("runs locally; the link works once; Ctrl-C stops the studio")
    if browser:
        threading.Thread(target=webbrowser.open, args=(served.address,), daemon=True).start()
    served.server.run(sockets=[served.listener])
