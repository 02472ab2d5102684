"""Path and body of a request -> the answer, or the sentence that a command would print."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Refused
from startrack.page.earth import EarthPage
from startrack.page.search import SearchRun
from startrack.page.tracker import TrackerPage
from startrack.page.trials import TrialsRun

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
MOST_CHANGES, MOST_LETTERS = 500, 20_000
LARGEST_TRIAL = 2**53

Body = Mapping[str, Any]


class Routes:
    """All that a page may ask for.

    executor  computes what is shown later, so that painting does not wait
    changes   that the command was called with
    """

    def __init__(
        self,
        page: TrackerPage | EarthPage,
        folder: Path,
        executor: Executor,
        search: SearchRun,
        trials: TrialsRun | None,
        changes: list[str],
    ) -> None:
        self._page, self._folder, self._executor = page, folder, executor
        self._search, self._trials, self._changes = search, trials, changes
        self._painting = threading.Lock()
        self._by_path: dict[str, Callable[[Body], Any]] = {
            "about": self._about,
            "form": lambda body: page.form(_changes(body)),
            "keys": lambda body: page.keys(_text(body, "words")),
            "paint": self._paint,
            "later": self._later,
            "save": self._save,
            "search/start": lambda body: search.start(_changes(body)),
            "search/stop": lambda body: search.stop(),
            "search/state": lambda body: search.state(_whole(body, "first")),
            "trials/start": self._start_trials,
            "trials/stop": lambda body: self._of_tracker().stop(),
            "trials/state": lambda body: self._of_tracker().state(),
        }

    def __contains__(self, path: str) -> bool:
        return path in self._by_path

    def answer(self, path: str, body: Body) -> Any:
        """The answer to a request; where it is refused, {"refused": sentence}."""
        try:
            with np.errstate(all="ignore"):
                return self._by_path[path](body)
        except BrokenExecutor:
            return {"refused": "the process that computes in the background has ended; try again"}
        except (ValueError, TypeError, OSError, MemoryError) as error:
            return {"refused": " ".join(str(error).split()) or type(error).__name__}

    def close(self) -> None:
        """End what runs."""
        self._search.stop()
        if self._trials:
            self._trials.stop()

    def _about(self, body: Body) -> dict[str, Any]:
        return {
            "kind": self._page.kind,
            "name": self._page.path.stem,
            "file": str(self._page.path),
            "folder": str(self._folder),
            "changes": self._changes,
            "not_shown": self._page.not_shown,
        }

    def _paint(self, body: Body) -> dict[str, Any]:
        with self._painting:  # one after the other, so that each is quick
            return self._page.paint(_changes(body), _whole(body, "trial"))

    def _later(self, body: Body) -> Any:
        """What takes longer: margins over units and conditions, or the error at a slew rate."""
        page, changes = self._of_tracker_page(), _changes(body)
        rate = body.get("rate")
        if rate is None:
            return self._executor.submit(page.requirements, changes).result()
        if not (isinstance(rate, int | float) and 0 <= rate < 10):
            raise Refused(f"rate must be a number from 0 to 10 rad / s, got {rate!r}")
        return self._executor.submit(page.at_rate, changes, float(rate)).result()

    def _save(self, body: Body) -> dict[str, Any]:
        name = _text(body, "name")
        if not NAME.fullmatch(name):
            raise Refused(
                "name must have letters, digits, - and _ alone, at most 64, without .toml, got "
                f"{name[:80]!r}"
            )
        path = self._folder / f"{name}.toml"
        return {"done": self._of_tracker_page().save(_changes(body), path)}

    def _start_trials(self, body: Body) -> None:
        self._of_tracker().start(_changes(body), _whole(body, "trials"), _text(body, "fidelity"))

    def _of_tracker(self) -> TrialsRun:
        if self._trials is None:
            raise Refused(self._page.not_shown)
        return self._trials

    def _of_tracker_page(self) -> TrackerPage:
        if not isinstance(self._page, TrackerPage):
            raise Refused(self._page.not_shown)
        return self._page


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
    if type(value) is not int or not 0 <= value < LARGEST_TRIAL:
        raise Refused(f"{name} must be a whole number from 0 on, got {str(value)[:80]!r}")
    return value
