"""Earth camera's scene, changed values -> its forecast and margins, as commands have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from startrack.core import Refused
from startrack.design import found_at
from startrack.earth.retrieval import EarthProblem, load_earth_design, scene_keys
from startrack.io import to_table
from startrack.page import form
from startrack.problem import Margin

NOT_SHOWN = (
    "images, the ground and trials of an Earth camera: see the commands earth, montecarlo and "
    "verify. A scene is not saved here: give the changed values to a command by --set"
)


@dataclass(frozen=True)
class EarthPage:
    """A scene with a retrieval and a campaign. Changes are texts KEY=VALUE."""

    path: Path
    seed: int

    kind = "earth"
    not_shown = NOT_SHOWN

    def load(self, changes: Sequence[str]) -> EarthProblem:
        """The problem with changed values. Raises Refused, as `load_earth_design`."""
        return EarthProblem(load_earth_design(self.path, changes))

    def form(self, changes: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each key."""
        return form.rows(to_table(self.load(changes).design), scene_keys())

    def keys(self, words: str) -> list[str]:
        """Names of the keys whose names and meanings have all words."""
        parts = words.lower().split()
        texts = {key.name: f"{key.name} {key.meaning}".lower() for key in scene_keys()}
        return [name for name, text in texts.items() if all(part in text for part in parts)]

    def paint(self, changes: Sequence[str], trial: int) -> dict[str, Any]:
        """Forecast and margins; the number of the trial changes nothing."""
        problem = self.load(changes)
        words, costs = problem.text(), _margins(problem.costs())
        sliders = [
            form.slider(bounds, type(found_at(problem.design, bounds.name)) is int)
            for bounds in problem.variables
        ]
        shown: dict[str, Any] = {"sliders": sliders, "later": False}
        try:
            expected = problem.expect()
        except Refused as reason:
            return shown | {"blind": str(reason), "requirements": costs}
        parts = [
            {"name": words.parts[name][0], "unit": words.parts[name][1], "value": value}
            for name, value in expected.parts.items()
        ]
        value = f"{expected.value:.4g} {words.unit}".strip()
        return shown | {
            "answer": f"{words.value}: {value}, by formula",
            "parts": parts,
            "left_out": list(expected.left_out),
            "requirements": [*costs, *_margins(expected.margins)],
        }


def _margins(margins: dict[str, Margin] | Any) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "value": f"{margin.value:.4g} {margin.unit}".strip(),
            "limit": f"{margin.limit:.4g} {margin.unit}".strip(),
            "margin": margin.relative,
        }
        for name, margin in margins.items()
    ]
