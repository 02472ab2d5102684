"""Errors of stars into errors of attitudes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from startrack.budget.fields import (
    FieldResponse,
    Fields,
    FieldStars,
    Solver,
    attitudes,
    fields,
    propagate,
    sobol_points,
)
from startrack.budget.fixed import displaced
from startrack.catalog import Sky
from startrack.core.units import deg
from startrack.core.values import Stars
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.metrics import attitude_bound

FOCAL = 2000.0
SIGMA = 0.1


@pytest.mark.parametrize("count", [1, 4, 32, 64, 512, 4096])
def test_sobol_points_are_those_of_scipy(count):
    expected = qmc.Sobol(3, scramble=False).random(count)
    assert np.array_equal(sobol_points(count), expected)


def scattered(count: int, stars: int, fov: float, seed: int = 1) -> Fields:
    """Fields of stars that are distributed evenly over the sphere."""
    rng = np.random.default_rng(seed)
    plane = np.empty((0, 2))
    while len(plane) < count * stars:
        more = rng.uniform(-1, 1, (4 * count * stars, 2)) * np.tan(fov / 2)
        weight = (1 + (more**2).sum(axis=1)) ** -1.5
        plane = np.concatenate([plane, more[rng.random(len(more)) < weight]])
    x, y = plane[: count * stars].T.copy()
    field = np.repeat(np.arange(count), stars)
    nothing = Stars(*(np.zeros(0),) * 4)
    return Fields(
        Sky(nothing), field[:0], Rotation.identity(count), field, x, y, np.zeros(len(x), np.int64)
    )


def response(sigma: float, fraction: float = 1.0) -> FieldResponse:
    """The same response for all magnitudes."""
    covariance = np.tile(np.eye(2) * sigma**2, (3, 1, 1))
    none = np.zeros(3)
    return FieldResponse(
        0.0, 1.0, np.full((1, 3), fraction), covariance[None], covariance[None, None], none
    )


def spread(view: Fields, displacement: np.ndarray, table: FieldResponse, **changes: object):  # type: ignore[no-untyped-def]
    options = {"tolerance": 0.0, "lost": np.ones(4), "most": 100} | changes
    first = np.searchsorted(view.field, np.arange(len(view.attitude) + 1))
    ones = np.ones(len(view.x))
    zone = np.zeros(len(ones), np.int64)
    stars = FieldStars(first, view.x, view.y, ones, zone, ones, 0 * ones, displacement)
    return propagate(stars, table, Solver(FOCAL, **options))


NONE = np.zeros((0, 1, 2))


def test_even_stars_meet_the_closed_form():
    """`attitude_bound` is within 0.5 % of trials at 12 stars; 4000 fields scatter by 1 %."""
    view = scattered(4000, 12, 14 * deg)
    found = spread(view, NONE, response(SIGMA))
    rms = np.sqrt(found.variance[:, 0].mean(axis=0))
    np.testing.assert_allclose(
        rms, attitude_bound(14 * deg, 14 * deg, 12, SIGMA / FOCAL), rtol=0.03
    )
    # With the weights of the noise, what the tracker states is what there is.
    stated = np.linalg.inv(found.stated)
    np.testing.assert_allclose(np.einsum("mii->mi", stated), found.variance[:, 0], rtol=1e-9)


@pytest.mark.parametrize("tolerance", [0.0, 1.0])
def test_trials_of_the_gain(tolerance):
    """The variance equals that of random displacements multiplied by the gain."""
    view = scattered(3, 7, 20 * deg)
    drawn = SIGMA * np.random.default_rng(2).standard_normal((4000, len(view.x), 2))
    found = spread(view, drawn, response(SIGMA), tolerance=tolerance)
    # 4000 draws: 1.1 % of each rms, 9 of them: 4 sigma is a false alarm in 1700.
    rms = np.sqrt((found.shift**2).mean(axis=1))
    np.testing.assert_allclose(rms, np.sqrt(found.variance[:, 0]), rtol=0.045)


@pytest.mark.parametrize("tolerance", [0.0, 1.0])
def test_a_turn_of_all_stars_is_that_turn(tolerance):
    view = scattered(5, 9, 16 * deg)
    turn = np.array([2e-6, -1e-6, 5e-6])
    x, y = view.x, view.y
    change = np.stack(
        [
            np.column_stack([-x * y, 1 + x * x, -y]) @ turn,
            np.column_stack([-1 - y * y, x * y, x]) @ turn,
        ],
        axis=-1,
    )
    found = spread(view, FOCAL * change[None], response(SIGMA), tolerance=tolerance)
    np.testing.assert_allclose(found.shift[:, 0], np.broadcast_to(turn, (5, 3)), rtol=1e-9)


def test_a_fitted_focal_length_takes_the_scale_up():
    view = scattered(6, 8, 16 * deg)
    scale = 1e-4 * FOCAL * np.column_stack([view.x, view.y])[None]
    free, held = (
        np.abs(spread(view, scale, response(SIGMA), tolerance=on).shift).max() for on in (1.0, 0.0)
    )
    assert free < 1e-12
    assert held > 1e-7


def test_the_chance_of_enough_stars_is_binomial():
    """8 stars, each detected with a probability of 0.6: at least 4 with 0.8263 (binomial table)."""
    found = spread(scattered(2, 8, 16 * deg), NONE, response(SIGMA, 0.6))
    np.testing.assert_allclose(found.solved, 0.8263, atol=1e-4)
    np.testing.assert_allclose(found.stars, 4.8)


def test_a_field_of_too_few_stars_is_not_solved():
    assert spread(scattered(2, 3, 16 * deg), NONE, response(SIGMA)).solved.max() == 0


def test_attitudes_are_even():
    """The means of boresights and of rolls vanish, within 1 / 512 of a circle."""
    matrix = attitudes(512).as_matrix()
    assert np.abs(matrix.mean(axis=0)).max() < 0.02
    np.testing.assert_allclose((matrix**2).mean(axis=0), 1 / 3, atol=0.01)


def test_a_camera_that_merges_other_stars_moves_the_rest_alike():
    """The index of a wider camera merges more stars; the shifts of all other stars by neighbours
    stay."""
    case = load_design(shipped("designs/noise_only.toml")).case
    camera = case.instrument.camera
    views = [fields(case.catalog, seen, attitudes, 64) for seen in (camera, camera.scaled(0.5))]
    assert len(views[0].name) > len(views[1].name)
    moved = []
    for view in views:
        star = np.arange(len(view.star))
        # A star that is merged is at another place.
        key = zip(view.field.tolist(), view.name[view.star].tolist(), view.x.tolist(), strict=True)
        moved.append(dict(zip(key, displaced(case, view, star), strict=True)))
    both = [key for key in moved[0] if key in moved[1]]
    assert len(both) > 5000
    apart = [moved[0][key] - moved[1][key] for key in both]
    np.testing.assert_allclose(apart, 0.0, atol=1e-9)
