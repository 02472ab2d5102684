"""Orbit height, local time and season as variables of an Earth design."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core import Refused, deg
from startrack.design import Variable, bounds_of
from startrack.earth.retrieval import EarthProblem, load_earth_design
from startrack.earth.retrieval.criteria import study_of

NORTH = ["retrieval.latitude=47 deg", "orbit.local_time=22:30", "orbit.day=172"]
HOUR = 3600.0


def zenith(problem, **values):
    names = {name.replace("_", ".", 1): value for name, value in values.items()}
    return study_of(problem.replaced(names).design).own.sun_zenith / deg


def test_local_time_and_season_move_the_sun():
    """By hand: 47 degree north is passed 37 minutes after the local time of the node, 11:07."""
    problem = EarthProblem(load_earth_design("fields", NORTH))
    assert zenith(problem) == pytest.approx(26.0, abs=0.5)
    assert zenith(problem, orbit_day=355.0) == pytest.approx(71.4, abs=0.5)
    assert zenith(problem, orbit_local_time=24 * HOUR - 60) == pytest.approx(24.5, abs=0.5)


@pytest.mark.slow
def test_height_and_season_change_forecast_and_trials_alike():
    design = load_earth_design("fields", NORTH)
    assert design.campaign
    problem = EarthProblem(replace(design, campaign=replace(design.campaign, conditions=())))
    errors = []
    for values in ({}, {"orbit.day": 340.0, "orbit.altitude": 1200e3}):
        own = problem.replaced(values)
        formula = own.expect().parts["nominal: reflectance"]
        found = own.judge(own.trials(3, range(6))).parts["nominal: reflectance"].value
        assert found == pytest.approx(formula, rel=0.15)
        errors.append(formula)
    assert errors[1] > 1.1 * errors[0]  # pixels of more ground, more of them mixed


def test_they_are_variables_of_a_campaign_with_units():
    design = load_earth_design("fields", NORTH)
    names = ["orbit.altitude", "orbit.local_time", "orbit.day", "air.visibility"]
    low_high = [("500 km", "900 km"), ("21:00", "23:59"), (1, 366), ("10 km", "50 km")]
    variables = [Variable(name, *ends) for name, ends in zip(names, low_high, strict=True)]
    bounds = bounds_of(design, variables)
    assert [bound.low for bound in bounds] == pytest.approx([500e3, 21 * HOUR, 1, 10e3])


def test_a_sun_that_the_retrieval_cannot_use_is_refused():
    dark = load_earth_design("fields", [*NORTH, "retrieval.flight=ascending"])
    with pytest.raises(Refused, match="sun_zenith must lie in"):
        EarthProblem(dark).expect()
    with pytest.raises(Refused, match="must be within reach of the orbit"):
        EarthProblem(load_earth_design("fields", [*NORTH, "retrieval.latitude=89 deg"])).expect()
    with pytest.raises(Refused, match="must be left out for minerals"):
        load_earth_design("mertis", ["retrieval.latitude=10 deg"])


def test_fires_by_night_are_those_of_the_ascending_pass():
    day, night = (
        study_of(
            load_earth_design("hsrs", ["retrieval.latitude=47 deg", f"retrieval.flight={way}"])
        ).spots.sun_zenith
        for way in ("descending", "ascending")
    )
    assert day < 60 * deg < np.pi / 2 < night


def test_the_distance_of_the_sun_is_that_of_the_day():
    """Perihelion and aphelion of 2026: 0.98330 and 1.01664 au (US Naval Observatory)."""
    assert load_earth_design("fields").distance_to_sun == 1.0
    for day, distance in ((3, 0.98330), (187, 1.01664)):
        design = load_earth_design("fields", [f"orbit.day={day}"])
        assert design.distance_to_sun == pytest.approx(distance, abs=2e-5)
    assert load_earth_design("mertis").distance_to_sun == 0.387
    problem = EarthProblem(load_earth_design("fields", ["orbit.day=3"]))
    far = problem.replaced({"orbit.day": 187.0})
    light = [own.studies["nominal"].design.distance_to_sun for own in (problem, far)]
    assert (light[1] / light[0]) ** 2 == pytest.approx(1.069, abs=0.001)


def test_a_local_time_without_a_latitude_is_said_to_move_no_sun():
    """At 22:30 the Sun of the retrieval is where it is at 10:30."""
    late, north = (
        EarthProblem(load_earth_design("fields", changes)).expect(("nominal",)).left_out
        for changes in (NORTH[1:], NORTH)
    )
    assert [words for words in late if "orbit.local_time" in words]
    assert not [words for words in north if "orbit.local_time" in words]
