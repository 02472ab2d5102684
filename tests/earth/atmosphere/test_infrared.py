"""Thermal radiance of the air: MODTRAN's sums, isothermal air over high ground, no air."""

from dataclasses import replace

import numpy as np
import pytest
from air_files import save_infrared

from startrack.core.units import deg, um
from startrack.earth.atmosphere import (
    InfraredTable,
    Reach,
    SlantPath,
    heat_of,
    infrared_bands,
    load_infrared,
    load_table,
    planck,
    radiance,
    refine,
    sun_spectrum,
    vacuum,
)
from startrack.earth.atmosphere.table import profile
from startrack.io import shipped

# MODTRAN 5.2.1 as pybsm 0.16 ships it: rural 23 km, sensor at 24.5 km, Sun at 50 degrees and at
# right angles, ground of 299 K that reflects 15 %, on 23 August (1.0104 astronomical units):
# watt / m^2 / sr / um of the air's heat, the ground's, and what the ground reflects, mean over
# each band, at nadir and at a ground range of 24 km.
BANDS = ((3.4, 4.2), (8.5, 9.3), (10.5, 12.5))
MODTRAN = {
    0.0: ((0.05515, 0.30433, 0.19403), (2.21752, 5.54168, 0.31760), (3.03408, 4.63943, 0.37588)),
    44.57: ((0.06708, 0.27511, 0.18051), (2.72577, 4.91008, 0.27684), (3.76870, 3.86174, 0.30985)),
}


def flat(spectrum, bands):
    edges = np.array(bands)[:, :, None] * um
    inside = (spectrum >= edges[:, 0] - 1e-9) & (spectrum <= edges[:, 1] + 1e-9)
    return inside / (inside * np.gradient(spectrum)).sum(1, keepdims=True)


def looked_at(bands, zenith, height=0.0):
    ones = np.ones(1)
    here = Reach(*((one, one) for one in (height, zenith, 50 * deg, 90 * deg)))
    sight = SlantPath(
        height * ones,
        zenith * ones,
        50 * deg * ones,
        90 * deg * ones,
        np.cos(50 * deg) * ones,
        ones,
        ones,
    )
    return refine(bands, here), sight


@pytest.mark.parametrize("zenith", MODTRAN)
def test_the_sums_are_those_of_modtran(zenith):
    table = load_infrared(shipped("atmosphere/infrared.fits"))
    response = flat(table.spectrum, BANDS)
    bands = infrared_bands(table, response, 24.5e3, 1.0104)
    fine, sight = looked_at(bands, zenith * deg)
    heat = heat_of(table.spectrum, response)
    terms = radiance(fine, sight, np.full(3, 0.15), np.zeros(3), heat, np.array([299.0]))
    theirs = np.array(MODTRAN[zenith])
    np.testing.assert_allclose(terms.emitted[0] * um, theirs[:, 1], rtol=0.03)
    np.testing.assert_allclose(terms.total[0] * um, theirs.sum(1), rtol=0.03)


# The same, of 3.4 to 4.2 micrometre: sunlight that the air scatters, and that the ground reflects.
SUNLIGHT = {0.0: (0.00273, 0.19403), 44.57: (0.00350, 0.18051)}


def with_particles():
    table = load_infrared(shipped("atmosphere/infrared.fits"))
    return replace(table, particles=load_table(shipped("atmosphere/rural-23km.fits")))


def sunlit(table, zenith):
    """Direct, indirect and scattered, watt / m^2 / sr / um; of the scattered, with black ground."""
    bands = infrared_bands(table, flat(table.spectrum, BANDS), 24.5e3, 1.0104)
    fine, sight = looked_at(bands, zenith * deg)
    grey = np.full(3, 0.15)
    terms, alone = (radiance(fine, sight, grey, around) for around in (grey, np.zeros(3)))
    light = (terms.direct, terms.indirect, terms.scattered, alone.scattered)
    return [term[0] * um for term in light]


@pytest.mark.parametrize("zenith", SUNLIGHT)
def test_sunlight_of_the_mid_infrared_is_nearer_to_modtran_with_particles(zenith):
    dark, found = (
        sunlit(load_infrared(shipped("atmosphere/infrared.fits")), zenith),
        sunlit(with_particles(), zenith),
    )
    wanted = sum(SUNLIGHT[zenith])
    assert sum(term[0] for term in dark[:3]) < 0.88 * wanted
    assert sum(term[0] for term in found[:3]) == pytest.approx(wanted, rel=0.1)
    assert SUNLIGHT[zenith][0] / 2.2 < found[3][0] < found[2][0] < SUNLIGHT[zenith][0] * 2.2
    np.testing.assert_array_equal(found[0], dark[0])
    assert found[1][0] > 0.01 * found[0][0]
    np.testing.assert_array_equal(found[2][1:], 0.0)  # beyond 5 micrometre


