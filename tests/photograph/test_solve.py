"""Photographs of unknown cameras, drawn star by star: all tries other than an unchanged pinhole."""

import math
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.core import Camera, Frame, deg
from startrack.detection import Detection, detect
from startrack.identification import Identification, build_index, cameras_of
from startrack.identification.index import indexed_field
from startrack.photograph import PhotographView, solve, solve_photograph
from startrack.photograph.spots import ScaledSpots
from startrack.photograph.tries import SQUARES, tries_of

STARS = open_sky(Selection("bright", limit_g=6.5)).stars
SETTINGS = Identification(focal_tolerance=0.1)
COLUMNS, ROWS, FIELD = 640, 480, 20 * deg
TURN = Rotation.from_euler("zyx", [40, 10, 65], degrees=True)


class Indexes:
    """Indexes with a quarter of the usual triangles, which are quicker to build."""

    stars = STARS

    def __call__(self, camera):
        return _index(indexed_field(camera))


@pytest.fixture(autouse=True)
def few_cameras(monkeypatch):
    """Only cameras of about the true field are tried: those of all fields would need thirty
    indexes."""
    monkeypatch.setattr(
        "startrack.photograph.tries.cameras",
        lambda columns, rows, *_, **more: cameras_of(columns, rows, FIELD, 0.1),
    )


@cache
def _index(field):
    return build_index(STARS, field, triangles=200_000)


def draw(project, columns, rows, width=1.0, full=255.0, turn=TURN):
    """An image of 8 bits: Gaussian stars of a width (pixel), the brightest saturated."""
    direction = turn.apply(STARS.direction)
    ahead = direction[:, 2] > 0.05
    pixel, magnitude = project(direction[ahead]), STARS.magnitude_g[ahead]
    image = np.random.default_rng(5).normal(20, 2, (rows, columns))
    y, x = np.indices(image.shape)
    inside = ((pixel > -5) & (pixel < [columns + 5, rows + 5])).all(axis=1)
    for (u, v), g in zip(pixel[inside], magnitude[inside], strict=True):
        half = math.ceil(6 * width)
        part = np.s_[
            max(round(v) - half, 0) : max(round(v) + half, 0),
            max(round(u) - half, 0) : max(round(u) + half, 0),
        ]
        square = (x[part] - u) ** 2 + (y[part] - v) ** 2
        image[part] += 30 * 10 ** (-0.4 * (g - 6)) * np.exp(-square / 2 / width**2)
    return np.clip(image, 0, full).astype(np.uint8)


PINHOLE = Camera.from_field_of_view(COLUMNS, ROWS, FIELD)


def apart_from(found, turn=TURN):
    """Angle (arcmin) of the found boresight from the true one."""
    return 60 * math.degrees(np.arccos(min(found.axis.as_matrix()[2] @ turn.as_matrix()[2], 1)))


@pytest.mark.parametrize(
    "view", ["as it is", "mirrored", pytest.param("squeezed", marks=pytest.mark.slow)]
)
def test_views_are_found_and_said(view):
    image = draw(PINHOLE.project, COLUMNS, ROWS)
    expected = PhotographView()
    if view == "mirrored":
        image, expected = image[:, ::-1].copy(), PhotographView(mirrored=True)
    if view == "squeezed":  # from 16 : 9, stars round before
        made = Camera.from_field_of_view(854, ROWS, FIELD)
        image = cv2.resize(
            draw(made.project, 854, ROWS), (COLUMNS, ROWS), None, 0, 0, cv2.INTER_AREA
        )
        expected = PhotographView(aspect=4 / 3)
    found = solve_photograph(Frame(image), Indexes(), SETTINGS, FIELD)
    assert found.axis is not None, found.estimate.reason
    assert found.view.mirrored == expected.mirrored
    assert found.aspect == pytest.approx(expected.aspect, rel=5e-3)
    assert found.as_hinted
    assert found.estimate.stars == len(found.matches)
    assert found.estimate.reason.startswith(f"{found.estimate.stars} of {len(found.spots)} ")
    assert apart_from(found) < 0.5


def test_a_camera_that_turned_is_solved_and_its_streaks_are_said():
    """Drawn as the mean of 41 images along 20 pixels: no spot has the shape of a point image."""
    way = np.linspace(-0.5, 0.5, 41)[:, None] * [17.0, -11.0]
    drawn = [draw(lambda d, s=s: PINHOLE.project(d) + s, COLUMNS, ROWS) for s in way]
    image = np.mean(np.array(drawn, float), axis=0).astype(np.float32)
    found = solve_photograph(Frame(image), Indexes(), SETTINGS)
    assert found.axis is not None, found.estimate.reason
    assert apart_from(found) < 2.0
    assert found.streak is not None
    assert math.hypot(*found.streak) == pytest.approx(math.hypot(17, 11), abs=1.5)
    assert "streaks of" in found.note


def test_a_file_whose_rows_go_upwards_is_tried_mirrored_first(monkeypatch):
    attempts = []
    attempt = solve._PhotographSearch.attempt

    def counted(search, guess, effort):
        attempts.append(guess.view.mirrored)
        return attempt(search, guess, effort)

    monkeypatch.setattr(solve._PhotographSearch, "attempt", counted)
    image = draw(PINHOLE.project, COLUMNS, ROWS)[::-1].copy()
    found = solve_photograph(Frame(image), Indexes(), SETTINGS, FIELD, mirrored=True)
    assert found.view.mirrored
    assert attempts == [True]


