"""Distances from which light of the ground is scattered into a line of sight: photon paths,
Gaussians."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from startrack.core import Floats
from startrack.earth.atmosphere import SPREADS

RADII: Floats = np.geomspace(5.0, 80e3, 61)  # metre, at which their sum is fitted
ORDERS = 60  # of scattering, at most
FAINT = 1e-4  # weight below which a path ends
ANGLES = 2001  # of the cumulative phase function


class Column(NamedTuple):
    """Air above a ground in plane layers.

    height     (n,) metre above the ground, rising
    molecules  (n,) 1 / metre, scattering
    aerosol    (n,) 1 / metre, extinction
    albedo     1, of the aerosol
    moments    (l,) 1, of its phase function, (2 l + 1) g_l
    """

    height: Floats
    molecules: Floats
    aerosol: Floats
    albedo: float
    moments: Floats


def spread(
    column: Column, altitude: Floats, photons: int, generator: np.random.Generator
) -> tuple[Floats, Floats]:
    """Weights of Gaussians over the ground, of light that air scatters between ground and ground.

        F(r) = sum of w (1 - exp(-r^2 / (2 s^2))),   s of SPREADS

    is the fraction of the diffuse transmittance from ground to sensor, or of the spherical albedo,
    that comes from closer than r. By reciprocity paths run from the sensor, or from the ground, to
    where they meet the ground, which is black.

    Source: Tanre, Herman and Deschamps (1981), Appl. Opt. 20, 3676; F is the environment function
    of 6S (Vermote et al., 1997, IEEE TGRS 35, 675).

    altitude  (a,) metre above the ground, of sensors that look down
    photons   of each of the two
    Returns   (a, g) and (g,); what they lack to a sum of one comes from beyond
    Accuracy  model: plane layers, no polarisation, a vertical line of sight. numerical: with 1e5
              photons F is within 0.01, of which the Gaussians' part is 0.005.
    """
    depth, of_aerosol = _depths(column)
    u = generator.random(photons)
    first = -np.log1p(-u * -np.expm1(-depth[-1]))  # depth at which paths scatter first
    place = np.interp(first, depth, column.height[::-1])
    start = np.zeros((photons, 2)), place, np.tile([0.0, 0.0, -1.0], (photons, 1)), np.ones(photons)
    radius, weight, which = _landed(column, depth, of_aerosol, *start, generator)
    down = np.array([_fit(radius, weight * (place[which] < top)) for top in altitude])
    rise = np.sqrt(1 - generator.random(photons))  # cosines of even light
    slant = -np.expm1(-depth[-1] / rise)
    first = -rise * np.log1p(-generator.random(photons) * slant)
    place = np.interp(depth[-1] - first, depth, column.height[::-1])
    level = np.sqrt(1 - rise**2)
    aside = np.stack([level / rise * place, np.zeros(photons)], 1)
    course = np.stack([level, np.zeros(photons), rise], 1)
    radius, weight, _ = _landed(column, depth, of_aerosol, aside, place, course, slant, generator)
    return down, _fit(radius, weight)


def _depths(column: Column) -> tuple[Floats, Floats]:
    """(n,) optical depth from the top down to each height, falling; (n,) the aerosol's part."""
    extinction = column.molecules + column.aerosol
    layers = (extinction[1:] + extinction[:-1]) / 2 * np.diff(column.height)
    depth = np.concatenate([[0.0], np.cumsum(layers[::-1])])
    return depth, column.aerosol / extinction


def _landed(
    column: Column,
    depth: Floats,
    of_aerosol: Floats,
    aside: Floats,
    height: Floats,
    course: Floats,
    weight: Floats,
    generator: np.random.Generator,
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Distances (m,) metre at which paths meet the ground, their weights, and their numbers.

    aside, height, course, weight  (n, 2), (n,) metre, (n, 3), (n,): where paths scatter first, and
                                   how they came
    """
    molecular, aerosol = _phase_angles(np.array([1.0, 0.0, 0.5])), _phase_angles(column.moments)
    number, out = np.arange(len(height)), []
    for _ in range(ORDERS):
        if not len(number):
            break
        by_aerosol = generator.random(len(number)) < np.interp(height, column.height, of_aerosol)
        weight = weight * np.where(by_aerosol, column.albedo, 1.0)
        u = generator.random(len(number)) * (ANGLES - 1)
        bend = np.where(
            by_aerosol, *(np.interp(u, np.arange(ANGLES), law) for law in (aerosol, molecular))
        )
        course = _turned(course, bend, 2 * math.pi * generator.random(len(number)))
        here = np.interp(height, column.height, depth[::-1])
        there = here + course[:, 2] * generator.standard_exponential(len(number)) * -1
        low = there >= depth[-1]
        at = np.where(low, 0.0, np.interp(there, depth, column.height[::-1]))
        moved = ((at - height) / course[:, 2])[:, None] * course[:, :2]
        aside = aside + moved
        out.append((np.hypot(*aside[low].T), weight[low], number[low]))
        on = ~low & (there > 0) & (weight > FAINT)
        number, aside, height, course, weight = (
            values[on] for values in (number, aside, at, course, weight)
        )
    radius, weight, number = (np.concatenate(part) for part in zip(*out, strict=True))
    return radius, weight, number


def _phase_angles(moments: Floats) -> Floats:
    """Cosines (ANGLES,) of the scattering angle at even steps of the cumulative phase function."""
    cosine = np.cos(np.linspace(0, math.pi, 20001))
    phase = np.maximum(np.polynomial.legendre.legval(cosine, moments), 0.0)
    steps = (phase[1:] + phase[:-1]) / 2 * -np.diff(cosine)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return np.interp(np.linspace(0, total[-1], ANGLES), total, cosine)


def _turned(course: Floats, cosine: Floats, azimuth: Floats) -> Floats:
    """Unit vectors (n, 3) turned by angles with these cosines (n,), towards azimuths (n,)."""
    sine = np.sqrt(np.maximum(1 - cosine**2, 0.0))
    # An orthonormal basis without a singular direction: Duff et al. (2017), JCGT 6, 1.
    x, y, z = course.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    one = np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1)
    two = np.stack([b, sign + y * y * a, -y], 1)
    across = np.cos(azimuth)[:, None] * one + np.sin(azimuth)[:, None] * two
    return cosine[:, None] * course + sine[:, None] * across


def _fit(radius: Floats, weight: Floats) -> Floats:
    """Weights (g,) of Gaussians whose sum comes closest to the distances of paths."""
    total = weight.sum()
    if total == 0:
        return np.zeros(len(SPREADS))
    counts = np.histogram(radius, np.concatenate([[0.0], RADII]), weights=weight)[0]
    shares = -np.expm1(-(RADII[:, None] ** 2) / (2 * SPREADS**2))
    return np.asarray(nnls(shares, np.cumsum(counts) / total)[0])
