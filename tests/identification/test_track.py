"""A predicted attitude, successive frames, and the index on disk."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.core.values import Stars, Status
from startrack.identification import Identification, build_index, cache, track
from startrack.identification.cache import cached_index

SETTINGS = Identification()


def follow(design, spots, predicted, sigma):
    return track(
        spots, design.camera, design.stars, design.index, predicted, np.diag(sigma**2), SETTINGS
    )


# Enough for the rates measured over 200 skies of each kind, with a false alarm in 1000 runs.
@pytest.mark.parametrize(
    ("count", "false", "rate"), [(2, 0, 0.9), (3, 0, 0.97), (3, 3, 0.96), (12, 10, 0.99)]
)
def test_few_stars_are_enough_where_the_attitude_is_predicted(design, spots_at, count, false, rate):
    camera = design(12, 6.0)
    rng = np.random.default_rng(1)
    sigma = np.full(3, 0.05 * deg)
    skies = solved = 0
    while skies < 60:
        seen = camera.look(rng, noise=0.2)
        if len(seen.spots) < count:
            continue
        skies += 1
        pixel = np.column_stack([seen.spots.x, seen.spots.y])[:count]
        pixel = np.concatenate([pixel, rng.random((false, 2)) * 1024 - 0.5])
        predicted = Rotation.from_rotvec(sigma * rng.standard_normal(3)) * seen.icrs_to_camera
        matches = follow(camera, spots_at(pixel, 0.2), predicted, sigma)
        if matches.status is Status.SOLVED:
            solved += 1
            assert seen.error(matches) < 5
            assert set(matches.spot) <= set(range(count + false))
    assert solved >= binom.ppf(1e-3, skies, rate)


def test_chance_is_not_followed_more_often_than_allowed(design, spots_at):
    """150 images of clutter against the bound of 1e-3, with a false alarm in 2000 runs."""
    camera = design(12, 6.0)
    rng = np.random.default_rng(2)
    followed = 0
    for number in range(150):
        pixel = rng.random(((2, 3, 30)[number % 3], 2)) * 1024 - 0.5
        predicted = Rotation.from_quat(rng.standard_normal(4))
        followed += len(follow(camera, spots_at(pixel, 0.2), predicted, np.full(3, 0.1 * deg))) > 0
    assert followed <= 2


def test_a_wrong_prediction_falls_back_to_the_whole_sky(design):
    camera = design(12, 6.0)
    rng = np.random.default_rng(3)
    seen = camera.look(rng, noise=0.1)
    far = Rotation.from_rotvec([0.5, 0.0, 0.0]) * seen.icrs_to_camera
    assert seen.error(follow(camera, seen.spots, far, np.full(3, 0.01 * deg))) < 3


def test_one_star_does_not_determine_the_attitude(design, spots_at):
    camera = design(12, 6.0)
    seen = camera.look(np.random.default_rng(4), noise=0.1)
    one = spots_at(np.column_stack([seen.spots.x, seen.spots.y])[:1], 0.1)
    matches = follow(camera, one, seen.icrs_to_camera, np.full(3, 0.01 * deg))
    assert matches.status is Status.TOO_FEW


SIDES = {"left": (-1, 0), "right": (1, 0), "upper": (0, -1), "lower": (0, 1), "corner": (1, 1)}


@pytest.mark.parametrize(
    ("side", "sigmas", "found"),
    [(side, 2.8, True) for side in SIDES] + [(side, 3.2, False) for side in ("left", "lower")],
)
def test_stars_predicted_outside_the_image_may_be_inside(spots_at, side, sigmas, found):
    """Four stars at the border, and a prediction that is off by as many sigma; three are
    predicted."""
    camera = Camera(1024, 1024, 2000.0)
    turn = Rotation.from_rotvec([0.4, -1.0, 2.0])
    out = np.array(SIDES[side], float)
    out /= np.linalg.norm(out)
    along = np.array([-out[1], out[0]])
    reach = 511.9 if side != "corner" else 511.9 * 2**0.5
    bend = np.abs([-20.0, -8.0, 10.0, 24.0]) if side == "corner" else np.zeros(4)
    pixel = camera.centre + np.array(
        [
            (reach - b) * out + a * along
            for a, b in zip([-20.0, -8.0, 10.0, 24.0], bend, strict=True)
        ]
    )
    others = np.random.default_rng(7).standard_normal((300, 3))
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    others = others[turn.apply(others)[:, 2] < 0]
    direction = np.concatenate([turn.inv().apply(camera.unproject(pixel)), others])
    count = len(direction)
    stars = Stars(np.arange(count), direction, np.linspace(2, 6, count), np.full(count, 0.8))
    index = build_index(stars, camera.fov_x)
    # A turn that moves the border by so many sigma; only that axis is in doubt.
    sigma = 0.012
    axis = np.array([-out[1], out[0], 0.0])
    slope = 1 + (reach / 2000) ** 2
    off = Rotation.from_rotvec(sigmas * sigma / slope * axis) * turn
    covariance = 1e-8 * np.eye(3) + sigma**2 * np.outer(axis, axis)
    settings = Identification(max_false_track=0.5, min_matches=5)
    matches = track(spots_at(pixel, 0.1), camera, stars, index, off, covariance, settings)
    assert matches.status is (Status.SOLVED if found else Status.TOO_FEW)
    assert sorted(matches.star) == (list(range(4)) if found else [])


def test_the_focal_length_of_the_last_frame_is_held(design):
    camera = design(12, 6.0)
    rng = np.random.default_rng(8)
    for _ in range(3):
        seen = camera.look(rng, noise=0.3)
        matches = follow(camera, seen.spots, seen.icrs_to_camera, np.full(3, 0.01 * deg))
        assert matches.camera == camera.camera


def test_a_match_with_too_weak_evidence_is_searched_again(design, spots_at):
    """Two stars, whose evidence suffices for one bound and not for another."""
    camera = design(12, 6.0)
    rng = np.random.default_rng(9)
    seen = camera.look(rng, noise=0.1)
    two = spots_at(np.column_stack([seen.spots.x, seen.spots.y])[:2], 0.1)
    known = np.eye(3) * (0.05 * deg) ** 2

    def at(bound):
        settings = Identification(max_false_track=bound)
        return track(
            two, camera.camera, camera.stars, camera.index, seen.icrs_to_camera, known, settings
        )

    chance = at(1e-3).false_probability
    assert at(chance * 1.01).status is Status.SOLVED
    assert at(chance * 0.99).status is Status.TOO_FEW


@pytest.mark.parametrize(
    "covariance",
    [np.zeros((3, 3)), -np.eye(3), np.eye(2), np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 0.0, 1.0])],
)
def test_a_covariance_that_is_none_is_refused(design, covariance):
    camera = design(12, 6.0)
    seen = camera.look(np.random.default_rng(5))
    with pytest.raises(ValueError, match="covariance must be"):
        track(
            seen.spots,
            camera.camera,
            camera.stars,
            camera.index,
            seen.icrs_to_camera,
            covariance,
            SETTINGS,
        )


def parts(index):
    return index.table, index.bright, index.faint


def same(one, other):
    """Every array of two nested tuples."""
    if isinstance(one, tuple):
        for a, b in zip(one, other, strict=True):
            same(a, b)
    else:
        np.testing.assert_array_equal(one, other)


def test_an_index_comes_back_from_disk_and_damage_is_noticed(design, tmp_path):
    stars = design(20, 5.0).stars[:300]
    folder = tmp_path / "not" / "there"
    first = cached_index(stars, 20 * deg, folder)
    (path,) = folder.iterdir()
    written = path.stat().st_ino
    same(parts(first), parts(build_index(stars, 20 * deg)))
    same(parts(cached_index(stars, 20 * deg, folder)), parts(first))
    assert path.stat().st_ino == written  # the same file, not one put in its place
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", whole[:200_000] + b"?" + whole[200_001:]):
        path.write_bytes(damaged)
        same(parts(cached_index(stars, 20 * deg, folder)), parts(first))
        assert path.read_bytes() != damaged
    cached_index(stars, 21 * deg, folder)
    assert len(list(folder.iterdir())) == 2


def test_old_indexes_are_deleted_and_a_read_only_folder_is_no_failure(
    design, tmp_path, monkeypatch
):
    monkeypatch.setattr(cache, "KEPT", 4)
    stars = design(20, 5.0).stars[:300]
    for number in range(7):
        cached_index(stars, (20 + number) * deg, tmp_path)
        if number == 1:
            first = min(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    assert len(list(tmp_path.iterdir())) == 4
    assert not first.exists()
    taken = tmp_path / "file"
    taken.write_text("")
    assert len(cached_index(stars, 20 * deg, taken / "folder")) > 0
