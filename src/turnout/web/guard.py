"""Access control of the studio: host, token, upload size, and security headers.

The server listens on 127.0.0.1, but every page in the user's browser can reach it there. A foreign
page is kept out by the host header (a name that was made to point here), by the origin header, and
by a token that only the address printed on the screen has. It is good for one use, which turns it
into a cookie.
"""

import secrets
from collections.abc import Iterable
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from turnout.core.errors import TurnoutError

LARGEST_UPLOAD = 100_000_000
# More than this of a refused upload is not even thrown away; the connection is closed.
MOST_DRAINED = 1_000_000_000
# Of the plotting script: an empty <style> that it then fills, and one attribute that it sets.
STYLES = (
    "'unsafe-hashes' 'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=' "
    "'sha256-wkY2X5hecQzbhnFCqvTpwrUJ1f4X8LH5WFjYUzv1wmU='"
)
POLICY = (
    "default-src 'none'; script-src 'self'; img-src 'self' data: blob:; "
    f"style-src 'self' {STYLES}; "
    "connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Stands before an application and lets permitted requests through.

    Parameters
    ----------
    app : ASGI application
        Guarded application.
    hosts : iterable of str
        Allowed host headers, with their port.
    token : str
        Of the address that is opened first; good once.
    largest : int
        Of a request's body [bytes].
    """

    def __init__(
        self, app: ASGIApp, *, hosts: Iterable[str], token: str, largest: int = LARGEST_UPLOAD
    ) -> None:
        self._app = app
        self._hosts = frozenset(hosts)
        self._token: str | None = token
        self._session = secrets.token_urlsafe(32)
        self._largest = largest
        port = max(self._hosts).rpartition(":")[2]
        self._cookie = f"turnout_studio_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request or pass it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        headers = {name.decode("latin-1"): v.decode("latin-1") for name, v in scope["headers"]}
        refusal = self._refusal(scope, headers)
        body = _Body(receive, self._largest)
        if refusal is None:
            try:
                length = int(headers.get("content-length", "0"))
            except ValueError:
                length = 0
            if length > self._largest:
                refusal = _refused(413, str(TooLargeError(self._largest)))
        if refusal is not None:
            await body.drain()
            await refusal(scope, receive, _with_headers(send))
            return
        await self._app(scope, body.receive, _with_headers(send))

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> Response | None:
        """Return a refusal, or None for an allowed request."""
        host = headers.get("host", "")
        if host not in self._hosts:
            known = " or ".join(sorted(self._hosts))
            return _refused(421, f"this studio accepts only {known} as host, not '{host}'")
        origin = headers.get("origin")
        if origin is not None and origin.removeprefix("http://") not in self._hosts:
            return _refused(403, f"a page of '{origin}' may not use this studio")
        if self._known(headers):
            return None
        token = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["path"] == "/" and token:
            return self._exchanged(token)
        return _refused(403, "open the studio with the address that `turnout studio` has printed")

    def _known(self, headers: dict[str, str]) -> bool:
        # By hand: what the standard library has for cookies takes seconds over some of 60 kB.
        for cookie in headers.get("cookie", "").split(";"):
            name, _, value = cookie.strip().partition("=")
            if name == self._cookie:
                return secrets.compare_digest(value.encode(), self._session.encode())
        return False

    def _exchanged(self, token: str) -> Response:
        """Turn the token into a cookie, once."""
        if self._token is None:
            text = "this address was used before; start `turnout studio` again for a new one"
            return _refused(403, text)
        if not secrets.compare_digest(token.encode(), self._token.encode()):
            return _refused(403, "wrong token; use the address that `turnout studio` has printed")
        self._token = None
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(self._cookie, self._session, httponly=True, samesite="strict", path="/")
        return answer


class TooLargeError(TurnoutError):
    """The upload is too large; the application replies with status 413."""

    def __init__(self, largest: int) -> None:
        super().__init__(f"the file is too large: at most {largest / 1e6:g} MB are taken")


class _Body:
    """The body of a request: counted, and thrown away if it is refused."""

    def __init__(self, receive: Receive, largest: int) -> None:
        self._receive, self._largest = receive, largest
        self._seen, self._ended = 0, False

    async def receive(self) -> Message:
        message = await self._receive()
        if message["type"] == "http.request":
            self._seen += len(message.get("body", b""))
            self._ended = not message.get("more_body", False)
            if self._seen > self._largest:
                await self.drain()
                raise TooLargeError(self._largest)
        return message

    async def drain(self) -> None:
        """Read the rest of a request, so that the sender hears why it is refused."""
        while not self._ended and self._seen < MOST_DRAINED:
            message = await self._receive()
            if message["type"] != "http.request":
                return
            self._seen += len(message.get("body", b""))
            self._ended = not message.get("more_body", False)


def _refused(status: int, text: str) -> Response:
    return PlainTextResponse(text + "\n", status_code=status)


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            own = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
            message["headers"] = [*message.get("headers", []), *own]
        await send(message)

    return sent
