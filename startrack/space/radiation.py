"""Orbit and shielding -> particles of the radiation belts and of the Sun behind it, their dose."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from startrack.core import GOLDEN_ANGLE, Floats, Ints, optional_package, positive, within
from startrack.space.electrons import DENSITY, Electrons

ELECTRON, PROTON = 0.51099895, 938.27209  # MeV, rest energies: CODATA 2018
BETHE = 0.307075  # MeV cm2 / mol, 4 pi N r_e^2 m c^2: Particle Data Group (2022), section 34
MEV_RAD = 1.602177e-8  # rad in a g of silicon
EPOCH = 1964.0  # year of the magnetic field that AP-8 MIN and AE-8 were made with
PLACES = 2000  # of an orbit and the Earth's longitudes
ENERGIES: Floats = np.geomspace(4.0, 390.0, 14)  # MeV; AP-8 ends at 400
ELECTRON_ENERGIES: Floats = np.array(
    [0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0]
)
CELLS = np.array([[0.02], [0.05]])  # of ln L and ln B / B0, in which electrons are the same
MOST_L = 12.0  # Earth's radii, beyond which particles of these energies are not trapped
LATITUDES, LONGITUDES = 46, 90  # nodes of a map over the Earth
SILICON_DENSITY, PAIR = 2.33, 3.65  # g / cm3; eV, to make an electron in silicon
OPEN_L = 5.0  # Earth's radii, beyond which solar protons come: 63.4 degrees of latitude, King


class Matter(NamedTuple):
    """An element."""

    z: int
    mass: float  # g / mol
    excitation: float  # MeV, mean


ALUMINIUM, SILICON = Matter(13, 26.9815, 166e-6), Matter(14, 28.0855, 173e-6)


def stopping(energy: Floats, matter: Matter = ALUMINIUM) -> Floats:
    """Energy that protons lose in matter, MeV cm2 / g, by the formula of Bethe.

        S = K Z / A (ln(2 m c^2 b^2 g^2 / I) - b^2) / b^2

    Source: Particle Data Group (2022), Review of Particle Physics, eq. (34.5), for heavy particles
    without corrections of density and shell.

    energy    (...) MeV
    Accuracy  model: 1 % from 4 to 400 MeV.
    """
    gamma = 1 + energy / PROTON
    square = 1 - 1 / gamma**2
    light = np.log(2 * ELECTRON * square * gamma**2 / matter.excitation) - square
    return np.asarray(BETHE * (matter.z / matter.mass) * light / square)


@lru_cache(maxsize=1)
def _ranges() -> tuple[Floats, Floats]:
    """Energies (n,) MeV and ranges (n,) g / cm2 of protons in aluminium; 0 below 1 MeV."""
    energy = np.geomspace(1.0, 2000.0, 4000)
    return energy, scipy.integrate.cumulative_trapezoid(1 / stopping(energy), energy, initial=0)


def left_behind(energy: Floats, shielding: float) -> Floats:
    """Energy (n,) MeV of protons behind a thickness of aluminium (metre); 0: stopped."""
    energies, ranges = _ranges()
    rest = np.interp(energy, energies, ranges) - 100 * shielding * DENSITY
    return np.where(rest > 0, np.interp(rest, ranges, energies), 0.0)


class Protons(NamedTuple):
    """Protons from all sides, in the mean over an orbit or at one place.

    energy  (n,) MeV, rising
    above   (n,) 1 / (cm2 s), or 1 / cm2, protons above each energy
    """

    energy: Floats
    above: Floats

    def behind(self, shielding: float) -> tuple[float, float]:
        """Protons / (cm2 s) and dose rate, rad / s, at the centre of a sphere of aluminium.

        Energies lie on a power law between two of the spectrum. Protons slow down on straight
        lines, without nuclear reactions.

        shielding  metre
        Returns    1 / (cm2 s) and rad / s; 1 / cm2 and rad if the spectrum is a fluence
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
    lines = _lines_of_orbit(altitude, inclination)
    return Protons(ENERGIES, _trapped_at(*lines, ENERGIES, "p", active).mean(axis=1))


