"""The radiative transfer of the tables, against other solvers and published values."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from startrack.core.units import nm, um
from startrack.earth.atmosphere import Air
from startrack.earth.atmosphere.table import profile

pytest.importorskip("sasktran2", reason="new tables of the air need the extra `earth`")
from air_particles import Haze, particles
from air_solver import EARTH, TOP, layers, limb_radiance, solve_radiance

ORACLE = Path(__file__).parents[2] / "oracle"
GREEN = np.array([550 * nm])
SHETTLE = (550 * nm, 1060 * nm)  # one integral over particles serves them all


def depth(air, wavelength):
    _, heights, extinction = solve_radiance(
        air, wavelength, 0.0, 0.5371, [(1.0, 0.0, TOP)], (0.0,), 4
    )
    return np.trapezoid(extinction, heights)


def test_optical_depth_of_molecules():
    """Bodhaine et al. (1999), J. Atmos. Ocean. Tech. 16, 1854: 0.0973 at 550 nm and 1013.25 hPa."""
    assert depth(Air("none"), GREEN)[0] == pytest.approx(0.0973, rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("aerosol", ["rural", "urban", "maritime"])
def test_particles_are_those_of_shettle_and_fenn(aerosol):
    """Values of LOWTRAN 7: dry particles, over the sea at a humidity of 80 %."""
    with (ORACLE / "lowtran_aerosol.csv").open(encoding="utf-8") as file:
        table = csv.DictReader(line for line in file if not line.startswith("#"))
        rows = [
            [float(row[name]) for name in ("micrometre", "extinction", "absorption", "asymmetry")]
            for row in table
            if row["aerosol"] == aerosol
        ]
    wavelength, extinction, absorption, asymmetry = np.array(rows).T
    found = particles(aerosol, tuple((wavelength * um).tolist()))
    seen = wavelength < 1.1
    np.testing.assert_allclose(found.extinction[seen], extinction[seen], rtol=0.005)
    absorbs = (1 - found.albedo) * found.extinction
    np.testing.assert_allclose(absorbs[seen], absorption[seen], rtol=0.04)
    np.testing.assert_allclose(found.moments[seen, 1] / 3, asymmetry[seen], atol=0.003)
    # The indices of 2 micrometre are held beyond; bands of water at 2.7 and 3 micrometre are not.
    far = (wavelength > 1.1) & ~np.isin(wavelength, (2.7, 3.0))
    np.testing.assert_allclose(found.extinction[far], extinction[far], rtol=0.15)
    np.testing.assert_allclose(found.moments[far, 1] / 3, asymmetry[far], atol=0.05)


def test_extinction_at_the_ground_is_koschmieders():
    """The contrast falls to 2 % over the visibility."""
    for visibility in (5e3, 10e3, 23e3, 50e3, 100e3):
        total = profile(visibility, np.array([0.0]))[0] + 1.16e-5
        assert total == pytest.approx(3.912 / visibility, rel=0.02)


def unit_cells(found, albedos):
    """Added light per albedo, and the spherical albedo, from three albedos."""
    first, second = ((lit - found[0]) / a for lit, a in zip(found[1:3], albedos[1:3], strict=True))
    spherical = (second - first) / (albedos[2] * second - albedos[1] * first)
    return first * (1 - albedos[1] * spherical), spherical


RAYS = [(0.9, 0.3, TOP), (0.55, 2.0, TOP), (0.31, 1.0, 5e3)]


@pytest.mark.parametrize(
    "air", [Air("none"), pytest.param(Air("rural", 10e3), marks=pytest.mark.slow)]
)
def test_any_albedo_follows_from_three(air):
    albedos = (0.0, 0.25, 0.75, 0.6)
    found = solve_radiance(air, np.array(SHETTLE), 0.0, 0.5371, RAYS, albedos)[0]
    added, spherical = unit_cells(found, albedos)
    np.testing.assert_allclose(found[3], found[0] + 0.6 * added / (1 - 0.6 * spherical), rtol=1e-6)


def test_the_spherical_albedo_does_not_know_sun_or_sensor():
    seen = []
    for sun in (0.2123, 0.9531):
        found = solve_radiance(Air(), np.array(SHETTLE[:1]), 0.0, sun, RAYS, (0.0, 0.25, 0.75))[0]
        seen.append(unit_cells(found, (0.0, 0.25, 0.75))[1])
    mean = np.mean(seen, axis=(0, 2), keepdims=True)  # over Suns and rays, at each wavelength
    np.testing.assert_allclose(seen, np.broadcast_to(mean, np.shape(seen)), rtol=1e-6)


def test_clear_air_loses_no_light():
    """Air without absorption transmits the light that it does not reflect: S + 2 int mu T = 1."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    cosines, weights = (nodes + 1) / 2, weights / 2  # the solver's own ordinates of 8 streams
    sun = 0.5371
    rays = [(cosine, 0.0, TOP) for cosine in [*cosines, sun]]
    found = solve_radiance(Air("none"), GREEN, 0.0, sun, rays, (0.0, 0.25, 0.75), 8)[0]
    added, spherical = unit_cells(found, (0.0, 0.25, 0.75))
    total = math.pi * added[0] / sun
    total /= math.sqrt(total[-1])
    assert spherical.mean() + 2 * (weights * cosines) @ total[:-1] == pytest.approx(1, abs=1e-7)


