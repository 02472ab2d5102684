import dataclasses
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from startrack import Refused
from startrack.design.files import Design, save_design
from startrack.design.variables import Choice, DesignSpace, Variable, branches
from startrack.metrics import Interval
from startrack.optimise.evaluate import evaluate
from startrack.optimise.explorer import Explorer
from startrack.optimise.ledger import Ledger
from startrack.optimise.optimise import _better, _Shown, optimize
from startrack.optimise.runner import TrialRunner
from startrack.optimise.source import TrackerSource
from startrack.optimise.steps import BRANCH_TOLERANCE, explore
from startrack.optimise.tables import comparison


@pytest.fixture(scope="module")
def ledger(tmp_path_factory):
    return tmp_path_factory.mktemp("optimum") / "ledger.sqlite"


@pytest.fixture(scope="module")
def campaign(small):
    """Focal length, f-number and blur, in few evaluations; 100 fresh trials decide."""
    return dataclasses.replace(
        small.campaign,
        variables=small.campaign.variables[:3],
        evaluations=5,
        fresh_trials=100,
        analytic_evaluations=3,
        requirements=dataclasses.replace(small.campaign.requirements, min_availability=0.9),
    )


@pytest.fixture(scope="module")
def optimum(small, campaign, ledger):
    with Ledger(ledger) as kept:
        return optimize(small.case, campaign, TrialRunner(5, ledger=kept))


def test_the_best_is_better_on_fresh_trials(optimum):
    assert optimum.feasible
    assert optimum.factor.low > 1
    start, best = optimum.fresh
    assert best.across.value < start.across.value
    assert start.trials == best.trials == 100


def test_a_worse_design_is_never_the_best(small, campaign):
    """The only choice has so much read noise that every design is worse than the start."""
    noisy = Choice("instrument.detector.read_noise", ("60 electron",))
    worse = dataclasses.replace(
        campaign,
        variables=campaign.variables[2:],
        choices=(noisy,),
        evaluations=2,
        analytic_evaluations=2,
        fresh_trials=30,
    )
    kept = optimize(small.case, worse, TrialRunner(5))
    assert kept.best == small.case
    assert kept.candidate is not None
    assert kept.candidate.design.instrument.detector.read_noise == 60
    assert kept.candidate.factor.value < 1
    assert kept.factor.value == 1
    assert "availability" in kept.margins
    text = comparison(kept, worse)
    assert text.startswith("No design that was found is better than the start, which stays.")
    assert "Better by a factor" not in text


def test_a_design_without_an_attitude_is_never_better_than_the_start(optimum, campaign):
    """Both miss a limit, so that their errors decide, one of which is not known."""
    solved, blind = (
        optimum.fresh[0],
        dataclasses.replace(optimum.fresh[1], across=Interval(math.nan, math.nan, math.nan)),
    )
    unknown = Interval(math.nan, math.nan, math.nan)
    found = dataclasses.replace(optimum, factor=unknown, margins={"availability": -0.1})
    shown = _Shown({}, {}, {}, optimum.availability)
    start = {"availability": -0.2}
    kept = _better(dataclasses.replace(found, fresh=(solved, blind)), start, shown)
    assert kept.best == found.start
    assert kept.candidate.design == found.best
    text = comparison(dataclasses.replace(found, fresh=(solved, blind)), campaign)
    assert text.startswith("No factor of improvement: fresh trials have no attitude with the best.")
    kept = _better(dataclasses.replace(found, fresh=(blind, solved)), start, shown)
    assert kept.best == found.best


def test_the_best_is_the_best_feasible_one_of_the_last_pass(optimum, small, campaign):
    last = [one for one in optimum.evaluations if one.trials == campaign.most_trials]
    best = min((one for one in last if one.feasible), key=lambda one: one.score)
    space = DesignSpace(small.case, campaign.variables)
    np.testing.assert_allclose(space.coordinates(optimum.best), best.coordinates, atol=1e-12)
    assert optimum.tuning_error == best.error
    assert len(optimum.evaluations) <= campaign.evaluations


def test_the_trials_grow(optimum):
    # None for designs that miss a requirement without any.
    assert {one.trials for one in optimum.evaluations} - {0} == {12, 24}


def test_the_optimism_compares_fresh_frames_with_the_promise(optimum):
    fresh = optimum.fresh[1].across.value
    assert optimum.optimism.value == pytest.approx(fresh / optimum.tuning_error)
    assert optimum.optimism.low < optimum.optimism.value < optimum.optimism.high


