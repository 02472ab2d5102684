"""The Earth's bright limb: table of radiance over tangent height and Sun, and its light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np

from startrack.core import Floats, Refused
from startrack.io import open_checked, shipped
from startrack.scene.bodies import EARTH_ALBEDO, Earth
from startrack.scene.photometry import WAVELENGTH
from startrack.space import EARTH_RADIUS

FORMAT = 1  # of the file
DARK = 1e-12  # 1 / sr, least radiance over the Sun's irradiance: its logarithm must be finite


@dataclass(frozen=True, eq=False)
class Limb:
    """Radiance along lines of sight above the ground, over the Sun's irradiance.

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
        tangent     (n,) metre; zero radiance above the table
        sun         (n,) radian; zero radiance beyond the table
        azimuth     (n,) radian
        Returns     (n, k) 1 / sr, over the Sun's irradiance
        Raises      ValueError where a tangent height lies under the table or is not a number.
        Accuracy    model: that of the table's air, straight rays; no twilight with the Sun below
                    the horizon. numerical: 3 % between the nodes, linear in the logarithm.
        """
        from scipy.interpolate import RegularGridInterpolator  # 0.1 s; few scenes have an Earth

        if not (tangent >= self.tangent[0]).all():
            raise Refused(f"tangent must be at least {self.tangent[0]:g} m, got {np.min(tangent)}")
        axes = np.log(self.wavelength), self.tangent, self.sun, self.azimuth
        logarithm = RegularGridInterpolator(axes, np.log(np.maximum(self.radiance, DARK)))
        turned = np.arccos(np.cos(azimuth))
        nodes = (
            np.clip(tangent, *self.tangent[[0, -1]]),
            np.clip(sun, *self.sun[[0, -1]]),
            np.clip(turned, *self.azimuth[[0, -1]]),
        )
        found = np.stack(
            [
                np.exp(logarithm(np.stack([np.full(len(tangent), one), *nodes], -1)))
                for one in np.log(wavelength)
            ],
            -1,
        )
        dark = (tangent > self.tangent[-1]) | (sun > self.sun[-1])
        return np.where(dark[:, None], 0.0, found)


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

    Raises  FileNotFoundError; ValueError where the file is no table of the limb or damaged.
    """
    with open_checked(path, "LIMB", FORMAT, "a table of the limb") as parts:
        axes = [parts[name].data.astype(np.float64) for name in _AXES]
        wavelength, tangent, sun, azimuth = axes
        radiance = parts[0].data.astype(np.float64)
        return Limb(parts[0].header["ALBEDO"], wavelength, tangent, sun, azimuth, radiance)


_AXES = tuple(field.name for field in fields(Limb) if field.name not in ("albedo", "radiance"))


def limb_light(
    earth: Earth, line: Floats, air: str = "molecules"
) -> Iterator[tuple[Floats, Floats]]:
    """The sunlit air above the horizon.

    line     (n, 3) unit vectors, ICRS axes
    air      molecules or rural, as in Scene
    Yields    (k,) photon / s / m^2 in each bin and (n,) 1 / sr; the light is the sum of their
              products. One pair for each wavelength of the table, which applies to the nearest bins
    Accuracy  model: that of `Limb`, over a ground of albedo 0.3; the Earth is a sphere.
    """
    table = _table(air)
    along = line @ earth.centre
    nearest = along[:, None] * line - earth.centre  # from the Earth's centre
    distance = np.linalg.norm(nearest, axis=1)
    height = distance - EARTH_RADIUS
    through = np.flatnonzero((along > 0) & (height >= 0) & (height < table.tangent[-1]))
    if not len(through):
        return
    zenith = nearest[through] / distance[through, None]
    cosine = np.clip(zenith @ earth.sun, -1, 1)
    level = earth.sun - cosine[:, None] * zenith
    towards = np.einsum("ij,ij->i", line[through], level)
    azimuth = np.arccos(np.clip(towards / np.maximum(np.linalg.norm(level, axis=1), 1e-12), -1, 1))
    found = table(table.wavelength, height[through], np.arccos(cosine), azimuth)
    sunlight = earth.light * np.pi / EARTH_ALBEDO
    nearest_wavelength = np.argmin(np.abs(WAVELENGTH - table.wavelength[:, None]), axis=0)
    for i in range(len(table.wavelength)):
        fraction = np.zeros(len(line))
        fraction[through] = found[:, i]
        yield np.where(nearest_wavelength == i, sunlight, 0.0), fraction


@lru_cache(maxsize=2)
def _table(air: str) -> Limb:
    name = "limb" if air == "molecules" else f"limb-{air}"
    return load_limb(shipped(f"atmosphere/{name}.fits"))
