"""Stars on a grid of cells: pixels that are computed for each of them."""

import dataclasses

import numpy as np
import pytest

from startrack.design import load_design
from startrack.io import shipped
from startrack.response import ResponseGrid, spot_response
from startrack.response.star_response import phases

NANOSATELLITE = load_design(shipped("designs/nanosatellite.toml")).case
FLUX = np.array([2e3, 2e4])


@pytest.mark.parametrize(
    ("blur", "settings", "fraction"),
    [(3e-6, {}, 0.7), (2e-5, {"centroid": "likelihood", "kernel": "psf"}, 0.4)],
)
def test_a_star_is_measured_in_the_pixels_that_are_read(monkeypatch, blur, settings, fraction):
    """A narrow star and a wide one, whose filter is large: whole cells give the same measurement.

    fraction  of the pixels of whole cells, which are not exceeded
    """
    optics = dataclasses.replace(NANOSATELLITE.instrument.optics, blur=blur)
    instrument = dataclasses.replace(NANOSATELLITE.instrument, optics=optics)
    detection = dataclasses.replace(NANOSATELLITE.tracker.detection, **settings)
    tracker = dataclasses.replace(NANOSATELLITE.tracker, detection=detection)
    case = dataclasses.replace(NANOSATELLITE, instrument=instrument, tracker=tracker)
    grid, made, drawn = ResponseGrid(case, 30.0), [], spot_response.star_grid

    def counted(*given):
        made.append(drawn(*given))
        return made[-1]

    monkeypatch.setattr(spot_response, "star_grid", counted)
    seen, place = grid.expect(phases(), FLUX)
    monkeypatch.setattr(ResponseGrid, "reach", grid.side)
    whole, place_in_whole = grid.expect(phases(), FLUX)
    few, all_of_them = (frame.image.size for frame, _ in made)
    assert few < fraction * all_of_them
    np.testing.assert_allclose(seen.x - place[:, 0], whole.x - place_in_whole[:, 0], atol=1e-9)
    np.testing.assert_allclose(seen.y - place[:, 1], whole.y - place_in_whole[:, 1], atol=1e-9)
    for name in ("flux", "sigma", "covariance", "above", "spread", "kept"):
        np.testing.assert_allclose(getattr(seen, name), getattr(whole, name), rtol=1e-9)
