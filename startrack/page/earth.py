"""Earth camera's scene, changed values -> forecast and margins, as by the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from startrack.core import Refused
from startrack.earth.retrieval import EarthProblem, load_earth_design, scene_keys
from startrack.io import to_table
from startrack.page import form
from startrack.problem import Margin


@dataclass(frozen=True)
class EarthPage:
    """A scene with a retrieval and a campaign. Changes are texts KEY=VALUE."""

    path: Path
    seed: int

    kind: ClassVar[str] = "earth"
    all_keys: ClassVar = staticmethod(scene_keys)
    not_shown: ClassVar[str] = (
        "images, the ground and trials of an Earth camera: see the commands earth, montecarlo "
        "and verify. The page does not save a scene: give changed values to a command by --set"
    )

    def load(self, changes: Sequence[str]) -> EarthProblem:
        """The problem with changed values. Raises Refused, as `load_earth_design`."""
        return EarthProblem(load_earth_design(self.path, changes))

    def form(self, changes: Sequence[str]) -> list[dict[str, Any]]:
        """A row for each key."""
        return form.rows(to_table(self.load(changes).design), self.all_keys())

    def paint(self, changes: Sequence[str], trial: int) -> dict[str, Any]:
        """Forecast and margins; they do not depend on the trial's number."""
        problem = self.load(changes)
        words, costs = problem.text(), _margins(problem.costs())
        sliders = form.sliders(problem.design, problem.variables)
        try:
            expected = problem.expect()
        except Refused as reason:
            return {"sliders": sliders, "blind": str(reason), "requirements": costs}
        value = f"{expected.value:.4g} {words.unit}".strip()
        return {
            "sliders": sliders,
            "answer": f"{words.value}: {value}, by formula",
            "parts": [
                {"name": " ".join(words.parts[name]), "value": part}
                for name, part in expected.parts.items()
            ],
            "left_out": list(expected.left_out),
            "requirements": [*costs, *_margins(expected.margins)],
        }


def _margins(margins: Mapping[str, Margin]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "value": f"{margin.value:.4g} {margin.unit}".strip(),
            "limit": f"{margin.limit:.4g} {margin.unit}".strip(),
            "margin": margin.relative,
        }
        for name, margin in margins.items()
    ]
