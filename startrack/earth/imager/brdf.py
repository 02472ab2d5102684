"""Reflectance of land, water and snow from the directions of Sun and camera.

A reflectance factor is the radiance of a surface towards the camera over the radiance of a white
Lambertian surface: pi times the BRDF.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Curve, Floats, Parameters, Range, Unit, parameter
from startrack.earth.terrain import Ground

GRAZING = 1e-3  # least cosine, against division by zero
ZENITHS, AZIMUTHS = 48, 64  # nodes of the integrals over a hemisphere
NODES = 91  # of tables over the zenith angle, every degree
SLOPES = 32  # nodes along each axis of the integral over waves
FOAM = 0.22  # reflectance of white caps; Koepke (1984), Applied Optics 23, 1816
NONE = Curve((), (0.0,))


@dataclass(frozen=True)
class RossLi:
    """Weights of the volumetric and geometric kernels, besides `reflectance`, the isotropic weight.

    Weights are defined as in the product MCD43 of MODIS; each depends on wavelength.
    """

    volumetric: Curve = NONE
    geometric: Curve = NONE


class Water(Parameters):
    """Waves on water; the light from below the surface has the cover's `reflectance`."""

    wind: float = parameter(
        "12.5 m above the water", unit=Unit("m / s"), limit=Range(0, 20), default=5.0
    )
    refraction: float = parameter("1, refractive index", limit=Range(1.01, 3), default=1.34)

    @property
    def slope_variance(self) -> float:
        """Mean square slope of the waves, along and across the wind together.

            s^2 = 0.003 + 0.00512 wind

        Source: Cox and Munk (1954), Journal of the Optical Society of America 44, 838.
        """
        return 0.003 + 0.00512 * self.wind

    @property
    def foam(self) -> float:
        """Fraction of the water under white caps.

            2.95e-6 wind^3.52

        Source: Monahan and O'Muircheartaigh (1980), Journal of Physical Oceanography 10, 2094.
        """
        return 2.95e-6 * self.wind**3.52


@dataclass(frozen=True)
class Snow:
    """Deep snow; the cover's `reflectance` is the white-sky albedo."""


Law = RossLi | Water | Snow


class Angles(NamedTuple):
    """Directions at n points of a surface, as cosines.

    sun     (n,) between normal and Sun; above 0
    camera  (n,) between normal and camera; above 0
    phase   (n,) between Sun and camera
    """

    sun: Floats
    camera: Floats
    phase: Floats


def angles_of(ground: Ground) -> Angles:
    """Angles on the slopes that rays meet; a Sun behind a slope is moved to the slope's horizon."""
    sun, camera = np.cos(ground.sun_incidence), np.cos(ground.incidence)
    return Angles(
        np.maximum(sun, GRAZING), np.maximum(camera, GRAZING), -ground.direction @ ground.sun
    )


def direct_factor(
    law: Law, rho: Floats, weights: tuple[float, float, float], angles: Angles
) -> Floats:
    """Reflectance factor (n,) for sunlight; at least 0, above 1 in glint.

    rho       (n,) 1, the cover's reflectance with its texture
    weights   1, weights of the isotropic, volumetric and geometric kernels in the band; only for
              RossLi
    Accuracy  model: negative values near the horizon are set to 0, which raises the mean over all
              directions by some 0.7 %.
    """
    if isinstance(law, Water):
        whitened = law.foam * FOAM
        return rho + (1 - law.foam) * glint(law, angles) + whitened
    if isinstance(law, Snow):
        return snow_factor(rho, angles)
    volumetric, geometric = kernels(angles)
    return _ross_li(rho, weights, volumetric, geometric)


