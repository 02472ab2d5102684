"""Orbit and shielding -> dose of protons behind aluminium, and the damage that ages a detector."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import within

# Trapped protons in a circular orbit at 550 km for five years: AP-8 at solar minimum, SHIELDOSE-2,
# silicon at the centre of spheres of aluminium. Computed with SPENVIS 4.6 by T. Pfandzelter
# (github.com/pfandzelter/leo-edge-failure-models, compute-failure/results; MIT licence).
INCLINATION = np.radians([0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0])
THICKNESS = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0]) * 1e-3  # metre
PROTON_RAD = np.array([  # rad / yr in silicon, of each inclination
    [1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3],
    [105.0, 80.3, 66.9, 52.8, 45.8, 39.3, 32.9, 26.7],
    [411.4, 357.0, 323.8, 285.8, 263.8, 238.6, 212.5, 181.6],
    [537.5, 383.7, 323.8, 269.6, 241.4, 212.9, 186.3, 155.3],
    [345.4, 243.8, 205.7, 171.4, 153.4, 135.3, 118.3, 98.7],
    [289.0, 207.9, 176.5, 147.9, 132.7, 117.1, 102.4, 85.6],
    [264.8, 191.0, 162.5, 136.3, 122.4, 108.1, 94.6, 79.1],
])  # fmt: skip
RAD = 6.2415e7  # MeV / g
# Non-ionising over ionising energy loss in silicon of the protons of some 50 MeV that are left
# behind a few millimetres: 3.9e-3 over 10 MeV cm2 / g. From 30 to 100 MeV 3.1e-4 to 4.5e-4.
# Assumed: remembered of the tables of PSTAR and of Jun et al. (2003).
NON_IONISING = 3.9e-4


def proton_dose(inclination: float, shielding: float) -> float:
    """Dose of trapped protons in silicon, rad in a year at 550 km.

    Interpolated along straight lines in inclination and in the logarithms of thickness and dose;
    retrograde orbits have the dose of 180 degrees less their inclination.

    inclination  radian
    shielding    metre of aluminium all around
    Raises    ValueError outside 0 to 180 degrees, or 1 to 20 mm.
    Accuracy  between the nodes 8 %; AP-8 itself within a factor of two. Other altitudes are not in
              the table (higher ones have several times as much), nor are solar protons, which count
              in polar orbits and are nearly all in a geostationary one: of these, tables of
              fluence behind a shield were not found (ECSS-E-ST-10-04C has their model, ESP).
    """
    within(0.0, math.pi, inclination=inclination)
    within(float(THICKNESS[0]), float(THICKNESS[-1]), shielding=shielding)
    at = min(inclination, math.pi - inclination)
    columns = [np.interp(at, INCLINATION, column) for column in PROTON_RAD.T]
    return float(np.exp(np.interp(math.log(shielding), np.log(THICKNESS), np.log(columns))))


def damage_fluence(dose: float, niel: float) -> float:
    """Protons of 10 MeV, of a square centimetre and a year, that displace as many atoms.

    dose      rad in a year, ionising, of protons in silicon behind the shield
    niel      MeV cm^2 / g, of protons of 10 MeV
    Accuracy  30 % of the ratio of energy losses, for protons of 30 to 100 MeV.
    """
    return dose * RAD * NON_IONISING / niel
