"""Parts of the identification against numpy, scipy and their definitions."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.values import Stars
from startrack.identification import Identification, build_index
from startrack.identification.agree import pair
from startrack.identification.evidence import log_brightness, log_evidence
from startrack.identification.fit import align, derivatives, fit
from startrack.identification.grids import cone, hits, sky_grid, spot_grid
from startrack.identification.index import (
    CELLS_BASE,
    CELLS_Y,
    cell_base,
    cell_x,
    cell_y,
    local_rank,
    merged,
    separation,
    triangle_code,
)
from startrack.identification.search import breadth_first
from startrack.identification.seen import predict, see, usable

IN_PYTHON = pytest.mark.usefixtures("in_python")


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def strewn(rng, count):
    """Unit vectors (n, 3), uniform over the sphere."""
    return unit(rng.standard_normal((count, 3)))


def near(rng, centre, radius, count):
    """Unit vectors (n, 3) about a direction."""
    return unit(centre + radius * rng.standard_normal((count, 3)))


@IN_PYTHON
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


def test_thinning_makes_the_density_uniform():
    """The stars are ten times denser on one half of the sky; equally many per area remain on
    both."""
    stars = strewn(np.random.default_rng(3), 20_000)
    keep = (stars[:, 2] > 0) | (np.arange(20_000) % 10 == 0)
    stars = stars[keep]
    kept = stars[local_rank(stars, 0.15, 40) < 4]
    north, south = np.sum(kept[:, 2] > 0.2), np.sum(kept[:, 2] < -0.2)
    assert 0.8 < north / south < 1.25


@IN_PYTHON
def test_code_is_invariant_to_rotation_and_scale():
    rng = np.random.default_rng(4)
    for _ in range(50):
        a, b, c = near(rng, strewn(rng, 1), 0.1, 3)
        x, y = triangle_code(a, b, c)
        turn = Rotation.random(rng=rng)
        np.testing.assert_allclose(triangle_code(*turn.apply([a, b, c])), (x, y), atol=1e-9)
        np.testing.assert_allclose(triangle_code(b, a, c), (1 - x, -y), atol=1e-9)
        mirrored = np.array([a, b, c]) * [1, 1, -1]
        np.testing.assert_allclose(triangle_code(*mirrored), (x, -y), atol=1e-9)


@IN_PYTHON
def test_code_in_the_plane_is_a_division_of_complex_numbers():
    """In a small field, similarity is multiplication by a complex number."""
    rng = np.random.default_rng(5)
    z = 1e-4 * (rng.standard_normal((20, 3)) + 1j * rng.standard_normal((20, 3)))
    for a, b, c in z:
        stars = unit(np.array([[w.real, w.imag, 1.0] for w in (a, b, c)]))
        expected = (c - a) / (b - a)
        x, y = triangle_code(*stars)
        assert complex(x, y) == pytest.approx(expected, abs=1e-5 * abs(expected) + 1e-6)


@IN_PYTHON
def test_codes_of_the_index_are_canonical_and_sorted(design):
    table = design(12, 6.0).index.table
    one, other = (table.sky.direction[table.triangle[:, k]] for k in (0, 1))
    base = 2 * np.arcsin(np.linalg.norm(one - other, axis=1) / 2)
    assert base.min() >= table.smallest * (1 - 1e-9)
    assert base.max() <= table.largest * (1 + 1e-9)
    pick = np.random.default_rng(6).choice(len(table.triangle), 100, replace=False)
    for number in pick:
        a, b, c = table.sky.direction[table.triangle[number]]
        apart = [separation(a, b), separation(b, c), separation(c, a)]
        assert apart[0] == max(apart)
        x, y = triangle_code(a, b, c)
        assert x <= 0.5
        row = (cell_x(x) * CELLS_Y + cell_y(y)) * CELLS_BASE + cell_base(apart[0], table.smallest)
        assert table.start[row] <= number < table.start[row + 1]


def test_no_triangle_is_missing_or_twice_among_the_brightest(design):
    """All sets of three bright neighbours, by exhaustive search."""
    index = design(12, 6.0).index
    table, field = index.table, index.field_of_view
    star = table.sky.direction
    brightest = np.argsort(index.bright.magnitude[table.sky.member], kind="stable")
    rank = np.empty(len(star), int)
    rank[brightest] = local_rank(star[brightest], field / np.sqrt(np.pi), 40)
    many = np.array([len(star) ** 2, len(star), 1])
    rows = np.sort(np.sort(table.triangle, axis=1) @ many)
    assert (np.diff(rows) > 0).all()
    wanted = 0
    for centre in star[[100, 900, 1700, 3000]]:
        around = np.flatnonzero((star @ centre > np.cos(0.6 * field)) & (rank < 5))
        a, b, c = around[np.array(list(combinations(range(len(around)), 3)))].T
        sides = [np.linalg.norm(star[i] - star[j], axis=1) for i, j in ((a, b), (b, c), (c, a))]
        longest = np.max(sides, axis=0)
        fitting = (0.21 * field < longest) & (longest < 1.19 * field)
        wanted += np.count_nonzero(fitting)
        sets = np.sort(np.column_stack([a, b, c])[fitting], axis=1)
        assert (rows[np.searchsorted(rows, sets @ many) % len(rows)] == sets @ many).all()
    assert wanted > 10


def test_stars_closer_than_the_resolution_are_one():
    """A pair, a chain of three and a single star; each group keeps its light."""
    x = np.array([0.0, 1e-4, 0.1, 0.1 + 8e-5, 0.1 + 16e-5, 0.3])
    direction = np.column_stack([np.sin(x), np.zeros(6), np.cos(x)])
    magnitude = np.array([3.0, 3.0, 5.0, 2.0, 6.0, 4.0])
    stars = Stars(np.arange(6), direction, magnitude, np.zeros(6))
    left, names = merged(stars, 1.01e-4)
    assert sorted(names.tolist()) == [0, 3, 5]
    place = dict(zip(names.tolist(), range(3), strict=True))
    middle = np.arctan2(*left.direction[place[0]][[0, 2]])
    assert middle == pytest.approx(5e-5, abs=1e-9)
    assert left.magnitude_g[place[0]] == pytest.approx(3.0 - 2.5 * np.log10(2))
    np.testing.assert_array_equal(left.direction[place[5]], direction[5])
    total = (10 ** (-0.4 * left.magnitude_g)).sum()
    assert total == pytest.approx((10 ** (-0.4 * magnitude)).sum(), rel=1e-12)
    everything, names = merged(stars, 1e-9)
    assert len(everything) == len(names) == 6


@IN_PYTHON
def test_stars_of_an_image_are_those_that_the_camera_projects_into_it(design):
    camera = design(12, 6.0)
    rng = np.random.default_rng(12)
    scale = 0.97
    for _ in range(5):
        turn = Rotation.random(rng=rng)
        seen = camera.look(rng, attitude=turn)
        view = see(seen.spots, usable(seen.spots), camera.camera, Identification())
        sky = camera.index.faint
        found, at = predict(view, sky, turn.as_matrix(), scale)
        direction = turn.apply(sky.direction)
        pixel = camera.camera.scaled(scale).project(direction)
        inside = np.flatnonzero((direction[:, 2] > 0) & camera.camera.holds(pixel))
        np.testing.assert_array_equal(np.sort(found), inside)
        plane = (pixel[found] - camera.camera.centre) / camera.camera.focal_length_px
        np.testing.assert_allclose(at, plane, atol=1e-12)


@IN_PYTHON
def test_the_spot_grid_finds_what_a_scan_finds():
    """Except close spots, of which a cell keeps one: fewer than one in fifty."""
    rng = np.random.default_rng(13)
    low, high = np.array([-0.1, -0.07]), np.array([0.1, 0.07])
    plane = low + (high - low) * rng.random((30, 2))
    screen = spot_grid(plane, low, high, 8e-4)
    places = np.concatenate([plane + 4e-4 * rng.standard_normal(plane.shape) for _ in range(30)])
    places = np.clip(places, low, high)
    apart = np.linalg.norm(places[:, None] - plane, axis=2).min(axis=1)
    truly = np.sum(apart <= 8e-4)
    found = hits(screen, plane, places)
    assert 0.98 * truly <= found <= truly
    assert hits(screen, plane, np.empty((0, 2))) == 0


@IN_PYTHON
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


def test_the_factor_of_brightness_has_a_mean_of_one_over_chance():
    """Random spots matched with random stars: the mean factor is at most one, 0.1 % alarms.

    The density by chance is estimated from the spots themselves, which makes the factor a little
    too small.
    """
    rng = np.random.default_rng(15)
    factors = []
    for _ in range(4000):
        magnitude = rng.normal(-9.0, 1.0, 12)
        expected = rng.normal(5.0, 1.0, 15)
        spot, star = rng.permutation(12)[:4], rng.permutation(15)[:4]
        blur = np.full(4, 0.3)
        factors.append(np.exp(log_brightness(magnitude, blur, expected, blur, spot, star)))
    mean, sigma = np.mean(factors), np.std(factors) / np.sqrt(len(factors))
    assert mean < 1 + 3.1 * sigma
    assert mean > 0.6


def test_brightness_is_evidence_for_true_matches_and_weak_against_them():
    rng = np.random.default_rng(16)
    expected = rng.uniform(2.0, 6.0, 10)
    every, blur = np.arange(10), np.full(10, 0.2)

    def factor(magnitude):
        return log_brightness(magnitude, blur, expected, blur, every, every)

    true = expected - 12.0 + 0.25 * rng.standard_normal(10)
    assert factor(true) > 3
    assert -np.log(2) <= factor(rng.permutation(true)) < 1
    saturated = np.maximum(true, -8.0)
    saturated[0] = np.nan
    assert factor(saturated) > -np.log(2)
    assert factor(np.full(10, np.nan)) == 0


def test_the_evidence_of_a_known_attitude_has_a_mean_of_one_over_chance():
    """Without unknowns it is a likelihood ratio; here of one star, expected at the origin.

    A spot anywhere in the unit square is matched with the star if that is likelier. The mean of the
    greatest evidence over all models is at most one for each, and above their fraction.
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


