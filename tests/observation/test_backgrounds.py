"""Backgrounds and bodies in whole trials: their effect on a tracker."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.catalog import open_sky
from startrack.core.streams import Streams
from startrack.core.units import deg
from startrack.design.files import Design, load_design, save_design
from startrack.detector import Exposure, expected
from startrack.io import shipped
from startrack.motion import Motion
from startrack.observation.exposure import exposure_of
from startrack.observation.images import psf_of
from startrack.observation.pointing import line_of_sight, random_attitude
from startrack.observation.stars import light_of, stars_in_field, throughput
from startrack.optics import Baffle
from startrack.scene import ObserverOrbit, Scene
from startrack.scene.ephemeris import observer_of
from startrack.trial.chain import observe

CASE = load_design(shipped("designs/noise_only.toml")).case
DATE = "2026-03-25T12:00:00"
BAFFLE = Baffle((10 * deg, 30 * deg, 60 * deg), (1e-5, 1e-8, 1e-10))


def case_with(scene: Scene, baffle: Baffle | None = None):
    instrument = dataclasses.replace(CASE.instrument, baffle=baffle)
    return dataclasses.replace(CASE, scene=scene, instrument=instrument)


def beside(direction, angle) -> Rotation:
    """An attitude whose boresight is at a given angle from a direction."""
    side = np.cross(direction, [0.0, 0.0, 1.0])
    z = np.cos(angle) * direction + np.sin(angle) * side / np.linalg.norm(side)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return Rotation.from_matrix(np.array([x, np.cross(z, x), z]))


def body(name: str):
    return observer_of(Scene(lights=("sun",), date=DATE), None).see(name)


def test_a_planet_is_a_false_star_that_is_not_taken():
    """Jupiter makes the brightest spot of the frame; no star is matched with it, and the
    attitude is right."""
    jupiter = body("jupiter")
    attitude = beside(jupiter.direction, 2 * deg)
    record = observe(case_with(Scene(lights=("planets",), date=DATE)), attitude, Streams(1, 0))
    (place,) = CASE.instrument.camera.project(attitude.apply(jupiter.direction[None]))
    away = np.hypot(record.spots.x - place[0], record.spots.y - place[1])
    planet = int(np.argmin(away))
    assert away[planet] < 0.5
    assert planet not in record.matches.spot
    assert record.outcome.solved
    assert not record.outcome.false


def test_nearer_the_sun_there_are_fewer_stars():
    """Stray light hides the faint stars; without a baffle there is none."""
    sun = body("sun").direction
    scene = Scene(lights=("sun",), date=DATE)
    found, level = [], []
    for angle in (25, 45, 80):
        attitude = beside(sun, angle * deg)
        lit = observe(case_with(scene, BAFFLE), attitude, Streams(2, 0))
        clear = observe(case_with(scene), attitude, Streams(2, 0))
        found.append(lit.outcome.stars / clear.outcome.stars)
        level.append(float(np.median(lit.frame.image)))
    assert found[0] < found[1] <= found[2]
    assert found[2] > 0.9
    assert level[0] > level[1] > level[2]


def test_the_veil_is_as_bright_as_the_curve_says():
    """Irradiance times transmittance times the pixel's area, through lens and photodiode."""
    sun = body("sun")
    attitude = beside(sun.direction, 45 * deg)
    scene = Scene(lights=("sun",), date=DATE)
    record = observe(case_with(scene, Baffle((1.0,), (1e-7,))), attitude, Streams(2, 0))
    dark = observe(case_with(Scene()), attitude, Streams(2, 0))
    gain, detector = record.frame.electrons_per_dn, CASE.instrument.detector
    electrons = np.median(record.frame.image - dark.frame.image.astype(float)) * gain
    # 1361 W/m^2, of which 0.35 is caught as electrons of 1.9 eV or so in this band.
    power = 1361 * 1e-7 * detector.pixel_pitch**2 * detector.exposure
    assert electrons * 1.9 * 1.602e-19 / power == pytest.approx(0.3, rel=0.35)


def test_a_scene_that_names_nothing_is_as_it_was():
    attitude = beside(body("sun").direction, 70 * deg)
    plain = observe(CASE, attitude, Streams(3, 1)).frame.image
    baffled = observe(case_with(CASE.scene, BAFFLE), attitude, Streams(3, 1)).frame.image
    np.testing.assert_array_equal(plain, baffled)


def test_a_scene_survives_a_file(tmp_path):
    scene = Scene(
        None, ("zodiacal", "earth"), DATE, 365.0, ObserverOrbit(550e3, 97 * deg, 30 * deg, 80 * deg)
    )
    case = case_with(scene, BAFFLE)
    save_design(tmp_path / "design.toml", Design(case))
    assert load_design(tmp_path / "design.toml").case == case


def lagging(fraction: float, rate: float):
    """The expected electrons of the frame of a slewing camera, its attitude and its instrument."""
    detector = dataclasses.replace(CASE.instrument.detector, lag=fraction, exposure=0.02)
    instrument = dataclasses.replace(CASE.instrument, detector=detector, motion=Motion(rate_y=rate))
    case, streams = dataclasses.replace(CASE, instrument=instrument), Streams(5, 0)
    attitude = random_attitude(streams)
    stars = stars_in_field(open_sky(case.catalog), attitude, instrument.camera)
    light = light_of(case, stars, attitude, streams)
    path = line_of_sight(instrument, streams)
    before = exposure_of(instrument, light, path, attitude, streams).residual_charge

    def seen(attitude: Rotation, before=None):
        exposure = Exposure(
            light,
            psf_of(instrument),
            path,
            attitude,
            instrument.camera,
            detector,
            throughput(instrument),
            None,
            before,
        )
        return expected(exposure)

    return seen, attitude, before, detector


def test_lag_shows_where_the_stars_were_a_frame_ago():
    """A frame has a fraction of its own charge, and a residual fraction of the previous frame's.

    The previous frame had another attitude: the camera rotates about its own y axis, and an
    unspecified lag leaves all of it.
    """
    rate = 0.02
    seen, attitude, before, detector = lagging(0.2, rate)
    late = 1 / detector.update_rate
    earlier = Rotation.from_rotvec([0.0, rate * late, 0.0]) * attitude
    assert rate * late * CASE.instrument.camera.focal_length_px > 2  # the ghosts stand apart
    wanted = seen(attitude) + 0.2 / 0.8 * seen(earlier)  # each without a frame before: 0.8 of it
    np.testing.assert_allclose(seen(attitude, before), wanted, rtol=1e-6, atol=1e-6)


def test_lag_at_rest_changes_nothing():
    """The previous frame was equal, so that the charge received equals the charge lost."""
    lagged, attitude, before, _ = lagging(0.3, 0.0)
    plain, _, none, _ = lagging(0.0, 0.0)
    assert none is None
    np.testing.assert_allclose(lagged(attitude, before), plain(attitude), rtol=1e-12)
