"""The cost of omitting a correction: each in the truth, and each in the belief."""

import math
from dataclasses import replace

import numpy as np
import pytest

from startrack.attitude import Mounting
from startrack.catalog import Selection, earth_observer, open_sky
from startrack.core.units import arcsec, deg
from startrack.design.case import Case, Tracker
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.io.tables import from_table, to_table
from startrack.motion import Motion
from startrack.trial.chain import run_random_trial

CASE = load_design(shipped("designs/noise_only.toml")).case
ORBIT = (0.0, 4600.0, -6050.0)  # m/s; 7.6 km/s together


def changed(case: Case = CASE, **parts: object) -> Case:
    """The case with replaced parts of its instrument, or of its tracker if their name begins so."""
    mine = {key: value for key, value in parts.items() if not key.startswith("tracker_")}
    tracker = {
        key.removeprefix("tracker_"): value for key, value in parts.items() if key not in mine
    }
    return replace(
        case, instrument=replace(case.instrument, **mine), tracker=replace(case.tracker, **tracker)
    )


def error(case: Case, number: int = 0) -> np.ndarray:
    outcome = run_random_trial(case, 4, number)
    assert outcome.solved
    return np.array([outcome.error_x, outcome.error_y, outcome.error_z]) / arcsec


def test_an_orbit_adds_5_2_arcsec():
    """v / c = 7.6 / 299792 rad = 5.2 arcsec (references), for stars across the velocity."""
    still = Selection(aberration=True)
    stars = open_sky(still).stars.direction
    moved = open_sky(replace(still, orbital_velocity=ORBIT)).stars.direction
    shift = np.linalg.norm(moved - stars, axis=1) / arcsec
    assert shift.max() == pytest.approx(5.2, abs=0.05)
    # Towards the velocity, by the sine of the angle to it.
    velocity = np.array(ORBIT) / np.linalg.norm(ORBIT)
    np.testing.assert_allclose(
        shift, 5.23 * np.linalg.norm(np.cross(stars, velocity), axis=1), atol=0.01
    )
    assert ((moved - stars) @ velocity > -1e-9).all()


def test_the_earth_moves_stars_by_20_5_arcsec():
    stars, moved = (open_sky(Selection(aberration=on)).stars.direction for on in (False, True))
    shift = np.linalg.norm(moved - stars, axis=1).max() / arcsec
    assert 20.1 < shift < 20.9  # 20.5 on the mean; the orbit's ellipse gives and takes 1.7 %


def test_an_attitude_without_the_orbit_is_off_by_up_to_5_arcsec():
    """The field moves as one: the error is v / c across the velocity, seen from the boresight."""
    sky = replace(CASE.catalog, aberration=True, orbital_velocity=ORBIT)
    case = replace(CASE, catalog=sky)
    left_out = changed(case, tracker_catalog=replace(sky, orbital_velocity=()))
    difference = [np.hypot(*(error(left_out, n) - error(case, n))[:2]) for n in range(8)]
    assert 3.5 < max(difference) < 5.3


def test_proper_motion_left_out_is_the_sky_of_the_catalogues_epoch():
    old = open_sky(Selection(epoch=2016.0)).stars.direction
    left_out = open_sky(Selection(epoch=2036.0, proper_motion=False)).stars.direction
    moved = open_sky(Selection(epoch=2036.0)).stars.direction
    np.testing.assert_array_equal(old, left_out)
    # 61 Cygni A and B run fastest among the bright: 5.2 arcsec a year (Hipparcos).
    fastest = np.linalg.norm(moved - old, axis=1).max() / arcsec
    assert fastest > 20 * 5.1


def test_parallax_of_alpha_centauri():
    """0.75 arcsec (Hipparcos) times the distance from the Sun across the line of sight."""
    stars, moved = (open_sky(Selection(parallax=on)).stars.direction for on in (False, True))
    largest = np.linalg.norm(moved - stars, axis=1).max() / arcsec
    assert 0.3 < largest <= 0.76 * np.linalg.norm(earth_observer(2026.0).position)


def test_a_late_time_stamp_costs_rate_times_delay():
    """1 deg/s for 10 ms are 36 arcsec about that axis, unless the tracker knows the delay."""
    case = changed(motion=Motion(rate_x=0.5 * deg), delay=0.010)
    unaware = changed(case, tracker_delay=0.0)
    difference = error(unaware) - error(case)
    np.testing.assert_allclose(difference, [18, 0, 0], atol=0.01)
    np.testing.assert_array_equal(error(changed(case, tracker_delay=0.010)), error(case))


def test_an_unknown_mounting_is_a_bias():
    case = changed(mounting=Mounting(x=30 * arcsec, z=-50 * arcsec))
    unaware = changed(case, tracker_mounting=Mounting())
    np.testing.assert_allclose(error(case), error(CASE), atol=1e-9)
    np.testing.assert_allclose(error(unaware) - error(CASE), [-30, 0, 50], atol=0.02)


def test_heat_swings_the_camera_by_its_amplitude_over_root_two():
    """32 trials at random phases; the rms of a sine scatters by 6 %: three sigma."""
    case = changed(mounting=Mounting(y=20 * arcsec, swing_y=40 * arcsec))
    swing = [(error(case, n) - error(CASE, n))[1] for n in range(32)]
    assert np.abs(swing).max() <= 40.01
    assert np.sqrt(np.mean(np.square(swing))) == pytest.approx(40 / math.sqrt(2), rel=0.2)


def test_corrections_live_in_design_files():
    sky = Selection(aberration=True, orbital_velocity=ORBIT, proper_motion=False)
    case = replace(
        changed(mounting=Mounting(x=30 * arcsec), delay=0.01, tracker_delay=0.0), catalog=sky
    )
    table = to_table(case)
    assert table["catalog"]["orbital_velocity"] == ["0 km / s", "4.6 km / s", "-6.05 km / s"]
    assert from_table(Case, table) == case


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Selection(orbital_velocity=ORBIT), "orbital_velocity must be empty if"),
        (lambda: Selection(aberration=True, orbital_velocity=(1.0,)), "must have three components"),
        (lambda: Tracker(mounting=Mounting(swing_x=1e-6)), "mounting of a tracker must not swing"),
        (lambda: Mounting(swing_z=-1e-6), "swing_z must not be negative, got -1e-06"),
        (lambda: Tracker(delay=math.inf), "delay must be finite, got inf"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
