"""Orbit and shielding -> protons of the radiation belts and of the Sun behind it, their dose."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from startrack.core import GOLDEN_ANGLE, Floats, positive, within

ELECTRON, PROTON = 0.51099895, 938.27209  # MeV, rest energies: CODATA 2018
BETHE = 0.307075  # MeV cm2 / mol, 4 pi N r_e^2 m c^2: Particle Data Group (2022), section 34
ALUMINIUM, SILICON = (13 / 26.9815, 166e-6), (14 / 28.0855, 173e-6)  # Z / A; MeV, mean excitation
DENSITY = 2.70  # g / cm3, of aluminium
MEV_RAD = 1.602177e-8  # rad in a g of silicon
EPOCH = 1964.0  # year of the magnetic field that AP-8 MIN was made with; others would be wrong
PLACES = 2000  # of an orbit and the Earth's longitudes
ENERGIES: Floats = np.geomspace(4.0, 390.0, 14)  # MeV; AP-8 ends at 400
MOST_L = 12.0  # Earth's radii, beyond which protons of these energies are not trapped
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
    slow = 1 / stopping(energy)
    steps = np.diff(energy) * (slow[1:] + slow[:-1]) / 2
    return energy, np.concatenate([[0.0], np.cumsum(steps)])


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
    line, ratio = field_lines(latitude, east, altitude)
    inside = np.flatnonzero((line > 0) & (line < MOST_L))
    flux, sun = _radbelt().aep8, "max" if active else "min"
    above = np.zeros((len(ENERGIES), len(turn)))
    for k, energy in enumerate(ENERGIES):
        above[k, inside] = flux(float(energy), line[inside], ratio[inside], "p", sun)
        inside = inside[above[k, inside] > 0]  # none of more energy where there are none of less
        if not len(inside):
            break
    return Protons(ENERGIES, above.mean(axis=1))


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
    try:
        import radbelt
    except ImportError:
        raise ImportError(
            "radiation of an orbit needs the package radbelt: pip install 'startrack[radiation]'"
        ) from None
    return radbelt
