"""The page on Chandra's aspect camera agrees with its figures, and these with the code."""

import json
import sys

import numpy as np
import pytest

from startrack.core import ZERO_CELSIUS
from startrack.design import Moment, load_design, unit_case
from startrack.detector import dark
from startrack.io import shipped
from tests.conftest import ROOT

FIGURES = json.loads((ROOT / "docs/figures/flight.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page():
    """The module that writes the page."""
    sys.path.insert(0, str(ROOT / "experiments"))
    try:
        import flight_page
    finally:
        sys.path.pop(0)
    return flight_page


def test_the_page_is_of_its_figures(page):
    before = json.loads((ROOT / "docs/figures/flight-before.json").read_text(encoding="utf-8"))
    assert (ROOT / "docs/figures/flight.md").read_text(encoding="utf-8") == page.text_of(
        FIGURES, before
    )


def test_the_figures_meet_what_the_page_wants():
    """The page states what is missed: acquisition in a tenth of its cells."""
    assert FIGURES["camera_y_arcsec"] <= 0.19
    assert FIGURES["camera_z_arcsec"] <= 0.20
    assert FIGURES["dark_bins_worst"] < 0.1
    assert FIGURES["warm_share_worst"] < 0.03
    assert FIGURES["flicker_worst"] < 0.03
    assert FIGURES["psf_worst"] < 0.02
    assert 1 / 1.3 < FIGURES["centroid_ratio"] < 1.3
    assert FIGURES["acquisition_rms"] < 0.05


def test_the_design_at_a_year_and_temperature_has_the_share_of_warm_pixels(oracle):
    """For a drawn map, against the flight at another date than the file's; 4 sigma."""
    case = load_design(
        shipped("trackers/chandra-aca.toml"),
        [
            "instrument.detector.age.year=2012.0",
            'instrument.detector.thermal.temperature="-10 degC"',
        ],
    ).case
    detector = case.instrument.detector
    assert detector.thermal.temperature == pytest.approx(ZERO_CELSIUS - 10)
    flown = oracle("chandra_dark.json")["histograms"][3]
    assert (flown["year"], flown["temperature_c"]) == (2012.0, -10.0)
    edges, pixels = np.array(flown["edges_e_per_s"]), np.array(flown["pixels"])
    warm = pixels[edges[:-1] > 99].sum()
    first = edges[:-1][edges[:-1] > 99][0]
    # A number has 5.9 electrons, where the flight counts 5.
    assert (dark(detector) > 1.18 * first).sum() == pytest.approx(
        warm, abs=4 * np.sqrt(warm) + 0.002 * warm
    )


def test_the_boresight_drifts_as_in_flight(tmp_path):
    """After ten years without jumps and temperature terms: -11.1 and -1.6 arcsec."""
    path = tmp_path / "chandra.toml"
    path.write_text(
        f'base = "{shipped("trackers/chandra-aca.toml")}"\n'
        f'include = ["{shipped("variations/chandra-aca-boresight.toml")}"]\n'
    )
    case = load_design(path).case
    year = 365.25 * 86400
    unit = unit_case(case, 1, Moment(3, age=10 * year, launched=False))
    angles = np.array([unit.instrument.mounting.x, unit.instrument.mounting.y]) * 206264.8
    np.testing.assert_allclose(angles, [-11.08, -1.59], atol=0.01)
    assert unit.believed_mounting == case.instrument.mounting.still
