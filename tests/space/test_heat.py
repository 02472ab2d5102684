"""Temperatures of a satellite, against those of other authors."""

import numpy as np
import pytest

from .satellites import CASES, extremes_of, largest_error

OTHER_ECLIPSE = "example, a third of 90 minutes in eclipse"  # its orbit has 35.5 of 95.6


@pytest.mark.parametrize("name", CASES)
def test_extremes_are_those_of_a_published_satellite(name):
    assert largest_error(name) < (7.0 if name == OTHER_ECLIPSE else 2.0)
    assert np.ptp(extremes_of(name)) == pytest.approx(np.ptp(CASES[name]["kelvin"]), abs=3.0)
