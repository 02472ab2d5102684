"""Calibrations that are run, against those that are drawn from their covariance."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core import Camera, Streams, arcsec, um
from startrack.design import CameraCalibration, Moment, Variation, load_design, unit_case
from startrack.io import shipped
from startrack.optics import Optics, Residual
from startrack.population import unit_of
from startrack.population.calibrate import calibrated, drawn, left_over

CASE = load_design(shipped("designs/noise_only.toml")).case
VARIED = replace(
    CASE,
    instrument=replace(CASE.instrument, residual=Residual(0.05)),
    variation=(
        Variation("instrument.optics.focal_length", sigma=2e-3, vary="relative"),
        Variation("instrument.optics.principal_x", sigma=5.0),
        Variation("instrument.optics.k1", sigma=0.05),
    ),
)
UNITS = 24


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(
    "settings",
    [
        CameraCalibration("ground", 100, noise=0.2, direction=5e-6),
        pytest.param(CameraCalibration("ground", 400, noise=0.05, order=5), marks=pytest.mark.slow),
        CameraCalibration("orbit", frames=3, stars=25, noise=0.2),
    ],
    ids=["ground", "many places, order 5", "orbit"],
)
def test_what_is_drawn_leaves_what_a_calibration_leaves(settings):
    """Over the frames of 24 units: within 5 %; in orbit, with few stars, within 15 %.

    `experiments/units.py` compares more units.
    """
    run, law = [], []
    for number in range(UNITS):
        unit = unit_case(VARIED, 3, Moment(number))
        camera, design = unit.instrument.camera, unit.as_designed.believed_camera
        for find, left in ((calibrated, run), (drawn, law)):
            left.append(left_over(camera, find(camera, design, settings, Streams(3, number))))
    assert rms(law) == pytest.approx(rms(run), rel=0.15 if settings.place == "orbit" else 0.05)


def test_a_perfect_calibration_leaves_the_residual_alone():
    settings = CameraCalibration("ground", 400, noise=1e-4)
    for number in range(3):
        unit = unit_case(VARIED, 3, Moment(number))
        camera, design = unit.instrument.camera, unit.as_designed.believed_camera
        bare = calibrated(camera.ideal, design, settings, Streams(3, number))
        assert rms(left_over(camera.ideal, bare)) < 1e-3
        whole = calibrated(camera, design, settings, Streams(3, number))
        field = rms(camera.residual(camera.project(camera.lattice(9))))
        # The field is orthogonal to what the fit holds, so that it removes little of it.
        assert 0.7 * field < rms(left_over(camera, whole)) < 1.1 * field


def test_the_alignment_is_calibrated_with_the_camera():
    """After its calibration, a unit whose principal point differs points where it states."""
    case = replace(
        VARIED,
        instrument=CASE.instrument,
        tracker=replace(CASE.tracker, calibration=CameraCalibration(noise=1e-3)),
    )
    unit = unit_of(case, 3, Moment(0))
    true = unit.instrument.mounting.camera_to_body().apply([0.0, 0.0, 1.0])
    pixel = unit.instrument.camera.project(np.array([[0.0, 0.0, 1.0]]))
    seen = unit.believed_camera.unproject(pixel)
    body = unit.believed_mounting.camera_to_body().apply(seen)[0]
    assert np.hypot(*(body - true)[:2]) * unit.instrument.camera.focal_length_px < 0.01


def test_a_launch_comes_between_ground_and_orbit():
    step = Variation("instrument.optics.focal_length", sigma=1e-3, vary="relative", per="launch")
    found = {}
    for place in ("ground", "orbit"):
        settings = CameraCalibration(place, noise=1e-3)
        case = replace(CASE, variation=(step,), tracker=replace(CASE.tracker, calibration=settings))
        unit = unit_of(case, 3, Moment(0))
        found[place] = rms(left_over(unit.instrument.camera, unit.believed_camera))
    assert found["orbit"] < 0.01 < found["ground"]


def test_a_recursive_calibration_follows_temperature_and_age():
    """Focal length by environment and age; principal point and mounting keep their calibrated
    values."""
    case = replace(
        CASE,
        variation=(
            Variation(
                "instrument.optics.focal_length", sigma=1e-3, vary="relative", per="environment"
            ),
            Variation("instrument.optics.k1", sigma=0.05, per="life"),
            Variation("instrument.optics.principal_x", sigma=5.0),
        ),
    )
    found = {}
    moments = [Moment(0, 0, 0, 1e7), Moment(0, 0, 1, 1e7), Moment(0, 1, 0, 3e7)]
    for place in ("orbit", "recursive"):
        settings = CameraCalibration(place, noise=1e-3)
        now = replace(case, tracker=replace(CASE.tracker, calibration=settings))
        found[place] = [unit_of(now, 3, moment) for moment in moments]
        left = [rms(left_over(one.instrument.camera, one.believed_camera)) for one in found[place]]
        assert (max(left) < 0.01) == (place == "recursive"), left
    once, again = found["orbit"][0], found["recursive"]
    assert again[0].believed_camera == again[1].believed_camera != again[2].believed_camera
    for one in again:
        assert one.believed_mounting == once.believed_mounting
        assert one.believed_camera.principal_x == once.believed_camera.principal_x
        assert one.believed_camera.focal_length_px != once.believed_camera.focal_length_px


@pytest.mark.slow
def test_a_recursive_calibration_makes_up_for_the_principal_point_that_it_holds():
    """A principal point ten pixels off: tangential terms of 24 fits, drawn and run."""
    settings = CameraCalibration("recursive", frames=30, tangential=True, noise=0.002)
    camera = unit_case(VARIED, 3, Moment(0)).instrument.camera.ideal
    known = replace(camera, principal_x=camera.principal_x + 10)
    tangential = []
    for find in (calibrated, drawn):
        models = [find(camera, known, settings, Streams(3, number)) for number in range(24)]
        assert all(model.principal_x == known.principal_x for model in models)
        assert max(rms(left_over(camera, model)) for model in models) < 0.01
        tangential.append([model.p2 for model in models])
    run, law = np.array(tangential) - camera.p2
    assert abs(law.mean()) > 5 * law.std(ddof=1)
    assert run.mean() == pytest.approx(law.mean(), rel=0.05)


def test_settings_that_make_no_calibration_are_refused():
    with pytest.raises(ValueError, match="order must be"):
        CameraCalibration(order=2)
    with pytest.raises(ValueError, match="place must be"):
        CameraCalibration("moon")


LENS = Residual(
    angle=5 * arcsec,
    flatness=2 * um,
    decentre=25 * um,
    tilt=90 * arcsec,
    wedge=90 * arcsec,
    family="double-gauss",
)


def residuals_left(settings, residual=LENS, find=drawn, units=20):
    """Pixel rms over the frames of some units, and that of their law."""
    optics, pitch = Optics(focal_length=0.035, f_number=2.0), 5.5 * um
    design = Camera(2048, 2048, 0.035 / pitch)
    left = []
    for number in range(1, units + 1):
        field = replace(residual, seed=number).field(design, optics, pitch)
        camera = replace(design, residual=field)
        left.append(left_over(camera, find(camera, design, settings, Streams(5, number))))
    law = residual.law(design, optics, pitch, settings.order, settings.tangential, settings.nodes)
    return rms(left), float(np.sqrt((law**2).sum(axis=-1).mean()))


@pytest.mark.parametrize("order", [3, 5])
def test_what_a_lens_as_built_leaves_is_what_the_tracker_knows(order):
    settings = CameraCalibration(positions=400, noise=1e-3, order=order)
    left, known = residuals_left(settings, units=60)
    assert left == pytest.approx(known, rel=0.15)  # of some ten elements, by chance


def test_tangential_terms_take_up_most_of_decentred_elements():
    lens = replace(LENS, angle=0.0, flatness=0.0)
    radial = CameraCalibration(positions=400, noise=1e-3, order=5)
    plain, _ = residuals_left(radial, lens)
    tangential, _ = residuals_left(replace(radial, tangential=True), lens)
    assert tangential < 0.25 * plain


def test_a_map_takes_up_what_a_polynomial_leaves_run_or_drawn():
    plain = CameraCalibration(positions=400, direction=1 * arcsec, order=5, tangential=True)
    mapped = replace(plain, map=5)
    left, _ = residuals_left(mapped)
    assert left < 0.5 * residuals_left(plain)[0]
    assert left == pytest.approx(residuals_left(mapped, find=calibrated, units=20)[0], rel=0.05)


def test_a_map_of_few_positions_is_worse_than_none():
    few = CameraCalibration(positions=16, noise=0.3)
    assert residuals_left(replace(few, map=9))[0] > residuals_left(few)[0]


@pytest.mark.parametrize("find", [drawn, calibrated])
def test_a_map_of_one_node_is_none(find):
    plain = CameraCalibration(positions=50)
    assert residuals_left(replace(plain, map=1), find=find, units=2) == residuals_left(
        plain, find=find, units=2
    )


def test_without_a_calibration_a_tracker_has_the_focal_length_of_its_design(tmp_path):
    """A scale error of 0.3 % has an rms per axis of 0.003 sqrt((w^2 + h^2) / 24) over the frame.

    The rms of 100 units is within three of its sigma of 7 %.
    """
    left = {}
    for answer in ("none", "display"):
        path = tmp_path / f"{answer}.toml"
        files = f'"variations/lens-shelf.toml", "variations/calibration-{answer}.toml"'
        path.write_text(f'base = "designs/noise_only.toml"\ninclude = [{files}]\n')
        case = load_design(path, ["instrument.residual="]).case
        units = [unit_of(case, 1, Moment(number)) for number in range(100)]
        left[answer] = rms([left_over(one.instrument.camera, one.believed_camera) for one in units])
    size = CASE.instrument.camera
    assert left["none"] == pytest.approx(
        0.003 * np.sqrt((size.columns**2 + size.rows**2) / 24), rel=0.21
    )
    assert left["display"] < 0.1 * left["none"]