def test_fluxes_are_those_of_disort():
    """PythonicDISORT (Ho and Pierrehumbert 2024), 16 streams, on the same air."""
    disort = pytest.importorskip("PythonicDISORT")
    sun, streams = 0.5371, 16
    found, heights, extinction = solve_radiance(
        Air("none"), GREEN, 0.0, sun, [(sun, 0.0, TOP)], (0.0, 0.25, 0.75), streams
    )
    added, _ = unit_cells(found, (0.0, 0.25, 0.75))
    total = math.sqrt(math.pi * added[0, 0] / sun)
    optical = np.trapezoid(extinction, heights)
    king = 1.0484  # Bates (1984) at 550 nm
    depolarisation = 6 * (king - 1) / (7 * king + 3)
    second = (1 - depolarisation) / (2 + depolarisation) / 5
    phase = np.zeros((1, streams + 1))
    phase[0, [0, 2]] = 1, second
    solved = disort.pydisort(
        optical, np.array([1 - 2e-6]), streams, phase, sun, 1.0, 0.0, only_flux=True
    )
    diffuse, direct = solved[2](optical[0])
    assert total == pytest.approx((diffuse + direct) / sun, rel=1e-5)


def test_layers_start_at_the_ground():
    assert layers(1234.5)[0] == 1234.5
    assert (np.diff(layers(1234.5)) > 0).all()
    assert layers(0.0)[-1] == TOP


def test_the_limb_is_as_bright_as_others_found():
    """Magnitude of a pixel of 60 arcsec at 550 nm, the Sun 30 degrees from the zenith.

    Vega's flux and the Sun's irradiance at 550 nm are 3.63e-11 and 1.863 W / m^2 / nm.
    """
    tangents = np.array([20e3, 40e3, 60e3, 80e3])
    light = limb_radiance(
        GREEN, math.cos(math.radians(30)), [(t, math.pi / 2) for t in tangents], 0.3
    )
    pixel = math.radians(1 / 60) ** 2
    magnitude = -2.5 * np.log10(light[0] * 1.863 * pixel / 3.63e-11)
    np.testing.assert_allclose(magnitude, [-5.5, -2.4, 0.3, 3.4], atol=0.3)


def line_of_sight(haze, tangent, sun, azimuth, wavelength):
    """Singly scattered light of molecules and haze: integrals along the line and towards the Sun.

    Air is linear between the borders of the solver's layers, which are 1 km thick.
    """
    heights = np.arange(0.0, TOP + 1, 1e3)
    air = depth_profile(heights, wavelength)
    grains = haze.optical_depth / haze.scale_height * np.exp(-heights / haze.scale_height)
    grains *= (wavelength / 550e-9) ** -haze.angstrom
    # Along the line, aside, and up at the tangent point; the camera is at -x.
    to_sun = np.sin(sun) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    to_sun[2] = np.cos(sun)
    half = math.sqrt((EARTH + TOP) ** 2 - (EARTH + tangent) ** 2)
    along = np.linspace(-half, half, 6001)
    place = np.stack([along, 0 * along, np.full(6001, EARTH + tangent)], -1)
    height = np.linalg.norm(place, axis=1) - EARTH
    molecules, aerosol = (np.interp(height, heights, each) for each in (air, grains))
    inward = place @ to_sun
    length = -inward + np.sqrt(inward**2 + (EARTH + TOP) ** 2 - (place**2).sum(1))
    nodes, weights = np.polynomial.legendre.leggauss(64)
    sunward = np.zeros(6001)
    for node, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        there = np.linalg.norm(place + (node * length)[:, None] * to_sun, axis=1) - EARTH
        sunward += weight * length * np.interp(there, heights, air + grains)
    both = molecules + aerosol
    step = along[1] - along[0]
    camera = np.concatenate([[0.0], np.cumsum((both[1:] + both[:-1]) / 2 * step)])
    cosine = float(to_sun[0])  # light flies from the Sun and leaves towards -x
    g, k = haze.asymmetry, DEPOLARISATION
    rayleigh = 0.75 * ((1 + k) + (1 - k) * cosine**2) / (1 + k / 2)
    phase = (1 - g**2) / (1 + g**2 - 2 * g * cosine) ** 1.5
    source = (molecules * rayleigh + haze.albedo * aerosol * phase) * np.exp(-camera - sunward)
    return np.trapezoid(source, along) / 4 / math.pi


DEPOLARISATION = 0.0277  # of air, Bates (1984)


def depth_profile(heights, wavelength):
    """Extinction of molecules over height, from the solver's plane layers."""
    _, at, extinction = solve_radiance(
        Air("none"), np.array([wavelength]), 0.0, 0.5371, [(1.0, 0.0, TOP)], (0.0,), 4
    )
    return np.exp(np.interp(heights, at, np.log(np.maximum(extinction[0], 1e-30))))


@pytest.mark.parametrize("case", [(0.0, 25e3), (0.3, 12e3), (0.1, 3e3)])
def test_haze_at_the_limb_is_the_integral_along_the_line(case):
    optical_depth, tangent = case
    haze = Haze(optical_depth, 3e3, 1.3, 0.9, 0.65)
    for sun, azimuth in ((30.0, 40.0), (75.0, 120.0)):
        sun, azimuth = math.radians(sun), math.radians(azimuth)
        rays = [(tangent, azimuth)]
        found = limb_radiance(800e-9 * np.ones(1), math.cos(sun), rays, 0.0, haze, False)[0, 0]
        told = line_of_sight(haze, tangent, sun, azimuth, 800e-9)
        assert found == pytest.approx(told, rel=0.02)
