"""The law of dark currents, against the maps that the detector draws from it."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.design.files import load_design
from startrack.detection import DarkMap
from startrack.detector import Age, Defects
from startrack.detector.maps import dark, dark_response
from startrack.io import shipped
from startrack.observation.belief import detection_plan
from startrack.response.dark_pattern import dark_currents, dark_electrons, dark_residual

CASE = load_design(shipped("designs/noise_only.toml")).case
SENSOR = CASE.instrument.detector


@pytest.mark.parametrize(
    ("mean", "defects"),
    [
        (190.0, Defects(dsnu=275.0)),  # HAS2: a third of the normal law lies below zero
        (60.0, Defects(dsnu=5.0, hot=0.01, hot_current=2000.0)),
        (0.0, Defects(dsnu=10.0)),
    ],
)
def test_it_is_that_of_a_million_pixels(mean, defects):
    """A million pixels measure a mean and an rms to 0.1 %, to 1 % if few hot ones dominate."""
    drawn = dark_response((1000, 1000), mean, defects, Streams(3, 0))
    sensor = replace(SENSOR, dark_current=mean, defects=defects)
    tolerance = 0.03 if defects.hot else 0.005
    np.testing.assert_allclose(dark_currents(sensor), (drawn.mean(), drawn.std()), rtol=tolerance)


def test_an_aged_sensor_has_the_mean_of_its_pixels():
    """For 262,144 pixels, of which 2.8 % are hit, the mean of the added current scatters by 1.7
    %."""
    age = Age(time=5 * 365.25 * 86400, inclination=1.7, shielding=5e-3, depleted=0.4e-6)
    sensor = replace(SENSOR, age=age)
    added = dark_currents(sensor)[0] - 60
    assert added == pytest.approx(np.mean(dark(sensor)) - 60, rel=0.05)


def test_an_even_sensor_has_no_spread():
    assert dark_electrons(SENSOR) == (pytest.approx(60 * SENSOR.exposure), 0.0)


@pytest.mark.parametrize("settings", [{}, {"frames": 4, "step": 2.0}, {"subtracted": False}])
def test_what_a_dark_map_leaves_is_that_of_the_pixels(settings):
    """The 262,144 pixels of a device without those that the map marks as hot; within 3 %."""
    sensor = replace(SENSOR, defects=Defects(dsnu=30.0, hot=0.01, hot_current=2000.0))
    case = replace(CASE, instrument=replace(CASE.instrument, detector=sensor))
    known = replace(CASE.tracker.detection, dark_map=DarkMap(**settings))
    found = detection_plan(case, known).correction
    electrons = np.asarray(dark(sensor)) * sensor.exposure
    left = electrons - found.offset * sensor.electrons_per_dn
    assert left[found.marks == 0].std() == pytest.approx(
        dark_residual(sensor, known.dark_map), rel=0.03
    )
