"""Who gets to the viewer: the right address from its own page, and nobody else."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import viser
from websockets.datastructures import Headers
from websockets.http11 import Request
from websockets.sync.client import connect

from browser import FOREIGN, needs_chromium
from rearticulate.commands.viewing import open_viewer
from rearticulate.errors import FitError
from rearticulate.io import save_result
from rearticulate.view.gate import Gate, guarded
from rearticulate.view.viewer import Viewer
from toy_result import toy

UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "lamp"
    save_result(path, *toy(60))
    return path


@pytest.fixture(scope="module")
def viewer(folder: Path) -> Iterator[Viewer]:
    viewer = open_viewer([folder], "127.0.0.1", 0, "z")
    before = sorted(folder.rglob("*"))
    yield viewer
    viewer.server.stop()
    assert sorted(folder.rglob("*")) == before, "something was written"


def place(viewer: Viewer) -> tuple[str, str]:
    """Host and path of the page."""
    parts = urlsplit(viewer.address)
    return parts.netloc, parts.path


def ask(viewer: Viewer, path: str, *heads: tuple[str, str], host: str | None = "") -> str:
    """The first line of the answer to a request; host: "" for the right one, None for none."""
    right = place(viewer)[0]
    lines = [f"GET {path} HTTP/1.1", *([] if host is None else [f"Host: {host or right}"])]
    lines += [f"{name}: {value}" for name, value in heads]
    with socket.create_connection(right.split(":"), timeout=20) as wire:
        wire.sendall("\r\n".join([*lines, "", ""]).encode())
        return wire.makefile("rb").readline().decode().strip()


def test_the_address_is_served_and_its_websocket_opens(viewer: Viewer) -> None:
    host, path = place(viewer)
    assert len(path) > 40
    assert "200" in ask(viewer, path)
    assert "200" in ask(viewer, path, host=host.replace("127.0.0.1", "LOCALHOST"))
    assert "404" in ask(viewer, f"{path}nothing")
    with connect(
        f"ws://{host}{path}", origin=f"http://{host}", subprotocols=[UPGRADE["Sec-WebSocket-Protocol"]]
    ) as wire:
        assert len(wire.recv(timeout=20)) > 1000


@pytest.mark.parametrize("path", ["/", "/index.html", "/{wrong}/", "/{token}x/", "/?token={token}", "//{token}/", "*"])
def test_without_the_token_nothing_is_served(viewer: Viewer, path: str) -> None:
    token = place(viewer)[1].strip("/")
    path = path.format(token=token, wrong=token[::-1])
    assert "403" in ask(viewer, path)
    own = ("Origin", f"http://{place(viewer)[0]}")
    assert "403" in ask(viewer, path, own, *UPGRADE.items())


@pytest.mark.parametrize(
    "host",
    [
        "evil.test:{port}",
        "127.0.0.1",
        "127.0.0.1:1",
        "127.0.0.1:{port}.evil.test",
        "x@127.0.0.1:{port}",
        "127.0.0.2:{port}",
        "10.0.0.1:{port}",
        "127.0.0.1:{port}, evil.test",
        "127.0.0.1:99999999999999999999",
        "[::1",
        " ",
        None,
    ],
)
def test_other_names_are_refused(viewer: Viewer, host: str | None) -> None:
    right, path = place(viewer)
    name = host and host.format(port=right.split(":")[1])
    assert "403" in ask(viewer, path, host=name)
    assert "403" in ask(viewer, path, ("Origin", f"http://{name}"), *UPGRADE.items(), host=name)


def test_two_names_at_once_are_refused(viewer: Viewer) -> None:
    right, path = place(viewer)
    assert "403" in ask(viewer, path, ("Host", right))
    assert "403" in ask(viewer, path, ("Host", "evil.test"))


@pytest.mark.parametrize("origin", [None, "null", "http://localhost:1", "http://evil.test", "https://{host}", "{host}"])
def test_a_websocket_from_elsewhere_is_refused_even_with_the_token(viewer: Viewer, origin: str | None) -> None:
    host, path = place(viewer)
    heads = [] if origin is None else [("Origin", origin.format(host=host))]
    assert "403" in ask(viewer, path, *heads, *UPGRADE.items())
    own = ("Origin", f"http://{host}")
    assert "101" in ask(viewer, path, own, *UPGRADE.items())
    assert "403" in ask(viewer, path, own, ("Origin", "http://evil.test"), *UPGRADE.items())


def test_what_is_no_request_is_dropped_in_silence(viewer: Viewer, caplog: pytest.LogCaptureFixture) -> None:
    host, path = place(viewer)
    long = b"GET / HTTP/1.1\r\n" + b"a" * 100_000
    many = b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 1000
    for sent in (b"\x16\x03\x01\x02\x00", b"POST / HTTP/1.1\r\n\r\n", long, many):
        with socket.create_connection(host.split(":"), timeout=20) as wire:
            try:
                wire.sendall(sent + b"\r\n\r\n")
                answer = wire.makefile("rb").readline()
            except ConnectionError:
                answer = b""
        assert b"200" not in answer and b"101" not in answer
    assert "200" in ask(viewer, path)
    assert not [note for note in caplog.records if note.name.startswith("websockets")]
    assert logging.getLogger("rearticulate.view.gate").handlers


def judged(gate: Gate, host: str) -> bool:
    return not gate.refusal(Request(urlsplit(gate.address).path, Headers(Host=host)))


def test_a_server_of_the_whole_network_is_reached_by_number_or_own_name_only() -> None:
    gate = Gate("0.0.0.0", 8080)
    assert gate.address.startswith("http://127.0.0.1:8080/")
    own = f"{socket.gethostname().lower()}:8080"
    assert all(judged(gate, host) for host in ("192.168.1.7:8080", "[fe80::1]:8080", "localhost:8080", own))
    assert not any(judged(gate, host) for host in ("evil.test:8080", "192.168.1.7.evil.test:8080", "192.168.1.7"))
    assert Gate("::", 80).address.startswith("http://[::1]:80/") and judged(Gate("::", 80), "[::1]")
    assert judged(Gate("Desk.local", 8080), "desk.local:8080") and not judged(Gate("Desk.local", 8080), "10.0.0.1:8080")
    assert judged(Gate("0:0:0:0:0:0:0:1", 8080), "[::1]:8080")
    assert Gate("127.0.0.1", 8080).address != Gate("127.0.0.1", 8080).address


def test_a_viser_that_would_not_be_guarded_does_not_serve() -> None:
    with pytest.raises(FitError, match="cannot be guarded"), guarded(Gate("127.0.0.1", 8080)):
        pass


class Evil(BaseHTTPRequestHandler):
    """A page of another origin."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<title>evil</title>")

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def evil() -> Iterator[int]:
    """The port of a server of pages that are not ours."""
    server = HTTPServer(("127.0.0.1", 0), Evil)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_port
    server.shutdown()
    server.server_close()


