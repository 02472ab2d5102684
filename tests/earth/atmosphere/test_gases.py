"""Columns of water and ozone of another climate with a shipped table."""

import numpy as np
import pytest

from startrack.core import Refused, um
from startrack.earth.atmosphere import Air, in_bands, load_table, with_gases
from startrack.earth.imager import air_table, band_of
from startrack.earth.retrieval import EarthProblem, load_earth_design
from startrack.io import shipped

# Columns by 6S (Vermote et al. 1997, manual part 2), g / cm2 and cm: other integrals of the same
# profiles; those of ozone are by season and differ by up to 30 %.
BY_6S = {
    "tropical": 4.12,
    "midlatitude summer": 2.93,
    "midlatitude winter": 0.853,
    "subarctic summer": 2.10,
    "subarctic winter": 0.419,
    "us standard": 1.424,
}


@pytest.fixture(scope="module")
def table():
    return load_table(shipped("atmosphere/rural-23km.fits"))


@pytest.mark.parametrize("climate", BY_6S)
def test_columns_of_water_are_those_of_6s(climate):
    assert Air(climate=climate).columns[0] / 10 == pytest.approx(BY_6S[climate], rel=0.015)


@pytest.mark.parametrize("climate", ["tropical", "subarctic winter"])
def test_a_table_is_as_one_that_was_built_so(table, climate):
    """Against the coefficients from which the tables are built, by pvlib."""
    pytest.importorskip("pvlib")
    from air_gases import transmittance

    water, ozone = Air(climate=climate).columns
    found = with_gases(table, water, ozone)
    slant = table.mass <= 5
    for n, gas in ((0, "water"), (2, "ozone")):
        wanted = transmittance(gas, table.spectrum, table.mass, water, ozone)
        error = abs(found.gas[n] - wanted)[:, slant]
        assert error[table.spectrum < 2.5 * um].max() < 0.01
        assert error.mean() < 5e-3
    assert found.gas[1] is not None
    np.testing.assert_array_equal(found.gas[1], table.gas[1])
    np.testing.assert_array_equal(found.path, table.path)


def test_the_shipped_climate_is_the_shipped_table():
    assert air_table(Air(), False).air == Air()
    same = air_table(Air(climate="midlatitude summer", water=29.2), False)
    np.testing.assert_array_equal(same.gas, air_table(Air(), False).gas)


def test_winter_is_brighter_where_water_absorbs(table):
    band = (abs(table.spectrum - 0.94 * um) < 2e-9)[None] / 4e-9
    light = [
        in_bands(with_gases(table, *Air(climate=climate).columns), band, 700e3).direct[0, 0, 4, 0]
        for climate in ("tropical", "midlatitude winter")
    ]
    assert light[0] < 0.7 * light[1]


def test_water_is_a_variable_and_climate_a_condition_of_a_design():
    """The blue band has less light with more ozone, and the forecast follows."""
    errors = [
        EarthProblem(load_earth_design("fields", [f"air.ozone={ozone} mm"])).expect()
        for ozone in (1, 6)
    ]
    assert errors[0].value != errors[1].value
    assert errors[0].value == pytest.approx(errors[1].value, rel=0.2)
    design = load_earth_design("fields", ["air.water=10 kg/m2"])
    assert EarthProblem(design).replaced({"air.water": 40.0}).design.air.water == 40.0


def test_infrared_bands_know_summer_alone():
    mir = load_earth_design("hsrs").camera.channels[0]
    for air in (Air(climate="tropical"), Air(ozone=3e-3)):
        with pytest.raises(Refused, match=r"whose shipped table is of midlatitude summer"):
            band_of(mir, air, 572e3, 1.0)
    with pytest.raises(Refused, match="climate must be one of"):
        Air(climate="polar")
