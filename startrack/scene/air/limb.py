"""The Earth's bright limb: tangent height and place of the Sun -> radiance; FITS in and out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from startrack.scene.air.checked import open_checked
from startrack.scene.air.solver import limb_radiance
from startrack.units import deg, nm

Floats = NDArray[np.float64]

FORMAT = 1  # of the file
DARK = 1e-12  # 1 / sr over the Sun's irradiance, below which the air counts as dark
WAVELENGTH: Floats = np.array([400.0, 450, 500, 550, 600, 700, 800, 900, 1000]) * nm
TANGENT: Floats = np.concatenate([np.arange(0, 40, 2.0), np.arange(40, 100, 4.0)]) * 1e3
SUN: Floats = np.array([0.0, 20, 40, 55, 65, 72, 78, 82, 85, 87, 89, 90]) * deg
AZIMUTH: Floats = np.array([0.0, 45, 90, 135, 180]) * deg


@dataclass(frozen=True, eq=False)
class Limb:
    """Radiance along lines that miss the ground, over the Sun's irradiance.

    albedo      1, of the ground below
    wavelength  (k,) metre
    tangent     (t,) metre, height of the point nearest to the ground
    sun         (s,) radian, zenith angle of the Sun there
    azimuth     (p,) radian, from the Sun's azimuth to that in which the light comes: 0 where the
                camera looks towards the Sun
    radiance    (k, t, s, p) 1 / sr
    """

    albedo: float
    wavelength: Floats
    tangent: Floats
    sun: Floats
    azimuth: Floats
    radiance: Floats

    def __call__(self, wavelength: Floats, tangent: Floats, sun: Floats, azimuth: Floats) -> Floats:
        """Radiance of n lines of sight.

        wavelength  (k,) metre, inside the table's
        tangent     (n,) metre; above the table's the air is dark, below it the ground is hit
        sun         (n,) radian; past the table's the air is dark
        azimuth     (n,) radian
        Returns     (n, k) 1 / sr, over the Sun's irradiance
        Errors      ValueError where a tangent height lies under the table or is not a number.
                    model: clear air without aerosol, straight rays; no twilight with the Sun
                    below the horizon.
                    numerical: straight lines in the logarithm, 3 % between the nodes.
        """
        if not (tangent >= self.tangent[0]).all():
            raise ValueError(
                f"tangent must be at least {self.tangent[0]:g} m, got {np.min(tangent)}"
            )
        axes = np.log(self.wavelength), self.tangent, self.sun, self.azimuth
        look = RegularGridInterpolator(axes, np.log(np.maximum(self.radiance, DARK)))
        turned = np.arccos(np.cos(azimuth))
        places = (
            np.clip(tangent, *self.tangent[[0, -1]]),
            np.clip(sun, *self.sun[[0, -1]]),
            np.clip(turned, *self.azimuth[[0, -1]]),
        )
        found = np.stack(
            [
                np.exp(look(np.stack([np.full(len(tangent), one), *places], -1)))
                for one in np.log(wavelength)
            ],
            -1,
        )
        dark = (tangent > self.tangent[-1]) | (sun > self.sun[-1])
        return np.where(dark[:, None], 0.0, found)


def build_limb(albedo: float = 0.3, progress: Callable[[float], None] | None = None) -> Limb:
    """Solve the radiative transfer in spherical layers of molecules.

    Errors  ModuleNotFoundError where sasktran2 is missing.
    """
    radiance = np.empty((len(WAVELENGTH), len(TANGENT), len(SUN), len(AZIMUTH)))
    rays = [(tangent, azimuth) for tangent in TANGENT for azimuth in AZIMUTH]
    for s, sun in enumerate(SUN):
        found = limb_radiance(WAVELENGTH, math.cos(sun), rays, albedo)
        radiance[:, :, s] = found.reshape(len(WAVELENGTH), len(TANGENT), len(AZIMUTH))
        if progress:
            progress((s + 1) / len(SUN))
    return Limb(albedo, WAVELENGTH, TANGENT, SUN, AZIMUTH, radiance)


def save_limb(path: Path, limb: Limb) -> None:
    """Write it as FITS with checksums, radiance in single precision."""
    from astropy.io import fits

    first = fits.PrimaryHDU(limb.radiance.astype(np.float32))
    first.header["LIMB"] = (FORMAT, "format of this table of the limb")
    first.header["ALBEDO"] = limb.albedo
    axes = [fits.ImageHDU(getattr(limb, name), name=name) for name in _AXES]
    fits.HDUList([first, *axes]).writeto(path, checksum=True)


def load_limb(path: Path) -> Limb:
    """Read it.

    Errors  FileNotFoundError; ValueError where the file is no table of the limb or damaged.
    """
    with open_checked(path, "LIMB", FORMAT, "a table of the limb") as parts:
        axes = [parts[name].data.astype(np.float64) for name in _AXES]
        wavelength, tangent, sun, azimuth = axes
        radiance = parts[0].data.astype(np.float64)
        return Limb(parts[0].header["ALBEDO"], wavelength, tangent, sun, azimuth, radiance)


_AXES = tuple(field.name for field in fields(Limb) if field.name not in ("albedo", "radiance"))
