"""The spectrum at the sensor."""

import numpy as np
import pytest

from startrack.core import Refused, um
from startrack.earth.retrieval import ground_spectrum, load_earth_design
from startrack.earth.retrieval.patch import view_below

DESIGN = load_earth_design("fields")


def test_the_mean_over_a_band_is_that_of_its_table():
    """Line by line against the means of transmittances over the band, within 0.2 %."""
    found = ground_spectrum(DESIGN, 0.52 * um, 0.62 * um, 600.0)
    assert np.diff(found.wavelength) == pytest.approx(1e-9)
    assert (found.path < found.radiance).all()
    (band,) = found.bands
    (channel,) = (each for each in DESIGN.camera.channels if each.name == "B3")
    assert band.name == "B3"
    assert band.radiance == pytest.approx(
        view_below(DESIGN, channel, 16, 600.0, 0.7).mean, rel=2e-3
    )


def test_a_range_outside_the_table_is_refused():
    for low, high in ((0.2, 0.5), (0.6, 0.5), (3.0, 5.0)):
        with pytest.raises(Refused, match=r"wavelengths must rise, from 0\.35 to 4\.00 um"):
            ground_spectrum(DESIGN, low * um, high * um)
    with pytest.raises(Refused, match="must have the table"):
        ground_spectrum(load_earth_design("mertis"), 0.5 * um, 0.6 * um)