def sky_factor(
    law: Law, rho: Floats, weights: tuple[float, float, float], camera: Floats | None
) -> Floats:
    """Reflectance factor (n,) in [0, 1] for light from all of a uniform sky.

    By reciprocity this is the black-sky albedo for a Sun in the direction of the camera. The
    emissivity is one minus this factor.

    camera   (n,) 1, cosine between normal and camera; None for the mean over all directions, the
             white-sky albedo
    """
    if isinstance(law, Water):
        mirror = _at(_wave_albedo(law), camera)
        return np.clip(rho + (1 - law.foam) * mirror + law.foam * FOAM, 0.0, 1.0)
    if isinstance(law, Snow):
        return rho if camera is None else rho ** _escape(camera)
    volumetric, geometric = (_at(albedo, camera) for albedo in kernel_albedos())
    return np.minimum(_ross_li(rho, weights, volumetric, geometric), 1.0)


def _ross_li(
    rho: Floats, weights: tuple[float, float, float], volumetric: Floats, geometric: Floats
) -> Floats:
    isotropic, of_volume, of_shape = weights
    if isotropic <= 0:
        return np.zeros_like(rho)
    shape = 1 + (of_volume * volumetric + of_shape * geometric) / isotropic
    return np.maximum(rho * shape, 0.0)


def kernels(angles: Angles) -> tuple[Floats, Floats]:
    """The kernels Ross-thick and Li-sparse-reciprocal.

        volumetric = ((pi / 2 - x) cos x + sin x) / (cos s + cos v) - pi / 4
        geometric  = O - sec s - sec v + (1 + cos x) / 2 sec s sec v
        O          = (t - sin t cos t) (sec s + sec v) / pi
        cos t      = 2 sqrt(D^2 + (tan s tan v sin p)^2) / (sec s + sec v), at most 1
        D^2        = tan^2 s + tan^2 v - 2 tan s tan v cos p

    s and v are the zenith angles of Sun and camera, p is the azimuth between them, x the phase
    angle. Crowns are as high as wide; the height of their centre is twice the radius.

    Source: Lucht, Schaaf and Strahler (2000), IEEE TGRS 38, 977, eqs. (37) to (44).

    Returns   (n,) 1 each
    Accuracy  model: meant for zenith angles up to some 70 degrees; the geometric kernel falls
              without limit towards the horizon.
    """
    sun, camera, phase = angles
    x = np.arccos(np.clip(phase, -1, 1))
    volumetric = ((math.pi / 2 - x) * phase + np.sin(x)) / (sun + camera) - math.pi / 4
    along = phase / (sun * camera) - 1  # tan s tan v cos p
    tan_s, tan_v = 1 / sun**2 - 1, 1 / camera**2 - 1  # squared tangents
    apart = np.maximum(tan_s + tan_v - 2 * along, 0)
    across = np.maximum(tan_s * tan_v - along**2, 0)
    paths = 1 / sun + 1 / camera
    cos_t = np.minimum(2 * np.sqrt(apart + across) / paths, 1.0)
    t = np.arccos(cos_t)
    overlap = (t - np.sin(t) * cos_t) * paths / math.pi
    return volumetric, overlap - paths + (1 + phase) / (2 * sun * camera)


def glint(water: Water, angles: Angles) -> Floats:
    """Reflectance factor (n,) of waves with Gaussian slopes, equal along and across the wind.

        R = pi F(w) P / (4 cos s cos v cos^4 b),   P = exp(-tan^2 b / s^2) / (pi s^2)

    b is the slope that mirrors the Sun into the camera, w the angle of incidence on it, F the
    Fresnel reflectance for unpolarised light.

    Source: Cox and Munk (1954).

    Accuracy  model: no shadowing and a single reflection; too bright beyond some 70 degrees.
    """
    sun, camera, phase = angles
    incident = np.sqrt(np.maximum((1 + phase) / 2, GRAZING**2))
    upright = np.minimum((sun + camera) / (2 * incident), 1.0)
    steep = 1 / upright**2 - 1
    density = np.exp(-steep / water.slope_variance) / (math.pi * water.slope_variance)
    reflected = fresnel(incident, water.refraction)
    return math.pi * reflected * density / (4 * sun * camera * upright**4)