OPENS = """([address, protocol]) => new Promise(done => {
  const wire = new WebSocket(address, [protocol]);
  wire.onopen = wire.onmessage = () => done("open");
  wire.onerror = wire.onclose = () => done("refused");
})"""
READS = "address => fetch(address).then(answer => answer.text(), () => 'refused')"


@needs_chromium
@pytest.mark.parametrize("name", ["localhost", FOREIGN])
def test_a_page_of_another_origin_gets_nothing(chromium: Any, viewer: Viewer, evil: int, name: str) -> None:
    host, path = place(viewer)
    page = chromium.new_page()
    page.goto(f"http://{name}:{evil}")
    assert page.title() == "evil"
    for where in ("/", f"{path}"):  # also where it has got the token somehow
        for at in (host, host.replace("127.0.0.1", "localhost")):
            assert page.evaluate(OPENS, [f"ws://{at}{where}", UPGRADE["Sec-WebSocket-Protocol"]]) == "refused"
    assert page.evaluate(READS, f"http://{host}{path}") == "refused"
    page.set_content(f'<iframe src="{viewer.address}"></iframe>')
    page.wait_for_timeout(1000)
    assert not viewer.server.get_clients()
    page.close()


@needs_chromium
def test_a_foreign_name_for_this_machine_shows_nothing(chromium: Any, viewer: Viewer) -> None:
    host, path = place(viewer)
    page = chromium.new_page()
    there = host.replace("127.0.0.1", FOREIGN)
    for where in ("/", path):
        assert page.goto(f"http://{there}{where}").status == 403
        assert page.inner_text("body").strip() == "Nothing is served under this name."
        assert page.evaluate(OPENS, [f"ws://{there}{where}", UPGRADE["Sec-WebSocket-Protocol"]]) == "refused"
    page.close()


@needs_chromium
def test_the_right_address_works_and_can_be_loaded_again(chromium: Any, viewer: Viewer) -> None:
    page, trouble = chromium.new_page(), []
    page.on("console", lambda note: trouble.append(note.text) if note.type == "error" else None)
    page.on("pageerror", lambda error: trouble.append(str(error)))
    page.goto(viewer.address.replace("127.0.0.1", "localhost"))
    page.get_by_text("Recording").first.wait_for(timeout=60_000)
    page.reload()
    page.get_by_text("Recording").first.wait_for(timeout=60_000)
    page.close()
    assert not trouble
