"""Emulators of a design space -> ranges and prices around its best design."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, printed
from startrack.optimise.emulators import SOLVED, Emulators


@printed
class Span(NamedTuple):
    """Unit-cube coordinates of a variable between which the score stays within the precision.

    at_low, at_high  (d,) the designs there
    everywhere       whether the variable does not matter
    """

    low: float
    high: float
    at_low: Floats
    at_high: Floats
    everywhere: bool


def spans_of(model: Emulators, best: Floats, precision: float, halvings: int = 0) -> list[Span]:
    """Range of each variable in which the score stays within the precision of a design's score.

    At each value of the variable, the other variables have the values of the least score.

    halvings  number of halvings of the step between two nodes, at the ends of a span
    """
    spans = list[Span]()
    limit = float(model.score(best[None])[0]) + precision
    nodes = np.linspace(0, 1, model.settings.span_nodes)

    def best_at(axis: int, value: float, start: Floats) -> Floats | None:
        """The best design with a variable at a value; None if its score exceeds the limit."""
        fixed = np.arange(len(best)) == axis
        box = np.where(fixed, value, 0.0), np.where(fixed, value, 1.0)
        point, score = model.least(np.array([start, best]), box=box)
        return None if score > limit else point

    for axis, middle in enumerate(best):
        ends = [best, best]
        for side, way in enumerate((nodes[nodes < middle][::-1], nodes[nodes > middle])):
            beyond = None
            for value in way:
                point = best_at(axis, value, ends[side])
                if point is None:
                    beyond = value
                    break
                ends[side] = point
            for _ in range(halvings if beyond is not None else 0):
                value = (ends[side][axis] + beyond) / 2
                point = best_at(axis, value, ends[side])
                if point is None:
                    beyond = value
                else:
                    ends[side] = point
        low, high = (float(end[axis]) for end in ends)
        everywhere = high - low >= model.settings.whole_span
        spans.append(Span(low, high, ends[0], ends[1], everywhere))
    return spans


def prices_of(model: Emulators, best: Floats, precision: float) -> dict[str, float]:
    """Price of each limit of a design: decrease of ln(error) if the margin is relaxed.

    The margin is relaxed by one per cent of its limit. Both errors are the least that a search from
    the design finds in the emulators, so that a design that is not the best of the emulators has no
    price for that. Margins that are met by more than this, and prices below a tenth of the
    precision, are left out.
    """
    least, prices = model.least(best[None])[1], dict[str, float]()
    for name, margin in model.margins.items():
        expected = float(margin.expected(best[None])[0])
        scale = model.scale(name)
        step = float(scale.of(np.array(model.settings.relaxed_limit * (scale.room or 1.0))))
        if name == SOLVED or expected > 2 * step:
            continue
        easier = replace(margin, mean=margin.mean + step)
        relaxed = replace(model, margins=model.margins | {name: easier})
        price = least - relaxed.least(best[None])[1]
        if price > precision / 10:
            prices[name] = price
    return dict(sorted(prices.items(), key=lambda item: -item[1]))


@printed
class Landscape(NamedTuple):
    """A design space around its best design, by the forecasts.

    forecasts  unit-cube coordinates of the designs
    expected   for each design, ln(arcsec) of the objective; NaN if no attitude is expected
    met        for each design, whether all requirements are met by its forecast
    left       bound of a further decrease of ln(error), with 98 % confidence
    spans      span of each variable, by its name
    prices     decrease of ln(error) if a limit is relaxed by 1 %, by the margin's name
    ending     why there are no more forecasts
    """

    forecasts: tuple[tuple[float, ...], ...]
    expected: tuple[float, ...]
    met: tuple[bool, ...]
    left: float
    spans: dict[str, Span]
    prices: dict[str, float]
    ending: str

    @property
    def unimportant(self) -> list[str]:
        """Names of the variables that do not matter."""
        return [name for name, span in self.spans.items() if span.everywhere]