def fresnel(incident: Floats, refraction: float) -> Floats:
    """Unpolarised reflectance of a smooth dielectric, at (n,) cosines of incidence."""
    inside = np.sqrt(refraction**2 - 1 + incident**2)
    across = (incident - inside) / (incident + inside)
    along = (refraction**2 * incident - inside) / (refraction**2 * incident + inside)
    return (across**2 + along**2) / 2


def snow_factor(albedo: Floats, angles: Angles) -> Floats:
    """Reflectance factor (n,) of snow.

        R  = R0 A^(u(s) u(v) / R0),   u = 3 / 7 (1 + 2 cos)
        R0 = (1.247 + 1.186 (cos s + cos v) + 5.157 cos s cos v + p) / (4 (cos s + cos v))
        p  = 11.1 exp(-0.087 T) + 1.1 exp(-0.014 T), T the scattering angle in degree

    Source: Kokhanovsky and Breon (2012), IEEE GRSL 9, 928.

    albedo    (n,) 1, albedo of the snow in diffuse light
    Accuracy  model: grains much larger than the wavelength, no layers; one albedo for the band.
    """
    sun, camera, phase = angles
    scattering = 180 - np.degrees(np.arccos(np.clip(phase, -1, 1)))
    grains = 11.1 * np.exp(-0.087 * scattering) + 1.1 * np.exp(-0.014 * scattering)
    white = (1.247 + 1.186 * (sun + camera) + 5.157 * sun * camera + grains) / (4 * (sun + camera))
    return white * albedo ** (_escape(sun) * _escape(camera) / white)


def _escape(cosine: Floats) -> Floats:
    return 3 / 7 * (1 + 2 * cosine)


def _at(table: Floats, camera: Floats | None) -> Floats:
    """Values of a table over the zenith angle, or their mean over the hemisphere."""
    zenith = np.linspace(0, math.pi / 2, NODES)
    if camera is None:
        return np.array(np.trapezoid(table * np.sin(2 * zenith), zenith))
    return np.interp(np.arccos(np.clip(camera, 0, 1)), zenith, table)


@lru_cache(maxsize=1)
def kernel_albedos() -> tuple[Floats, Floats]:
    """Black-sky integrals (91,) of both kernels, for the Sun at each degree from the zenith.

    (1 / pi) Int k cos v dw over the hemisphere of the camera
    """
    node, weight = np.polynomial.legendre.leggauss(ZENITHS)
    camera = (node[:, None] + 1) / 2
    azimuth = (np.arange(AZIMUTHS) + 0.5) * math.pi / AZIMUTHS
    out = np.empty((2, NODES))
    for n, zenith in enumerate(np.linspace(0, math.pi / 2, NODES)):
        sun = max(math.cos(zenith), GRAZING)
        phase = sun * camera + math.sqrt(1 - sun**2) * np.sqrt(1 - camera**2) * np.cos(azimuth)
        seen = Angles(np.full_like(phase, sun), np.broadcast_to(camera, phase.shape), phase)
        for kernel, table in zip(kernels(seen), out, strict=True):
            table[n] = weight @ (camera[:, 0] * kernel.mean(1))
    return out[0], out[1]


def _wave_albedo(water: Water) -> Floats:
    """Fraction (91,) of light that waves mirror, for the Sun at each degree from the zenith.

    The mean over slopes is weighted by the area that faces the Sun.
    """
    node, weight = np.polynomial.hermite.hermgauss(SLOPES)
    slope = math.sqrt(water.slope_variance) * node
    x, y = np.meshgrid(slope, slope)
    share = np.outer(weight, weight)
    zenith = np.linspace(0, math.pi / 2, NODES)[:, None, None]
    shown = np.maximum(np.cos(zenith) - x * np.sin(zenith), 0)
    mirrored = fresnel(shown / np.sqrt(1 + x**2 + y**2), water.refraction)
    return (share * shown * mirrored).sum((1, 2)) / (share * shown).sum((1, 2))