def test_every_design_lies_in_the_box(optimum):
    points = np.array([one.coordinates for one in optimum.evaluations])
    assert ((points >= 0) & (points <= 1)).all()


def test_what_is_in_the_ledger_is_not_tried_again(optimum, small, campaign, ledger, monkeypatch):
    monkeypatch.setattr("startrack.optimise.runner.run", None)
    with Ledger(ledger) as kept:
        again = optimize(small.case, campaign, TrialRunner(5, ledger=kept))
    # The same seed, the same answer; as text, in which NaN is NaN.
    assert str(dataclasses.asdict(again)) == str(dataclasses.asdict(optimum))
    tried = [one.trials for one in optimum.evaluations]
    # Doubled trials are added to those that were done; fresh ones are doubled three times at most.
    assert sum(optimum.trials.values()) <= sum(tried) + 100 + 8 * 100


def test_designs_are_compared_on_the_same_sky(small):
    space = DesignSpace(small.case, small.campaign.variables)
    one = evaluate(space, small.campaign, space.start, TrialRunner(5))
    again = evaluate(space, small.campaign, space.start, TrialRunner(5))
    assert one == again


def test_a_design_that_breaks_a_limit_is_not_feasible(small):
    tight = dataclasses.replace(small.campaign.requirements, max_mass=0.01)
    campaign = dataclasses.replace(small.campaign, requirements=tight)
    space = DesignSpace(small.case, campaign.variables)
    done = evaluate(space, campaign, space.start, TrialRunner(5))
    free = evaluate(space, small.campaign, space.start, TrialRunner(5))
    assert not done.feasible
    assert done.margins["mass"] < 0
    assert done.score > free.score + 10


def test_a_box_that_meets_nothing_is_said_to(small, monkeypatch):
    """No lens of the design space is under 10 g, and none has an update rate of 100 Hz."""
    monkeypatch.setattr("startrack.optimise.steps.START_EVALUATIONS", 2)
    tight = dataclasses.replace(
        small.campaign.requirements, max_mass=0.01, min_update_rate=100.0, min_availability=0.5
    )
    campaign = dataclasses.replace(
        small.campaign, requirements=tight, variables=small.campaign.variables[:1], fresh_trials=12
    )
    optimum = optimize(small.case, campaign, TrialRunner(5))
    assert not optimum.feasible
    assert "no design in the design space" in optimum.ending
    short = list(optimum.lacking)
    assert {"update rate", "mass"} <= set(short)
    assert sorted(short, key=lambda name: optimum.margins[name]) == short
    assert len(optimum.evaluations) == 1


@pytest.mark.slow
def test_a_start_that_sees_no_star_still_finds_some(small):
    """50 us at f/4, with a threshold of 12 sigma: nothing is detected."""
    case = small.case
    optics = dataclasses.replace(case.instrument.optics, f_number=4.0)
    detector = dataclasses.replace(case.instrument.detector, exposure=5e-5)
    tracker = dataclasses.replace(
        case.tracker, detection=dataclasses.replace(case.tracker.detection, threshold=12.0)
    )
    instrument = dataclasses.replace(case.instrument, optics=optics, detector=detector)
    dim = dataclasses.replace(case, instrument=instrument, tracker=tracker)
    wide = [
        dataclasses.replace(one, low="0.05 ms") if one.name.endswith("exposure") else one
        for one in small.campaign.variables
    ]
    campaign = dataclasses.replace(small.campaign, variables=tuple(wide), evaluations=40)
    runner = TrialRunner(5)
    assert runner.run(dim, 12)["spots"].max() == 0
    optimum = optimize(dim, campaign, runner)
    assert optimum.feasible
    assert math.isnan(optimum.factor.value)
    assert optimum.fresh[1].availability.value > 0.9


@pytest.mark.slow
def test_branches_race_and_the_better_wins(small):
    """Windows of 5 and 15 pixels on small stars: 15 pixels of noise lose."""
    window = Choice("tracker.detection.window", (15.0, 5.0))
    campaign = dataclasses.replace(
        small.campaign, choices=(window,), variables=small.campaign.variables[:2], evaluations=40
    )
    optimum = optimize(small.case, campaign, TrialRunner(5))
    assert optimum.branch == "window 5"
    assert optimum.best.tracker.detection.window == 5
    assert "The best design has the choices window 5." in comparison(optimum, campaign)
    corner = optimum.space.design(np.zeros(len(optimum.space)))
    assert "On a bound of its variable" in comparison(
        dataclasses.replace(optimum, best=corner), campaign
    )