@lru_cache(maxsize=32)
def trapped_electrons(altitude: float, inclination: float, active: bool = False) -> Electrons:
    """Electrons of the radiation belts in the mean over a circular orbit.

    AE-8 of NASA by the package radbelt, as `trapped_protons`; at solar maximum there are more.
    Source: Vette (1991), The AE-8 trapped electron model environment, NSSDC/WDC-A-R&S 91-24.

    altitude, inclination  metre, radian
    Raises    ImportError without radbelt.
    Accuracy  model: AE-8 within a factor of two over years, of ten on single days; what was
              measured was half of its dose in geostationary orbit behind 2.5 mm (Chen, Larsen and
              Henderson, 2020 IEEE Aerospace Conference) and a sixth at 840 km (New low-altitude
              dose measurements, 1987, IEEE Transactions on Nuclear Science 34). Beside spectra of
              SPENVIS 0.84 to 1.05 up to 5 MeV.  numerical: 5 %.
    """
    lines = _lines_of_orbit(altitude, inclination)
    above, cell = _electrons_at(*lines, active)
    return Electrons(ELECTRON_ENERGIES, above[:, cell].sum(axis=1) / PLACES)


def _electrons_at(line: Floats, ratio: Floats, active: bool) -> tuple[Floats, Ints]:
    """1 / (cm2 s) (energies, cells) in cells of L and B / B0, and the cell of each place (n,)."""
    inside = (line > 0) & (line < MOST_L)
    place = np.log(np.where(inside, np.stack([line, ratio]), 2 * MOST_L))
    cells, cell = np.unique(np.round(place / CELLS), axis=1, return_inverse=True)
    line, ratio = np.exp(cells * CELLS)
    return _trapped_at(line, ratio, ELECTRON_ENERGIES, "e", active), cell.ravel()


def _trapped_at(line: Floats, ratio: Floats, energies: Floats, kind: str, active: bool) -> Floats:
    """Flux above each energy (MeV) at L (n,) and B / B0 (n,), 1 / (cm2 s), (energies, n)."""
    inside = np.flatnonzero((line > 0) & (line < MOST_L))
    flux, sun = _radbelt().aep8, "max" if active else "min"
    above = np.zeros((len(energies), len(line)))
    for k, energy in enumerate(energies):
        if not len(inside):
            break
        above[k, inside] = flux(float(energy), line[inside], ratio[inside], kind, sun)
        inside = inside[above[k, inside] > 0]  # none of more energy where there are none of less
    return above


