import dataclasses

import numpy as np
import pytest

from startrack.budget import Budget, BudgetLine, ErrorLaw
from startrack.core import YEAR, arcsec, deg
from startrack.design import Campaign, Condition, KeepOut, Requirements, Variation, load_design
from startrack.io import shipped
from startrack.optics import Baffle
from startrack.trial import OUTCOMES
from startrack.verification import Answer, Looks, cases, counted, unit_text, verify, verify_units
from startrack.verification.accuracy import expected_availability

CASE = load_design(shipped("designs/noise_only.toml")).case
NEEDS = Requirements(max_across=1 * arcsec, max_about=20 * arcsec, min_availability=0.9)


class Drawn:
    """Trials with normal errors of an rms that depends on the slew rate."""

    def __init__(self, arcsec_at_rest, arcsec_turning):
        self.sigma, self.asked = (arcsec_at_rest, arcsec_turning), []

    def __call__(self, case, trials):
        self.asked.append((case.instrument.motion.rate, trials))
        rng = np.random.default_rng(1)
        table = np.zeros(trials, OUTCOMES)
        sigma = self.sigma[case.instrument.motion.rate > 0] * arcsec
        for axis, times in (("x", 1), ("y", 1), ("z", 10)):
            error = rng.normal(0, 1, trials)
            table[f"error_{axis}"] = times * sigma * error / np.sqrt(np.mean(error**2))
        table["solved"] = True
        return table


def judged(needs, drawn, case=CASE, most=1024, **more):
    campaign = Campaign(requirements=needs, **more)
    return verify(case, campaign, drawn, 1, Looks(128, most))


def by_name(found):
    return {(one.condition, one.name): one for one in found.verdicts}


def test_rest_is_always_judged():
    """A design that is good at its nominal rate and bad at rest fails."""
    found = judged(NEEDS, Drawn(3.0, 0.5))
    assert found.answer is Answer.FAIL
    answers = {name: one.answer for name, one in by_name(found).items()}
    assert answers["nominal", "across"] is Answer.PASS
    assert answers["rest", "across"] is Answer.FAIL
    assert by_name(found)["rest", "across"].margin == pytest.approx(-2, abs=0.3)


def test_it_stops_when_all_is_decided():
    drawn = Drawn(0.5, 0.5)
    assert judged(NEEDS, drawn).answer is Answer.PASS
    assert [trials for _, trials in drawn.asked] == [128, 128]


def test_what_is_not_shown_names_the_trials_that_would_do():
    found = judged(NEEDS, Drawn(0.98, 0.98), most=256)
    one = by_name(found)["nominal", "across"]
    assert found.answer is Answer.NOT_SHOWN
    assert (one.answer, one.number) == (Answer.NOT_SHOWN, 256)
    assert one.needed > 256


def test_formulas_and_analysis_stand_beside_the_trials():
    found = by_name(judged(dataclasses.replace(NEEDS, max_mass=0.1), Drawn(0.5, 0.5)))
    assert found["nominal", "mass"].answer is Answer.FAIL
    # Of the same design in a thousand frames: 0.46 arcsec.
    assert found["nominal", "across"].analysis / arcsec == pytest.approx(0.5, abs=0.1)
    assert found["nominal", "availability"].analysis == pytest.approx(1, abs=1e-3)


def test_conditions_have_their_own_limits():
    fast = Condition("slew", rate=0.3 * deg, max_across=5 * arcsec, min_availability=0.5)
    found, _ = cases(CASE, Campaign(requirements=NEEDS, conditions=(fast,)))
    assert [one.name for one in found] == ["nominal", "slew", "rest"]
    assert [one.needs.max_across / arcsec for one in found] == pytest.approx([1, 5, 1])
    assert [one.case.instrument.motion.rate / deg for one in found] == pytest.approx(
        [0.05 * 2**0.5, 0.3, 0]
    )
    assert [one.weight for one in found] == [1, 1, 0]


def test_the_largest_rate_that_is_required_is_judged():
    needs = dataclasses.replace(NEEDS, max_rate=1 * deg)
    found, _ = cases(CASE, Campaign(requirements=needs))
    assert [one.name for one in found] == ["nominal", "rest", "max rate"]


