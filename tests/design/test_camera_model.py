"""The camera that a tracker believes: radial, or a polynomial over the field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from startrack import load_design, shipped
from startrack.core import Camera
from startrack.optics import Optics


def behind(focal_length=0.035, **optics):
    case = load_design(shipped("designs/noise_only.toml")).case
    optics = replace(
        Optics(focal_length, 2.4, **optics), transmission=case.instrument.optics.transmission
    )
    return replace(case, instrument=replace(case.instrument, optics=optics))


def believing(case, model):
    return replace(case, tracker=replace(case.tracker, camera_model=model))


def apart(one: Camera, other: Camera) -> float:
    """Largest distance in pixel at random places of the frame."""
    pixel = np.random.default_rng(1).uniform(-0.5, 511.5, (500, 2))
    return float(np.abs(other.project(one.unproject(pixel)) - pixel).max())


def test_a_polynomial_is_exact_for_cubic_distortion_and_inverts():
    """k1 and a tilt of the detector are cubic in x and y; k2 is not."""
    case = behind(k1=0.08, p1=0.002, principal_x=3.0)
    camera = believing(case, "polynomial").believed_camera
    assert camera.polynomial is not None
    assert camera.k1 == 0
    assert apart(case.instrument.camera, camera) < 1e-8
    strong = behind(k1=0.08, k2=-9.0)
    left = apart(strong.instrument.camera, believing(strong, "polynomial").believed_camera)
    assert 1e-3 < left < apart(strong.instrument.camera, strong.instrument.camera.scaled(1.001))


def test_behind_a_lens_table_it_follows_the_temperature_of_the_calibration():
    case = behind(0.052, lens_file="petzval")
    warm = replace(case, tracker=replace(case.tracker, calibrated_at=313.15))
    for one in (case, warm):
        radial, polynomial = one.believed_camera, believing(one, "polynomial").believed_camera
        assert apart(radial, polynomial) < 0.02
    assert apart(case.believed_camera, believing(warm, "polynomial").believed_camera) > 0.05


def test_what_it_refuses():
    case = behind()
    with pytest.raises(ValueError, match="camera_model must be one of"):
        believing(case, "cubic")
    with pytest.raises(ValueError, match="camera_model must be left out if"):
        replace(case.tracker, camera=Camera(8, 8, 100.0), camera_model="polynomial")