@dataclass(frozen=True, eq=False)
class HitMap:
    """Protons and electrons of the belts behind a shield over the Earth, at one altitude.

    rate    (2, LATITUDES, LONGITUDES) 1 / (m2 s), of both through a surface from both sides
    charge  (2,) electron / metre, in the mean, along their tracks in silicon
    """

    rate: Floats
    charge: Floats

    def __call__(self, latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
        """Rate and mean charge (n,) at places (n,) radian, by straight lines between the nodes."""
        _, rows, columns = self.rate.shape
        down = (latitude / math.pi + 0.5) * (rows - 1)
        across = np.mod(longitude / math.tau, 1.0) * columns
        j = np.clip(down.astype(int), 0, rows - 2)
        i, v = across.astype(int) % columns, down - j
        u, beside = across - across.astype(int), (i + 1) % columns
        low, high = (
            (1 - u) * self.rate[:, row, i] + u * self.rate[:, row, beside] for row in (j, j + 1)
        )
        rates = (1 - v) * low + v * high
        rate = rates.sum(axis=0)
        charge = (rates * self.charge[:, None]).sum(axis=0) / np.where(rate > 0, rate, 1.0)
        return rate, charge


@lru_cache(maxsize=8)
def hit_map(altitude: float, shielding: float) -> HitMap:
    """Map of the places where particles of the belts hit a detector behind a shield, by AP-8 and
    AE-8 at solar minimum.

        rate = J / 2,   charge = sum J S density / (3.65 eV) / sum J

    for isotropic particles, with the omnidirectional flux J behind a sphere of aluminium and their
    stopping power S in silicon there.

    altitude, shielding  metre
    Raises    ImportError without radbelt.
    Accuracy  model: AP-8 and AE-8 within a factor of two; they have no time, so that the anomaly
              lies where it lay in 1964, some 15 degrees east of today's. Cosmic rays and electrons
              that photons set free are left out.  numerical: nodes of 4 degrees.
    """
    positive(altitude=altitude, shielding=shielding)
    latitude = np.linspace(-math.pi / 2, math.pi / 2, LATITUDES)
    east = np.arange(LONGITUDES) * (math.tau / LONGITUDES)
    north, along = (
        np.asarray(side, np.float64).ravel() for side in np.meshgrid(latitude, east, indexing="ij")
    )
    lines = field_lines(north, along, altitude)
    above = _trapped_at(*lines, ENERGIES, "p", active=False)
    left = np.zeros((2, 2, len(north)))  # protons and electrons; their number, MeV / g
    for k in np.flatnonzero(above[0] > 0):
        left[0, :, k] = Protons(ENERGIES, above[:, k]).behind(shielding)
    left[0, 1] /= MEV_RAD
    above, cell = _electrons_at(*lines, active=False)
    behind = [Electrons(ELECTRON_ENERGIES, one).behind(shielding) for one in above.T]
    left[1] = np.array([(one.number, one.loss) for one in behind]).T[:, cell]
    number, loss = np.moveaxis(left, 1, 0)
    mean = loss.sum(axis=1) / np.maximum(number.sum(axis=1), 1e-30)
    rate = 1e4 * number.reshape(2, LATITUDES, LONGITUDES) / 2
    return HitMap(rate, mean * SILICON_DENSITY * 1e6 / PAIR * 100)


def solar_protons(altitude: float, inclination: float) -> Protons:
    """Fluence of one anomalously large event, such as that of August 1972, in a circular orbit.

        F(> E) = 7.9e9 exp((30 - E) / 26.5) 1 / cm2,   in the part of the orbit with L > 5

    Source: King (1974), Solar proton fluences for 1977-1983 space missions, Journal of Spacecraft
    and Rockets 11, 401; one cutoff for all energies: Stassinopoulos and King (1974), Empirical
    solar proton model for orbiting spacecraft applications, IEEE Transactions on Aerospace and
    Electronic Systems 10, 442.

    Raises    ImportError without radbelt.
    Accuracy  model: events differ by factors of ten; the Earth's shadow, up to a third, is left
              out.
    """
    line, _ = _lines_of_orbit(altitude, inclination)
    open_part = float(((line > OPEN_L) | ~(line > 0)).mean())  # lines of no dipole lead to space
    return Protons(ENERGIES, open_part * 7.9e9 * np.exp((30 - ENERGIES) / 26.5))


def _lines_of_orbit(altitude: float, inclination: float) -> tuple[Floats, Floats]:
    """`field_lines` of PLACES, evenly over the arguments of latitude and the longitudes."""
    positive(altitude=altitude)
    within(0, math.pi, inclination=inclination)
    k = np.arange(PLACES) + 0.5
    latitude = np.arcsin(np.sin(inclination) * np.sin(math.tau * k / PLACES))
    return field_lines(latitude, np.mod(GOLDEN_ANGLE * k, math.tau) - math.pi, altitude)


def _radbelt() -> Any:
    needed = "radiation of an orbit needs the package radbelt: pip install 'startrack[radiation]'"
    return optional_package("radbelt", needed)
