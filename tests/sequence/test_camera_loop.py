"""Frames of a control loop: those of `simulate`, and slews that are sent."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import Refused, Status, Streams, arcsec, deg
from startrack.design import load_design
from startrack.io import pointing, shipped
from startrack.sequence import CameraLoop
from startrack.trial import observe

CASE = load_design(shipped("designs/noise_only.toml")).case
ORION = pointing(83.0, -5.0, 20.0)


def test_a_frame_is_that_of_the_trial_of_its_number_whatever_came_before():
    loop = CameraLoop(CASE, seed=4)
    loop.see(pointing(10.0, 20.0, 0.0))
    loop.see(ORION, np.array([0.3, 0.1, 0.0]) * deg)
    seen = loop.see(ORION)
    assert seen.number == 2
    record = observe(CASE, ORION, Streams(4, 2))
    assert seen.frame.image.tobytes() == record.frame.image.tobytes()
    assert seen.spots == len(record.spots)
    same = seen.estimate.icrs_to_camera * record.estimate.icrs_to_camera.inv()
    assert same.magnitude() == 0


def test_the_rate_of_the_design_makes_the_frames_of_the_design():
    motion = CASE.instrument.motion
    loop = CameraLoop(CASE)
    told = loop.see(ORION, np.array([motion.rate_x, motion.rate_y, motion.rate_z]), number=5)
    assert told.frame.image.tobytes() == loop.see(ORION, number=5).frame.image.tobytes()


def star_of(image):
    """Column and row of the brightest star that is far from saturation and from all other stars."""
    for pixel in np.argsort(image, axis=None)[::-1]:
        y, x = divmod(int(pixel), image.shape[1])
        around = image[max(y - 25, 0) : y + 26, max(x - 25, 0) : x + 26]
        if image[y, x] < 2500 and image[y, x] == around.max() and around.shape == (51, 51):
            return x, y
    raise AssertionError("no such star")


def spread(window):
    """Variances along columns and rows (pixel^2) of the light above the background."""
    light = window - np.median(window)
    place = np.indices(window.shape)
    middle = (light * place).sum(axis=(1, 2)) / light.sum()
    away = place - middle[:, None, None]
    return ((light * away**2).sum(axis=(1, 2)) / light.sum())[::-1]


def test_a_slew_smears_across_its_axis_and_is_measured_in_the_middle_of_the_exposure():
    """At 1 deg/s about x, stars move by 1 deg/s x 80 ms x f = 4.4 pixels along y."""
    loop = CameraLoop(CASE)
    still = loop.see(ORION, np.zeros(3), number=1)
    slewing = loop.see(ORION, np.array([1.0, 0.0, 0.0]) * deg, number=1)
    assert slewing.estimate.status is Status.SOLVED
    error = (slewing.estimate.icrs_to_camera * ORION.inv()).as_rotvec()
    sigma = np.sqrt(np.diag(slewing.estimate.covariance))
    assert (np.abs(error) < 5 * sigma).all()
    # Without the rate, the middle would be wrong by up to half of the path, 144 arcsec.
    assert abs(error[0]) < 10 * arcsec
    x, y = star_of(still.frame.image)
    spreads = [spread(one.frame.image[y - 9 : y + 10, x - 9 : x + 10]) for one in (still, slewing)]
    longer = np.subtract(*spreads[::-1])
    path = 1 * deg * 0.080 * 35e-3 / 11e-6
    assert longer[1] == pytest.approx(path**2 / 12, rel=0.2)  # of a uniform line
    assert abs(longer[0]) < 0.1


def test_lines_and_wrong_rates_are_refused():
    scanner = load_design(shipped("designs/scanner.toml")).case
    with pytest.raises(Refused, match=r"instrument\.detector\.scan must be left out"):
        CameraLoop(scanner)
    for rate in (np.zeros(2), np.array([0.0, np.nan, 0.0])):
        with pytest.raises(Refused, match="rate must be three finite numbers"):
            CameraLoop(CASE).see(ORION, rate)


def test_the_period_is_that_of_the_update_rate():
    detector = dataclasses.replace(CASE.instrument.detector, frame_rate=5.0)
    case = dataclasses.replace(
        CASE, instrument=dataclasses.replace(CASE.instrument, detector=detector)
    )
    assert CameraLoop(case).period == pytest.approx(0.2)


def test_a_frame_without_stars_has_no_attitude():
    dark = dataclasses.replace(CASE, catalog=dataclasses.replace(CASE.catalog, limit_g=-1.0))
    seen = CameraLoop(dark).see(Rotation.identity())
    assert seen.estimate.status is not Status.SOLVED
