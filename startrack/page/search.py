"""Start, watch, stop and continue the command `optimize` in the background."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from startrack.core import Refused

LOG, RESULT, MESSAGES = "search.jsonl", "result.json", "messages.txt"
STOPS_WITH_INPUT = "STARTRACK_STOPS_WITH_INPUT"  # read by `startrack.cli.stopping`
POLITE = 10  # steps of priority below the page's process, which stays quick
PATIENCE = 20.0  # second from a request to stop until the search is killed


class SearchRun:
    """One search at a time, in a separate process; its ledger lets it continue.

    folder  folder of the results, within the page's folder
    """

    def __init__(self, path: Path, folder: Path, seed: int, workers: int) -> None:
        self._path, self._folder = path, folder
        self._options = ["--seed", str(seed), "--workers", str(workers)]
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False

    @property
    def running(self) -> bool:
        """Whether the search computes."""
        return self._process is not None and self._process.poll() is None

    def start(self, changes: Sequence[str]) -> None:
        """Begin a search, or continue the search with the same values."""
        if self.running:
            raise Refused("a search runs already: stop it before another begins")
        self._release()
        self._folder.mkdir(parents=True, exist_ok=True)
        for name in (LOG, RESULT):
            (self._folder / name).unlink(missing_ok=True)
        words = [sys.executable, "-m", "startrack.cli", "optimize", str(self._path)]
        words += ["--out", str(self._folder), *self._options]
        words += [word for change in changes for word in ("--set", change)]
        with (self._folder / MESSAGES).open("wb") as messages:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,  # it closes with the page, however the page ends
                env={**os.environ, STOPS_WITH_INPUT: "1"},
                stdout=subprocess.DEVNULL,
                stderr=messages,
                start_new_session=True,
            )
        self._stopped = False
        with suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, POLITE)

    def stop(self) -> None:
        """Ask the search to end; computed results stay in its ledger.

        SIGINT is not used: shells let background processes ignore it.
        """
        if self._process is None or not self.running:
            self._release()
            return
        self._stopped = True
        self._process.terminate()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._release()

    def _release(self) -> None:
        """Close the input of a search that has ended."""
        if self._process and self._process.stdin:
            self._process.stdin.close()

    def state(self, first: int) -> dict[str, Any]:
        """Lines of the log from number `first` on, and the end of the search if it has ended."""
        ended = self._process is not None and not self.running  # before the last lines are read
        lines = self._lines(self._folder / LOG)
        state: dict[str, Any] = {"lines": lines[first:], "count": len(lines)}
        state |= {"running": self.running, "stopped": self._stopped}
        if ended and self._process:
            state["status"] = self._process.returncode
            state["message"] = self._last_words()
            with suppress(OSError, ValueError):
                state["result"] = json.loads((self._folder / RESULT).read_text(encoding="utf-8"))
        return state

    @staticmethod
    def _lines(path: Path) -> list[Any]:
        """The complete lines of a file that may still grow."""
        try:
            text = path.read_text(encoding="utf-8")
        except OSError:
            return []
        return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]

    def _last_words(self) -> str:
        words = (self._folder / MESSAGES).read_text(encoding="utf-8", errors="replace")
        return words.strip().rpartition("\n")[2]
