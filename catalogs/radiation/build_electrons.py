"""Build the table of electrons that enter a sphere of aluminium, and its checksum.

    python catalogs/radiation/build_electrons.py

Electrons are followed by multiple scattering and continuous loss of energy; photons of their
bremsstrahlung are counted towards the centre. It takes some seconds.
"""

from __future__ import annotations

import hashlib
import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from startrack.core import Floats
from startrack.io import save_text
from startrack.io.saving import whole
from startrack.space.electrons import ARRAYS, FORMAT

HERE = Path(__file__).parent

ELECTRON = 0.51099895  # MeV, rest energy: CODATA 2018
BETHE = 0.307075  # MeV cm2 / mol, 4 pi N r_e^2 m c^2: Particle Data Group (2022), section 34
FINE = 1 / 137.035999
DENSITY = 2.70  # g / cm3, of aluminium


class Matter(NamedTuple):
    """An element. Sternheimer, Berger and Seltzer (1984), Atomic Data and Nuclear Data Tables 30,
    261: `density_effect` is C, x0, x1, a and k of their formula.
    """

    z: int
    mass: float  # g / mol
    excitation: float  # MeV, mean
    density_effect: tuple[float, float, float, float, float]


ALUMINIUM = Matter(13, 26.9815, 166e-6, (4.2395, 0.1708, 3.0127, 0.08024, 3.6345))
SILICON = Matter(14, 28.0855, 173e-6, (4.4351, 0.2014, 2.8715, 0.14921, 3.2546))
DISPLACE = 21e-6  # MeV, to move an atom of silicon from its place
# MeV; cm2 / g that absorb the energy of photons in aluminium and in silicon: Hubbell and Seltzer
# (1995), Tables of X-ray mass attenuation coefficients, NISTIR 5632.
ABSORBED = np.array([
    [0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.3, 0.6, 1.0, 2.0, 4.0, 8.0],
    [3.094, 0.8778, 0.3601, 0.1840, 0.1099, 0.05511, 0.03794, 0.02827, 0.02816, 0.02851, 0.02686,
     0.02266, 0.01882, 0.01678],
    [4.076, 1.164, 0.4782, 0.2430, 0.1434, 0.06896, 0.04513, 0.03086, 0.02932, 0.02954, 0.02778,
     0.02345, 0.01963, 0.01770],
])  # fmt: skip
PHOTON: Floats = np.geomspace(0.02, 8.0, 61)  # MeV
IN_ALUMINIUM, IN_SILICON = (
    np.exp(np.interp(np.log(PHOTON), np.log(ABSORBED[0]), np.log(row))) for row in ABSORBED[1:]
)
STARTS: Floats = np.geomspace(0.1, 8.0, 10)  # MeV, of the electrons that are followed
COSINES, STEPS = 10, 120  # nodes in a quarter turn; of the path, over the range
BINS = 60  # of depth, over the range
CHANCES = (np.arange(10) + 0.5) / 10  # of less loss of energy than that


def stopping(energy: Floats, matter: Matter = ALUMINIUM) -> Floats:
    """Energy that electrons lose by collisions, MeV cm2 / g.

        S = K Z / (2 A b^2) (ln(t^2 (t + 2) / (2 (I / m)^2)) + F - d),   t = energy / m
        F = 1 - b^2 + (t^2 / 8 - (2 t + 1) ln 2) / (t + 1)^2

    Source: ICRU report 37 (1984), eq. (2.9), with the density effect d of Sternheimer et al.

    energy    (...) MeV
    Accuracy  model: 1 % from 0.02 to 10 MeV.
    """
    t = energy / ELECTRON
    square = t * (t + 2) / (t + 1) ** 2
    shape = 1 - square + (t**2 / 8 - (2 * t + 1) * math.log(2)) / (t + 1) ** 2
    c, low, high, a, k = matter.density_effect
    x = np.log10(np.maximum(t * (t + 2), 1e-12)) / 2
    dense = 2 * math.log(10) * x - c + a * np.clip(high - x, 0, None) ** k
    light = np.log(t**2 * (t + 2) / (2 * (matter.excitation / ELECTRON) ** 2)) + shape
    scale = BETHE * matter.z / (2 * matter.mass * square)
    return np.asarray(scale * (light - np.where(x < low, 0.0, dense)))