@IN_PYTHON
def test_fit_finds_attitude_and_scale_again():
    rng = np.random.default_rng(7)
    plane = rng.uniform(-0.3, 0.3, (12, 2))
    seen = unit(np.column_stack([plane, np.ones(12)]))
    truth = Rotation.random(rng=rng)
    stars = truth.inv().apply(seen)
    every = np.arange(12)
    start = (Rotation.from_rotvec(0.02 * rng.standard_normal(3)) * truth).as_matrix()
    weight = np.full(12, 1e20)
    found, scale = fit(1.07 * plane, weight, stars, every, every, start, 1.0, 1.0, 6)
    np.testing.assert_allclose(found, truth.as_matrix(), atol=1e-12)
    assert scale == pytest.approx(1.07, abs=1e-12)
    _, held = fit(1.07 * plane, weight, stars, every, every, start, 1.0, 1e-14, 6)
    assert held == pytest.approx(1.0, abs=1e-3)


@IN_PYTHON
def test_fit_agrees_with_scipy_on_noise():
    """Residuals in the plane against Wahba's cost: equal to first order in a narrow field."""
    rng = np.random.default_rng(8)
    plane = rng.uniform(-0.02, 0.02, (30, 2))
    truth = Rotation.random(rng=rng)
    stars = truth.inv().apply(unit(np.column_stack([plane, np.ones(30)])))
    noisy = plane + 1e-5 * rng.standard_normal((30, 2))
    every = np.arange(30)
    weight = rng.uniform(0.5, 2.0, 30)
    found, scale = fit(noisy, weight, stars, every, every, truth.as_matrix(), 1.0, 0.0, 3)
    seen = unit(np.column_stack([noisy, np.ones(30)]))
    other, _ = Rotation.align_vectors(seen, stars, weights=weight)
    assert scale == 1.0
    assert (Rotation.from_matrix(found) * other.inv()).magnitude() < 1e-6
    assert (Rotation.from_matrix(found) * truth.inv()).magnitude() < 1e-3


