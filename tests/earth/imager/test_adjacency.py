"""Light of the ground around: against photons in three dimensions, 6S, and taken off again."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from startrack.core import Curve
from startrack.core.units import deg, nm
from startrack.detector import Detector, Scan
from startrack.earth.atmosphere import Air, load_table
from startrack.earth.atmosphere.spread import SPREADS
from startrack.earth.geometry.scene import Fractal, Terrain
from startrack.earth.imager import Channel, Setting, around_of, band_of, surrounded, terms_in_band
from startrack.earth.terrain import EQUATORIAL, Rays, cartesian, up
from startrack.earth.terrain import survey as survey_ground
from startrack.io import shipped
from startrack.optics import Optics

ORACLE = json.loads((Path(__file__).parents[2] / "oracle" / "adjacency.json").read_text())
FLAT = Terrain(fractal=Fractal(0.0, 0.0, 200.0, 64, 1e-3), highest=100.0, lowest=-10.0)
MAPS = {
    "coast": lambda x, y: np.where(x < 0, 0.02, 0.30),
    "patch": lambda x, y: np.where(np.maximum(abs(x), abs(y)) < 500, 0.8, 0.1),
}
DETECTOR = Detector(40, 40, 10e-6, 1e-3, Curve((), (0.5,)), full_well=1e6, scan=Scan())


def narrow(wavelength: float) -> Channel:
    low, high = (wavelength - 1) * nm, (wavelength + 1) * nm
    band = Curve((low - 0.5 * nm, low, high, high + 0.5 * nm), (0.0, 1.0, 1.0, 0.0))
    return Channel("one", Optics(0.1, 4.0), DETECTOR, band)


def nadir(x, y):
    """Flat ground at the equator and 0 degrees, seen from above; the Sun 40 degrees from zenith."""
    longitude, latitude = x / EQUATORIAL, y / EQUATORIAL
    rays = Rays(
        cartesian(longitude, latitude, np.full(len(x), 20e3)), -up(longitude, latitude),
        np.full(len(x), 1e-3),
    )  # fmt: skip
    sun = np.array([math.cos(40 * deg), math.sin(40 * deg), 0.0])
    return survey_ground(FLAT.open(Path()), rays, sun)


@pytest.mark.parametrize("column", ORACLE["columns"], ids=["470 nm", "865 nm"])
@pytest.mark.parametrize("case", ["coast", "patch"])
def test_a_coast_and_a_patch_shine_as_photons_say(column, case):
    """Radiance at the satellite within 1 %, with cells of 60 m; by the mean alone it is not."""
    band = band_of(narrow(column["wavelength"]), Air(), 700e3, 1.0)
    theirs = column["collected"][case]
    x = np.array(theirs["place"], float)
    ground = nadir(x, np.zeros(len(x)))
    rho = MAPS[case](x, 0 * x)

    def values(longitude, latitude):
        return MAPS[case](longitude * EQUATORIAL, latitude * EQUATORIAL)

    corners = nadir(np.array([-6e3, 6e3, 0.0]), np.array([-6e3, 6e3, 0.0]))
    mean = {"coast": 0.16, "patch": 0.1}[case]
    environment = surrounded([corners], 15.0, mean, band, values)
    setting = Setting(0, 1, 0, None, band, mean, 1, None, environment=environment)
    extinction = np.array(column["molecules"]) + np.array(column["aerosol"])
    direct = math.exp(-np.trapezoid(extinction, column["height"]))
    black = terms_in_band(ground, band, np.zeros(1), 0.0).total
    white = terms_in_band(ground, band, np.ones(1), 0.0)
    lamp = (white.direct + white.indirect) / direct
    truth = black + lamp * np.array(theirs["mean"])
    ours = terms_in_band(ground, band, rho, around_of(setting, ground)).total
    plain = terms_in_band(ground, band, rho, mean).total
    assert abs(ours / truth - 1).max() < 0.01
    if column["wavelength"] == 470:
        assert abs(plain / truth - 1).max() > 0.02


def test_molecules_spread_light_as_in_6s():
    """F of 6S, subroutine ENVIRO (Vermote et al., 2006), for molecules and a satellite."""
    table = load_table(shipped("atmosphere/molecules.fits"))
    weights = table.spread[4, 0, -1]  # 460 nm, the sea, space
    radius = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
    ours = -np.expm1(-((radius[:, None] * 1e3) ** 2) / (2 * SPREADS**2)) @ weights
    theirs = 1 - 0.93 * np.exp(-0.08 * radius) - 0.07 * np.exp(-1.1 * radius)
    np.testing.assert_allclose(ours, theirs, atol=0.02)


def test_low_and_hazy_sight_is_lit_from_nearer():
    clear, haze = (load_table(shipped(f"atmosphere/rural-{km}km.fits")) for km in (23, 5))
    near = 3  # Gaussians to 200 m
    assert (clear.spread[6, 0, 0, :near].sum() > clear.spread[6, 0, -1, :near].sum() * 1.2).all()
    assert haze.spread[6, 0, -1, :5].sum() > clear.spread[6, 0, -1, :5].sum()
    for table in (clear, haze):
        for weights in (table.spread, table.returned):
            assert (weights >= 0).all()
            assert (weights.sum(-1) <= 1.005).all()
