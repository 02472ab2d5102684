"""Path and body of a request -> the answer, or the error message of a command."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Refused
from startrack.design import search_keys
from startrack.page.problem import ProblemPage
from startrack.page.search import SearchRun
from startrack.page.tracker import TrackerPage
from startrack.page.trials import TrialsRun

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
MOST_CHANGES, MOST_LETTERS = 500, 20_000
LARGEST = 2**53  # whole number of a browser

Body = Mapping[str, Any]


class Routes:
    """All requests of a page.

    folder    folder for written files
    painter   one process for images, which keeps what they have in common
    executor  computes later results and trials, so that painting does not wait
    changes   changes given to the command
    """

    def __init__(
        self,
        page: TrackerPage | ProblemPage,
        folder: Path,
        painter: Executor,
        executor: Executor,
        workers: int,
        changes: list[str],
    ) -> None:
        search = SearchRun(page.path, folder / "search", page.seed, workers)
        trials = TrialsRun(folder, executor, workers)
        self._painting, self._starting = threading.Lock(), threading.Lock()
        self._page, self._folder, self._trials = page, folder, trials
        self._stops = search.stop, trials.stop
        self._about = {
            "kind": page.kind,
            "name": page.path.stem,
            "file": str(page.path),
            "folder": str(folder),
            "changes": changes,
            "fidelities": page.fidelities,
            "not_shown": page.not_shown,
        }
        self._by_path: dict[str, Callable[[Body], Any]] = {
            "about": lambda body: self._about,
            "form": lambda body: page.form(_changes(body)),
            "keys": lambda body: [
                key.name for key in search_keys(_text(body, "words"), page.all_keys())
            ],
            "paint": self._paint,
            "images": lambda body: painter.submit(
                page.images, _changes(body), _whole(body, "trial"), _text(body, "condition")
            ).result(),
            "later": lambda body: executor.submit(
                page.later, _changes(body), body.get("rate")
            ).result(),
            "save": self._save,
            "search/start": lambda body: self._alone(search.start, _changes(body)),
            "search/stop": lambda body: search.stop(),
            "search/state": lambda body: search.state(_whole(body, "first")),
            "trials/start": self._try,
            "trials/stop": lambda body: trials.stop(),
            "trials/state": lambda body: trials.state(),
        }

    def __contains__(self, path: str) -> bool:
        return path in self._by_path

    def answer(self, path: str, body: Body) -> Any:
        """The answer to a request; {"refused": message} for a refused request."""
        try:
            with np.errstate(all="ignore"):
                return self._by_path[path](body)
        except BrokenExecutor:
            return {"refused": "the process that computes in the background has ended; try again"}
        except (ValueError, TypeError, OSError, MemoryError) as error:
            return {"refused": " ".join(str(error).split()) or type(error).__name__}

    def close(self) -> None:
        """End searches and trials that run."""
        for stop in self._stops:
            stop()

    def _alone(self, start: Callable[..., None], *values: Any) -> None:
        with self._starting:  # only one of two tabs starts a run
            start(*values)

    def _try(self, body: Body) -> None:
        """Begin trials."""
        fidelity, every = _text(body, "fidelity"), self._page.fidelities
        if fidelity not in [*every]:
            raise Refused(f"fidelity must be one of {', '.join(every)}, got {fidelity!r}")
        source_of = partial(self._page.trials, _changes(body), fidelity)
        self._alone(self._trials.start, _whole(body, "trials"), source_of)

    def _paint(self, body: Body) -> dict[str, Any]:
        with self._painting:  # one at a time, so that each is quick
            return self._page.paint(_changes(body))

    def _save(self, body: Body) -> dict[str, str]:
        """Write the design over its base file."""
        name, page = _text(body, "name"), self._page
        if not NAME.fullmatch(name):
            raise Refused(
                "name must have letters, digits, - and _ alone, at most 64, without .toml, got "
                f"{name[:80]!r}"
            )
        path = self._folder / f"{name}.toml"
        over = " in place of an earlier file" if path.exists() else ""
        page.write(_changes(body), path, f"saved by startrack page, from {page.path.name}")
        numbers = f"startrack {page.command} {path} has the numbers shown here"
        return {"done": f"{path} is written{over}; {numbers}"}


def _changes(body: Body) -> list[str]:
    changes = body.get("changes", [])
    if not isinstance(changes, list) or len(changes) > MOST_CHANGES:
        raise Refused(f"changes must be a list of at most {MOST_CHANGES} texts")
    for change in changes:
        if not isinstance(change, str) or len(change) > MOST_LETTERS:
            raise Refused(f"a change must be a text KEY=VALUE, got {str(change)[:80]!r}")
    return changes


def _text(body: Body, name: str) -> str:
    value = body.get(name, "")
    if not isinstance(value, str):
        raise Refused(f"{name} must be a text, got {str(value)[:80]!r}")
    return value


def _whole(body: Body, name: str) -> int:
    value = body.get(name, 0)
    if type(value) is not int or not 0 <= value < LARGEST:
        raise Refused(f"{name} must be a whole number from 0 on, got {str(value)[:80]!r}")
    return value
