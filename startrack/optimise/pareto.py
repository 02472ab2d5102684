"""DesignSpace, two objectives -> the designs that no other design beats in both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Refused, arcsec, one_of, whole
from startrack.design import Campaign, DesignSpace, Judged, Objective, fewest_trials_beyond
from startrack.metrics import Interval
from startrack.optimise.evaluate import PENALTY, combined, missed
from startrack.optimise.forecast import Forecast, expect, expected_objective
from startrack.optimise.runner import FRESH, TrialRunner
from startrack.optimise.search import least_of_all
from startrack.optimise.units import fresh_units, level_interval_of_units

METHODS = ("epsilon", "weighted")
UNITS = {"mass": "kg", "power": "W", "data rate": "bit / s", "volume": "m3", "cost": "1"}


@dataclass(frozen=True)
class Goals:
    """Two objectives that are traded off.

    first, second  an objective of the error, such as "across" or "about-99.73", or a cost of a
                   design: "mass", "power", "data rate", "volume" or "cost"
    """

    first: str = "across"
    second: str = "mass"

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise Refused(f"first and second must differ, got {self.first} twice")
        for goal in (self.first, self.second):
            if goal not in UNITS:
                Objective.read(goal)


@dataclass(frozen=True)
class Point:
    """A design of the front.

    coordinates  (d,) in the unit cube
    values       of the variables, SI
    expected     of both goals, by the analytic budget where they are errors
    measured     of both goals, by trials
    intervals    of both goals, with the intervals of the trials
    """

    coordinates: tuple[float, ...]
    values: dict[str, float]
    expected: tuple[float, float]
    measured: tuple[float, float]
    intervals: tuple[Interval, Interval]


def front(
    space: DesignSpace,
    campaign: Campaign,
    goals: Goals,
    runner: TrialRunner,
    points: int = 7,
    method: str = "epsilon",
    watch: Callable[[Point], None] | None = None,
) -> list[Point]:
    """Pareto front of both goals by the analytic budget; trials then measure each point.

    epsilon:   least first goal while the second is at most e, for e between the two extremes
    weighted:  least w ln first + (1 - w) ln second, for w from 1 to 0

    The first finds all points of the front, the second only those where it is convex.
    Source: Miettinen (1999), Nonlinear Multiobjective Optimization, 3.1 and 3.2.

    Returns  the points that are not dominated by the budget, in order of the first
    Raises    ValueError where no design in the design space meets the requirements.
    Accuracy  model: the budget's; `measured` shows it.
    """
    whole(2, 1000, points=points)
    one_of(METHODS, method=method)
    if campaign.units is not None:
        _check_levels(goals, campaign)
    forecasts = _Forecasts(space, campaign, goals, runner.seed)
    first, second = (
        forecasts.least(partial(_weighted, fraction), space.start) for fraction in (1.0, 0.0)
    )
    if method == "epsilon":
        steps = np.linspace(forecasts(first)[1], forecasts(second)[1], points)
        scores = [partial(_limited, limit) for limit in steps]
    else:
        scores = [partial(_weighted, fraction) for fraction in np.linspace(1, 0, points)]
    found = [first]
    for score in scores[1:-1]:
        found.append(forecasts.least(score, found[-1]))
    found.append(second)
    kept = [
        found[i] for i in undominated(np.array([forecasts(coordinates) for coordinates in found]))
    ]
    kept.sort(key=lambda coordinates: float(forecasts(coordinates)[0]))
    result = []
    for coordinates in kept:
        result.append(
            _measured(space, campaign, goals, runner, coordinates, forecasts(coordinates))
        )
        if watch:
            watch(result[-1])
    return result


def _check_levels(goals: Goals, campaign: Campaign) -> None:
    for goal in (goals.first, goals.second):
        fewest = 0 if goal in UNITS else fewest_trials_beyond(Objective.read(goal))
        if campaign.trials_per_unit < fewest:
            raise Refused(
                f"campaign.unit_trials must be at least {fewest} for the goal {goal} over units, "
                f"got {campaign.trials_per_unit}"
            )


def _limited(limit: float, pair: Floats) -> float:
    return float(pair[0] + PENALTY * max(0.0, pair[1] - limit))


def _weighted(fraction: float, pair: Floats) -> float:
    return float(fraction * pair[0] + (1 - fraction) * pair[1])


def undominated(values: Floats) -> list[int]:
    """Indices of the non-dominated rows of values (n, k), least best; of equal rows the first."""
    return [
        i
        for i, one in enumerate(values)
        if not any(
            (other <= one).all() and ((other < one).any() or j < i)
            for j, other in enumerate(values)
            if j != i
        )
    ]


def cost_of(campaign: Campaign, goal: str) -> Callable[..., float] | None:
    """The cost model of a goal, None where the goal is an error."""
    needs = campaign.requirements
    models = {
        "mass": needs.mass,
        "power": needs.power,
        "data rate": needs.data_rate,
        "volume": needs.volume,
        "cost": needs.cost,
    }
    return models.get(goal)


class _Forecasts:
    """Logarithms of both goals by the budget, computed once for each design."""

    def __init__(self, space: DesignSpace, campaign: Campaign, goals: Goals, seed: int) -> None:
        self._space, self._campaign, self._seed = space, campaign, seed
        self._goals = (goals.first, goals.second)
        self._known = dict[bytes, tuple[Floats, float]]()

    def __call__(self, coordinates: Floats) -> Floats:
        return self._known_or_new(coordinates)[0]

    def _known_or_new(self, coordinates: Floats) -> tuple[Floats, float]:
        key = coordinates.tobytes()
        if key not in self._known:
            self._known[key] = self._new(coordinates)
        return self._known[key]

    def _new(self, coordinates: Floats) -> tuple[Floats, float]:
        try:
            case = self._space.design(coordinates)
            _, margins = expect(case, self._campaign, self._seed)
        except Refused:
            return np.full(2, math.nan), math.nan
        pair = []
        for goal in self._goals:
            model = cost_of(self._campaign, goal)
            pair.append(
                model(case)
                if model
                else expected_objective(case, self._campaign, goal, self._seed) / arcsec
            )
        return np.log(pair), missed(margins)

    def least(self, score: Callable[[Floats], float], start: Floats) -> Floats:
        """The least of a score of both goals, of all designs so far that meet the requirements.

        Raises  ValueError where none does.
        """

        def penalised(coordinates: Floats) -> float:
            pair, short = self._known_or_new(coordinates)
            return score(pair) + PENALTY * short

        fraction = max(1, self._campaign.analytic_evaluations // 2)
        least_of_all(penalised, start, fraction, fraction)
        met = {key: score(pair) for key, (pair, short) in self._known.items() if short == 0}
        if not met:
            raise Refused(
                "no design in the design space meets the requirements that need no trials"
            )
        return np.frombuffer(min(met, key=met.__getitem__))


def _measured(
    space: DesignSpace,
    campaign: Campaign,
    goals: Goals,
    runner: TrialRunner,
    coordinates: Floats,
    expected: Floats,
) -> Point:
    judged = campaign.judged(space.design(coordinates))
    tried = {
        one.name: fresh_units(one, campaign, runner)
        if one.units is not None
        else runner.run(one.case, campaign.most_trials, campaign.fidelity, FRESH)
        for one in judged
        if one.weight
    }
    found = []
    for goal, known in zip((goals.first, goals.second), np.exp(expected), strict=True):
        if cost_of(campaign, goal):
            found.append(Interval(*[float(known)] * 3))
        elif campaign.units is not None:
            found.append(_over_units(judged, tried, Objective.read(goal), campaign, runner.seed))
        else:
            found.append(_interval(judged, tried, Objective.read(goal), runner.seed))
    both = (float(np.exp(expected[0])), float(np.exp(expected[1])))
    measured = found[0].value, found[1].value
    point = tuple(coordinates), space.values(coordinates), both, measured
    return Point(*point, (found[0], found[1]))


def _over_units(
    judged: Sequence[Judged],
    tried: Mapping[str, NDArray[np.void]],
    objective: Objective,
    campaign: Campaign,
    seed: int,
) -> Interval:
    """Arcsec, the level of the objective over the fresh units in all conditions of a weight."""
    counted = [one for one in judged if one.name in tried and one.units is not None]
    units, weights = counted[0].units, [one.weight for one in counted]
    assert units
    outcomes = [tried[one.name] for one in counted]
    found = level_interval_of_units(objective, outcomes, units, campaign, weights, seed)
    return Interval(*(each / arcsec for each in (found.value, found.low, found.high)))


def _interval(
    judged: Sequence[Judged], tried: Mapping[str, NDArray[np.void]], objective: Objective, seed: int
) -> Interval:
    """Arcsec, the objective over the trials of all conditions that have a weight."""
    counted = [one for one in judged if one.name in tried]
    squares = [objective.squares(tried[one.name]) for one in counted]
    # Over errors of one arcsec, of which every sample has the same statistic.
    unit = [np.full_like(one, arcsec**2) for one in squares]
    ratio = objective.ratio_of_means(squares, unit, [one.weight for one in counted], seed)
    scale = float(objective.of(unit[0])) / arcsec
    nothing = {one.name: Forecast(np.nan, {}) for one in counted}
    value = combined(judged, tried, objective, nothing) / arcsec
    return Interval(value, ratio.low * scale, ratio.high * scale)
