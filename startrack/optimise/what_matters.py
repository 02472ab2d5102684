"""Designs around a design -> effect, share of the variance and range of each variable."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from startrack.core import Advance, printed
from startrack.metrics import Interval
from startrack.optimise.evaluate import Foresight
from startrack.optimise.explorer import Explorer
from startrack.optimise.explorer_settings import DEFAULTS
from startrack.optimise.landscape import Span, spans_of
from startrack.optimise.sensitivity import Probes, Sensitivity, probe, sensitivities_of
from startrack.optimise.source import StudiedSource

DESIGNS = 64  # over the space; chosen by hand: twice as many narrow the indices by a third
# Largest number of forecasts in the search of the best design, around which the ranges lie. Chosen
# by hand: searches of the shipped designs need fewer.
REFINING = 64
HALVINGS = 4  # of a step of 1/24 of a range, to find the ends of the range within the precision
PER_CENT = 0.01
# Ranges do not need a best design that is more exact than the roughness of forecasts.
SETTINGS = replace(DEFAULTS, polish_per_variable=0)


@dataclass(frozen=True)
class Influence:
    """Effect of one variable on a design.

    sensitivity  of the objective
    change       1, relative change of the objective if the variable is larger by one per cent (if
                 it is zero, by one per cent of its range)
    margins      changes of the margins for the same change of the variable
    costs        changes of the costs for the same change, by names with their units
    missed       margins that are missed with the variable at its low and at its high bound
    span         range within which the objective stays within the precision of the best
    """

    sensitivity: Sensitivity
    change: float
    margins: Mapping[str, float]
    costs: Mapping[str, float]
    missed: tuple[tuple[str, ...], tuple[str, ...]]
    span: Span


@printed
@dataclass(frozen=True)
class WhatMatters:
    """Variables on which the objective and the margins of a design depend.

    here      the forecast of the design
    tightest  name of the tightest margin, relative to its limit; empty without any
    best      the best forecast in the ranges
    met       whether the best forecast meets all limits
    left      largest possible decrease of ln(objective) in the ranges, with 98 % confidence
    count     number of forecasts
    """

    influences: tuple[Influence, ...]
    here: Foresight
    tightest: str
    best: Foresight
    met: bool
    left: float
    count: int

    @property
    def ordered(self) -> list[Influence]:
        """The influences, the largest share of the variance first."""
        return sorted(self.influences, key=lambda one: -one.sensitivity.total.value)


def forecasts_needed(dimensions: int, designs: int = DESIGNS) -> int:
    """Largest number of forecasts."""
    return 4 * dimensions + designs * (dimensions > 1) + REFINING


def what_matters(
    source: StudiedSource, designs: int = DESIGNS, progress: Advance | None = None
) -> WhatMatters:
    """Sensitivities of a design, and the ranges of its variables, by the same forecasts.

    `sensitivities` needs forecasts over the whole space. An explorer adds the forecasts that lead
    to the best design, as in a search. Its emulators give the range of each variable around this
    design if the others are adapted.

    designs   over the space, a power of two
    progress  called with the number of designs that were just forecast
    Raises    as `sensitivities`
    Accuracy  model: the forecasts'. Indices have intervals; ranges are those of the emulators,
              which `left` bounds.
    """
    probes = probe(source, designs, progress)
    explorer = _explored(source, probes, progress)
    best = explorer.best
    spans = spans_of(explorer.emulators, best, source.precision, HALVINGS)
    influences = [
        _influence(source, probes, axis, sensitivity, spans[axis])
        for axis, sensitivity in enumerate(sensitivities_of(source, probes))
    ]
    margins = probes.here.margins
    left = {name: margin / source.rooms.get(name, 1.0) for name, margin in margins.items()}
    return WhatMatters(
        influences=tuple(influences),
        here=probes.here,
        tightest=min(left, key=lambda name: left[name]) if left else "",
        best=explorer.forecast_of(best),
        met=explorer.met(best),
        left=max(0.0, explorer.score - explorer.lowest()),
        count=len(explorer.points),
    )


def _explored(source: StudiedSource, probes: Probes, progress: Advance | None) -> Explorer:
    """The forecasts, and those that lead to the best design from them."""
    raw = list(probes.foresights)
    explorer = Explorer(
        source, points=list(probes.points), raw=raw, values=list(raw), settings=SETTINGS
    )
    known = most = len(explorer.points)
    most += REFINING
    explorer.complete()
    while not explorer.ending and len(explorer.points) < most:
        explorer.step(most - len(explorer.points))
        if progress:
            progress(len(explorer.points) - known)
        known = len(explorer.points)
    if progress:
        progress(most - known)
    return explorer


def _influence(
    source: StudiedSource, probes: Probes, axis: int, sensitivity: Sensitivity, span: Span
) -> Influence:
    name = source.names[axis]
    (below, low), (above, high) = probes.beside(axis)
    ends = probes.ends(axis)
    value = source.start_values[name]
    lowest, highest = (source.value(point, name) for point, _ in ends)
    step = PER_CENT * (value or highest - lowest)
    part = step / (source.value(above, name) - source.value(below, name))
    margins = {
        margin: part * (high.margins[margin] - low.margins[margin])
        for margin in probes.here.margins
        if margin in low.margins and margin in high.margins
    }
    missed = tuple(
        tuple(margin for margin, left in foresight.margins.items() if left < 0)
        for _, foresight in ends
    )
    less, more = source.costs(below), source.costs(above)
    costs = {cost: part * (more[cost] - less[cost]) for cost in less}
    change = math.expm1(part * (high.expected - low.expected))
    return Influence(sensitivity, change, margins, costs, (missed[0], missed[1]), span)


def share(index: Interval) -> Interval:
    """A Sobol index between 0 and 1, whose bounds an emulator may exceed."""
    return Interval(*(min(max(end, 0.0), 1.0) for end in (index.value, index.low, index.high)))