def radiated(energy: Floats, matter: Matter = ALUMINIUM) -> Floats:
    """Energy that electrons lose to photons of bremsstrahlung, MeV cm2 / g.

    Source: Heitler (1954), The quantum theory of radiation, section 25, eq. (24), in Born's
    approximation without screening, with Z (Z + 1) for the electrons of the atoms.

    energy    (...) MeV
    Accuracy  model: 10 % from 0.1 to 8 MeV.
    """
    e = energy / ELECTRON + 1
    p = np.sqrt(e**2 - 1)
    turn = np.log(e + p)
    number = (12 * e**2 + 4) / (3 * e * p) * turn - (8 * e + 6 * p) / (3 * e * p**2) * turn**2
    number += -4 / 3 - 2 / (e * p) * scipy.special.spence(1 + 2 * p * (e + p))
    scale = BETHE * FINE / (4 * math.pi * matter.mass) * matter.z * (matter.z + 1)
    return np.asarray(scale * e * number)


def photon_spectrum(energy: float) -> Floats:
    """Energy (photons,) of bremsstrahlung of an electron, cm2 / g, at each of PHOTON per energy.

    Source: Koch and Motz (1959), Reviews of Modern Physics 31, 920, formula 3BN: the integrand of
    `radiated`.
    """
    e0 = energy / ELECTRON + 1
    k = np.minimum(PHOTON / ELECTRON, 0.999999 * (e0 - 1))
    e = e0 - k
    p0, p = math.sqrt(e0**2 - 1), np.sqrt(e**2 - 1)
    turn0, turn = 2 * math.log(e0 + p0), 2 * np.log(e + p)
    both = 2 * np.log((e0 * e + p0 * p - 1) / k)
    curve = (e0 * e + p0**2) / p0**3 * turn0 - (e0 * e + p**2) / p**3 * turn
    curve = k / (2 * p0 * p) * (curve + 2 * k * e0 * e / (p * p0) ** 2)
    curve += 8 * e0 * e / (3 * p0 * p) + k**2 * ((e0 * e) ** 2 + (p0 * p) ** 2) / (p0 * p) ** 3
    number = 4 / 3 - 2 * e0 * e * (p**2 + p0**2) / (p0 * p) ** 2 + both * curve
    number += turn0 * e / p0**3 + turn * e0 / p**3 - turn * turn0 / (p0 * p)
    z, mass = ALUMINIUM.z, ALUMINIUM.mass
    scale = BETHE * FINE / (4 * math.pi * mass) * z * (z + 1) / ELECTRON
    return np.where(energy > PHOTON, scale * p / p0 * number, 0.0)


def displacing(energy: Floats) -> Floats:
    """Energy that electrons lose to displaced atoms of silicon (NIEL), MeV cm2 / g.

        NIEL = N / A pi Z^2 r_e^2 (1 - b^2) / b^4 T (ln(1 / u) - b^2 (1 - u)
               + pi a Z b (1 - sqrt(u))^2),   T = 2 E (E + 2 m) / M,   u = 21 eV / T

    Source: McKinley and Feshbach (1948), Physical Review 74, 1759, eq. (7), integrated over the
    energies of recoil; all of it is counted as displacement.

    energy    (...) MeV
    Accuracy  20 %: 3.2e-5 at 1 MeV, where Summers et al. (1993), IEEE Transactions on Nuclear
              Science 40, 1372, have 3.1e-5.
    """
    e = energy / ELECTRON + 1
    square, z = 1 - 1 / e**2, SILICON.z
    most = 2 * energy * (energy + 2 * ELECTRON) / (SILICON.mass * 931.494)
    u = np.minimum(DISPLACE / most, 1.0)
    number = -np.log(u) - square * (1 - u)
    number += math.pi * FINE * z * np.sqrt(square) * (1 - np.sqrt(u)) ** 2
    scale = BETHE / (4 * ELECTRON * SILICON.mass) * z**2 * (1 - square) / square**2
    return np.asarray(scale * most * number)


