"""Reflectance and transmission of a cloud layer, by doubling, with exact single scattering."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, RegularGridInterpolator

from startrack.core import Floats, within

STREAMS = 12  # streams in each hemisphere
TERMS = 2 * STREAMS  # terms of the phase function; higher terms count as its forward peak
MODES = 10  # modes of the azimuth, in multiply scattered light
AZIMUTHS = 64
THINNEST, DOUBLINGS = 2.0**-22, 31  # scaled optical depth of the first layer: up to 512
KEPT = 20  # number of doublings whose layers are kept
FINE, FLUX_FINE = 4, 16  # nodes of the optical depth per doubling, for radiance and for fluxes
LOWEST = 0.04  # least cosine of a zenith angle; smaller values are set to it
ANGLES: Floats = np.linspace(0, np.arccos(LOWEST), 45)


class LayerLight(NamedTuple):
    """Reflected and transmitted light of a layer, relative to the flux of light from one direction
    through a horizontal plane.

    reflected  (n,) 1, plane albedo; also the reflectance factor in this direction under an even sky
    direct     (n,) 1, light transmitted without change of direction, forward peak included
    diffuse    (n,) 1, light transmitted in other directions
    """

    reflected: Floats
    direct: Floats
    diffuse: Floats

    @property
    def transmitted(self) -> Floats:
        """Direct and diffuse transmittance together, (n,) 1."""
        return self.direct + self.diffuse

    @property
    def emissivity(self) -> Floats:
        """Emissivity in this direction by Kirchhoff's law, (n,) 1."""
        return np.maximum(1 - self.reflected - self.transmitted, 0.0)


@dataclass(frozen=True, eq=False)
class LayerOptics:
    """A plane layer of particles in one band; made by `layer_optics`.

    albedo, asymmetry  1, single-scattering albedo; mean cosine of the scattering angle (Henyey and
                       Greenstein)
    """

    albedo: float
    asymmetry: float
    _flux: RegularGridInterpolator
    _multiple: RegularGridInterpolator

    @property
    def scale(self) -> float:
        """Ratio of scaled to true optical depth; the scaled depth excludes the forward peak."""
        return 1 - self.albedo * self.asymmetry**TERMS

    def light(self, depth: Floats, cosine: Floats) -> LayerLight:
        """Reflected and transmitted light of a beam from one direction.

        The forward peak is g^2 of the scattered light, as cut by Joseph, Wiscombe and Weinman
        (1976), J. Atmos. Sci. 33, 2452. It counts as direct light, for views of the ground and
        shadows.

        depth   (n,) 1, vertical optical depth
        cosine  (n,) 1, of the zenith angle
        """
        cosine = np.maximum(cosine, LOWEST)
        reflected, diffuse, _ = self._flux(self._place(depth, cosine)).T
        transmitted = diffuse + np.exp(-self.scale * depth / cosine)
        straight = np.exp(-(1 - self.albedo * self.asymmetry**2) * depth / cosine)
        straight = np.minimum(straight, transmitted)
        return LayerLight(reflected, straight, transmitted - straight)

    def spherical(self, depth: Floats) -> Floats:
        """Albedo under an even sky, from above or below, (n,) 1."""
        return self._flux(self._place(depth, np.ones(len(depth))))[:, 2]

    def reflectance(self, depth: Floats, sun: Floats, sensor: Floats, azimuth: Floats) -> Floats:
        """Reflectance factor, pi L / (cos(sun) E).

            R = w P(angle) / (1 - w f) / 4 / (m + m0) (1 - exp(-t (1 / m + 1 / m0)))
                + sum_k M_k(m, m0, t) cos(k azimuth),   t = (1 - w f) depth

        Source: the first term is the TMS method of Nakajima and Tanaka (1988), JQSRT 40, 51.

        sun, sensor  (n,) 1, cosines of the zenith angles
        azimuth      (n,) radian, between Sun and sensor; 0 for the same side
        """
        sun, sensor = np.maximum(sun, LOWEST), np.maximum(sensor, LOWEST)
        phase = henyey_greenstein(_angle(sun, sensor, azimuth), self.asymmetry)
        single = _single(self.scale * depth, sun, sensor) * self.albedo * phase / self.scale
        place = self._place(depth, sensor)
        modes = self._multiple(np.column_stack([place, _zenith(sun)]))
        turns = np.cos(np.arange(MODES) * azimuth[:, None])
        return single + np.einsum("nk,nk->n", modes, turns)

    def _place(self, depth: Floats, cosine: Floats) -> Floats:
        scaled = np.clip(self.scale * depth, 0, DEPTHS[-1])
        return np.stack([_stretched(scaled), _zenith(cosine)], -1)


