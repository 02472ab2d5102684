"""Design file -> errors of the unit as designed, by formula, for draws of its unknown values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack.budget import analytic
from startrack.core import Advance, Floats, Refused, printed, whole
from startrack.design import load_design
from startrack.prediction.draws import MIDDLE, drawn_design
from startrack.verification import expected_margins, margins


@printed
class DesignedDraw(NamedTuple):
    """Error of the unit as designed, with one value of each unknown.

    errors  radian rms per axis (2,), across the boresight and about it; NaN without an attitude
    met     whether the formula meets each requirement of the campaign, by name, in the design's own
            condition; empty without an attitude
    """

    errors: Floats
    met: dict[str, bool]


@printed
@dataclass(frozen=True)
class DesignedDraws:
    """Draws of the unknown values of a design.

    unknowns  number of unknown values
    middle    the draw with all unknown values at their middle
    draws     draws with other values, of equal weight
    """

    unknowns: int
    middle: DesignedDraw
    draws: tuple[DesignedDraw, ...]

    @property
    def factors(self) -> Floats:
        """(n, 2) errors of each draw over errors of the middle draw; NaN without an attitude."""
        return np.array([draw.errors / self.middle.errors for draw in self.draws])

    @property
    def lost(self) -> int:
        """Number of draws without an attitude, or with a value outside its limits."""
        return int(np.isnan([draw.errors[0] for draw in self.draws]).sum())

    @property
    def all_met(self) -> int:
        """Number of draws that meet all requirements."""
        return sum(bool(draw.met) and all(draw.met.values()) for draw in self.draws)

    def count_met(self) -> dict[str, int]:
        """Number of draws that meet each requirement, by its name."""
        names = dict.fromkeys(name for draw in self.draws for name in draw.met)
        return {name: sum(draw.met.get(name, False) for draw in self.draws) for name in names}


def draw_as_designed(
    path: Path, seed: int, count: int, changes: Sequence[str] = (), progress: Advance | None = None
) -> DesignedDraws:
    """Errors of the unit as designed, by its analytic budget, in draws of all unknowns.

    The draws are those of `draw_unknowns`. Two designs with one seed have equal quantiles for
    unknowns of the same name. Therefore the ratio of their errors is more certain than each error.

    progress  called with 1 after each draw
    Raises    as `load_design`.
    Accuracy  as `analytic`; variations from unit to unit are not included.
    """
    whole(1, 10**4, count=count)
    unknowns = load_design(path, changes).unknowns
    draws = list[DesignedDraw]()
    for number in (MIDDLE, *range(count)):
        draws.append(_draw(path, changes, seed, number, count))
        if progress:
            progress(1)
    return DesignedDraws(len(unknowns), draws[0], tuple(draws[1:]))


def _draw(path: Path, changes: Sequence[str], seed: int, number: int, count: int) -> DesignedDraw:
    try:
        design = drawn_design(path, changes, seed, number, count, {})
        budget = analytic(design.case)
    except Refused:
        return DesignedDraw(np.full(2, np.nan), {})
    met = dict[str, bool]()
    if design.campaign:
        needs = design.campaign.requirements
        by_name = margins(needs, design.case) | expected_margins(needs, budget)
        met = {name: bool(value >= 0) for name, value in by_name.items()}
    return DesignedDraw(np.array(budget.sum), met)
