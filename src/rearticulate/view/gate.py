"""Who may see and move a model: whoever has the address with this run's token, from the page at that address alone.

viser serves everyone who can reach its port, pages of other origins included, and has no hook to refuse a request: it
hands a function of its own to `websockets.serve` as `process_request`. That call is intercepted while viser starts, so
that the gate comes before that function. websockets bounds what comes before it, the head of a request: 128 lines of
8 kB within 10 s.
"""

from __future__ import annotations

import hmac
import ipaddress
import logging
import re
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from rearticulate.errors import FitError

Answer = Callable[[ServerConnection, Request], Response | None]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
EVERYWHERE = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # hosts to listen at, and where the page is then
HOST = re.compile(r"(\[[0-9a-f:.]+\]|[^\s:@/\[\]]+)(?::(\d{1,5}))?")
POLICY = (  # the page gets all it needs from its own address; what else it may be led to ask for is refused
    "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'; connect-src 'self' ws://{host} data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)

_starting = threading.Lock()
_log = logging.getLogger(__name__)
_log.addHandler(logging.NullHandler())  # broken requests are no news to who runs the viewer


class Gate:
    """Judges requests to a server that listens at `host`:`port`."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = _canonical(host), port
        self._token = secrets.token_urlsafe()
        self._names = {*LOOPBACK, self._host}
        if self._host in EVERYWHERE:
            self._names |= {name.lower() for name in (socket.gethostname(), socket.getfqdn())}

    @property
    def address(self) -> str:
        """Of the page; its path is the token, which the page's own requests keep."""
        host = EVERYWHERE.get(self._host, self._host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self._port}/{self._token}/"

    def refusal(self, request: Request) -> str:
        """Why a request is refused; empty where it is not."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._serves(hosts[0].lower()):
            return "Nothing is served under this name."
        if origins and origins != [f"http://{hosts[0]}"]:
            return "Pages from elsewhere may not use this."
        if not origins and "Upgrade" in request.headers:
            return "A websocket must say which page it is from."
        if not hmac.compare_digest(_bytes(_split(request.path)[0]), _bytes(self._token)):
            return "Open the whole address that `rearticulate view` has printed."
        return ""

    def before(self, answer: Answer | None) -> Answer:
        """What answers requests, asked only about those that are not refused, and without the token."""

        def guarded(connection: ServerConnection, request: Request) -> Response | None:
            refusal = self.refusal(request)
            if refusal:
                return connection.respond(403, refusal + "\n")
            response = answer(connection, Request(_split(request.path)[1], request.headers)) if answer else None
            if response is not None:
                response.headers["Content-Security-Policy"] = POLICY.format(host=request.headers["Host"])
                response.headers["Referrer-Policy"] = "no-referrer"  # the address is a secret
            return response

        return guarded

    def _serves(self, host: str) -> bool:
        """Whether a Host header means this server. An address that is a number is always its own, if it listens
        everywhere: only a name can be made to point here by someone else."""
        found = HOST.fullmatch(host)
        if not found or int(found[2] or 80) != self._port:
            return False
        name = found[1].strip("[]")
        return name in self._names or (self._host in EVERYWHERE and _is_number(name))


@contextmanager
def guarded(gate: Gate) -> Iterator[None]:
    """A viser server that starts within the block is behind the gate. FitError where it would not be."""
    passed = []
    with _starting:
        serve = websockets.asyncio.server.serve

        def serve_behind_gate(*places: Any, process_request: Answer | None = None, **options: Any) -> Any:
            passed.append(gate)
            return serve(*places, process_request=gate.before(process_request), **{"logger": _log, **options})

        websockets.asyncio.server.serve = serve_behind_gate  # type: ignore[misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not passed:
        raise FitError("the installed viser cannot be guarded against other pages; viser 1.1 can")


def _split(path: str) -> tuple[str, str]:
    """First folder of a request's path, and the rest."""
    first, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
    return first, f"/{rest}"


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")


def _canonical(host: str) -> str:
    """As browsers write it."""
    return str(ipaddress.ip_address(host)) if _is_number(host) else host.lower()


def _is_number(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True
