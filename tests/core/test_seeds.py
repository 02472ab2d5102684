"""Seeds against numpy's own SeedSequence."""

import numpy as np
import pytest

from startrack.core.streams import Seeds

EDGES = [0, 1, 2**31, 2**32 - 1, 2**32, 2**32 + 1, 2**63 - 1, 2**63, 2**64 - 1]


def states(*entropy):
    return (
        each.generate_state(3, np.uint64).tolist()
        for each in (Seeds(*entropy), np.random.SeedSequence(entropy))
    )


@pytest.mark.parametrize("first", EDGES)
def test_they_are_numpys_at_the_edges_of_words(first):
    for second in EDGES:
        for third in EDGES:
            ours, numpys = states(first, second, third)
            assert ours == numpys


def test_they_are_numpys_for_numbers_of_all_sizes():
    rng = np.random.default_rng(1)
    for entropy in rng.integers(0, 2**64, (1000, 3), np.uint64) >> rng.integers(
        0, 64, (1000, 3), np.uint64
    ):
        ours, numpys = states(*entropy.tolist())
        assert ours == numpys


def test_a_generator_of_them_is_numpys():
    ours, numpys = (
        np.random.Generator(np.random.SFC64(each))
        for each in (Seeds(1, 2, 3), np.random.SeedSequence((1, 2, 3)))
    )
    assert ours.standard_normal(100).tolist() == numpys.standard_normal(100).tolist()


def test_children_are_numpys():
    ours, numpys = (
        np.random.Generator(np.random.SFC64(each))
        for each in (Seeds(1, 2, 3), np.random.SeedSequence((1, 2, 3)))
    )
    for _ in range(2):  # the second time, others
        one, other = ours.spawn(2)[1], numpys.spawn(2)[1]
        assert one.random(5).tolist() == other.random(5).tolist()


def test_other_generators_are_refused():
    with pytest.raises(ValueError, match="n_words must be 3 of uint64, got 4"):
        np.random.PCG64(Seeds(1, 2, 3))
