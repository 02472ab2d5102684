"""Orbit and shielding -> protons of the radiation belts and of the Sun behind it, their dose."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from startrack.core import GOLDEN_ANGLE, Floats, optional_package, positive, within

ELECTRON, PROTON = 0.51099895, 938.27209  # MeV, rest energies: CODATA 2018
BETHE = 0.307075  # MeV cm2 / mol, 4 pi N r_e^2 m c^2: Particle Data Group (2022), section 34
ALUMINIUM, SILICON = (13 / 26.9815, 166e-6), (14 / 28.0855, 173e-6)  # Z / A; MeV, mean excitation
DENSITY = 2.70  # g / cm3, of aluminium
MEV_RAD = 1.602177e-8  # rad in a g of silicon
EPOCH = 1964.0  # year of the magnetic field that AP-8 MIN was made with; others would be wrong
PLACES = 2000  # of an orbit and the Earth's longitudes
ENERGIES: Floats = np.geomspace(4.0, 390.0, 14)  # MeV; AP-8 ends at 400
MOST_L = 12.0  # Earth's radii, beyond which protons of these energies are not trapped
LATITUDES, LONGITUDES = 46, 90  # nodes of a map over the Earth
SILICON_DENSITY, PAIR = 2.33, 3.65  # g / cm3; eV, to make an electron in silicon
OPEN_L = 5.0  # Earth's radii, beyond which solar protons come: 63.4 degrees of latitude, King


def stopping(energy: Floats, material: tuple[float, float] = ALUMINIUM) -> Floats:
    """Energy that protons lose in matter, MeV cm2 / g, by the formula of Bethe.

        S = K Z / A (ln(2 m c^2 b^2 g^2 / I) - b^2) / b^2

    Source: Particle Data Group (2022), Review of Particle Physics, eq. (34.5), for heavy particles
    without corrections of density and shell.

    energy    (...) MeV
    Accuracy  model: 1 % from 4 to 400 MeV.
    """
    charge, excitation = material
    gamma = 1 + energy / PROTON
    square = 1 - 1 / gamma**2
    light = np.log(2 * ELECTRON * square * gamma**2 / excitation) - square
    return np.asarray(BETHE * charge * light / square)


@lru_cache(maxsize=1)
def _ranges() -> tuple[Floats, Floats]:
    """Energies (n,) MeV and ranges (n,) g / cm2 of protons in aluminium; 0 below 1 MeV."""
    energy = np.geomspace(1.0, 2000.0, 4000)
    return energy, scipy.integrate.cumulative_trapezoid(1 / stopping(energy), energy, initial=0)


def left_behind(energy: Floats, shielding: float) -> Floats:
    """Energy (n,) MeV that protons have left behind so much aluminium (metre); 0: stopped."""
    energies, ranges = _ranges()
    rest = np.interp(energy, energies, ranges) - 100 * shielding * DENSITY
    return np.where(rest > 0, np.interp(rest, ranges, energies), 0.0)


class Protons(NamedTuple):
    """Protons from all sides, in the mean over an orbit or at one place.

    energy  (n,) MeV, rising
    above   (n,) 1 / (cm2 s), or 1 / cm2: those of more energy
    """

    energy: Floats
    above: Floats

    def behind(self, shielding: float) -> tuple[float, float]:
        """What is left at the centre of a sphere of aluminium: protons / (cm2 s) and rad / s.

        Energies lie on a power law between two of the spectrum. Protons slow down on straight
        lines, without nuclear reactions.

        shielding  metre
        Returns    also 1 / cm2 and rad, of a fluence
        """
        fine = np.geomspace(self.energy[0], self.energy[-1], 600)
        count = np.maximum(self.above, 1e-30)
        above = np.exp(np.interp(np.log(fine), np.log(self.energy), np.log(count)))
        middle = np.sqrt(fine[1:] * fine[:-1])
        number, rest = -np.diff(above), left_behind(middle, shielding)
        passed = rest > 0
        loss = stopping(np.maximum(rest, 1.0), SILICON)
        beyond = above[-1] * (left_behind(fine[-1:], shielding)[0] > 0)
        rad = MEV_RAD * float((number * loss)[passed].sum())
        return float(number[passed].sum() + beyond), rad


def field_lines(latitude: Floats, longitude: Floats, altitude: float) -> tuple[Floats, Floats]:
    """L (n,) in radii of the Earth and B / B0 (n,) at places (radian, metre)."""
    place = np.degrees(longitude), np.degrees(latitude)
    found = _radbelt().igrf(*place, altitude / 1e3, EPOCH)
    line, ratio = (np.array(one, dtype=np.float64) for one in found)
    return line, ratio


@lru_cache(maxsize=32)
def trapped_protons(altitude: float, inclination: float, active: bool = False) -> Protons:
    """Protons of the radiation belts in the mean over a circular orbit.

    AP-8 of NASA by the package radbelt, at solar minimum or maximum, in the magnetic field of 1964.
    Source: Sawyer and Vette (1976), AP-8 trapped proton environment, NSSDC 76-06.

    altitude, inclination  metre, radian
    active    solar maximum, at which there are fewer in low orbits
    Raises    ImportError without radbelt.
    Accuracy  model: AP-8 within a factor of two. numerical: 5 % for 2000 places at 550 km.
    """
    positive(altitude=altitude)
    within(0, math.pi, inclination=inclination)
    turn, east = _places()
    latitude = np.arcsin(np.sin(inclination) * np.sin(turn))
    return Protons(ENERGIES, _trapped_at(latitude, east, altitude, active).mean(axis=1))


def _trapped_at(latitude: Floats, east: Floats, altitude: float, active: bool) -> Floats:
    """1 / (cm2 s) (energies, n) of more than each of ENERGIES, at places (n,) radian."""
    line, ratio = field_lines(latitude, east, altitude)
    inside = np.flatnonzero((line > 0) & (line < MOST_L))
    flux, sun = _radbelt().aep8, "max" if active else "min"
    above = np.zeros((len(ENERGIES), len(latitude)))
    for k, energy in enumerate(ENERGIES):
        above[k, inside] = flux(float(energy), line[inside], ratio[inside], "p", sun)
        inside = inside[above[k, inside] > 0]  # none of more energy where there are none of less
        if not len(inside):
            break
    return above


@dataclass(frozen=True, eq=False)
class ProtonMap:
    """Trapped protons behind a shield over the Earth, at one altitude.

    rate    (LATITUDES, LONGITUDES) 1 / (m2 s), through a surface from both sides
    charge  electron / metre, in the mean, along their tracks in silicon
    """

    rate: Floats
    charge: float

    def __call__(self, latitude: Floats, longitude: Floats) -> Floats:
        """1 / (m2 s) (n,) at places (n,) radian, by straight lines between the nodes."""
        down = (latitude / math.pi + 0.5) * (len(self.rate) - 1)
        across = np.mod(longitude / math.tau, 1.0) * self.rate.shape[1]
        j = np.clip(down.astype(int), 0, len(self.rate) - 2)
        i, v = across.astype(int) % self.rate.shape[1], down - j
        u, beside = across - across.astype(int), (i + 1) % self.rate.shape[1]
        low, high = ((1 - u) * self.rate[row, i] + u * self.rate[row, beside] for row in (j, j + 1))
        return np.asarray((1 - v) * low + v * high)


@lru_cache(maxsize=8)
def proton_map(altitude: float, shielding: float, active: bool = False) -> ProtonMap:
    """Where protons of the belts hit a detector behind a shield, by AP-8 as `trapped_protons`.

        rate = J / 2,   charge = sum J S density / (3.65 eV) / sum J

    for isotropic protons, with the omnidirectional flux J behind a sphere of aluminium and their
    stopping power S in silicon there.

    altitude, shielding  metre
    Raises    ImportError without radbelt.
    Accuracy  model: AP-8 within a factor of two; it has no time, so that the anomaly lies where it
              lay in 1964, some 15 degrees east of today's. Electrons and cosmic rays are left out.
              numerical: nodes of 4 degrees.
    """
    positive(altitude=altitude, shielding=shielding)
    latitude = np.linspace(-math.pi / 2, math.pi / 2, LATITUDES)
    east = np.arange(LONGITUDES) * (math.tau / LONGITUDES)
    north, along = (np.asarray(side, np.float64).ravel()
                    for side in np.meshgrid(latitude, east, indexing="ij"))  # fmt: skip
    above = _trapped_at(north, along, altitude, active)
    some = np.flatnonzero(above[0] > 0)
    left = np.zeros((2, len(north)))
    for k in some:
        left[:, k] = Protons(ENERGIES, above[:, k]).behind(shielding)
    number, rad = left
    loss = rad.sum() / MEV_RAD / number.sum() if number.any() else 0.0
    charge = loss * SILICON_DENSITY * 1e6 / PAIR * 100
    return ProtonMap(1e4 * number.reshape(LATITUDES, LONGITUDES) / 2, float(charge))


def solar_protons(altitude: float, inclination: float) -> Protons:
    """Fluence of one anomalously large event, as of August 1972, in a circular orbit.

        F(> E) = 7.9e9 exp((30 - E) / 26.5) 1 / cm2,   in the part of the orbit with L > 5

    Source: King (1974), Solar proton fluences for 1977-1983 space missions, Journal of Spacecraft
    and Rockets 11, 401; one cutoff for all energies: Stassinopoulos and King (1974), Empirical
    solar proton model for orbiting spacecraft applications, IEEE Transactions on Aerospace and
    Electronic Systems 10, 442.

    Raises    ImportError without radbelt.
    Accuracy  model: events differ by factors of ten; the Earth's shadow, up to a third, is left
              out.
    """
    turn, east = _places()
    line, _ = field_lines(np.arcsin(np.sin(inclination) * np.sin(turn)), east, altitude)
    open_part = float(((line > OPEN_L) | ~(line > 0)).mean())  # lines of no dipole lead to space
    return Protons(ENERGIES, open_part * 7.9e9 * np.exp((30 - ENERGIES) / 26.5))


def _places() -> tuple[Floats, Floats]:
    """Arguments of latitude and longitudes (n,) radian, evenly over both."""
    k = np.arange(PLACES) + 0.5
    east = np.mod(GOLDEN_ANGLE * k, math.tau) - math.pi
    return np.asarray(math.tau * k / PLACES, np.float64), np.asarray(east, np.float64)


def _radbelt() -> Any:
    needed = "radiation of an orbit needs the package radbelt: pip install 'startrack[radiation]'"
    return optional_package("radbelt", needed)