DEPTHS: Floats = THINNEST * np.exp2(np.arange(DOUBLINGS - KEPT, DOUBLINGS + 1, dtype=np.float64))


def henyey_greenstein(cosine: Floats, asymmetry: float) -> Floats:
    """Phase function, of mean 1 over all directions."""
    g = asymmetry
    return (1 - g**2) / (1 + g**2 - 2 * g * cosine) ** 1.5


@lru_cache(maxsize=16)
def layer_optics(albedo: float, asymmetry: float) -> LayerOptics:
    """A layer of particles of one albedo and asymmetry, for all optical depths and directions.

    A thin layer scatters once; two equal layers on top of each other make a layer of twice the
    depth.

    Source: Hansen and Travis (1974), Space Sci. Rev. 16, 527, section 3.2; the phase function is
    cut as in Wiscombe (1977), J. Atmos. Sci. 34, 1408.

    albedo     1, single-scattering albedo
    asymmetry  1
    Raises     ValueError if albedo or asymmetry is out of range.
    Accuracy   model: scalar; Henyey and Greenstein's function has no rainbow, glory or halo.
               numerical: reflectance factor 0.4 % rms and 4.3 % at worst, fluxes 0.003 of the
               incident flux, against PythonicDISORT with 48 streams; optical depths from 0.03 to
               100, Sun and sensor up to 75 degrees from the zenith.
    """
    within(0, 1, albedo=albedo)
    within(-0.9, 0.9, asymmetry=asymmetry)
    cosine, weight = np.polynomial.legendre.leggauss(STREAMS)
    cosine, weight = (cosine + 1) / 2, weight / 2
    reflected, transmitted = _double(cosine, weight, *_scattering(cosine, albedo, asymmetry))
    flux = 2 * cosine * weight
    plane = np.einsum("i,tij->tj", flux, reflected[:, 0])
    diffuse = np.einsum("i,tij->tj", flux, transmitted)
    even = np.broadcast_to((plane @ flux)[:, None], plane.shape)
    fluxes = np.stack([plane, diffuse, even], -1)
    once = _scattering(cosine, albedo, asymmetry)[0] * _single(
        DEPTHS[:, None, None, None], cosine[:, None], cosine
    )
    multiple = np.moveaxis(reflected - once, 1, -1)  # (t, i, j, k)
    multiple *= np.where(np.arange(MODES), 2.0, 1.0) * (-1.0) ** np.arange(MODES)
    depths = [
        np.append(0.0, np.geomspace(DEPTHS[0], DEPTHS[-1], fine * KEPT + 1))
        for fine in (FLUX_FINE, FINE)
    ]
    fluxes = _refined(np.concatenate([0 * fluxes[:1], fluxes]), depths[0], cosine, (1,))
    multiple = _refined(np.concatenate([0 * multiple[:1], multiple]), depths[1], cosine, (1, 2))
    few, fewer = (_stretched(depth) for depth in depths)
    of_flux = RegularGridInterpolator((few, ANGLES), fluxes)
    return LayerOptics(
        albedo, asymmetry, of_flux, RegularGridInterpolator((fewer, ANGLES, ANGLES), multiple)
    )