@lru_cache(maxsize=1)
def _ranges() -> tuple[Floats, Floats]:
    """Energies (n,) MeV and mean paths (n,) g / cm2 in aluminium until electrons rest."""
    energy = np.geomspace(1e-3, 12.0, 3000)
    loss = stopping(energy) + radiated(energy)
    first = energy[0] / (2 * loss[0])
    return energy, first + scipy.integrate.cumulative_trapezoid(1 / loss, energy, initial=0)


def path_length(energy: Floats) -> Floats:
    """Mean path (...) g / cm2 in aluminium of electrons (MeV) until they rest."""
    energies, paths = _ranges()
    return np.exp(np.interp(np.log(energy), np.log(energies), np.log(paths)))


def _turning(energy: float, most: int) -> Floats:
    """1 / (g / cm2), at which the Legendre moments 0 to `most` of directions decay in aluminium.

        G_l = N (2 pi) int (1 - P_l) dsigma = C / 2 (l (l + 1) (ln(1 / n) + 1 - 2 H_l)
              - 2 b^2 H_l + pi a Z b (4 l - 2 H_l)),   C = 2 pi N r_e^2 Z (Z + 1) / (p b)^2

    of Moliere's screening n and the spin terms of McKinley and Feshbach; H_l harmonic numbers.

    Source: Goudsmit and Saunderson (1940), Physical Review 57, 24.
    """
    e = energy / ELECTRON + 1
    p2, b2, z = e**2 - 1, 1 - 1 / e**2, ALUMINIUM.z
    order = np.arange(most + 1.0)
    harmonic = np.concatenate([[0.0], np.cumsum(1 / order[1:])])
    screen = (FINE * z ** (1 / 3) / 0.885) ** 2 / (4 * p2) * (1.13 + 3.76 * (FINE * z) ** 2 / b2)
    decay = order * (order + 1) * np.maximum(1 - 2 * harmonic - math.log(screen), 1.0)
    decay += math.pi * FINE * z * b2**0.5 * (4 * order - 2 * harmonic) - 2 * b2 * harmonic
    scale = BETHE / (4 * ELECTRON * ALUMINIUM.mass) * z * (z + 1) / (p2 * b2)
    return np.maximum.accumulate(np.maximum(scale * decay, 0.0))


@lru_cache(maxsize=1)
def _basis() -> tuple[Floats, Floats, Floats]:
    """Cosines (n,), their weights (n,) and vectors (n, n) of diffusion in angle, by its moments."""
    cosine = np.arange(-COSINES, COSINES + 1) / COSINES
    weight = np.full(len(cosine), 1 / COSINES)
    weight[[0, -1]] /= 2
    between = (1 - ((cosine[1:] + cosine[:-1]) / 2) ** 2) * COSINES
    middle = np.concatenate([between, [0]]) + np.concatenate([[0], between])
    root = np.sqrt(weight)
    _, vectors = scipy.linalg.eigh_tridiagonal(middle / weight, -between / (root[1:] * root[:-1]))
    return cosine, weight, vectors


class Followed(NamedTuple):
    """Electrons of one energy and of flux 1 / cm2, from all sides of a sphere of aluminium.

    path     g / cm2, mean one until they rest
    left     (3, BINS) at the centre, for radii in parts of the path: electrons / cm2, and
             MeV / g that silicon takes by their collisions and by displaced atoms
    photons  (photons, BINS) MeV / cm2 of bremsstrahlung to the centre, made at these depths
    """

    path: float
    left: Floats
    photons: Floats


