import math

import numpy as np
import pytest
from scipy import stats

from startrack.core import arcsec
from startrack.design import Accuracy, Objective, Requirements
from startrack.metrics import ErrorLimits
from startrack.trial import OUTCOMES
from startrack.verification import Answer, Looks, claims_of
from startrack.verification.accuracy import REGIONS
from startrack.verification.decide import Claim

NOWHERE = np.empty((0, 3))
EVERYTHING = ErrorLimits(math.inf, math.inf)


def normal(rng, trials, sigma=1.0):
    table = np.zeros(trials, OUTCOMES)
    for axis in "xyz":
        table[f"error_{axis}"] = rng.normal(0, sigma, trials)
    table["solved"] = True
    return table


def answers(claims, looks, repetitions, draw):
    """How often each claim passed and failed at any look; the claims differ only in their limit."""
    passed, failed = np.zeros((2, len(claims)), int)
    tails = looks.tails(1)
    for seed in range(repetitions):
        table = draw(np.random.default_rng(seed), looks.most)
        waiting = set(range(len(claims)))
        for size in looks.sizes:
            bounds = claims[0].bounds(table[:size], NOWHERE, *tails)
            for k in list(waiting):
                answer = claims[k].answer(bounds)
                passed[k] += answer is Answer.PASS
                failed[k] += answer is Answer.FAIL
                if answer is not Answer.NOT_SHOWN:
                    waiting.remove(k)
            if not waiting:
                break
    return passed, failed


@pytest.mark.parametrize(
    ("objective", "truth"),
    [
        (Objective("across"), 1.0),
        (Objective("across", None, "radial"), math.sqrt(2)),
        (Objective("about", 0.68), stats.norm.isf(0.16)),
        (Objective("across", 0.9545, "per axis"), stats.norm.isf(0.0455 / 2)),
        (Objective("across", 0.9545), stats.rayleigh.isf(0.0455)),
    ],
    ids=str,
)
def test_an_answer_is_rarely_wrong_at_any_look(objective, truth):
    """Just beyond the limit at most 5 % pass, just within it at most 5 % fail; false alarm 1e-3."""
    looks = Looks(100, 800)
    most = stats.binom.isf(1e-3, 200, 0.05)
    below, above = (
        Claim(Accuracy(objective, limit), 0.0, EVERYTHING)
        for limit in (0.9999 * truth, 1.0001 * truth)
    )
    passed, failed = answers([below, above], looks, 200, normal)
    assert passed[0] <= most
    assert failed[1] <= most


def test_what_is_clear_is_decided_at_the_first_look():
    looks = Looks(100, 800)
    wide, narrow = (Claim(Accuracy(Objective("across"), a), 0.0, EVERYTHING) for a in (2.0, 0.5))
    passed, failed = answers([wide, narrow], Looks(100, 100), 20, normal)
    assert (passed.tolist(), failed.tolist()) == ([20, 0], [0, 20])
    assert looks.sizes == [100, 200, 400, 800]
    assert Looks(300, 1000).sizes == [300, 600, 1000]


def test_the_number_that_would_do_does():
    """Four times the stated number nearly always decides, a quarter of it seldom."""
    claim = Claim(Accuracy(Objective("across"), 1.1), 0.0, EVERYTHING)
    tails = Looks(100, 100).tails(1)
    needed = claim.needed(normal(np.random.default_rng(1), 4000), NOWHERE, *tails)
    shown = {}
    for times in (0.25, 4.0):
        shown[times] = sum(
            claim.answer(
                claim.bounds(normal(np.random.default_rng(s), int(times * needed)), NOWHERE, *tails)
            )
            is Answer.PASS
            for s in range(40)
        )
    assert shown[0.25] < 20
    assert shown[4.0] > 30


def test_two_errors_tell_no_number_that_would_do():
    claim = Claim(Accuracy(Objective("across"), 1.1), 0.0, EVERYTHING)
    errors = normal(np.random.default_rng(1), 2)
    assert claim.needed(errors, NOWHERE, *Looks(2, 2).tails(1)) is None


def test_too_few_trials_show_no_high_level():
    """ln(0.05) / ln(0.9973) is 1108: Wilks' number without a failure."""
    claim = Claim(Accuracy(Objective("across", 0.9973), 9.0), 0.0, EVERYTHING)
    looks = Looks(1000, 1000)
    few = normal(np.random.default_rng(1), 1000)
    assert claim.answer(claim.bounds(few, NOWHERE, *looks.tails(1))) is Answer.NOT_SHOWN
    assert claim.needed(few, NOWHERE, *looks.tails(1)) == pytest.approx(1109, rel=0.02)


def test_one_bad_region_fails_the_worst_part_of_the_sky():
    rng = np.random.default_rng(2)
    boresight = rng.normal(size=(2400, 3))
    boresight /= np.linalg.norm(boresight, axis=1)[:, None]
    table = normal(rng, 2400)
    bad = REGIONS.of(boresight) == 7
    for axis in "xy":
        table[f"error_{axis}"][bad] *= 2
    accuracy, tails = Accuracy(Objective("across"), 1.3), Looks(2400, 2400).tails(1)
    whole = Claim(accuracy, 0.0, EVERYTHING)
    worst = Claim(accuracy, 0.0, EVERYTHING, "worst")
    assert whole.answer(whole.bounds(table, boresight, *tails)) is Answer.PASS
    bounds = worst.bounds(table, boresight, *tails)
    assert worst.answer(bounds) is Answer.FAIL
    assert bounds.value == pytest.approx(2.0, rel=0.15)


def test_a_single_attitude_may_err_as_999_of_a_normal_law():
    """A design that just meets a requirement has 99.73 % correct attitudes."""
    rng = np.random.default_rng(3)
    table = normal(rng, 400_000, arcsec)
    for level, kind in (
        ("rms", "per axis"),
        ("rms", "radial"),
        ("95.45 %", "radial"),
        ("68 %", "per axis"),
    ):
        probe = Requirements(max_across=1.0, level=level, kind=kind)
        objective = probe.accuracy[0].objective
        just = objective.of(objective.squares(table))
        needs = Requirements(max_across=just, level=level, kind=kind)
        (claim, _) = claims_of(needs)
        size = np.hypot(table["error_x"], table["error_y"])
        assert np.mean(size <= claim.limits.across) == pytest.approx(0.9973, abs=5e-4)


@pytest.mark.parametrize("trials", [5, 10, 30])
def test_more_trials_are_asked_for_than_did_not_show_it(trials):
    """Ten trials of an error of half of its limit do not show it, nor do two more.

    The stated number shows it in about half of the cases.
    """
    looks = Looks(100, 400)
    tails = looks.tails(1)
    shown = 0
    for seed in range(20):
        table = normal(np.random.default_rng(seed), 4000)
        claim = Claim(Accuracy(Objective("across"), 1.7), 0.0, EVERYTHING)
        few = table[:trials]
        if claim.answer(claim.bounds(few, NOWHERE, *tails)) is not Answer.NOT_SHOWN:
            shown += 1
            continue
        needed = claim.needed(few, NOWHERE, *tails)
        assert needed is None or needed > trials
        if needed is not None:
            bounds = claim.bounds(table[:needed], NOWHERE, *tails)
            shown += claim.answer(bounds) is not Answer.NOT_SHOWN
    assert shown >= 7


def test_looks_are_told_in_words():
    assert Looks(100, 400).words.startswith("tested at 100, 200 and 400 trials until decided; ")
    assert Looks(2, 2).words.startswith("tested at 2 trials; ")
