import numpy as np
import pytest
from scipy import stats

from startrack.core.streams import Streams


def draw(seed, trial, cause):
    return Streams(seed, trial)(cause).standard_normal(4).tolist()


def test_a_stream_depends_on_seed_trial_and_cause_alone():
    first = draw(1, 2, "read noise")
    draw(1, 2, "shot noise")
    assert draw(1, 2, "read noise") == first
    for other in [(2, 2, "read noise"), (1, 3, "read noise"), (1, 2, "shot noise")]:
        assert draw(*other) != first


def test_neighbouring_trials_are_independent():
    """Correlation between 500 neighbouring streams; false alarm 1e-4."""
    block = np.array([Streams(7, n)("x").standard_normal(200) for n in range(501)])
    correlation = np.mean(block[1:] * block[:-1]) * np.sqrt(block[1:].size)
    assert abs(correlation) < stats.norm.isf(0.5e-4)


@pytest.mark.parametrize(("seed", "trial"), [(-1, 0), (0, -1), (2**63, 0)])
def test_seeds_outside_their_range_are_refused(seed, trial):
    with pytest.raises(ValueError, match="must be a whole number"):
        Streams(seed, trial)


@pytest.mark.parametrize("cause", ["read noise", "a cause with an accent: é"])
@pytest.mark.parametrize("seed", [0, 7, 2**63 - 1])
def test_a_key_is_the_first_number_of_the_generator(seed, cause):
    streams = Streams(seed, 2**40 + 3)
    assert streams.key(cause) == streams(cause).bit_generator.random_raw()