@pytest.mark.slow
def test_the_branch_with_the_best_forecasts_wins(small):
    """Of four branches, one whose forecasts equal the best within the changes by trials.

    A search of each branch alone gives the reference.
    """
    window = Choice("tracker.detection.window", (5.0, 7.0, 9.0, 15.0))
    campaign = dataclasses.replace(
        small.campaign,
        choices=(window,),
        variables=small.campaign.variables[:2],
        evaluations=24,
        fresh_trials=20,
    )
    optimum = optimize(small.case, campaign, TrialRunner(5))
    assert len(optimum.evaluations) <= 24
    scores = {}
    for branch in branches(small.case, campaign.choices):
        space = DesignSpace(branch.case, campaign.variables, campaign.links)
        explorer = Explorer(TrackerSource(space, campaign, own_seed=5))
        explore({"": explorer}, {"": space.start}, campaign)
        scores[branch.label] = explorer.score
    assert len(scores) == 4
    assert max(scores.values()) > min(scores.values()) + 2 * BRANCH_TOLERANCE
    assert scores[optimum.branch] < min(scores.values()) + BRANCH_TOLERANCE


def test_a_design_that_cannot_be_built_is_recorded_not_raised(small, blind):
    space = DesignSpace(blind, small.campaign.variables)
    done = evaluate(space, small.campaign, space.start, TrialRunner(5))
    assert done.summary is None
    assert "must overlap" in done.note
    assert math.isfinite(done.score)


def test_designs_that_a_function_refuses_are_avoided(small):
    """No design with a blur above 9 um can be built: the optimum has to be below."""

    def sharp(case):
        if case.instrument.optics.blur > 9e-6:
            raise Refused("too blurred to be true")
        return case

    blur = (Variable("instrument.optics.blur", "2 um", "16 um"),)
    campaign = dataclasses.replace(
        small.campaign,
        variables=blur,
        evaluations=3,
        analytic_evaluations=3,
        fresh_trials=20,
        requirements=dataclasses.replace(small.campaign.requirements, min_availability=0.5),
    )
    case = dataclasses.replace(
        small.case,
        instrument=dataclasses.replace(
            small.case.instrument,
            optics=dataclasses.replace(small.case.instrument.optics, blur=6e-6),
        ),
    )
    optimum = optimize(case, campaign, TrialRunner(5), adapt=sharp)
    assert optimum.best.instrument.optics.blur <= 9e-6
    assert any(math.isnan(expected) for expected in optimum.landscape.expected)


@pytest.mark.slow
def test_killed_it_goes_on_to_the_same_answer(small, tmp_path):
    """kill -9 at twelve random moments; the last run is not killed."""
    design = tmp_path / "small.toml"
    save_design(design, Design(small.case, small.campaign))
    command = [sys.executable, "-m", "startrack.cli", "optimize", str(design), "--seed", "3"]
    command += ["--workers", "2", "--out"]
    subprocess.run([*command, str(tmp_path / "whole")], check=True, capture_output=True)
    rng, killed = np.random.default_rng(0), 0
    for _ in range(12):
        driver = subprocess.Popen(
            [*command, str(tmp_path / "cut")],
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            driver.wait(rng.uniform(2, 8))
        except subprocess.TimeoutExpired:
            os.kill(driver.pid, signal.SIGKILL)
            killed += 1
        driver.wait()
        time.sleep(0.5)
    subprocess.run([*command, str(tmp_path / "cut")], check=True, capture_output=True)
    assert killed >= 2
    whole, cut = ((tmp_path / name / "best.toml").read_bytes() for name in ("whole", "cut"))
    assert whole == cut


@pytest.mark.parametrize(
    "search",
    [
        "direct+sbplx",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("bobyqa", "GN_ISRES")),
    ],
)
def test_a_campaign_names_the_algorithms_of_nlopt(small, campaign, search):
    named = dataclasses.replace(
        campaign, variables=campaign.variables[:1], search=search, evaluations=3, fresh_trials=12
    )
    optimum = optimize(small.case, named, TrialRunner(5))
    start = optimum.landscape.expected[0]
    assert min(optimum.landscape.expected) < start


def test_an_algorithm_that_nlopt_lacks_is_refused(small, campaign):
    with pytest.raises(Refused, match=r"campaign\.search must be emulator.*got 'newton'"):
        optimize(small.case, dataclasses.replace(campaign, search="newton"), TrialRunner(5))
