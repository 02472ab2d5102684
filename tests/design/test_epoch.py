"""The scene's date and orbit agree with the catalogue's epoch and orbital velocity."""

import dataclasses

import numpy as np
import pytest

from startrack.catalog import Selection, earth_observer
from startrack.core import arcsec, deg
from startrack.design.case import Case
from startrack.design.files import Design, load_design, save_design
from startrack.io import shipped
from startrack.scene import ObserverOrbit, Scene
from startrack.scene.ephemeris import observer_of, on_orbit, orbital_velocity
from startrack.space import AU, EARTH_RADIUS

CASE = load_design(shipped("designs/noise_only.toml")).case
DATE = "2026-03-20T12:00:00"
ORBIT = ObserverOrbit(600e3, 51.6 * deg, 30 * deg, 100 * deg)


def case_of(scene: Scene, catalog: Selection, believed: Selection | None = None) -> Case:
    tracker = dataclasses.replace(CASE.tracker, catalog=believed)
    return Case(CASE.instrument, tracker, scene, catalog)


def test_what_a_design_left_out_without_a_date_is_as_before():
    case = case_of(Scene(), Selection(), Selection())
    assert case.catalog == case.tracker.catalog == Selection(epoch=2026.0, orbital_velocity=())
    assert case_of(Scene(), Selection(epoch=1991.25)).catalog.epoch == 1991.25


def test_what_a_design_gives_is_kept_to_the_bit():
    given = Selection(epoch=2026.3, aberration=True)
    assert case_of(Scene(date=DATE), given).catalog.epoch == 2026.3
    assert CASE.catalog.epoch == 2026.0


def test_the_epoch_is_the_middle_of_the_dates():
    """Against astropy's Julian year of the scene's own date."""
    case = case_of(Scene(lights=("sun",), date=DATE), Selection())
    assert case.catalog.epoch == pytest.approx(observer_of(case.scene, None).year, abs=3e-6)
    spread = case_of(Scene(date=DATE, days=100.0), Selection())
    assert spread.catalog.epoch - case.catalog.epoch == pytest.approx(50 / 365.25, abs=1e-9)


def test_the_epoch_that_the_tracker_leaves_out_is_the_true_one():
    case = case_of(Scene(date=DATE), Selection(epoch=2025.9), Selection())
    assert case.tracker.catalog.epoch == 2025.9
    other = case_of(Scene(date=DATE), Selection(), Selection(epoch=1991.25))
    assert other.tracker.catalog.epoch == 1991.25  # what a tracker believes may be wrong


def test_the_velocity_is_that_of_the_orbit():
    """Against differences of the positions, and the period of 96.7 minutes (Kepler's third law)."""
    case = case_of(Scene(date=DATE, orbit=ORBIT), Selection(aberration=True))
    step = 1e-4
    rate = 2 * np.pi / 5801.23  # rad / s
    moved = on_orbit(ORBIT, ORBIT.phase + step) - on_orbit(ORBIT, ORBIT.phase - step)
    np.testing.assert_allclose(
        case.catalog.orbital_velocity, moved / (2 * step) * rate, rtol=0, atol=0.1
    )
    assert np.linalg.norm(on_orbit(ORBIT, 1.0)) == pytest.approx(EARTH_RADIUS + 600e3)


def test_there_is_no_velocity_without_aberration_or_of_a_phase_that_is_drawn():
    assert case_of(Scene(orbit=ORBIT), Selection()).catalog.orbital_velocity == ()
    drawn = Scene(orbit=dataclasses.replace(ORBIT, phase=None))
    assert case_of(drawn, Selection(aberration=True)).catalog.orbital_velocity == ()


def test_a_tracker_may_believe_another_velocity():
    sky = Selection(aberration=True)
    case = case_of(Scene(orbit=ORBIT), sky, sky)
    assert case.tracker.catalog == case.catalog
    still = dataclasses.replace(sky, orbital_velocity=())
    assert case_of(Scene(orbit=ORBIT), sky, still).tracker.catalog.orbital_velocity == ()
    plain = case_of(Scene(orbit=ORBIT), sky, Selection())
    assert plain.tracker.catalog.orbital_velocity == ()


