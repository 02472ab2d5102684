"""HTTP on 127.0.0.1 for one token: pages, requests, and refusals."""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, cast
from urllib.parse import parse_qs, urlsplit

from startrack.io import finite
from startrack.page.routes import Routes

HOST = "127.0.0.1"
MOST_BYTES = 2**20  # largest body of a request
SECONDS = 60.0  # timeout of a silent connection
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
NOTHING: Mapping[str, str] = {}
STALE = (
    "this page has no token of the running startrack page: open the address that the running "
    "command printed"
)


class PageServer(ThreadingHTTPServer):
    """The server of one page. It answers only requests with its token.

    address  address with the token, for a browser's first request
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
        """Do not report connections that a browser has closed."""


class _Denied(Exception):
    """A denied request: HTTP status and message."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "startrack", ""
    disable_nagle_algorithm = True
    timeout = SECONDS

    def do_GET(self) -> None:
        """The page and its files; the first request has the token and receives a cookie."""
        try:
            self._check_origin()
            url = urlsplit(self.path)
            token = parse_qs(url.query).get("token", [""])[0]
            if self._right(token):
                cookie = f"{self._page.cookie}={token}; HttpOnly; SameSite=Strict; Path=/"
                self._reply(303, b"", "text/plain", {"Location": "/", "Set-Cookie": cookie})
                return
            self._check_cookie()
            name = url.path.removeprefix("/") or "page.html"
            if name not in SHOWN:
                raise _Denied(404, "there is no such file")
            content, kind = SHOWN[name].read_bytes(), KINDS[SHOWN[name].suffix]
            self._reply(200, content, f"{kind}; charset=utf-8")
        except _Denied as denied:
            self._reply(denied.status, str(denied).encode(), "text/plain; charset=utf-8")

    def do_POST(self) -> None:
        """A request of the page, as JSON."""
        self.close_connection = True  # unless the body is read
        try:
            self._check_origin()
            self._check_cookie()
            body, path = self._body(), self.path.removeprefix("/api/")
            if path == self.path or path not in self._page.routes:
                raise _Denied(404, "there is no such request")
            self._json(200, self._page.routes.answer(path, body))
        except _Denied as denied:
            self._json(denied.status, {"refused": str(denied)})

    @property
    def _page(self) -> PageServer:
        assert isinstance(self.server, PageServer)
        return self.server

    def _check_origin(self) -> None:
        """Deny a request that names another host or comes from another page."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if host not in self._page.names:
            raise _Denied(403, f"Host must be {HOST}:{self._page.server_port}")
        if origin is not None and origin != f"http://{host}":
            raise _Denied(403, "Origin must be the address of this page")

    def _check_cookie(self) -> None:
        try:
            cookie = SimpleCookie(self.headers.get("Cookie", "")).get(self._page.cookie)
        except CookieError:
            cookie = None
        if cookie is None or not self._right(cookie.value):
            raise _Denied(403, STALE)

    def _right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._page.token.encode())

    def _body(self) -> dict[str, Any]:
        if self.headers.get_content_type() != "application/json":
            raise _Denied(415, "a request must be application/json")
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal()):
            raise _Denied(411, "a request must state its length")
        if len(length) > 9 or int(length) > MOST_BYTES:
            raise _Denied(413, f"a request must have at most {MOST_BYTES} bytes")
        try:
            body = json.loads(self.rfile.read(int(length)) or b"{}")
        except (ValueError, RecursionError):
            body = None
        self.close_connection = False
        if not isinstance(body, dict):
            raise _Denied(400, "a request must be an object of JSON")
        return body

    def _json(self, status: int, value: Any) -> None:
        self._reply(status, json.dumps(finite(value)).encode(), "application/json")

    def _reply(
        self, status: int, content: bytes, kind: str, more: Mapping[str, str] = NOTHING
    ) -> None:
        self.send_response(status)
        length = str(len(content))
        own = {**HEADERS, **more, "Content-Type": kind, "Content-Length": length}
        for name, value in own.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: requests are not reported to the user."""