@IN_PYTHON
def test_align_is_exact_on_two_directions():
    rng = np.random.default_rng(9)
    a, b = near(rng, np.array([0.2, 0.3, 0.9]), 0.1, 2)
    turn = Rotation.random(rng=rng)
    np.testing.assert_allclose(align(a, b, *turn.apply([a, b])), turn.as_matrix(), atol=1e-9)


@IN_PYTHON
def test_pairs_are_one_to_one():
    spots = np.array([[0.0, 0.0], [1.0, 0.0], [5.0, 5.0]])
    stars = np.array([[0.4, 0.0], [0.1, 0.0], [1.2, 0.0], [9.0, 9.0]])
    spot, star, distance = pair(spots, stars, np.full(3, 0.5))
    assert spot.tolist() == [0, 1]
    assert star.tolist() == [1, 2]
    np.testing.assert_allclose(distance, [0.1, 0.2])
    assert pair(spots, stars, np.array([0.5, 0.1, 0.5]))[0].tolist() == [0]


def test_breadth_first_holds_all_choices_the_brightest_first():
    choices = breadth_first(9, 24)
    assert choices[0].tolist() == [0, 1, 2]
    assert len(np.unique(choices, axis=0)) == 84
    assert (np.diff(choices.sum(axis=1)) >= 0).all()
    more = breadth_first(14, 9)
    np.testing.assert_array_equal(more[:84], choices)
    assert more[84:].min() == 9
    assert len(more) == 84 + 10


def test_the_number_of_triangles_is_about_the_wanted_one():
    """For randomly distributed stars, which the estimate assumes; within a tenth."""
    stars = strewn(np.random.default_rng(20), 4000)
    sky = Stars(np.arange(4000), stars, np.linspace(0, 6, 4000), np.zeros(4000))
    index = build_index(sky, 0.35, triangles=20_000)
    assert len(index) == pytest.approx(20_000, rel=0.1)
    for wrong in ({"triangles": 0}, {"triangles": 2**28 + 1}, {"stars_per_field": 2}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            build_index(sky, 0.35, **wrong)


def test_unknown_colour_has_the_error_of_one_magnitude_from_the_suns():
    """0.3 magnitude for a star like the Sun, and 0.2 per magnitude of colour, added in squares."""
    stars = strewn(np.random.default_rng(21), 500)
    colour = np.tile([0.82, np.nan, 1.82, -0.68, 0.82], 100)
    sky = Stars(np.arange(500), stars, np.linspace(0, 6, 500), colour)
    bright = build_index(sky, 0.35, triangles=100).bright
    wanted = np.tile([0.3, 0.13**0.5, 0.13**0.5, 0.18**0.5, 0.3], 100)
    np.testing.assert_allclose(bright.blur, wanted[bright.sky.member])
