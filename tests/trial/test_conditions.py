"""The law of dark currents beside the maps that the detector draws from it."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.design.files import load_design
from startrack.detector import Defects
from startrack.detector.nonuniformity import dark_response
from startrack.io import shipped
from startrack.trial.conditions import dark_currents, dark_electrons

SENSOR = load_design(shipped("designs/nanosatellite.toml")).case.instrument.detector


@pytest.mark.parametrize(
    ("mean", "defects"),
    [
        (190.0, Defects(dsnu=275.0)),  # HAS2: a third of the normal law lies below zero
        (60.0, Defects(dsnu=5.0, hot=0.01, hot_current=2000.0)),
        (0.0, Defects(dsnu=10.0)),
    ],
)
def test_it_is_that_of_a_million_pixels(mean, defects):
    """A million pixels know a mean and an rms to 0.1 %, 1 % where few hot ones make them."""
    drawn = dark_response((1000, 1000), mean, defects, Streams(3, 0))
    sensor = replace(SENSOR, dark_current=mean, defects=defects)
    tolerance = 0.03 if defects.hot else 0.005
    np.testing.assert_allclose(dark_currents(sensor), (drawn.mean(), drawn.std()), rtol=tolerance)


def test_an_even_sensor_has_no_spread():
    assert dark_electrons(SENSOR) == (pytest.approx(60 * SENSOR.exposure), 0.0)
