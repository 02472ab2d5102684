"""Debian's Chromium, driven by the WebDriver protocol; a test skips if there is none."""

import json
import shutil
import socket
import subprocess
import time
import urllib.request
from contextlib import contextmanager

import pytest

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-sync",
    "--no-first-run",
    "--disable-component-update",
)


class Browser:
    """One open session."""

    def __init__(self, address, session):
        self.at = f"{address}/session/{session}"

    def get(self, path):
        return ask(f"{self.at}/{path}")

    def post(self, path, **values):
        return ask(f"{self.at}/{path}", values)

    def run(self, script):
        """The value of a JavaScript expression in the page."""
        return self.post("execute/sync", script=f"return {script}", args=[])

    def press(self, key):
        keys = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self.post("actions", actions=[{"type": "key", "id": "keys", "actions": keys}])


def ask(url, values=None):
    text = None if values is None else json.dumps(values).encode()
    with urllib.request.urlopen(urllib.request.Request(url, text), timeout=60) as answer:
        return json.load(answer)["value"]


@contextmanager
def browser(folder, width, height):
    """A session with a viewport of this size, as a phone's or a desktop's."""
    driver, chromium = shutil.which("chromedriver"), shutil.which("chromium")
    if not (driver and chromium):
        pytest.skip("Debian's chromium and chromium-driver are not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        [driver, f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    address = f"http://127.0.0.1:{port}"
    try:
        end = time.monotonic() + 30
        while True:
            try:
                if ask(f"{address}/status")["ready"]:
                    break
            except OSError:
                if time.monotonic() > end:
                    raise
            time.sleep(0.1)
        options = {
            "binary": chromium,
            "args": [*FLAGS, f"--user-data-dir={folder}"],
            "mobileEmulation": {
                "deviceMetrics": {"width": width, "height": height, "pixelRatio": 1}
            },
        }
        asked = {
            "browserName": "chrome",
            "goog:chromeOptions": options,
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
        }
        made = ask(f"{address}/session", {"capabilities": {"alwaysMatch": asked}})
        session = Browser(address, made["sessionId"])
        yield session
        urllib.request.urlopen(urllib.request.Request(session.at, method="DELETE"), timeout=30)
    finally:
        process.terminate()
        process.wait()