def _scattering(cosine: Floats, albedo: float, asymmetry: float) -> tuple[Floats, Floats]:
    """Modes (k, i, j) of light scattered backwards and forwards, relative to the light outside the
    peak."""
    order = np.arange(TERMS)
    peak = asymmetry**TERMS
    moments = (2 * order + 1) * (asymmetry**order - peak) / (1 - peak)
    scaled = albedo * (1 - peak) / (1 - albedo * peak)
    azimuth = (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS * np.pi
    turns = np.cos(np.arange(MODES)[:, None] * azimuth) / AZIMUTHS
    out = []
    for way in (1, -1):  # azimuth of propagation, 0 is forwards
        angle = _angle(cosine[:, None, None], way * cosine[:, None], np.pi - azimuth)
        phase = scaled * np.polynomial.legendre.legval(angle, moments)
        out.append(np.einsum("kp,ijp->kij", turns, phase))
    return out[0], out[1]


def _double(
    cosine: Floats, weight: Floats, backwards: Floats, forwards: Floats
) -> tuple[Floats, Floats]:
    """Reflection (t, k, i, j) of layers of DEPTHS, and diffuse transmission (t, i, j) of mode 0.

    For both, radiance = 2 sum_j R_ij weight_j cosine_j times incident radiance.
    """
    flux, identity = 2 * cosine * weight, np.eye(len(cosine))
    straight = np.exp(-THINNEST / cosine)
    r = backwards * _single(THINNEST, cosine[:, None], cosine) * flux
    apart = 1 / cosine[:, None] - 1 / cosine
    both = -np.expm1(-THINNEST * apart) / np.where(apart, apart, 1.0)
    both[apart == 0] = THINNEST
    t = forwards * both * straight / 4 / (cosine[:, None] * cosine) * flux
    t = t + np.diag(straight)
    reflected, transmitted = [r / flux], [(t[0] - np.diag(straight)) / flux]
    for _ in range(DOUBLINGS):
        between = np.linalg.solve(identity - r @ r, t)
        r, t = r + t @ r @ between, t @ between
        straight = straight**2
        reflected.append(r / flux)
        transmitted.append((t[0] - np.diag(straight)) / flux)
    return np.array(reflected[-KEPT - 1 :]), np.array(transmitted[-KEPT - 1 :])


def _refined(values: Floats, depth: Floats, cosine: Floats, along: tuple[int, ...]) -> Floats:
    """Cubic splines from the ordinates to ANGLES, and from DEPTHS to a finer depth.

    An even mode of the azimuth is even over the zenith, an odd mode odd; fluxes are even.
    """
    angle = np.arccos(cosine[::-1])
    parity = (-1.0) ** np.arange(values.shape[-1]) if len(along) > 1 else 1.0
    for axis in along:
        right = np.flip(values, axis)
        around = np.concatenate([parity * values, right], axis)
        values = CubicSpline(np.concatenate([-angle[::-1], angle]), around, axis)(ANGLES)
    return CubicSpline(_stretched(np.append(0.0, DEPTHS)), values, 0)(_stretched(depth))


def _zenith(cosine: Floats) -> Floats:
    return np.arccos(np.clip(cosine, LOWEST, 1.0))


def _single(depth: Floats | float, sun: Floats, sensor: Floats) -> Floats:
    """Reflectance factor of isotropic single scattering."""
    return -np.expm1(-depth * (1 / sun + 1 / sensor)) / 4 / (sun + sensor)


def _angle(sun: Floats, sensor: Floats, azimuth: Floats) -> Floats:
    """Cosine of the scattering angle of reflected light; a sensor below 0 gives transmitted
    light."""
    sines = np.sqrt(np.maximum((1 - sun**2) * (1 - sensor**2), 0))
    return -sun * sensor - sines * np.cos(azimuth)


def _stretched(depth: Floats) -> Floats:
    """Axis of the tables: uniform in the depth of thin layers, in the logarithm of the depth of
    thick layers."""
    return np.log1p(depth / 0.02)
