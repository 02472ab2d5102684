"""Temperatures of the standard atmosphere."""

import pytest

from startrack.space import standard_temperature


# U.S. Standard Atmosphere 1976 (NASA-TM-X-74335), table I: kelvin at metres of geopotential.
@pytest.mark.parametrize(
    ("height", "kelvin"),
    [
        (-1000.0, 294.65),
        (5e3, 255.65),
        (15e3, 216.65),
        (25e3, 221.65),
        (40e3, 251.05),
        (51e3, 270.65),
    ],
)
def test_the_air_has_the_temperature_of_the_published_table(height, kelvin):
    assert standard_temperature(height) == pytest.approx(kelvin, abs=1e-9)
