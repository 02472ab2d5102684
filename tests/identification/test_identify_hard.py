"""Unusual fields and wrong input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.units import deg
from startrack.core.values import Stars, Status
from startrack.identification import Identification, build_index, identify

SETTINGS = Identification()


# Both poles, and the meridian at which right ascension jumps.
@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [1, -1e-4, 0.7]])
@pytest.mark.parametrize("roll", [0.0, 2.0, 4.0])
def test_poles_and_the_jump_of_right_ascension_are_solved(design, towards, direction, roll):
    camera = design(12, 6.0)
    rng = np.random.default_rng(1)
    seen = camera.look(rng, noise=0.1, false=3, attitude=towards(direction, roll))
    assert seen.error(camera.solve(seen.spots)) < 3


def test_a_mirrored_image_is_not_solved(design):
    camera = design(12, 6.0)
    rng = np.random.default_rng(2)
    for _ in range(25):
        spots = camera.look(rng, noise=0.1).spots
        mirrored = replace(spots, x=camera.camera.columns - 1 - spots.x)
        assert camera.solve(mirrored).status is Status.NO_MATCH


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_too_few_spots_are_data(design, spots_at, count):
    pixel = np.array([[100.0, 200.0], [700.0, 300.0], [500.0, 900.0]])[:count]
    matches = design(12, 6.0).solve(spots_at(pixel, 0.1))
    assert matches.status is (Status.TOO_FEW if count else Status.BLANK)
    assert str(count) in matches.reason
    assert matches.icrs_to_camera is None
    assert matches.direction.shape == (0, 3)
    assert matches.false_probability == 1.0


def test_spots_without_a_finite_position_are_left_out(design):
    camera = design(12, 6.0)
    seen = camera.look(np.random.default_rng(3), noise=0.1)
    x, y = seen.spots.x.copy(), seen.spots.y.copy()
    x[0], y[2], x[5] = np.nan, np.inf, -np.inf
    matches = camera.solve(replace(seen.spots, x=x, y=y))
    assert seen.error(matches) < 3
    assert not set(matches.spot) & {0, 2, 5}
    all_gone = replace(seen.spots, x=np.full_like(x, np.nan))
    assert camera.solve(all_gone).status is Status.BLANK


@pytest.mark.parametrize("sigma2", [np.nan, 0.0, -1.0, np.inf, 1e6])
def test_a_useless_covariance_is_accepted(design, sigma2):
    camera = design(12, 6.0)
    seen = camera.look(np.random.default_rng(4), noise=0.1, false=3)
    covariance = np.full_like(seen.spots.covariance, sigma2)
    assert seen.error(camera.solve(replace(seen.spots, covariance=covariance))) < 3


def test_spots_at_the_same_position(design, spots_at):
    camera = design(12, 6.0)
    seen = camera.look(np.random.default_rng(5), noise=0.1)
    pixel = np.column_stack([seen.spots.x, seen.spots.y])
    doubled = np.repeat(pixel, 2, axis=0)
    matches = camera.solve(spots_at(doubled, 0.1))
    assert seen.error(matches) < 3
    assert len(np.unique(matches.star)) == len(matches)
    one_place = spots_at(np.full((30, 2), 500.0), 0.1)
    assert camera.solve(one_place).status is Status.NO_MATCH


def test_ten_thousand_spots(design, spots_at):
    camera = design(12, 6.0)
    rng = np.random.default_rng(6)
    seen = camera.look(rng, noise=0.1)
    faint = rng.random((10_000, 2)) * 1024 - 0.5
    pixel = np.concatenate([np.column_stack([seen.spots.x, seen.spots.y]), faint])
    assert seen.error(camera.solve(spots_at(pixel, 0.1))) < 3
    assert camera.solve(spots_at(faint, 0.1)).status is Status.NO_MATCH


def test_all_magnitudes_wrong(design, spots_at):
    camera = design(12, 6.0)
    rng = np.random.default_rng(7)
    solved = 0
    for _ in range(30):
        seen = camera.look(rng, noise=0.1, false=3)
        pixel = np.column_stack([seen.spots.x, seen.spots.y])
        matches = camera.solve(spots_at(rng.permutation(pixel), 0.1))
        if matches.status is Status.SOLVED:
            assert seen.error(matches) < 3
            solved += 1
    assert solved >= 25


def test_few_hypotheses_end_the_search(design, spots_at):
    """The number may be exceeded by the other hypotheses of the last cell of the index."""
    camera = design(12, 6.0)
    pixel = np.random.default_rng(8).random((30, 2)) * 1024
    answer = camera.solve(spots_at(pixel, 0.1), Identification(max_hypotheses=100)).reason
    tried = int(answer.split()[2])
    assert 100 <= tried < 200
    assert int(camera.solve(spots_at(pixel, 0.1)).reason.split()[2]) > 1000


@pytest.mark.parametrize("count", [0, 1, 3, 10])
def test_a_catalogue_of_few_stars_solves_nothing(design, count):
    camera = design(12, 6.0)
    stars = camera.stars[:count]
    index = build_index(stars, 12 * deg)
    seen = camera.look(np.random.default_rng(9))
    matches = identify(seen.spots, camera.camera, stars, index, SETTINGS)
    assert matches.status is Status.NO_MATCH


def test_an_index_of_another_catalogue_is_refused(design):
    camera = design(12, 6.0)
    seen = camera.look(np.random.default_rng(10))
    with pytest.raises(ValueError, match=r"index must be built from the same stars, got \d+"):
        identify(seen.spots, camera.camera, camera.stars[:100], camera.index, SETTINGS)


def test_directions_must_be_unit_vectors():
    for length in (2.0, np.nan):
        direction = np.array([[1.0, 0, 0], [0, length, 0]])
        stars = Stars(np.arange(2), direction, np.zeros(2), np.zeros(2))
        with pytest.raises(ValueError, match=r"stars\.direction must be unit vectors"):
            build_index(stars, 0.2)


@pytest.mark.parametrize("field", [100, 120])
def test_images_wider_than_any_index_are_identified(design, field):
    """All of 30 skies; of 1,000 others at each of these fields none was lost or false."""
    camera, rng = design(field, 3.5), np.random.default_rng(field)
    for _ in range(30):
        seen = camera.look(rng, false=3)
        matches = camera.solve(seen.spots)
        assert matches.status is Status.SOLVED
        turn = (matches.icrs_to_camera * seen.icrs_to_camera.inv()).magnitude()
        assert turn < 2 / camera.camera.focal_length_px


@pytest.mark.parametrize("field", [0.0, -0.1, np.nan, 2.0])
def test_a_field_of_view_out_of_range_is_refused(design, field):
    with pytest.raises(ValueError, match="field_of_view must"):
        build_index(design(12, 6.0).stars, field)


@pytest.mark.parametrize(
    "wrong",
    [
        {"focal_tolerance": -0.01},
        {"focal_tolerance": 0.5},
        {"match_radius": 0.0},
        {"max_false_probability": 0.0},
        {"max_false_probability": 2.0},
        {"min_matches": 3},
        {"pattern_spots": 3},
        {"verify_spots": 0},
        {"code_tolerance": 1.0},
        {"max_hypotheses": 0},
    ],
)
def test_settings_out_of_range_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=name):
        Identification(**wrong)


def test_settings_of_another_type_are_refused():
    with pytest.raises(TypeError, match="min_matches"):
        Identification(min_matches=4.5)


# A sky of 20 deg whose nineteenth spot was matched to a wrong star, which held the focal length: 7
# of 21 spots were matched, 9 pixels off across. Columns: x, y (pixel), magnitude.
HELD = np.array(
    [
        [612.0, 177.2, 2.9],
        [89.0, 23.1, 3.0],
        [39.3, 401.4, 3.1],
        [635.4, 353.5, 3.1],
        [174.5, 868.4, 3.2],
        [598.6, 163.2, 3.3],
        [30.1, 111.6, 3.3],
        [771.4, 839.2, 3.7],
        [634.8, 184.9, 3.7],
        [643.1, 187.1, 3.8],
        [284.8, 683.2, 4.0],
        [1012.4, 826.8, 4.0],
        [184.3, 821.8, 4.0],
        [409.3, 74.1, 4.1],
        [613.7, 192.8, 4.3],
        [631.3, 201.1, 4.3],
        [318.8, 734.0, 4.3],
        [237.5, 288.9, 4.3],
        [76.8, 13.8, 4.5],
        [84.0, 103.8, 4.5],
        [655.9, 511.9, 5.0],
    ]
)


def test_a_focal_length_that_one_false_match_holds_is_refused(design, spots_at):
    known = design(20, 5.0)
    x, y, magnitude = HELD.T
    spots = replace(spots_at(np.column_stack([x, y]), 0.2), flux=10 ** (-0.4 * magnitude))
    believed = known.camera.scaled(1.0236)
    matches = identify(spots, believed, known.stars, known.index, SETTINGS)
    assert matches.status is Status.NO_MATCH
    assert "16 of 21 spots are stars for a focal length -2.3 % off" in matches.reason
    told = replace(SETTINGS, focal_tolerance=0.03)
    matches = identify(spots, believed, known.stars, known.index, told)
    assert matches.camera.focal_length_px == pytest.approx(known.camera.focal_length_px, rel=2e-4)
    truth = Rotation.from_quat([-0.579577, -0.072195, -0.569057, -0.578837])
    error = (matches.icrs_to_camera * truth.inv()).as_rotvec()
    assert np.hypot(*error[:2]) * known.camera.focal_length_px < 0.5
