"""Radiative transfer in spherical layers enters; the table of the Earth's bright limb leaves."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from startrack.core import Floats, deg, nm
from startrack.earth.atmosphere.solver import limb_radiance
from startrack.scene import Limb

WAVELENGTH: Floats = np.array([400.0, 450, 500, 550, 600, 700, 800, 900, 1000]) * nm
TANGENT: Floats = np.concatenate([np.arange(0, 40, 2.0), np.arange(40, 100, 4.0)]) * 1e3
SUN: Floats = np.array([0.0, 20, 40, 55, 65, 72, 78, 82, 85, 87, 89, 90]) * deg
AZIMUTH: Floats = np.array([0.0, 45, 90, 135, 180]) * deg


def build_limb(albedo: float = 0.3, progress: Callable[[float], None] | None = None) -> Limb:
    """Solve the radiative transfer in spherical layers of molecules.

    Raises  ModuleNotFoundError where sasktran2 is missing.
    """
    radiance = np.empty((len(WAVELENGTH), len(TANGENT), len(SUN), len(AZIMUTH)))
    rays = [(tangent, azimuth) for tangent in TANGENT for azimuth in AZIMUTH]
    for s, sun in enumerate(SUN):
        found = limb_radiance(WAVELENGTH, math.cos(sun), rays, albedo)
        radiance[:, :, s] = found.reshape(len(WAVELENGTH), len(TANGENT), len(AZIMUTH))
        if progress:
            progress((s + 1) / len(SUN))
    return Limb(albedo, WAVELENGTH, TANGENT, SUN, AZIMUTH, radiance)