@lru_cache(maxsize=len(STARTS))
def follow(start: float) -> Followed:
    """Electrons (MeV) from their entrance into aluminium to their rest.

    They lose energy continuously, turn by multiple scattering and leave the surface for good:

        df / ds = -mu df / dz - sum_l G_l f_l P_l(mu),   ds = -dE / (S + S_r)

    A plane in isotropic flux has the dose D at depth z, and the centre of a solid sphere twice
    D - z dD / dz. Photons have directions 1 / (1 - b cos)^2 around the electron's; those towards
    the centre are counted.

    Source: Lewis (1950), Physical Review 78, 526, eq. (5); sphere: Seltzer (1980), SHIELDOSE, NBS
    Technical Note 1116; photons: Koch and Motz (1959), section II.B.
    Accuracy  model: without straggling and delta rays.  numerical: 2 %.
    """
    cosine, weight, vectors = _basis()
    root, wide = np.sqrt(weight)[:, None], PHOTON * math.log(PHOTON[1] / PHOTON[0])
    sides = np.clip(cosine + np.array([[-0.5], [0.5]]) / COSINES, -1, 1)
    energies, paths = _ranges()
    path = float(path_length(np.array(start)))
    step = path / STEPS
    middle = np.interp(path - (np.arange(STEPS) + 0.5) * step, paths, energies)
    losses = np.stack([np.ones(STEPS), stopping(middle, SILICON), displacing(middle)])
    state = np.zeros((len(cosine), STEPS * COSINES + 1))
    state[:, 0] = np.clip(cosine, 0, None) * weight
    state /= state.sum()
    # A node of depth is as wide as a step at the least cosine, so that all move by whole nodes.
    come = np.arange(state.shape[1]) + np.arange(2 * COSINES, -1, -1)[:, None]
    left, photons = np.zeros((3, BINS)), np.zeros((len(PHOTON), BINS))
    for energy, loss in zip(middle, losses.T, strict=True):
        turned = np.exp(-_turning(energy, len(cosine) - 1) * step / 2)
        turn = root * ((vectors * turned) @ vectors.T) / root.T
        before = turn @ state
        after = np.take_along_axis(np.pad(before, ((0, 0), (COSINES, COSINES))), come, axis=1)
        state = turn @ after
        there = (before + after)[:, 1:].reshape(len(cosine), BINS, -1).sum(axis=2) * (step / 2)
        left += loss[:, None] * there.sum(axis=0)
        speed = math.sqrt(1 - (1 + energy / ELECTRON) ** -2)
        ahead = np.diff(1 / (1 - speed * sides), axis=0)[0] * (1 - speed**2) / (2 * speed)
        made = photon_spectrum(energy) * wide
        photons += made[:, None] * (there * (ahead / weight)[:, None]).sum(axis=0)
    depth = (np.arange(BINS) + 0.5) / BINS
    plane = left * (BINS / path / 2)
    sphere = np.clip(plane - depth * np.gradient(plane, depth, axis=1), 0, None)
    return Followed(path, sphere, photons / 2)


def table() -> dict[str, Floats]:
    """The arrays of the file, see `ElectronTable`.

    Losses vary around the mean by Moyal's form of Landau's distribution, as if they did alike all
    along the path: Moyal (1955), Philosophical Magazine 46, 263.
    """
    energy = np.geomspace(STARTS[0], STARTS[-1], 300)
    square = 1 - (1 + energy / ELECTRON) ** -2
    width = BETHE * ALUMINIUM.z / (2 * ALUMINIUM.mass * square * stopping(energy))
    moyal = scipy.stats.moyal.ppf(CHANCES)
    path, left, photons = zip(*(follow(float(start)) for start in STARTS), strict=True)
    return {
        "energy": energy,
        "mean_path": path_length(energy),
        "loss": 1 + (moyal - moyal.mean())[:, None] * width,
        "start": STARTS,
        "path": np.array(path),
        "left": np.array(left),
        "photons": np.array(photons),
        "in_aluminium": IN_ALUMINIUM,
        "in_silicon": IN_SILICON,
    }


def main() -> None:
    from astropy.io import fits

    arrays = table()
    first = fits.PrimaryHDU()
    first.header["ELECTRON"] = (FORMAT, "format of this table of electrons in aluminium")
    parts = [fits.ImageHDU(arrays[name], name=name) for name in ARRAYS]
    with whole(HERE / "electrons.fits") as draft:
        fits.HDUList([first, *parts]).writeto(draft, checksum=True)
    digest = hashlib.sha256((HERE / "electrons.fits").read_bytes()).hexdigest()
    save_text(HERE / "SHA256SUMS", f"{digest}  electrons.fits\n")


if __name__ == "__main__":
    main()
