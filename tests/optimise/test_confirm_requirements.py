import dataclasses

import numpy as np
import pytest
from scipy import stats

from startrack.design.case import Fidelity
from startrack.optimise.runner import FRESH
from startrack.optimise.steps import confirm_requirements
from startrack.trial.chain import OUTCOMES


class Coin:
    """A runner whose trials are solved with a known probability."""

    def __init__(self, seed, fraction):
        self.rng, self.fraction, self.asked = np.random.default_rng(seed), fraction, []
        self.seed = seed

    def run(self, case, trials, fidelity=Fidelity.FRAME, first=0, progress=None):
        self.asked.append(range(first, first + trials))
        table = np.zeros(trials, OUTCOMES)
        for axis in "xyz":
            table[f"sigma_{axis}"] = 1.0
        table["solved"] = self.rng.random(trials) < self.fraction
        return table


@pytest.fixture
def campaign(small):
    def asking(fraction):
        needs = dataclasses.replace(small.campaign.requirements, min_availability=fraction)
        return dataclasses.replace(small.campaign, requirements=needs)

    return asking


def shown(coin, small, campaign, trials=500):
    own = campaign.judged(small.case)[0]
    outcomes = coin.run(small.case, trials, first=FRESH)
    return confirm_requirements(own, campaign, coin, outcomes)["availability"].bounds


@pytest.mark.slow
def test_a_design_just_below_the_requirement_is_rarely_believed(small, campaign):
    """1000 designs of 98.9 % where 99 % is required: 5 % may pass wrongly; false alarm 1e-3."""
    asked = campaign(0.99)
    wrong = sum(shown(Coin(seed, 0.989), small, asked).low >= 0.99 for seed in range(1000))
    assert wrong <= stats.binom.isf(1e-3, 1000, 0.05)


def test_one_failure_in_a_thousand_can_be_shown(small, campaign):
    """For a design that never fails, 500 trials cannot show 99.85 %, 4000 can."""
    coin = Coin(1, 1.0)
    assert shown(coin, small, campaign(0.9985)).low >= 0.9985
    tried = [len(numbers) for numbers in coin.asked]
    assert tried == [500, 500, 1000, 2000]


def test_no_sky_is_tried_twice(small, campaign):
    coin = Coin(1, 0.995)
    shown(coin, small, campaign(0.994))
    numbers = [number for one in coin.asked for number in one]
    assert len(numbers) == len(set(numbers)) == 4000


def test_a_clear_answer_takes_no_more_trials(small, campaign):
    for fraction in (0.5, 1.0):
        coin = Coin(1, fraction)
        shown(coin, small, campaign(0.9))
        assert len(coin.asked) == 1