def test_a_hint_that_is_wrong_is_left():
    image = draw(PINHOLE.project, COLUMNS, ROWS)
    found = solve_photograph(Frame(image), Indexes(), SETTINGS, 1.3 * FIELD)
    assert found.axis is not None
    assert found.as_hinted is False
    assert apart_from(found) < 0.5


def test_the_brightest_stars_are_among_the_spots_however_large_they_are():
    """Stars of sigma 7 pixels, the brightest saturated over hundreds of pixels: not found at
    full scale."""
    big = Camera.from_field_of_view(1280, 960, FIELD)
    turn = Rotation.random(random_state=0)
    frame = Frame(draw(big.project, 1280, 960, width=7.0, turn=turn))
    direction = turn.apply(STARS.direction)
    pixel = np.where(direction[:, 2:] > 0, big.project(direction), -1e9)
    inside = big.holds(pixel, -30)
    pixel = pixel[inside][np.argsort(STARS.magnitude_g[inside])]
    gaps = np.hypot(*(pixel[:10, None] - pixel[None, :60]).transpose(2, 0, 1))
    alone = (gaps < 60).sum(axis=1) == 1
    assert alone.sum() >= 3

    def distance(spots):
        x, y = spots.x[:30], spots.y[:30]
        return np.hypot(x - pixel[:10][alone][:, [0]], y - pixel[:10][alone][:, [1]]).min(axis=1)

    assert distance(ScaledSpots(frame)(5.0, (1, 2, 4, 8))).max() < 1.0
    assert (distance(detect(frame, Detection(threshold=5.0))) > 5.0).mean() > 0.5
    found = solve_photograph(frame, Indexes(), SETTINGS, FIELD)
    assert found.axis is not None
    assert apart_from(found, turn) < 0.5


def test_the_middle_of_an_all_sky_image():
    side = 900
    focal = side / math.pi

    def project(direction):
        angle = np.arccos(direction[:, 2])
        flat = direction[:, :2] / np.hypot(direction[:, 0], direction[:, 1])[:, None]
        return (side - 1) / 2 + focal * angle[:, None] * flat

    frame = Frame(draw(project, side, side, 0.8))
    found = solve_photograph(frame, Indexes(), SETTINGS, math.pi)
    assert found.axis is not None, found.estimate.reason
    assert found.view.middle is not None
    assert apart_from(found) < 10


def test_squares_of_any_lens_are_tried_with_wide_fields(monkeypatch):
    monkeypatch.undo()  # with the cameras of all fields
    near, rest = tries_of(960, 540, None, 0.1, None, [])
    assert not near
    squares = [guess for guess in rest if guess.view.middle and len(guess.cameras) > 1]
    assert [guess.view.middle for guess in squares] == [324, 243]
    assert all(camera.fov_x >= 20 * deg for guess in squares for camera, _ in guess.cameras)


def test_the_middle_of_a_wide_lens_of_another_projection(monkeypatch):
    """A stereographic lens of 150 degrees across 16:9 is neither a pinhole nor a fisheye."""
    columns, rows = 960, 540
    focal = columns / 4 / math.tan(150 / 4 * deg)

    def project(direction):
        half = np.arccos(np.clip(direction[:, 2], -1, 1)) / 2
        length = np.hypot(direction[:, 0], direction[:, 1])
        radius = 2 * focal * np.tan(half) / np.maximum(length, 1e-12)
        centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
        return centre + radius[:, None] * direction[:, :2]

    side = round(SQUARES[0] * rows)
    field = 4 * math.atan(side / 4 / focal)
    monkeypatch.setattr(
        "startrack.photograph.tries.cameras",
        lambda wide, high, *_, **more: cameras_of(wide, high, field, 0.1),
    )
    frame = Frame(draw(project, columns, rows, 0.8))
    found = solve_photograph(frame, Indexes(), SETTINGS, 150 * deg)
    assert found.axis is not None, found.estimate.reason
    assert found.view.middle is not None
    assert found.as_hinted is None, "the middle does not show the field of the image"
    assert apart_from(found) < 10


def test_a_refusal_names_what_was_tried_and_what_is_seen():
    rng = np.random.default_rng(1)
    image = rng.normal(20, 2, (ROWS, COLUMNS)) + np.linspace(0, 120, COLUMNS)
    for x, y in rng.uniform(40, [COLUMNS - 40, ROWS - 40], (30, 2)):  # streaks, 30 degrees
        for step in np.linspace(-9, 9, 60):
            image[round(y + step * 0.5), round(x + step * 0.87)] += 40
    image[:60, :60] = 255
    settings = Identification(focal_tolerance=0.1, max_hypotheses=1)
    found = solve_photograph(Frame(np.clip(image, 0, 255).astype(np.uint8)), Indexes(), settings)
    assert found.axis is None
    for words in ("mirrored", "fisheyes", "saturated over 1.2 %", "background from", "as long as"):
        assert words in found.estimate.reason
    assert "motion" in found.estimate.reason
    assert "--aspect" not in found.estimate.reason


def test_lamps_that_outshine_the_stars_in_a_part_of_the_image():
    image = draw(PINHOLE.project, COLUMNS, ROWS).astype(float)
    rng = np.random.default_rng(8)
    y, x = np.indices(image.shape)
    for u, v in zip(rng.uniform(330, 620, 110), rng.uniform(370, 470, 110), strict=True):
        image += rng.uniform(120, 230) * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 2)
    found = solve_photograph(Frame(np.clip(image, 0, 255).astype(np.uint8)), Indexes(), SETTINGS)
    assert found.axis is not None
    assert apart_from(found) < 0.5
