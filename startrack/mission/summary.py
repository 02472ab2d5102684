"""Flown -> availability by number of heads, times without an attitude, reacquisition, verdicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from startrack.core import Floats, Ints
from startrack.design import Case
from startrack.mission.engine import Flown
from startrack.mission.heads import Blind
from startrack.mission.parameters import MissionRequirements

EDGES = (0.0, 10.0, 30.0, 60.0, 300.0, 900.0, 3600.0, np.inf)  # second, of the histogram


@dataclass(frozen=True, eq=False)
class Spells:
    """Uninterrupted times in which something holds.

    begin   (k,) second after the begin of the mission
    length  (k,) second; each end is right to a step
    """

    begin: Floats
    length: Floats

    @property
    def longest(self) -> float:
        """Second; 0 where it never holds."""
        return float(self.length.max(initial=0.0))

    def histogram(self) -> Ints:
        """Number of spells in each of the classes of EDGES, the upper edge included."""
        inside = np.searchsorted(EDGES, self.length, side="left") - 1
        return np.bincount(inside, minlength=len(EDGES) - 1)

    def worst(self, count: int) -> list[tuple[float, float]]:
        """Begin and length of the longest, longest first."""
        order = np.argsort(-self.length, kind="stable")[:count]
        return [(float(self.begin[k]), float(self.length[k])) for k in order]


def spells(holds: NDArray[np.bool_], step: float) -> Spells:
    """The times in which (m,) steps hold."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    begin, end = edge[::2], edge[1::2]
    return Spells(step * begin.astype(float), step * (end - begin).astype(float))


@dataclass(frozen=True, eq=False)
class Availability:
    """How often heads are valid.

    heads   (h + 1,) fraction of the time with exactly so many valid heads
    causes  Blind -> (h,) fraction of the time in which it blinds each head
    alone   (h,) fraction of the time in which each head is valid
    known   (h + 1,) fraction of the time with an attitude of exactly so many heads: of those that
            are valid, with the probability that enough stars are detected
    none    times without a valid head
    each    times in which each head is blind
    """

    heads: Floats
    causes: dict[Blind, Floats]
    alone: Floats
    known: Floats
    none: Spells
    each: tuple[Spells, ...]

    def at_least(self, count: int) -> float:
        """Fraction of the time with attitudes of so many heads or more."""
        return float(self.known[count:].sum())


def availability_of(flown: Flown) -> Availability:
    """The availability of a mission, each cause counts where it blinds, also beside others."""
    valid = flown.valid
    exactly = np.bincount(valid, minlength=len(flown.blind) + 1) / len(valid)
    return Availability(
        exactly,
        {cause: ((flown.blind & cause) > 0).mean(axis=1) for cause in Blind},
        (flown.blind == 0).mean(axis=1),
        flown.exactly / len(valid) if flown.exactly.any() else exactly,
        spells(valid == 0, flown.step),
        tuple(spells(blind > 0, flown.step) for blind in flown.blind),
    )


@dataclass(frozen=True)
class Reacquisition:
    """How long a head takes from the end of a blinding to its next attitude.

    times   number of reacquisitions in the mission
    mean    second, expected over them
    level   second, that 99 % of them do not exceed
    """

    times: int
    mean: float
    level: float


def reacquisition_of(case: Case, chances: Sequence[float]) -> Reacquisition:
    """The reacquisitions of a head.

    The frames after a blinding lie at a random phase of the frame rate, each has an attitude with
    the probability of the sky there, and its result comes after half of the exposure and the
    read-out:

        time = latency + (n - u) period,   n frames to the first attitude, u uniform in [0, 1]

    chances   probability of an attitude at each end of a blinding
    Accuracy  model: frames are independent; the time that the tracker computes, and stray light
              that fades after the blinding, are left out.
    """
    period, latency = timing_of(case)
    chance = np.clip(np.array(chances, float), 1e-6, 1.0)
    if not len(chance):
        return Reacquisition(0, math.nan, math.nan)
    mean = float((1 / chance - 0.5).mean()) * period + latency

    def later(time: float) -> float:
        """Fraction of the reacquisitions that take longer."""
        frames = max((time - latency) / period, 0.0)
        full = math.floor(frames)
        rest = (1 - chance) ** full * (1 - (frames - full) * chance)
        return float(rest.mean()) - 0.01

    high = latency + period
    while later(high) > 0:
        high *= 2
    return Reacquisition(len(chance), mean, float(brentq(later, latency, high)))


def timing_of(case: Case) -> tuple[float, float]:
    """Second between two frames, and from the middle of an exposure to the end of its read-out."""
    detector = case.instrument.detector
    reading = detector.rows * detector.columns / detector.pixel_rate
    return 1 / detector.update_rate, detector.exposure / 2 + reading


@dataclass(frozen=True)
class OfBeta:
    """The mission while the Sun is at some angles to the plane of the orbit.

    low, high   radian
    time        1, fraction of the mission
    one, two    fraction of that time with at least one, and two, valid heads
    error       radian, rms of the fused attitude about its worst axis
    """

    low: float
    high: float
    time: float
    one: float
    two: float
    error: float


def over_beta(flown: Flown) -> list[OfBeta]:
    """The mission by the angle from the Sun to the plane of the orbit, where it occurs."""
    steps, one, two, _, *squares = flown.by_beta.sum(axis=2)
    edge = np.linspace(-math.pi / 2, math.pi / 2, len(steps) + 1)
    worst = np.max(squares, axis=0) / np.maximum(one, 1)
    return [
        OfBeta(
            float(edge[k]),
            float(edge[k + 1]),
            float(steps[k] / steps.sum()),
            float(one[k] / steps[k]),
            float(two[k] / steps[k]),
            math.sqrt(worst[k]) if one[k] else math.nan,
        )
        for k in np.flatnonzero(steps)
    ]


@dataclass(frozen=True)
class Verdict:
    """Whether a requirement of the mission is met.

    name   key in the mission file
    limit  that it must keep, SI
    value  of the mission, SI
    met    whether it keeps it
    """

    name: str
    limit: float
    value: float
    met: bool


def verdicts(
    needs: MissionRequirements, availability: Availability, error: float | None = None
) -> list[Verdict]:
    """The requirements that the mission file gives, in their order.

    error  radian, rms of the fused attitude about its worst axis; None: not known
    """
    values = {
        "max_blind": availability.none.longest,
        "availability_one": availability.at_least(1),
        "availability_two": availability.at_least(2) if len(availability.heads) > 2 else None,
        "max_error": error,
    }
    results = []
    for name, value in values.items():
        limit = getattr(needs, name)
        if limit is not None and value is not None:
            met = value >= limit if name.startswith("availability") else value <= limit
            results.append(Verdict(name, limit, value, bool(met)))
    return results
