"""A search -> a file with a line of JSON for each forecast and each design that was tried."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from startrack.core import arcsec
from startrack.design import Case, found_at
from startrack.io import finite
from startrack.optimise.evaluate import Evaluation, Foresight
from startrack.optimise.steps import SearchStage


class SearchLog:
    """Lines of a search; each is written as soon as its design is known.

        {"by": "formula", "values": {...}, "value": 3.2, "margins": {...}, "met": true}
        {"by": "120 trials", ...}
        {"stage": "40 forecasts", "part": 0.3}

    Values of variables are SI. The value is the minimised quantity: an error in arcsec, or a cost
    or objective in its unit. A search that continues first writes the lines that it knows.

    unit  unit of the errors of tried designs, radian for star trackers
    """

    def __init__(self, path: Path, unit: float = arcsec) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file, self._unit = path.open("w", encoding="utf-8"), unit

    def forecast_of(self, case: Case, foresight: Foresight, names: list[str]) -> None:
        """Write the forecast of a star tracker's design."""
        self.forecast({name: found_at(case, name) for name in names}, foresight)

    def forecast(self, values: Mapping[str, float], foresight: Foresight) -> None:
        """Write the forecast of a design."""
        value = math.exp(foresight.expected)
        self._design("formula", values, value, foresight.margins, math.isfinite(value))

    def tried(self, design: Evaluation) -> None:
        """Write the results of a design's trials."""
        cost = math.isfinite(design.cost)
        value = design.cost if cost else design.error / self._unit
        self._design(
            f"{design.trials} trials", design.values, value, design.margins, design.trials > 0
        )

    def stage(self, stage: SearchStage) -> None:
        """Write the progress of the search."""
        self._write({"stage": stage.name, "part": stage.part})

    def _design(
        self,
        by: str,
        values: Mapping[str, float],
        value: float,
        margins: Mapping[str, float],
        has_value: bool,
    ) -> None:
        met = has_value and all(margin >= 0 for margin in margins.values())
        line = {"by": by, "values": dict(values), "value": value, "margins": dict(margins)}
        self._write({**line, "met": met})

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(finite(line)) + "\n")
        self._file.flush()

    def __enter__(self) -> SearchLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
