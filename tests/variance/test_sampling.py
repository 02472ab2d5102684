"""What the trials of a campaign are."""

import numpy as np
import pytest

from startrack.campaign.precision import Precision
from startrack.campaign.resume import resume
from startrack.campaign.store import Store
from startrack.case import Fidelity
from startrack.catalog import shipped
from startrack.chain import OUTCOMES, trials
from startrack.design import load_design
from startrack.study.montecarlo import Serial, run
from startrack.variance.attitudes import by_sobol
from startrack.variance.mean_square import mean_square
from startrack.variance.sampling import Sampling

CASE = load_design(shipped("designs/nanosatellite.toml")).case


@pytest.mark.parametrize("fidelity", Fidelity)
def test_sobol_trials_are_those_of_the_chain_at_its_points(fidelity):
    sampling = Sampling(fidelity, "sobol")
    made = sampling.trials(CASE, 9, range(3, 6))
    again = trials(CASE, 9, range(3, 6), fidelity, by_sobol(9, range(3, 6)))
    assert made.tobytes() == again.tobytes()
    np.testing.assert_array_equal(made["trial"], [3, 4, 5])
    assert (made["error_x"] != trials(CASE, 9, range(3, 6), fidelity)["error_x"]).all()


def test_a_campaign_with_controls_holds_the_plain_trials_and_knows_more():
    """Its outcomes are those of a plain run; the interval is narrower, about the same value."""
    with Store(None, CASE, 4, Sampling(control=True)) as store:
        outcomes = resume(store, Serial(), 1, 48, block=20)
    alone = run(CASE, 48, 4, Serial())
    for name in OUTCOMES.names:
        np.testing.assert_array_equal(outcomes[name], alone[name])
    precision = Precision(0.01)
    helped, plain = precision.interval(outcomes), precision.interval(alone)
    assert helped.high - helped.low < 0.9 * (plain.high - plain.low)
    assert plain.low < helped.value < plain.high
    assert helped == mean_square(outcomes).root()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((Fidelity.WINDOW, "random", True), "control needs fidelity frame, got window"),
        ((Fidelity.FRAME, "grid"), "attitudes must be one of random, sobol, got 'grid'"),
    ],
)
def test_what_cannot_be_made_is_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        Sampling(*arguments)
