"""HTTP on 127.0.0.1 for one token: pages, requests, and what is refused."""

from __future__ import annotations

import hmac
import json
import secrets
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, cast
from urllib.parse import parse_qs, urlsplit

from startrack.io import finite
from startrack.page.routes import Routes

HOST = "127.0.0.1"
MOST_BYTES = 2**20  # of a request's body
SECONDS = 60.0  # that a connection may be silent
FILES = Path(__file__).with_name("files")
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".txt": "text/plain"}
SHOWN = {file.name: file for file in FILES.iterdir() if file.suffix in KINDS}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
STALE = (
    "this page is of another run of startrack page, or lacks its token: open the address that the "
    "running command printed"
)


class PageServer(ThreadingHTTPServer):
    """The server of one page. It answers nobody without its token.

    address  with the token, for a browser's first request
    """

    daemon_threads = True

    def __init__(self, routes: Routes, port: int) -> None:
        super().__init__((HOST, port), cast(Any, _Handler))
        self.routes = routes
        self.token = secrets.token_urlsafe(24)
        self.names = {f"{name}:{self.server_port}" for name in (HOST, "localhost")}
        self.cookie = f"startrack-{self.server_port}"
        self.address = f"http://{HOST}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of connections that a browser has closed."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "startrack", ""
    disable_nagle_algorithm = True
    timeout = SECONDS

    def do_GET(self) -> None:
        """The page and its files; the first request brings the token, and takes a cookie."""
        url = urlsplit(self.path)
        if not self._is_ours():
            return
        token = parse_qs(url.query).get("token", [""])[0]
        if token and self._right(token):
            self._reply(303, b"", "text/plain", {"Location": "/", "Set-Cookie": self._cookie()})
            return
        if token or not self._has_cookie():
            self._reply(403, STALE.encode(), "text/plain; charset=utf-8")
            return
        name = url.path.removeprefix("/") or "page.html"
        if name not in SHOWN:
            self._reply(404, b"there is no such file", "text/plain")
            return
        file = SHOWN[name]
        self._reply(200, file.read_bytes(), f"{KINDS[file.suffix]}; charset=utf-8")

    def do_POST(self) -> None:
        """A request of the page, as JSON."""
        self.close_connection = True  # unless the body is read
        if not self._is_ours():
            return
        if not self._has_cookie():
            self._refuse(403, STALE)
            return
        if self.headers.get_content_type() != "application/json":
            self._refuse(415, "a request must be application/json")
            return
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal()):
            self._refuse(411, "a request must say its length")
            return
        if len(length) > 9 or int(length) > MOST_BYTES:
            self._refuse(413, f"a request must have at most {MOST_BYTES} bytes, got {length[:20]}")
            return
        path = self.path.removeprefix("/api/")
        try:
            body = json.loads(self.rfile.read(int(length)) or b"{}")
        except (ValueError, RecursionError):
            body = None
        self.close_connection = False
        if not isinstance(body, dict):
            self._refuse(400, "a request must be an object of JSON")
        elif path not in self._page.routes or not self.path.startswith("/api/"):
            self._refuse(404, "there is no such request")
        else:
            self._json(200, self._page.routes.answer(path, body))

    @property
    def _page(self) -> PageServer:
        assert isinstance(self.server, PageServer)
        return self.server

    def _is_ours(self) -> bool:
        """Whether the request names this host and comes from its own page; else it is refused."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if host not in self._page.names:
            self._refuse(403, f"Host must be {HOST}:{self._page.server_port}")
            return False
        if origin is not None and origin != f"http://{host}":
            self._refuse(403, "Origin must be that of this page")
            return False
        return True

    def _right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._page.token.encode())

    def _has_cookie(self) -> bool:
        try:
            cookie = SimpleCookie(self.headers.get("Cookie", "")).get(self._page.cookie)
        except CookieError:
            return False
        return cookie is not None and self._right(cookie.value)

    def _cookie(self) -> str:
        return f"{self._page.cookie}={self._page.token}; HttpOnly; SameSite=Strict; Path=/"

    def _refuse(self, status: int, sentence: str) -> None:
        self._json(status, {"refused": sentence})

    def _json(self, status: int, value: Any) -> None:
        content = json.dumps(finite(value), allow_nan=False).encode()
        self._reply(status, content, "application/json")

    def _reply(
        self, status: int, content: bytes, kind: str, more: dict[str, str] | None = None
    ) -> None:
        self.send_response(status)
        for name, value in (HEADERS | (more or {})).items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: a request is no message to the user."""
