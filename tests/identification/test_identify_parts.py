"""The parts against numpy, scipy and the definitions."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.identification.code import place, separation
from startrack.identification.evidence import log_evidence
from startrack.identification.fit import align, derivatives, fit
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
    stars = index.bright.direction[index.table.base[index.table.pattern]]
    pick = np.random.default_rng(6).choice(len(index), 200, replace=False)
    for four in stars[pick]:
        apart = np.linalg.norm(four[:, None] - four, axis=-1)
        assert apart[0, 1] == apart.max()
        assert index.table.smallest <= separation(four[0], four[1]) <= index.table.largest
        xc, _ = place(four[0], four[1], four[2])
        xd, _ = place(four[0], four[1], four[3])
        assert xc <= xd
        assert xc + xd <= 1


def test_no_pattern_is_missing_or_twice_among_the_brightest(design):
    """All sets of four bright neighbours, found by trying all."""
    index = design(12, 6.0).index
    brightest = np.argsort(index.magnitude, kind="stable")
    rank = np.empty(len(brightest), int)
    radius = index.field_of_view / np.sqrt(np.pi)
    rank[brightest] = local_rank(index.bright.direction[brightest], radius, 40)
    rank = rank[index.table.base]
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


def test_derivatives_are_differences():
    rng = np.random.default_rng(11)
    star = unit(np.array([0.2, -0.1, 1.0]))
    turn = Rotation.random(rng=rng)
    star = turn.inv().apply(star)
    scale, step = 1.05, 1e-6

    def spot(vector, scale):
        x, y, z = (Rotation.from_rotvec(vector) * turn).apply(star)
        return scale * np.array([x, y]) / z

    columns = [
        (spot(step * axis, scale) - spot(-step * axis, scale)) / (2 * step) for axis in np.eye(3)
    ]
    columns.append((spot(np.zeros(3), scale + step) - spot(np.zeros(3), scale - step)) / (2 * step))
    found = derivatives(turn.as_matrix(), star, scale)
    np.testing.assert_allclose(found, np.transpose(columns), atol=1e-8)


def test_the_evidence_of_a_known_attitude_has_a_mean_of_one_over_chance():
    """Without unknowns it is a likelihood ratio; here one star, expected at the origin.

    A spot anywhere in the unit square is taken for the star where that is likelier. The mean
    of the greatest evidence over all models is at most one for each, and above their share.
    """
    rng = np.random.default_rng(10)
    no_rows, nothing = np.empty((1, 2, 0)), np.empty((0, 0))
    square = ((rng.random((40_000, 2)) - 0.5) ** 2).sum(axis=1)
    every = [
        log_evidence(
            np.array([s]), np.array([1e-3]), np.zeros(1, int), no_rows, nothing, 0.0, 1, 1, 1.0, 0.1
        )
        for s in square
    ]
    missed = log_evidence(
        np.empty(0), np.empty(0), np.empty(0, int), no_rows[:0], nothing, 0.0, 1, 1, 1.0, 0.1
    )
    mean = np.mean(np.exp(np.maximum(every, missed)))
    assert mean < 1


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