def test_scattered_light_is_that_of_thin_air():
    """E tau w P / (4 pi cos) of single scattering, with LOWTRAN 7's rural aerosol at 3.75 um.

    Its extinction is 0.0996 of that at 550 nm, of which 0.0087 is absorbed; Henyey and Greenstein's
    phase function with an asymmetry of 0.731. The optical depth at 550 nm follows from the profile
    by hand; the two ways through the gases are those of the table.
    """
    table = with_particles()
    response = flat(table.spectrum, [(3.7, 3.8)])
    bands = infrared_bands(table, response, 50e3)
    fine, sight = looked_at(bands, 0.0)
    found = radiance(fine, sight, np.zeros(1), np.zeros(1)).scattered[0, 0] * um
    height = np.arange(50.0, 60e3, 100.0)
    scattering = (0.0996 - 0.0087) * profile(23e3, height).sum() * 100.0
    cosine, asymmetry = -np.cos(50 * deg), 0.731
    phase = (1 - asymmetry**2) / (1 + asymmetry**2 - 2 * asymmetry * cosine) ** 1.5
    sun = response[0] * np.gradient(table.spectrum) @ sun_spectrum(table.spectrum) * um
    direct = radiance(fine, sight, np.ones(1), np.zeros(1)).direct[0, 0] * um
    both = direct * np.pi / sun / np.cos(50 * deg)  # transmittance of both ways
    thin = sun * scattering * phase / (4 * np.pi) * both
    assert found == pytest.approx(thin, rel=0.35)


def grey(temperature: float) -> InfraredTable:
    """Isothermal air whose optical depth is 1 and halves every 1500 m."""
    spectrum = np.linspace(8, 12, 81) * um
    altitude, sensor = np.array([500.0, 1e3, 2e3, 4e3, 8e3, 100e3]), np.arange(0, 75, 10) * deg
    depth = 1 - 0.5 ** (altitude / 1500.0)
    through = np.exp(-depth[:, None, None] / np.cos(sensor)[:, None]) * np.ones(81)
    black = planck(spectrum, temperature)
    fall = (1 - np.exp(-5 / 3)) * black
    return InfraredTable(spectrum, altitude, sensor, through, (1 - through) * black, fall)


@pytest.mark.parametrize("height", [0.0, 1000.0, 3000.0])
@pytest.mark.parametrize("zenith", [0.0, 40.0])
def test_isothermal_air_over_black_ground_is_a_blackbody(height, zenith):
    table = grey(290.0)
    response = flat(table.spectrum, [(9, 11)])
    fine, sight = looked_at(infrared_bands(table, response, 50e3), zenith * deg, height)
    heat = heat_of(table.spectrum, response)
    terms = radiance(fine, sight, np.zeros(1), np.zeros(1), heat, np.array([290.0]))
    assert terms.total[0, 0] - terms.direct[0, 0] == pytest.approx(
        heat(np.array([290.0]))[0, 0], rel=2e-3
    )


def test_higher_ground_has_less_air_above():
    table = load_infrared(shipped("atmosphere/infrared.fits"))
    bands = infrared_bands(table, flat(table.spectrum, BANDS), 570e3)
    assert (np.diff(bands.through, axis=0) >= 0).all()
    assert (np.diff(bands.rise, axis=0) <= 0).all()
    # Above 8 km nearly nothing is left, and the ratio of two slants knows it to 1e-4.
    assert (np.diff(bands.through, axis=1) <= 1e-4).all()


def test_without_air_the_ground_is_all_there_is():
    table = vacuum()
    response = flat(table.spectrum, [(9, 11)])
    fine, sight = looked_at(infrared_bands(table, response, 400e3, 0.387), 30 * deg)
    heat = heat_of(table.spectrum, response)
    terms = radiance(fine, sight, np.full(1, 0.1), np.zeros(1), heat, np.array([700.0]))
    assert terms.emitted[0, 0] == pytest.approx(0.9 * heat(np.array([700.0]))[0, 0], rel=1e-5)
    assert terms.thermal[0, 0] == terms.scattered[0, 0] == terms.indirect[0, 0] == 0
    # The Sun fills 6.794e-5 sr at one astronomical unit, so pi L = 0.1 B(Sun) Omega cos(50) / d^2.
    # At 10 micrometre it shines as a body of 5000 K (ASTM E490: 2.42e-4 W / m2 / nm).
    sun = heat(np.array([2999.0]))[0, 0] / planck(10 * um, 2999.0) * planck(10 * um, 5000.0)
    expected = 0.1 * sun * 6.794e-5 * np.cos(50 * deg) / 0.387**2 / np.pi
    assert terms.direct[0, 0] == pytest.approx(expected, rel=0.08)


def test_a_table_survives_its_file(tmp_path):
    table = load_infrared(shipped("atmosphere/infrared.fits"))
    save_infrared(tmp_path / "again.fits", table)
    again = load_infrared(tmp_path / "again.fits")
    np.testing.assert_array_equal(again.through, table.through)
    with pytest.raises(ValueError, match="infrared table of the air of format 1"):
        load_infrared(shipped("atmosphere/limb.fits"))
