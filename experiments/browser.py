"""A headless Chromium, driven by WebDriver: loads pages, runs scripts, takes pictures."""

from __future__ import annotations

import base64
import json
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--hide-scrollbars", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
    # Every address but this machine's fails, as with the network cut.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
PATIENCE = 60.0  # second


def installed() -> bool:
    """Whether there is a Chromium with its driver."""
    return bool(shutil.which("chromium") and shutil.which("chromedriver"))


class Browser:
    """One window of a browser."""

    def __init__(self, address: str, session: str) -> None:
        self._address = f"{address}/session/{session}"

    def _ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        return _ask(method, f"{self._address}/{path}", body)

    def open(self, address: str) -> None:
        """Load a page."""
        self._ask("POST", "url", {"url": address})

    def run(self, script: str, *values: Any) -> Any:
        """The value that a script returns."""
        return self._ask("POST", "execute/sync", {"script": script, "args": list(values)})

    def promised(self, script: str, *values: Any) -> Any:
        """The value that an asynchronous script gives to `done`."""
        text = f"const done = arguments[arguments.length - 1]; (async () => {{ {script} }})();"
        return self._ask("POST", "execute/async", {"script": text, "args": list(values)})

    def until(self, script: str, seconds: float = PATIENCE) -> float:
        """Wait until an expression is true; returns the waiting time in seconds. Raises
        TimeoutError."""
        began = time.monotonic()
        while not self.run(f"return Boolean({script})"):
            if time.monotonic() - began > seconds:
                raise TimeoutError(f"after {seconds:g} s not true: {script}")
            time.sleep(0.02)
        return time.monotonic() - began

    def resize(self, wide: int, high: int) -> None:
        """Give the page a size in pixels of CSS."""
        self._ask(
            "POST",
            "goog/cdp/execute",
            {
                "cmd": "Emulation.setDeviceMetricsOverride",
                "params": {"width": wide, "height": high, "deviceScaleFactor": 1, "mobile": False},
            },
        )

    def picture(self, path: Path, whole: bool = True) -> None:
        """Write a PNG of the window, or of the whole page."""
        shown = self._ask(
            "POST",
            "goog/cdp/execute",
            {"cmd": "Page.captureScreenshot", "params": {"captureBeyondViewport": whole}},
        )
        path.write_bytes(base64.b64decode(shown["data"]))

    def new_tab(self) -> None:
        """Open another tab and switch to it."""
        handle = self._ask("POST", "window/new", {"type": "tab"})["handle"]
        self._ask("POST", "window", {"handle": handle})


def _ask(method: str, address: str, body: dict[str, Any] | None = None) -> Any:
    content = None if method == "GET" else json.dumps(body or {}).encode()
    request = Request(address, content, {"Content-Type": "application/json"}, method=method)
    try:
        with urlopen(request, timeout=600) as reply:
            return json.load(reply)["value"]
    except HTTPError as error:
        raise RuntimeError(json.load(error)["value"]["message"]) from None


@contextmanager
def browser() -> Iterator[Browser]:
    """A new browser with its own profile, which is ended afterwards."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        driver = subprocess.Popen(
            ["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            _wait(address)
            options = {"args": [*FLAGS, f"--user-data-dir={profile}"]}
            wanted = {"alwaysMatch": {"goog:chromeOptions": options}}
            session = _ask("POST", f"{address}/session", {"capabilities": wanted})["sessionId"]
            _ask("POST", f"{address}/session/{session}/timeouts", {"script": 600_000})
            try:
                yield Browser(address, session)
            finally:  # or the browser outlives its driver
                with suppress(RuntimeError, URLError, ConnectionError):
                    _ask("DELETE", f"{address}/session/{session}")
        finally:
            driver.terminate()
            driver.wait()


def _wait(address: str) -> None:
    for _ in range(600):
        with suppress(URLError, ConnectionError):
            if _ask("GET", f"{address}/status")["ready"]:
                return
        time.sleep(0.1)
    raise TimeoutError("chromedriver does not answer")
