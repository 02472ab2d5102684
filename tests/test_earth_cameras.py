"""The page on Earth cameras in orbit agrees with its figures, and these with the code."""

import json
import sys

import pytest

from startrack.earth.imager import load_imager
from startrack.earth.imager.band import band_of
from startrack.earth.imager.figures import figures
from tests.conftest import ROOT


def read(name):
    return json.loads((ROOT / name).read_text(encoding="utf-8"))


FIGURES = read("docs/figures/earth-cameras.json")


def test_the_page_is_of_its_figures():
    sys.path.insert(0, str(ROOT / "experiments"))
    try:
        import earth_page
    finally:
        sys.path.pop(0)
    text = earth_page.text_of(
        FIGURES,
        read("tests/oracle/earth_cameras.json"),
        read("docs/figures/earth-cameras-before.json"),
    )
    assert (ROOT / "docs/figures/earth-cameras.md").read_text(encoding="utf-8") == text


@pytest.mark.parametrize("camera", FIGURES["snr"])
def test_the_snr_of_the_page_is_that_of_the_code(camera):
    for channel in load_imager(camera).channels:
        found = figures(channel, band_of(channel, None, 700e3, 1.0), 700e3, 1e-3)
        assert found.snr == pytest.approx(FIGURES["snr"][camera][channel.name][1], rel=1e-6)