def test_a_keep_out_angle_is_a_brighter_sky_or_not_judged():
    needs = dataclasses.replace(NEEDS, min_keep_out=KeepOut(sun=40 * deg, moon=2 * deg))
    campaign = Campaign(requirements=needs)
    _, left = cases(CASE, campaign)
    assert len(left) == 2
    assert "instrument.baffle or tube must be given" in left[0]
    baffle = Baffle((20 * deg, 60 * deg), (1e-3, 1e-7))
    shaded = dataclasses.replace(
        CASE, instrument=dataclasses.replace(CASE.instrument, baffle=baffle)
    )
    found, left = cases(shaded, campaign)
    assert found[-1].name == "sun at 40 deg"
    assert found[-1].case.scene.background_g < shaded.scene.background_g
    assert len(left) == 1
    assert "the body would be in the field" in left[0]
    assert judged(needs, Drawn(0.5, 0.5)).answer is Answer.NOT_SHOWN


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"level": "99.73"}, "level must be rms or a percentage"),
        ({"kind": "both"}, "kind must be one of per axis, radial"),
        ({"sky": "half"}, "sky must be one of whole, worst"),
        ({"max_across": -1.0}, "max_across must be positive"),
    ],
)
def test_a_wrong_requirement_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Requirements(**change)


def test_two_conditions_of_a_name_are_refused():
    campaign = Campaign(conditions=(Condition("a"), Condition("a")))
    with pytest.raises(ValueError, match="different names"):
        campaign.judged(CASE)


def test_blinded_trials_may_be_left_out():
    """For trials over a year, a quarter lies within 60 degrees of the Sun, as on the sphere."""
    scene = dataclasses.replace(CASE.scene, lights=("sun",), date="2026-01-01T00:00:00", days=360)
    case = dataclasses.replace(CASE, scene=scene)
    keep_out = KeepOut(sun=60 * deg)
    table = np.zeros(400, OUTCOMES)
    table["trial"] = np.arange(400)
    kept = {
        blinded: len(counted(Requirements(min_keep_out=keep_out, blinded=blinded), case, 1, table))
        for blinded in ("counted", "left out")
    }
    assert kept["counted"] == 400
    assert abs(kept["left out"] - 300) < 4 * 8.66


def test_the_expected_availability_is_that_of_such_errors():
    """Errors drawn with the variances of 500 fields, 90 % of them solved: within 0.5 %."""
    rng = np.random.default_rng(1)
    sigma = np.exp(rng.normal(0, 0.5, 500))[:, None] * np.array([1, 1, 8])
    law = ErrorLaw(np.zeros((500, 3)), sigma, np.full(500, 1 / 500))
    budget = Budget((), BudgetLine("end to end", None, law), 0.9, 10.0)
    needs = Requirements(max_across=1.0, max_about=8.0)
    error = rng.normal(size=(200, 500, 3)) * sigma
    across = np.hypot(error[..., 0], error[..., 1]) <= needs.limits.across
    about = np.abs(error[..., 2]) <= needs.limits.about
    found = expected_availability(needs, budget)
    assert found == pytest.approx(0.9 * np.mean(across & about), abs=0.005)
    assert expected_availability(Requirements(), budget) == pytest.approx(0.9)


def test_units_are_judged_by_their_yield_at_both_ends_of_life():
    """All of 100 units have 1 arcsec at first, and 80 of them at the end, where 90 % are
    required."""
    name = "instrument.mounting.x"
    case = dataclasses.replace(CASE, variation=(Variation(name, sigma="1 arcsec"),), lifetime=YEAR)
    needs = dataclasses.replace(NEEDS, max_about=None)
    asked = []

    def trials(case, how):
        asked.append(how.age)
        table = np.zeros(100 * how.trials, OUTCOMES)
        table["trial"] = 7 * how.trials + np.arange(len(table))
        bad = (table["trial"] // how.trials) % 5 == 0
        table["error_x"] = np.where(bad & (how.age > 0), 3.0, 0.5) * arcsec
        table["solved"] = True
        return table

    campaign = Campaign(requirements=needs, units=0.9)
    found = verify_units(case, campaign, trials, 100, 1)
    first = found.rows[0]
    assert [one.share.value for one in first.ages] == [1.0, 0.8]
    # 0.05^(1/100) by hand, of 100 hits in 100.
    assert first.ages[0].share.low == pytest.approx(0.9705, abs=1e-4)
    assert [one.answer for one in first.ages] == [Answer.PASS, Answer.FAIL]
    assert found.at(0) is Answer.PASS
    assert found.answer is Answer.FAIL
    assert asked == [0, YEAR] * 2  # also at rest
    assert "verdict: pass at 0 yr, FAIL at 1 yr" in unit_text(found)
    # Each unit has one error: with its bias (0.2 * 3^2 + 0.8 * 0.5^2)^(1/2), without it nothing.
    assert found.stated[1].with_bias[0] == pytest.approx(2**0.5 * arcsec)
    assert np.abs(found.stated[1].without).max() < 1e-12 * arcsec
