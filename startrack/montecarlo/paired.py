"""Outcomes of two campaigns -> their statistics side by side, and the differences."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from startrack.core import Floats
from startrack.design import Objective
from startrack.metrics import STATED_ALONE, Interval, Limits, correct, fraction_interval

RESAMPLES = 2000  # of the bootstrap; its percentiles of 95 % then scatter by 3 % of the width
PAIRS = 3  # names the stream of the resampling
STATISTICS = (
    Objective("across"),
    Objective("about"),
    Objective("across", 0.9973),
    Objective("across", 0.9973, "per axis"),
)


class Difference(NamedTuple):
    """One statistic of two campaigns.

    name           in words
    first, second  its values: radian, or a fraction for the availability
    change         second minus first, with its 95 % interval
    """

    name: str
    first: float
    second: float
    change: Interval


def differences(
    first: NDArray[np.void],
    second: NDArray[np.void],
    seed: int = 0,
    limits: tuple[Limits, Limits] = (STATED_ALONE, STATED_ALONE),
    paired: bool = True,
) -> list[Difference]:
    """Errors and availability of two campaigns, and their differences.

    Errors: over the trials that both solved, where paired; bootstrap percentiles over trials.
    Availability: Agresti and Min (2005), Statist. Med. 24, 729, for pairs; else the two exact
    intervals as those of independent fractions (Newcombe 1998, Statist. Med. 17, 873, method 10).

    first, second  outcomes; where paired, of the same trials in the same order
    seed           of the bootstrap
    limits         of a correct attitude, of each
    Accuracy       statistical: a level of 99.73 % of fewer than 1000 trials is nearly the largest
                   error, and its bootstrap interval too narrow.
    """
    return [
        *_errors(first, second, seed, paired),
        _availability(correct(first, limits[0]), correct(second, limits[1]), paired),
    ]


def _errors(
    first: NDArray[np.void], second: NDArray[np.void], seed: int, paired: bool
) -> Iterator[Difference]:
    rng = np.random.default_rng(np.random.SeedSequence((seed, PAIRS)))
    known = [one["solved"] & ~one["false"] for one in (first, second)]
    if paired:
        known = [known[0] & known[1]] * 2
    first, second = first[known[0]], second[known[1]]
    n, m = len(first), len(second)
    chosen = rng.integers(0, n, (RESAMPLES, n)) if n else np.empty((0, 0), int)
    other = chosen if paired else rng.integers(0, m, (RESAMPLES, m)) if m else chosen[:0]
    for objective in STATISTICS:
        a, b = objective.squares(first), objective.squares(second)
        if not (n and m):
            nothing = Interval(math.nan, math.nan, math.nan)
            yield Difference(str(objective), math.nan, math.nan, nothing)
            continue
        made = _in_parts(objective, b, other) - _in_parts(objective, a, chosen)
        low, high = np.quantile(made, [0.025, 0.975]).tolist()
        one, two = float(objective.of(a)), float(objective.of(b))
        yield Difference(str(objective), one, two, Interval(two - one, low, high))


def _in_parts(objective: Objective, squares: Floats, chosen: NDArray[np.int64]) -> Floats:
    """The statistic of each resample; few at a time, for the memory."""
    parts = np.array_split(chosen, max(1, chosen.size // 2_000_000))
    return np.concatenate([objective.of(squares[part]) for part in parts])


def _availability(first: NDArray[np.bool_], second: NDArray[np.bool_], paired: bool) -> Difference:
    one, two = float(first.mean()), float(second.mean())
    if paired:
        n = len(first) + 2
        gained = (int((second & ~first).sum()) + 0.5) / n
        lost = (int((first & ~second).sum()) + 0.5) / n
        half = float(special.ndtri(0.975)) * math.sqrt(
            max(gained + lost - (gained - lost) ** 2, 0.0) / n
        )
        change = Interval(two - one, gained - lost - half, gained - lost + half)
    else:
        a, b = (fraction_interval(int(each.sum()), len(each)) for each in (first, second))
        low = two - one - math.hypot(two - b.low, a.high - one)
        high = two - one + math.hypot(b.high - two, one - a.low)
        change = Interval(two - one, low, high)
    return Difference("availability", one, two, change)
