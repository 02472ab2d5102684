"""Forecasts of known functions: the optimum is found, limits hold, and the statements are true."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from startrack.core import arcsec
from startrack.design import DesignSpace
from startrack.metrics import summarise
from startrack.optimise import Ledger, TrackerSource, TrialRunner, source, steps
from startrack.optimise.emulators import Scale, emulators
from startrack.optimise.evaluate import Evaluation, Foresight, foresee_all
from startrack.optimise.explorer import Explorer
from startrack.optimise.explorer_settings import DEFAULTS
from startrack.optimise.forecast import forecasts
from startrack.optimise.landscape import prices_of
from startrack.trial.chain import OUTCOMES


class Requirements:
    min_availability = 0.99


class Judged:
    name, needs, weight = "nominal", Requirements, 1.0


class Campaign:
    precision, requirements, evaluations, most_trials = 0.01, Requirements, 6, 100

    def judged(self, _):
        return (Judged(),)


class Variable:
    def __init__(self, name):
        self.name = name


class Space:
    """A space whose designs are their own coordinates."""

    case = None

    def __init__(self, count, levels=0):
        self.variables = [Variable(f"x{k}") for k in range(count)]
        self.start = np.full(count, 0.5)
        self.whole, self.levels = np.arange(count) < bool(levels), levels

    def __len__(self):
        return len(self.variables)

    def design(self, point):
        return point

    def snapped(self, point):
        return np.where(self.whole, np.round(point * self.levels) / (self.levels or 1), point)


def explored(monkeypatch, function, count, most, seed=1, levels=0):
    """An explorer after a search of a function of points, which returns a Foresight."""
    monkeypatch.setattr(
        source,
        "foresee_all",
        lambda space, campaign, points, *_, **__: [function(one) for one in points],
    )
    monkeypatch.setattr(source, "cost_margins", lambda *_: {})
    explorer = Explorer(TrackerSource(Space(count, levels), Campaign(), own_seed=seed))
    explorer.begin(explorer.source.space.start, most)
    while not explorer.ending and len(explorer.points) < most:
        explorer.step(most - len(explorer.points))
    return explorer


def limited(point):
    """Smallest at x + y = 0.8, its limit, and x = 0.55: -0.8 + 0.09 at (0.55, 0.25)."""
    x, y = point[:2]
    return Foresight(-x - y + 0.09 + 4 * (x - 0.55) ** 2, {"mass": 1 - (x + y) / 0.8})


def leaping(point):
    """Four times as large below x = 0.5 as above, where it grows: smallest just above 0.5."""
    x, y = point
    return Foresight(2 * (x - 0.5) + (y - 0.3) ** 2 + (1.4 if x < 0.5 else 0.0), {"mass": 1.0})


def even_are_better(point):
    """Smallest, 0, at level 6 of 9 with x = 0.7, y = 0.3 there; odd levels add 8 %."""
    level, (x, y) = round(9 * point[0]), point[1:]
    assert point[0] * 9 == pytest.approx(level, abs=1e-12)
    valley = (x - 0.7 + 0.6 * (y - 0.3)) ** 2 + 0.2 * (y - 0.3) ** 2
    return Foresight(0.08 * (level % 2) + 0.01 * (level - 6) ** 2 + 3 * valley, {"mass": 1.0})


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
)
def test_whole_numbers_are_forecast_as_they_are_rounded(monkeypatch, seed):
    """Each design is forecast once, and the optimum is found within 1 % of the error."""
    explorer = explored(monkeypatch, even_are_better, 3, 60, seed, levels=9)
    assert explorer.ending
    assert explorer.score < 0.01
    assert round(9 * explorer.best[0]) == 6
    assert len(np.unique(explorer.points, axis=0)) == len(explorer.points)


def test_trials_begin_at_the_best_forecast_where_the_objective_leaps(monkeypatch):
    """Emulators expect a smaller objective beyond the discontinuity."""
    explorer = explored(monkeypatch, leaping, 2, 24)
    assert explorer.score < 0.1

    def tried_exactly(point, trials, correction):
        known = explorer.forecast_of(point)
        error, score = math.exp(known.expected) * arcsec, known.expected
        summary = summarise(np.zeros(100, OUTCOMES))
        return Evaluation(tuple(point), {}, error, error, score, known.margins, summary, "")

    first = list[Evaluation]()
    tried, _ = steps.refine(explorer, 6, 100, tried_exactly, first.append)
    assert math.log(first[0].error / arcsec) < explorer.score + 0.02
    assert math.log(tried[0].error / arcsec) < explorer.score + 0.02


@pytest.fixture(scope="module")
def of_limited():
    """The explorer of `limited`, and its best design."""
    with pytest.MonkeyPatch.context() as patch:
        found = explored(patch, limited, 3, 60)
    return found, found.emulators.least(found.starts())[0]


@pytest.mark.parametrize(
    "seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 2, 4))]
)
def test_the_best_at_a_limit_is_found(monkeypatch, seed):
    """At most 0.4 % of the error above the minimum, with the limit met to 3e-4, in 60 forecasts;
    then the search ends soon."""
    found = explored(monkeypatch, limited, 3, 80, seed)
    assert found.ending
    assert min(one.score for one in found.values[:60]) < -0.71 + 4e-3
    best = found.emulators.least(found.starts())[0]
    assert limited(best).margins["mass"] > -3e-4
    assert best[:2] == pytest.approx([0.55, 0.25], abs=0.03)


def test_what_does_not_matter_is_said_and_what_does_is_bounded(of_limited):
    """x may differ by sqrt(0.01 / 4) = 0.05 while y follows along the limit."""
    found, best = of_limited
    x, _, z = found.spans(best)
    assert z.everywhere
    assert not x.everywhere
    assert x.low == pytest.approx(0.5, abs=1.05 / (DEFAULTS.span_nodes - 1))
    assert x.high == pytest.approx(0.6, abs=1.05 / (DEFAULTS.span_nodes - 1))


def test_the_price_of_a_limit_is_its_multiplier(of_limited):
    """One per cent more of x + y = 0.8 lowers the score by 0.008."""
    found, best = of_limited
    prices = prices_of(found.emulators, best, found.source.precision)
    assert prices == {"mass": pytest.approx(0.008, rel=0.2)}


def test_a_design_that_is_not_the_best_of_the_emulators_has_no_price_for_that(of_limited):
    """Its score is above the least by 0.1 per unit of x, or by what it misses of the limit."""
    found, best = of_limited
    for shift in (-0.1, 0.1):
        elsewhere = best + np.array([shift, 0.0, 0.0])
        prices = prices_of(found.emulators, elsewhere, found.source.precision)
        assert prices.get("mass", 0.0) < 0.01


def test_of_two_valleys_the_deeper_is_found(monkeypatch):
    """Wells of depth 1 at 0.2 and 0.9 at 0.8, from the start between them."""

    def wells(point):
        depth = [(1.0, 0.2), (0.9, 0.8)]
        return Foresight(
            -sum(d * math.exp(-(((point - at) / 0.15) ** 2).sum()) for d, at in depth), {}
        )

    found = explored(monkeypatch, wells, 2, 100)
    assert found.best == pytest.approx([0.2, 0.2], abs=0.02)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_designs_far_from_the_best_do_not_make_the_good_ones_uncertain(seed):
    # A cliff, as where an exposure is too short to see enough stars: nothing varies fast near the
    # best, and an emulator of all designs would take the length of the cliff for that of the rest.
    def value(points):
        wall = 3.0 * np.tanh(np.maximum(points[:, 0] - 0.5, 0) / 0.02)
        return 0.5 * points[:, 1] + 0.3 * (points**2).sum(axis=1) + wall

    random = np.random.default_rng(seed)
    points, others = random.random((40, 4)), random.random((200, 4))
    others = others[others[:, 0] < 0.45]
    values = [Foresight(float(one), {}, {}) for one in value(points)]
    known = emulators(points, values, {})
    expected, sigma = known.objective.expected_and_sigma(others)
    error = expected - value(others)
    assert np.sqrt((error**2).mean()) < 0.1
    assert np.sqrt(((error / np.maximum(sigma, 1e-4)) ** 2).mean()) < 2


def test_designs_without_a_forecast_are_avoided(monkeypatch):
    def holed(point):
        return Foresight(math.nan, {}) if point[0] > 0.6 else Foresight(float(-point[0]), {})

    found = explored(monkeypatch, holed, 2, 60)
    assert 0.57 < found.best[0] <= 0.6


def cliffs(point):
    """A valley along a limit of the availability, which falls slowly to where two cliffs stand."""
    x, y = point[:2]
    few, small = 1.5 * (x < 0.635), 0.25 * (y < 0.145)
    lacking = 10 ** (40 * (x - 0.68) - 30 * (y - 0.165)) + 50 * (y < 0.145)
    margins = {"availability": 0.01 * (1 - min(lacking, 99)), "mass": 0.715 - x}
    return Foresight(float(few + small - x + 1.5 * y), margins)


@pytest.mark.slow
class TighterByTrials:
    """Trials of each design have a margin a tenth smaller than its forecast."""

    def corrected(self, _point, margin):
        return margin - 0.1

    def fitted(self, _evidence):
        return self


def test_a_search_that_had_ended_finds_the_best_within_limits_that_trials_moved(monkeypatch):
    """x + y = 0.72 remains allowed: 0.72 - 0.09 at best, within 1 %."""
    found = explored(monkeypatch, limited, 3, 80, seed=3)
    assert "next to the best" in found.ending, "batches in vain, as of a search that stalled"
    found.limits = {"mass": TighterByTrials()}
    found.correct_limits({})
    steps.resume(found)
    assert -0.63 <= found.score < -0.62


@pytest.mark.slow
def test_the_end_of_a_valley_between_cliffs_is_found(monkeypatch):
    """Within 1 % of the smallest feasible value, in 130 forecasts of three variables.

    At least four of five seeds, and within 6 % the fifth: which seed fails depends on the
    processor, because rounding decides between equal proposals.
    """
    every = [cliffs((x, y)) for x in np.linspace(0.6, 0.72, 241) for y in np.linspace(0, 1, 1001)]
    least = min(one.score for one in every if min(one.margins.values()) >= 0)
    found = [explored(monkeypatch, cliffs, 3, 130, seed) for seed in range(5)]
    assert all(min(cliffs(one.best).margins.values()) >= 0 for one in found)
    over = sorted(one.score - least for one in found)
    assert over[3] < 0.01
    assert over[4] < 0.06


def test_the_best_design_meets_the_limits_that_others_miss_by_little(monkeypatch):
    """A design that is 2 % better misses its limit by 0.1 %, which adds less to its score."""

    def steep(point):
        return Foresight(float(-20 * point[0]), {"mass": float(0.7 - point[0])})

    found = explored(monkeypatch, steep, 1, 30)
    assert found.best[0] <= 0.7
    assert found.score == pytest.approx(-14, abs=0.03)


@pytest.mark.slow
def test_twenty_variables(monkeypatch):
    """A bowl whose axes matter by 1, 1/4, 1/9, ...: within 1 % of its least in 160 forecasts."""
    weight = 1 / np.arange(1, 21) ** 2.0

    def bowl(point):
        return Foresight(float(weight @ (point - 0.3) ** 2), {})

    assert explored(monkeypatch, bowl, 20, 160).score < 0.01


def test_a_chance_is_emulated_by_the_logarithm_of_what_it_lacks():
    """An unavailability of a tenth of its limit and of ten times it are equally far from zero."""
    scale = Scale(0.01)
    good, bad = scale.of(np.array([0.009, -0.09]))
    assert good == pytest.approx(-bad)
    assert scale.missing(np.array([bad]))[0] == pytest.approx(0.09)
    assert scale.missing(np.array([good]))[0] == 0
    plain = Scale()
    assert plain.missing(plain.of(np.array([-0.3])))[0] == pytest.approx(0.3)


def test_after_designs_next_to_the_best_others_are_proposed_again(monkeypatch):
    explorer, asked = explored(monkeypatch, limited, 2, 30), []
    explorer.ending, explorer._in_vain = "", DEFAULTS.patience
    explorer._spanned, explorer._polished = -math.inf, math.inf
    monkeypatch.setattr(Explorer, "_proposals", lambda self: asked.append(len(self.points)) or [])
    explorer.step(30)  # next to the best
    assert not explorer.ending
    assert not asked
    explorer.step(30)
    assert asked == [len(explorer.points)]


def test_the_best_design_is_forecast_in_all_conditions(monkeypatch):
    """Conditions without a weight are left out except for the best designs: at rest, 0.8 misses
    its limit."""

    class AtRest:
        name, needs, weight = "rest", Requirements, 0.0

    campaign = Campaign()
    campaign.judged = lambda _: (Judged(), AtRest())

    def foreseen(_space, _campaign, points, _runner, _seed, enough=math.inf, known=None):
        assert enough < math.inf or list(known) == ["nominal"]  # which is not forecast again
        known = {"nominal": None} | ({"rest": None} if enough == math.inf else {})
        return [
            Foresight(-x, {"across (rest)": 0.5 - x} if "rest" in known else {}, known)
            for x in (float(point[0]) for point in points)
        ]

    monkeypatch.setattr(source, "foresee_all", foreseen)
    monkeypatch.setattr(Explorer, "_all_conditions_matter", False)
    found = Explorer(TrackerSource(Space(1), campaign))
    found.forecast(np.array([[0.2], [0.8], [0.4]]))
    assert found.best == 0.4
    assert [len(value.conditions) for value in found.values] == [1, 2, 2]


def test_the_same_seed_goes_the_same_way(monkeypatch):
    first, second = (explored(monkeypatch, limited, 2, 20, seed=4) for _ in range(2))
    assert np.array_equal(first.points, second.points)


def test_an_interrupted_search_computes_no_forecast_again(small, tmp_path, monkeypatch):
    """Three of five designs were forecast before; the results are the same for all."""
    space = DesignSpace(small.case, small.campaign.variables[:2])
    computed = []

    def counted(*args, **named):
        computed.append(1)
        return forecasts(*args, **named)

    monkeypatch.setattr(sys.modules[Foresight.__module__], "forecasts", counted)
    points = list(np.linspace(0.3, 0.5, 10).reshape(5, 2))
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        first = Explorer(TrackerSource(space, small.campaign, TrialRunner(2, ledger=ledger)))
        first.forecast(points[:3])
    before = len(computed)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        again = Explorer(TrackerSource(space, small.campaign, TrialRunner(2, ledger=ledger)))
        again.forecast(points[:3])
        assert len(computed) == before > 0
        assert again.values == first.values
        again.forecast(points[3:])
    assert len(computed) > before


def test_a_forecast_is_kept_as_soon_as_it_is_made(small, tmp_path):
    """Of five designs that are requested together; the search is stopped after the third."""
    space, done = DesignSpace(small.case, small.campaign.variables[:2]), []

    def stopping(number):
        done.append(number)
        if len(done) == 3:
            raise KeyboardInterrupt

    points = list(np.linspace(0.3, 0.5, 10).reshape(5, 2))
    with Ledger(tmp_path / "ledger.sqlite") as ledger, pytest.raises(KeyboardInterrupt):
        foresee_all(space, small.campaign, points, TrialRunner(2, ledger=ledger), progress=stopping)
    known = list[int]()
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        runner = TrialRunner(2, ledger=ledger)
        foresee_all(space, small.campaign, points, runner, progress=known.append)
    assert known == [3, 1, 1]


def test_a_design_that_costs_too_much_is_not_forecast(small):
    """Its margins are known and show where the limit is; the objective is unknown."""
    tight = replace(small.campaign.requirements, max_mass=0.01)
    campaign = replace(small.campaign, requirements=tight, variables=small.campaign.variables[:2])
    explorer = Explorer(TrackerSource(DesignSpace(small.case, campaign.variables), campaign))
    explorer.forecast([np.full(2, 0.5)])
    (value,) = explorer.values
    assert value.left_out
    assert value.margins["mass"] < 0
    assert not value.conditions