def test_a_case_built_again_from_its_parts_is_the_same(tmp_path):
    scene = Scene(date=DATE, days=20.0, orbit=ORBIT)
    case = case_of(scene, Selection(aberration=True), Selection())
    assert dataclasses.replace(case) == case
    save_design(tmp_path / "saved.toml", Design(case))
    assert load_design(tmp_path / "saved.toml").case == case


@pytest.mark.parametrize("epoch", [2025.3, 2027.1])
def test_an_epoch_within_a_year_is_no_contradiction(epoch):
    assert case_of(Scene(date=DATE), Selection(epoch=epoch)).catalog.epoch == epoch


def test_an_epoch_within_the_days_is_no_contradiction():
    days = Scene(date=DATE, days=3652.5)
    assert case_of(days, Selection(epoch=2036.0)).catalog.epoch == 2036.0


NEAR_EARTH = tuple((earth_observer(2026.2162).position * AU * 1.01).tolist())
MARS = tuple((earth_observer(2026.2162).position * AU * 1.5).tolist())


def test_a_place_near_the_earth_has_its_parallax():
    sky = Selection(aberration=True, parallax=True)
    assert case_of(Scene(date=DATE, place=NEAR_EARTH), sky).catalog.parallax
    moving = Selection(aberration=True, orbital_velocity=(1e3, 2e3, 3e3))
    assert case_of(Scene(date=DATE, place=MARS), moving).catalog.orbital_velocity


@pytest.mark.parametrize(
    ("scene", "catalog", "words"),
    [
        (
            Scene(date=DATE),
            Selection(epoch=2044.5),
            "catalog.epoch must lie within 1 years of scene.date '2026-03-20T12:00:00', or be left "
            "out, got 2044.5",
        ),
        (
            Scene(date=DATE, days=100.0),
            Selection(epoch=2025.0),
            "scene.date '2026-03-20T12:00:00' and scene.days 100, or be left out, got 2025",
        ),
        (
            Scene(date=DATE),
            Selection(epoch=2026.0, aberration=True),
            "catalog.epoch must lie within 0.17 years with aberration or parallax of scene.date",
        ),
        (
            Scene(orbit=ORBIT),
            Selection(aberration=True, orbital_velocity=(0.0, 7.6e3, 0.0)),
            "catalog.orbital_velocity must be that, (-6.038, -4.428, -1.029) km/s, of scene.orbit, "
            "or be left out, got (0, 7.6, 0) km/s",
        ),
        (
            Scene(orbit=dataclasses.replace(ORBIT, phase=None)),
            Selection(aberration=True, orbital_velocity=(0.0, 0.0, 7.6e3)),
            "catalog.orbital_velocity must be one of scene.orbit, or be left out, got (0, 0, 7.6)",
        ),
        (
            Scene(date=DATE, place=MARS),
            Selection(parallax=True),
            "scene.place must lie within 0.1 AU of the Earth if catalog.parallax is true",
        ),
        (Scene(date=DATE, place=MARS), Selection(aberration=True), "got 0.5 AU"),
    ],
)
def test_a_contradiction_is_refused_by_both_names(scene, catalog, words):
    with pytest.raises(ValueError) as refused:
        case_of(scene, catalog)
    assert words in str(refused.value)


def test_a_rounded_velocity_is_no_contradiction():
    rounded = tuple(np.round(orbital_velocity(ORBIT, ORBIT.phase), -2).tolist())
    sky = Selection(aberration=True, orbital_velocity=rounded)
    assert case_of(Scene(orbit=ORBIT), sky).catalog.orbital_velocity == rounded


def test_the_tolerated_epoch_displaces_stars_by_no_more_than_aberration():
    """By astropy's ephemeris: 1/6 year turns the Earth's velocity by 60 degrees."""
    from startrack.design.epoch import ABERRATION_YEARS

    velocity = [earth_observer(2026.0 + t).velocity for t in (0.0, ABERRATION_YEARS)]
    change = np.linalg.norm(velocity[1] - velocity[0]) / 299792458
    assert change == pytest.approx(20.5 * arcsec, rel=0.03)
