"""The catalogue of published trackers: the designs agree with the publications, and run."""

import math

import numpy as np
import pytest

from startrack.core.units import deg
from startrack.core.values import Stars
from startrack.design.files import load_design
from startrack.detector import electron_rate
from startrack.io import shipped
from startrack.observation.stars import throughput
from startrack.scene import illuminate
from startrack.trial.chain import run_random_trial

NAMES = sorted(path.stem for path in shipped("trackers").glob("*.toml"))
# A deep catalogue, megapixels; the others of a kind are tried by one.
LARGE = {"chandra-aca", "plato-fcam", "st-16", "sagitta", "he-5as", "astro-aps", "vst-68m"}
LARGE |= {"st400", "ast-201", "oersted-asc"}


def case_of(name: str):
    return load_design(shipped(f"trackers/{name}.toml")).case


def test_each_tracker_is_held_against_its_publication(oracle):
    assert set(oracle("trackers.json")) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_geometry_and_timing_are_as_published(oracle, name):
    known, instrument = oracle("trackers.json")[name], case_of(name).instrument
    camera, detector = instrument.camera, instrument.detector
    if "fov_deg" in known:
        for have, wanted in zip((camera.fov_x, camera.fov_y), known["fov_deg"], strict=True):
            assert have / deg == pytest.approx(wanted, rel=0.05)
    if "fov_square_deg" in known:
        assert camera.fov_x * camera.fov_y / deg**2 == pytest.approx(known["fov_square_deg"], 0.03)
    if "pixel_arcsec" in known:
        assert 3600 / deg / camera.focal_length_px == pytest.approx(known["pixel_arcsec"], 0.01)
    if "pixel_um" in known:
        assert detector.pitch == pytest.approx(known["pixel_um"] * 1e-6)
    if "exposure_s" in known:
        assert detector.exposure == known["exposure_s"]
    if "update_hz" in known:
        assert detector.update_rate == pytest.approx(known["update_hz"], rel=0.01)
    if "aperture_mm" in known:
        assert instrument.optics.aperture == pytest.approx(known["aperture_mm"] * 1e-3, rel=1e-3)


def test_chandras_numbers_count_its_electrons(oracle):
    """Numbers per second of a star at the zero point: the team counts 5 electrons to a number.

    The design counts 5.9, by the photon transfer of flown pixels.
    """
    known, case = oracle("trackers.json")["chandra-aca"], case_of("chandra-aca")
    detector = case.instrument.detector
    star = Stars(np.zeros(1, int), np.array([[0, 0, 1.0]]), np.array([10.32]), np.array([0.82]))
    rate, _ = electron_rate(illuminate(case.scene, star), detector, throughput(case.instrument))
    seen = known["electron_per_s_at_10_32"] / known["electrons_per_dn"]
    assert rate[0] / detector.electrons_per_dn == pytest.approx(seen, rel=0.02)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if name in LARGE else []) for name in NAMES],
)
def test_each_tracker_solves_the_sky(oracle, name):
    """At least two of three attitudes are found, none false, with errors no worse than published.

    The errors are of noise alone, so that a published figure, which includes bias, is an upper
    bound.
    """
    case, known = case_of(name), oracle("trackers.json")[name]
    outcomes = [run_random_trial(case, 11, number) for number in range(3)]
    solved = [one for one in outcomes if one.solved]
    assert len(solved) >= 2
    assert not any(one.false for one in outcomes)
    across = math.sqrt(np.mean([(one.error_x**2 + one.error_y**2) / 2 for one in solved]))
    about = math.sqrt(np.mean([one.error_z**2 for one in solved]))
    assert 3600 / deg * across < known.get("cross_arcsec", 5)
    assert 3600 / deg * about < known.get("roll_arcsec", math.inf)
    assert min(one.stars for one in solved) >= known.get("stars_min", 4)
