"""File of a problem, changed values -> forecast, margins, images and trials, as by the commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from startrack.core import Refused, Rows
from startrack.design import Key
from startrack.earth.retrieval import (
    EarthProblem,
    load_earth_design,
    save_earth_overlay,
    scene_keys,
)
from startrack.io import aligned, to_table
from startrack.moving import MovingProblem, load_moving_design, moving_keys, save_moving_overlay
from startrack.optimise import ProblemSource
from startrack.page import form
from startrack.page.pictures import encoded
from startrack.page.trials import Runner, TrialColumns, TrialSource
from startrack.problem import Margin, beside_forecast

BLOCK = 4  # trials between checks for a stop, or the trials of an image; chosen by hand


class ProblemFiles(NamedTuple):
    """Files of a kind of problem.

    load       function: file, changes -> the problem
    keys       function: all keys of a file
    save       function: file to write, design, base file, comment
    not_shown  what the page leaves out
    """

    load: Callable[[Path, Sequence[str]], EarthProblem | MovingProblem]
    keys: Callable[[], Sequence[Key]]
    save: Callable[[Path, Any, Path, str], None]
    not_shown: str


def _earth(path: Path, changes: Sequence[str]) -> EarthProblem:
    return EarthProblem(load_earth_design(path, changes))


def _moving(path: Path, changes: Sequence[str]) -> MovingProblem:
    return MovingProblem(load_moving_design(path, changes))


EARTH = ProblemFiles(
    _earth,
    scene_keys,
    save_earth_overlay,
    "terrain: images are of level ground straight below, as in trials; see the command earth",
)
MOVING = ProblemFiles(
    _moving, moving_keys, save_moving_overlay, "the field outside the object's surroundings"
)


@dataclass(frozen=True)
class ProblemPage:
    """A problem and its campaign. Changes are texts KEY=VALUE."""

    path: Path
    seed: int
    files: ProblemFiles

    kind: ClassVar[str] = "problem"
    command: ClassVar[str] = "requirements"
    fidelities: ClassVar = EarthProblem.fidelities

    @property
    def not_shown(self) -> str:
        """What the page leaves out."""
        return self.files.not_shown

    def all_keys(self) -> Sequence[Key]:
        """All keys of a file."""
        return self.files.keys()

    def load(self, changes: Sequence[str]) -> EarthProblem | MovingProblem:
        """The problem with changed values. Raises Refused."""
        return self.files.load(self.path, changes)

    def form(self, changes: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each key."""
        return form.rows(to_table(self.load(changes).design), self.all_keys())

    def paint(self, changes: Sequence[str]) -> dict[str, Any]:
        """Forecast and margins."""
        problem = self.load(changes)
        words, costs = problem.text(), _margins(problem.costs())
        shown: dict[str, Any] = {"sliders": form.sliders(problem.design, problem.variables)}
        shown["conditions"] = list(problem.conditions)
        try:
            expected = problem.expect()
        except Refused as reason:
            return shown | {"blind": str(reason), "requirements": costs}
        value = f"{expected.value:.4g} {words.unit}".strip()
        return shown | {
            "answer": f"{words.value}: {value}, by formula",
            "value": expected.value,
            "parts": [
                {"name": words.parts[name][0], "unit": words.parts[name][1], "value": part}
                for name, part in expected.parts.items()
            ],
            "left_out": list(expected.left_out),
            "requirements": [*costs, *_margins(expected.margins)],
        }

    def images(self, changes: Sequence[str], trial: int, condition: str) -> dict[str, Any]:
        """Images, truth and result of a trial."""
        problem = self.load(changes)
        return encoded(problem.view(self.seed, trial, condition or next(iter(problem.conditions))))

    def trials(self, changes: Sequence[str], fidelity: str, run: Runner) -> TrialSource:
        """The trials of `startrack montecarlo`."""
        problem = self.load(changes)
        source, words = ProblemSource(problem, self.seed, run.executor, run.ledger), problem.text()

        def columns(rows: Rows) -> TrialColumns:
            each = (problem.judge(rows[n : n + 1]).value.value for n in range(len(rows)))
            value = np.fromiter(each, float, len(rows))
            named = {f"{words.value} ({words.unit})".removesuffix(" ()"): value}
            return TrialColumns(
                named | {n: rows[n] for n in rows.dtype.names or ()}, np.isfinite(value)
            )

        def lines(rows: Rows) -> list[str]:
            table = beside_forecast(words, problem.judge(rows), problem.expect())
            return list(aligned([["", "by trials", "by formula"], *table]))

        block = max(BLOCK, problem.per_image)
        return TrialSource(lambda count: source.rows(problem, count), columns, lines, block)

    def later(self, changes: Sequence[str], rate: Any = None) -> dict[str, Any]:
        """Refuse: the first results of a problem are complete."""
        raise Refused("a problem has no results that come later")

    def write(self, changes: Sequence[str], path: Path, note: str) -> None:
        """Write the design as an overlay."""
        self.files.save(path, self.load(changes).design, self.path, note)


def _margins(margins: Mapping[str, Margin]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "value": margin.value_text,
            "limit": margin.limit_text,
            "margin": margin.relative,
        }
        for name, margin in margins.items()
    ]
