"""Designs, two goals -> the designs that no other design beats in both."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from startrack.core import Flags, Floats, Refused, Rows, arcsec, one_of, printed, whole
from startrack.design import COSTS, Campaign, DesignSpace, Judged, Objective, fewest_trials_beyond
from startrack.metrics import Interval
from startrack.optimise.evaluate import Foresight, combined, foresee_all, missed
from startrack.optimise.explorer import Explorer
from startrack.optimise.forecast import Forecast
from startrack.optimise.gaussian_process import emulator
from startrack.optimise.population import population_of
from startrack.optimise.runner import TrialRunner
from startrack.optimise.source import TrackerSource
from startrack.optimise.steps import USUAL_FORECASTS, SearchStage, explore, feasible_start
from startrack.optimise.units import level_interval_of_units
from startrack.problem import SearchSettings

METHODS = ("epsilon", "weighted")
NONE_MEETS = "no design in the design space meets the requirements that need no trials"
SAME = 1e-3  # tolerance of a limit in ln(goal)


@dataclass(frozen=True)
class FrontGoals:
    """Two objectives that are traded off.

    first, second  an objective of the error, such as "across" or "about-99.73", or a cost of a
                   design: "mass", "power", "data rate", "volume", "cost" or "aperture"
    """

    first: str = "across"
    second: str = "mass"

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise Refused(f"first and second must differ, got {self.first} twice")
        for goal in (self.first, self.second):
            if goal not in COSTS:
                Objective.read(goal)


@printed
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
    goals: FrontGoals,
    runner: TrialRunner,
    points: int = 7,
    method: str = "epsilon",
    watch: Callable[[SearchStage], None] | None = None,
) -> list[Point]:
    """Pareto front of both goals by the analytic budget; trials then measure each point.

    epsilon:   least first goal while the second is at most e, for e between the two extremes
    weighted:  least w ln first + (1 - w) ln second, for w from 1 to 0

    The method epsilon finds all points of the front, weighted only points where the front is
    convex. Source: Miettinen (1999), Nonlinear Multiobjective Optimization, 3.1 and 3.2.

    Emulators of both goals, fitted to the forecasts of an `Explorer`, propose all points at once.
    The forecasts of these points improve the emulators, until no point is new.

    watch    called with the progress
    Returns  the points that are not dominated, by the budget, in the order of the first goal
    Raises    ValueError if no design in the design space meets the requirements.
    Accuracy  model: that of the budget. `measured` shows its error; over units, with the same
              number of fresh units as in the budget.
    """
    campaign = campaign.of_errors
    if campaign.units is not None:
        _check_levels(goals, campaign)
    start = feasible_start(space, campaign.requirements)
    if start.short:
        raise Refused(NONE_MEETS)
    named = goals.first, goals.second
    errors = [goal for goal in named if goal not in COSTS]
    own = replace(campaign, objective=(errors or [campaign.objective])[0])
    first, second = (partial(_log_goal, space, own, runner, goal) for goal in named)

    def measured(coordinates: Floats, expected: Floats) -> Point:
        return _measured(space, campaign, goals, runner, coordinates, expected)

    explorer = Explorer(TrackerSource(space, own, runner))
    return trade_off(
        explorer, own, start.coordinates, (first, second), measured, points, method, watch
    )


# Logarithms (n,) of a goal of n designs, by their coordinates and forecasts; NaN: it has none.
LogGoal = Callable[[Sequence[Floats], Sequence[Foresight]], Floats]


def trade_off(
    explorer: Explorer,
    settings: SearchSettings,
    start: Floats,
    goals: tuple[LogGoal, LogGoal],
    measured: Callable[[Floats, Floats], Point],
    points: int = 7,
    method: str = "epsilon",
    watch: Callable[[SearchStage], None] | None = None,
) -> list[Point]:
    """The front of any designs, as by `front`.

    explorer  of the designs, without forecasts
    start     (d,) coordinates of a design within the limits of cost
    goals     by forecast
    measured  a point of the front, of its coordinates and the logarithms of both goals
    """
    whole(2, 1000, points=points)
    one_of(METHODS, method=method)

    def tell() -> None:
        if watch:
            count, usual = (
                len(explorer.points),
                (USUAL_FORECASTS + ROUNDS) * len(explorer.source.names),
            )
            watch(
                SearchStage(f"{count} forecasts", FORECAST_PART * min(count / usual, 1.0), math.nan)
            )

    explorer.watch = tell
    explore({"": explorer}, {"": start}, settings)
    search = _Search(explorer, goals)
    for _ in range(ROUNDS):
        new = search.proposals(points, method)
        if not new:
            break
        explorer.forecast(new)
    result, numbers = [], search.front(points, method)
    for number in numbers:
        result.append(measured(explorer.points[number], search.pairs[number]))
        if watch:
            part = FORECAST_PART + (1 - FORECAST_PART) * len(result) / len(numbers)
            watch(SearchStage(f"{len(result)} of {len(numbers)} points tried", part, math.nan))
    return result


def _check_levels(goals: FrontGoals, campaign: Campaign) -> None:
    for goal in (goals.first, goals.second):
        fewest = 0 if goal in COSTS else fewest_trials_beyond(campaign.error(goal))
        if campaign.trials_per_unit < fewest:
            raise Refused(
                f"campaign.unit_trials must be at least {fewest} for the goal {goal} over units, "
                f"got {campaign.trials_per_unit}"
            )


def undominated(values: Floats) -> list[int]:
    """Indices of the non-dominated rows of values (n, k), least best; of equal rows the first."""
    return [
        i
        for i, value in enumerate(values)
        if not any(
            (other <= value).all() and ((other < value).any() or j < i)
            for j, other in enumerate(values)
            if j != i
        )
    ]


def cost_of(campaign: Campaign, goal: str) -> Callable[..., float] | None:
    """The cost model of a goal, None where the goal is an error."""
    return partial(campaign.requirements.cost_named, goal) if goal in COSTS else None


ROUNDS = 4  # of proposals for all points of a front; chosen by hand
FORECAST_PART = 0.7  # of the time, until all forecasts are made: on the nanosatellite


class _Search:
    """The forecasts of an explorer, and both goals of each."""

    def __init__(self, explorer: Explorer, goals: tuple[LogGoal, LogGoal]) -> None:
        self.explorer, self._goals, self._known = explorer, goals, list[Floats]()

    @property
    def pairs(self) -> Floats:
        """Logarithms (n, 2) of both goals of all designs so far; NaN where one has none."""
        new = self.explorer.points[len(self._known) :]
        values = self.explorer.values[len(self._known) :]
        columns = [goal(new, values) for goal in self._goals]
        self._known += list(np.transpose(columns).reshape(-1, 2))
        return np.array(self._known)

    def _met(self, pairs: Floats) -> Flags:
        short = np.array([missed(value.margins) for value in self.explorer.values])
        return (short == 0) & np.isfinite(pairs).all(axis=1)

    def proposals(self, points: int, method: str) -> list[Floats]:
        """New designs that the emulators expect on the front."""
        pairs, places = self.pairs, np.array(self.explorer.points)
        finite = np.isfinite(pairs).all(axis=1)
        first, second = (emulator(places[finite], pairs[finite, k]) for k in range(2))
        like, proposed = self.explorer.emulators, list[Floats]()
        near = self.explorer.starts()
        ends = [
            replace(like, objective=surface).least(np.vstack([near, self._best(pairs, weight)]))[0]
            for surface, weight in ((first, 1.0), (second, 0.0))
        ]
        high, low = (float(second.expected(end[None])[0]) for end in ends)
        for part in np.linspace(0, 1, points):
            limit = high + part * (low - high)
            starts = np.vstack([near, ends, self._best(pairs, 1 - part, limit)])
            if method == "epsilon":
                # As a margin, near zero on the scale of `Scale`.
                width = like.settings.margin_width
                mean, weight = (limit - second.mean) / width, -second.weight / width
                room = replace(second, mean=mean, weight=weight, size=second.size / width)
                limited = replace(like, objective=first, margins=like.margins | {"goal": room})
                point = ends[1] if part == 1 else limited.least(starts)[0]
            else:
                sums = pairs[finite] @ [1 - part, part]
                both = emulator(places[finite], sums, first)
                point = replace(like, objective=both).least(starts)[0]
            if self.explorer.is_new(point, proposed):
                proposed.append(point)
        return proposed

    def _best(self, pairs: Floats, weight: float, limit: float = math.inf) -> Floats:
        """The best design (1, d) so far, by a weight of the first goal and a limit of the
        second."""
        score = pairs @ [weight, 1 - weight]
        allowed = self._met(pairs) & ((pairs[:, 1] <= limit) | (weight == 0))
        score = np.where(allowed, score, np.inf)
        return self.explorer.points[int(score.argmin())][None]

    def front(self, points: int, method: str) -> list[int]:
        """Numbers of the designs at most a number of limits or weights away from each other."""
        pairs = self.pairs
        met = np.flatnonzero(self._met(pairs))
        if not len(met):
            raise Refused(NONE_MEETS)
        some = pairs[met]
        high, low = some[some[:, 0].argmin(), 1], some[:, 1].min()
        chosen = list[int]()
        for part in np.linspace(0, 1, points):
            score = some @ [1 - part, part]
            if method == "epsilon":
                allowed = some[:, 1] <= high + part * (low - high) + SAME
                score = np.where(allowed, some[:, 0], np.inf)
            chosen.append(int(score.argmin()))
        unique = sorted(set(chosen), key=lambda number: float(some[number, 0]))
        kept = undominated(some[unique])
        return [int(met[unique[number]]) for number in kept]


def _log_goal(
    space: DesignSpace,
    campaign: Campaign,
    runner: TrialRunner,
    goal: str,
    points: Sequence[Floats],
    values: Sequence[Foresight],
) -> Floats:
    """Logarithm of a goal of a star tracker; campaign: that of the forecasts."""
    if model := cost_of(campaign, goal):
        costs = [
            model(space.design(point)) if value.margins else math.nan
            for point, value in zip(points, values, strict=True)
        ]
        return np.log(costs)
    if goal != campaign.objective:
        other = replace(campaign, objective=goal)
        values = foresee_all(space, other, points, runner, enough=-math.inf)
    return np.array([value.expected for value in values])


def _measured(
    space: DesignSpace,
    campaign: Campaign,
    goals: FrontGoals,
    runner: TrialRunner,
    coordinates: Floats,
    expected: Floats,
) -> Point:
    judged = campaign.judged(space.design(coordinates))
    tried = {
        condition.name: population_of(condition).few_fresh(campaign, runner)
        for condition in judged
        if condition.weight
    }
    intervals = []
    for goal, value in zip((goals.first, goals.second), np.exp(expected), strict=True):
        if cost_of(campaign, goal):
            intervals.append(Interval(*[float(value)] * 3))
        else:
            intervals.append(_interval(judged, tried, campaign.error(goal), campaign, runner))
    both = (float(np.exp(expected[0])), float(np.exp(expected[1])))
    first, second = intervals
    measured = first.value, second.value
    return Point(tuple(coordinates), space.values(coordinates), both, measured, (first, second))


def _interval(
    judged: Sequence[Judged],
    tried: Mapping[str, Rows],
    objective: Objective,
    campaign: Campaign,
    runner: TrialRunner,
) -> Interval:
    """Arcsec, the objective over trials, or its level over units, in conditions of a weight."""
    counted = [condition for condition in judged if condition.name in tried]
    if campaign.units is not None:
        outcomes = [tried[condition.name] for condition in counted]
        level = level_interval_of_units(objective, counted, outcomes, campaign, runner)
        return Interval(*(bound / arcsec for bound in vars(level).values()))
    squares = [objective.squares(tried[condition.name]) for condition in counted]
    # Over errors of one arcsec, of which every sample has the same statistic.
    unit = [np.full_like(sample, arcsec**2) for sample in squares]
    weights = [condition.weight for condition in counted]
    ratio = objective.ratio(squares, unit, weights)
    scale = float(objective.of(unit[0])) / arcsec
    nothing = {condition.name: Forecast(np.nan, {}) for condition in counted}
    value = combined(judged, tried, objective, nothing) / arcsec
    return Interval(value, ratio.low * scale, ratio.high * scale)
