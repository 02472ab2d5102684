"""The parts against numpy, scipy and the definitions."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from startrack.identification.chance import log_tail
from startrack.identification.code import place, separation
from startrack.identification.fit import align, fit
from startrack.identification.index import UNIT
from startrack.identification.search import breadth_first
from startrack.identification.sky import cone, sky_grid
from startrack.identification.thin import local_rank
from startrack.identification.verify import pair


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def strewn(rng, count):
    """Unit vectors (n, 3), uniform over the sphere."""
    return unit(rng.standard_normal((count, 3)))


def near(rng, centre, radius, count):
    """Unit vectors (n, 3) about a direction."""
    return unit(centre + radius * rng.standard_normal((count, 3)))


@pytest.mark.parametrize("radius", [0.02, 0.3, 1.5, 3.2])
@pytest.mark.parametrize("spacing", [0.01, 0.1, 1.0, 5.0])
def test_cone_is_a_scan(radius, spacing):
    rng = np.random.default_rng(1)
    stars = strewn(rng, 3000)
    grid = sky_grid(stars, spacing)
    for axis in [*strewn(rng, 5), *np.eye(3), *-np.eye(3)]:
        found = np.sort(grid.member[cone(grid, axis, radius)])
        angle = np.arccos(np.clip(stars @ axis, -1, 1))
        np.testing.assert_array_equal(found, np.flatnonzero(angle <= radius))


def test_local_rank_counts_brighter_neighbours():
    stars = strewn(np.random.default_rng(2), 1500)
    close = stars @ stars.T >= np.cos(0.2)
    brighter = np.tril(close, -1).sum(axis=1)
    np.testing.assert_array_equal(local_rank(stars, 0.2, 1000), brighter)
    np.testing.assert_array_equal(local_rank(stars, 0.2, 1000) == 0, brighter == 0)


def test_thinning_evens_the_sky_out():
    """Of a sky ten times denser on one half, as many stars stay per area on both."""
    stars = strewn(np.random.default_rng(3), 20_000)
    keep = (stars[:, 2] > 0) | (np.arange(20_000) % 10 == 0)
    stars = stars[keep]
    kept = stars[local_rank(stars, 0.15, 40) < 4]
    north, south = np.sum(kept[:, 2] > 0.2), np.sum(kept[:, 2] < -0.2)
    assert 0.8 < north / south < 1.25


def test_code_does_not_turn_nor_grow():
    rng = np.random.default_rng(4)
    for _ in range(50):
        a, b, c = near(rng, strewn(rng, 1), 0.1, 3)
        x, y = place(a, b, c)
        turn = Rotation.random(rng=rng)
        np.testing.assert_allclose(place(*turn.apply([a, b, c])), (x, y), atol=1e-9)
        np.testing.assert_allclose(place(b, a, c), (1 - x, -y), atol=1e-9)
        mirrored = np.array([a, b, c]) * [1, 1, -1]
        np.testing.assert_allclose(place(*mirrored), (x, -y), atol=1e-9)


def test_code_in_the_plane_is_a_division_of_complex_numbers():
    """A small field is flat, and similarity there is multiplication by a complex number."""
    rng = np.random.default_rng(5)
    z = 1e-4 * (rng.standard_normal((20, 3)) + 1j * rng.standard_normal((20, 3)))
    for a, b, c in z:
        stars = unit(np.array([[w.real, w.imag, 1.0] for w in (a, b, c)]))
        expected = (c - a) / (b - a)
        x, y = place(*stars)
        assert complex(x, y) == pytest.approx(expected, abs=1e-5 * abs(expected) + 1e-6)


def test_codes_of_the_index_are_canonical(design):
    index = design(12, 6.0).index
    code = index.table.code * UNIT
    assert (code[:, 0] <= code[:, 2] + UNIT).all()
    assert (code[:, 0] + code[:, 2] <= 1 + 2 * UNIT).all()
    stars = index.bright.direction[index.table.base[index.table.pattern]]
    pick = np.random.default_rng(6).choice(len(index), 200, replace=False)
    for four, stored in zip(stars[pick], code[pick], strict=True):
        apart = np.linalg.norm(four[:, None] - four, axis=-1)
        assert apart[0, 1] == apart.max()
        assert index.table.smallest <= separation(four[0], four[1]) <= index.table.largest
        flat = np.array([*place(four[0], four[1], four[2]), *place(four[0], four[1], four[3])])
        np.testing.assert_allclose(stored, flat, atol=UNIT)


def test_no_pattern_is_missing_or_twice_among_the_brightest(design):
    """All sets of four bright neighbours, found by trying all."""
    index = design(12, 6.0).index
    rank = index.rank[index.table.base]
    star = index.bright.direction[index.table.base]
    field = index.field_of_view
    rows = {tuple(sorted(row)) for row in index.table.pattern.tolist()}
    assert len(rows) == len(index)
    centre = star[100]
    around = np.flatnonzero((star @ centre > np.cos(0.6 * field)) & (rank < 8))
    wanted = 0
    for four in combinations(sorted(around.tolist()), 4):
        apart = np.linalg.norm(star[list(four)][:, None] - star[list(four)], axis=-1).max()
        if 0.21 * field < apart < 0.7 * field:
            wanted += 1
            assert four in rows
    assert wanted > 10


@pytest.mark.parametrize(("n", "p"), [(5, 1e-3), (40, 0.01), (40, 0.9), (9998, 1e-4)])
def test_tail_is_the_binomial(n, p):
    for k in (0, 1, 2, 4, 5):
        assert log_tail(n, k, p) == pytest.approx(binom.logsf(k - 1, n, p), rel=1e-9, abs=1e-12)
    assert log_tail(5, 6, 0.5) == -np.inf
    assert log_tail(5, 2, 0.0) == -np.inf
    assert log_tail(5, 2, 1.0) == 0


def test_fit_finds_attitude_and_scale_again():
    rng = np.random.default_rng(7)
    plane = rng.uniform(-0.3, 0.3, (12, 2))
    seen = unit(np.column_stack([plane, np.ones(12)]))
    truth = Rotation.random(rng=rng)
    stars = truth.inv().apply(seen)
    every = np.arange(12)
    start = (Rotation.from_rotvec(0.02 * rng.standard_normal(3)) * truth).as_matrix()
    found, scale = fit(1.07 * plane, stars, every, every, start, 1.0, True, 6)
    np.testing.assert_allclose(found, truth.as_matrix(), atol=1e-12)
    assert scale == pytest.approx(1.07, abs=1e-12)


def test_fit_agrees_with_scipy_on_noise():
    """Residuals in the plane against Wahba's cost: equal to first order in a narrow field."""
    rng = np.random.default_rng(8)
    plane = rng.uniform(-0.02, 0.02, (30, 2))
    truth = Rotation.random(rng=rng)
    stars = truth.inv().apply(unit(np.column_stack([plane, np.ones(30)])))
    noisy = plane + 1e-5 * rng.standard_normal((30, 2))
    every = np.arange(30)
    found, scale = fit(noisy, stars, every, every, truth.as_matrix(), 1.0, False, 3)
    other, _ = Rotation.align_vectors(unit(np.column_stack([noisy, np.ones(30)])), stars)
    assert scale == 1.0
    assert (Rotation.from_matrix(found) * other.inv()).magnitude() < 1e-6
    assert (Rotation.from_matrix(found) * truth.inv()).magnitude() < 1e-3


def test_align_is_exact_on_two_directions():
    rng = np.random.default_rng(9)
    a, b = near(rng, np.array([0.2, 0.3, 0.9]), 0.1, 2)
    turn = Rotation.random(rng=rng)
    np.testing.assert_allclose(align(a, b, *turn.apply([a, b])), turn.as_matrix(), atol=1e-9)


def test_pairs_are_one_to_one():
    spots = np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 5.0]])
    stars = np.array([[0.4, 0.0], [0.1, 0.0], [1.2, 0.0], [9.0, 9.0]])
    spot, star, distance = pair(spots, stars, 0.5)
    assert spot.tolist() == [0, 1]
    assert star.tolist() == [1, 2]
    np.testing.assert_allclose(distance, [0.1, 0.2])


def test_breadth_first_holds_all_choices_the_brightest_first():
    choices = breadth_first(9)
    assert choices[0].tolist() == [0, 1, 2, 3]
    assert len(np.unique(choices, axis=0)) == 126
    assert (np.diff(choices.sum(axis=1)) >= 0).all()
