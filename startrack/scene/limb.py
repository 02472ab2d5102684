"""Light of the Earth's air: its bright limb by day, its airglow by night."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused, nm
from startrack.io import open_checked, shipped
from startrack.scene.bodies import EARTH_ALBEDO, Earth
from startrack.scene.photometry import BIN, WAVELENGTH
from startrack.space import EARTH_RADIUS

FORMAT = 1  # of the file
DARK = 1e-12  # 1 / sr, least radiance over the Sun's irradiance, for a finite logarithm
RAYLEIGH = 1e10 / (4 * np.pi)  # photon / s / m^2 / sr
HIGHEST = 300e3  # metre, of all shells
# Night glow seen from the zenith, Leinert et al. (1998), A&A Supplement Series 127, 1, table 13:
# 250 R of O at 557.7 nm, 30 to 100 R of Na, 60 R of O at 630 nm; 2.5 R / nm of continuum. The bands
# of OH above 600 nm follow from the brightness of the night sky: 16 R / nm at 640 nm and 28 R / nm
# at 800 nm, from R 20.9 and I 19.7 mag per square arcsecond (Patat 2003, A&A 400, 1183), less the
# zodiacal light; above 900 nm they are an assumption.
CONTINUUM = 2.5  # R / nm
OH_AT: Floats = np.array([600.0, 640, 700, 800, 900, 1100]) * nm
OH: Floats = np.array([0.0, 8, 12, 25, 40, 90])  # R / nm


@dataclass(frozen=True, eq=False)
class Limb:
    """Radiance along lines of sight above the ground, over the Sun's irradiance.

    albedo      1, of the ground below
    wavelength  (k,) metre
    tangent     (t,) metre, height of the point nearest to the ground
    sun         (s,) radian, zenith angle of the Sun there
    azimuth     (p,) radian, from the Sun's azimuth to the azimuth of the incoming light: 0 if the
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
        Raises      ValueError if a tangent height lies under the table or is not a number.
        Accuracy    model: that of the table's air, straight rays; no twilight with the Sun below
                    the horizon. numerical: 3 % between the nodes, linear in the logarithm.
        """
        from scipy.interpolate import RegularGridInterpolator  # 0.1 s; few scenes have an Earth

        if not (tangent >= self.tangent[0]).all():
            raise Refused(f"tangent must be at least {self.tangent[0]:g} m, got {np.min(tangent)}")
        axes = np.log(self.wavelength), self.tangent, self.sun, self.azimuth
        logarithm = RegularGridInterpolator(axes, np.log(np.maximum(self.radiance, DARK)))
        half_turn = np.arccos(np.cos(azimuth))  # in [0, pi], as the table
        nodes = [
            np.clip(place, axis[0], axis[-1])
            for place, axis in zip((tangent, sun, half_turn), axes[1:], strict=True)
        ]
        radiance = np.empty((len(tangent), len(wavelength)))
        for k, at in enumerate(np.log(wavelength)):
            radiance[:, k] = np.exp(logarithm(np.stack([np.full(len(tangent), at), *nodes], -1)))
        dark = (tangent > self.tangent[-1]) | (sun > self.sun[-1])
        return np.where(dark[:, None], 0.0, radiance)


def load_limb(path: Path) -> Limb:
    """Read a table of the limb.

    Raises  FileNotFoundError; ValueError if the file is not a table of the limb or damaged.
    """
    with open_checked(path, "LIMB", FORMAT, "a table of the limb") as parts:
        arrays = (parts[name].data.astype(np.float64) for name in (*AXES, 0))
        return Limb(parts[0].header["ALBEDO"], *arrays)


AXES = "wavelength", "tangent", "sun", "azimuth"


def limb_light(
    earth: Earth, line: Floats, air: str = "molecules"
) -> Iterator[tuple[Floats, Floats]]:
    """The sunlit air above the horizon.

    line     (n, 3) unit vectors, ICRS axes
    air      molecules or rural, as in Scene
    Yields    (k,) photon / s / m^2 in each bin and (n,) 1 / sr; the light is the sum of their
              products. One pair for each wavelength of the table, for the bins nearest to it
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
    radiance = table(table.wavelength, height[through], np.arccos(cosine), azimuth)
    sunlight = earth.light * np.pi / EARTH_ALBEDO
    nearest_wavelength = np.argmin(np.abs(WAVELENGTH - table.wavelength[:, None]), axis=0)
    for i in range(len(table.wavelength)):
        fraction = np.zeros(len(line))
        fraction[through] = radiance[:, i]
        yield np.where(nearest_wavelength == i, sunlight, 0.0), fraction


@lru_cache(maxsize=2)
def _table(air: str) -> Limb:
    name = "limb" if air == "molecules" else f"limb-{air}"
    return load_limb(shipped(f"atmosphere/{name}.fits"))


class Shell(NamedTuple):
    """Air of uniform emission between two heights, metre; lines are (wavelength, rayleigh)."""

    low: float
    high: float
    lines: tuple[tuple[float, float], ...]
    bands: bool


SHELLS = (
    Shell(82e3, 98e3, ((557.7 * nm, 250.0), (589.3 * nm, 60.0)), bands=True),
    Shell(200e3, HIGHEST, ((630.0 * nm, 60.0),), bands=False),
)


def airglow(earth: Earth, line: Floats) -> Iterator[tuple[Floats, Floats]]:
    """The shells' light.

        brightness = zenith brightness * path inside the shell / its thickness

    line     (n, 3) unit vectors, ICRS axes
    Yields   (k,) photon / s / m^2 / sr in each bin and (n,) 1; the light is the sum of products
    Accuracy  model: a factor of two from night to night; the same by day, when the limb is much
              brighter; no structure; the Earth is a sphere; a line is spread over 10 nm to each
              side, so that a narrower filter passes only a part of it.
    """
    for shell in SHELLS:
        outer, inner = (_path(earth, line, height) for height in (shell.high, shell.low))
        yield spectrum(shell), (outer - inner) / (shell.high - shell.low)


@lru_cache(maxsize=4)
def spectrum(shell: Shell) -> Floats:
    """(k,) photon / s / m^2 / sr in each bin, of the shell seen in the zenith."""
    rayleigh = np.zeros_like(WAVELENGTH)
    if shell.bands:
        rayleigh += (CONTINUUM + np.interp(WAVELENGTH, OH_AT, OH)) * (BIN / nm)
    for wavelength, strength in shell.lines:
        rayleigh += strength * np.maximum(1 - np.abs(WAVELENGTH - wavelength) / BIN, 0.0)
    return rayleigh * RAYLEIGH


def _path(earth: Earth, line: Floats, height: float) -> Floats:
    """(n,) metre of each line of sight inside a sphere around the Earth, up to the ground."""
    along = line @ earth.centre
    aside = earth.centre @ earth.centre - along**2  # squared distance of the line from the centre
    half = np.sqrt(np.maximum((EARTH_RADIUS + height) ** 2 - aside, 0))
    ground = np.sqrt(np.maximum(EARTH_RADIUS**2 - aside, 0))
    hits = (aside < EARTH_RADIUS**2) & (along > 0)
    end = np.where(hits, along - ground, along + half)
    return np.maximum(end - np.maximum(along - half, 0), 0) * (half > 0)
