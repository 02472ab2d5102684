"""How far are the reflectances of Earth scenes from integrals by independent code?

python experiments/earth_surfaces.py prints two errors. `rossli_error`: the Ross-thick kernel
against a sum over leaves of all directions, the Li-sparse kernel in the principal plane against the
overlap of shadows on a grid, and the white-sky integrals of both against Lucht, Schaaf and Strahler
(2000), table 1. `glint_error`: sunlight that waves reflect, its mean direction and its width,
against a sum over facets with the slope variance of Cox and Munk (1954).
"""

from __future__ import annotations

import argparse
import math

import command
import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_legendre

from startrack.earth.imager import Angles, Water, glint, kernel_albedos, kernels

Floats = NDArray[np.float64]
WHITE_SKY = 0.189184, -1.377622  # Lucht, Schaaf and Strahler (2000), table 1
ZENITHS = ((0, 0), (30, 0), (30, 40), (45, 60), (10, 65))  # degree, of Sun and camera


def main() -> None:
    """Print and save both errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    options = command.read(parser)
    figures = {"rossli_error": rossli_error(), "glint_error": glint_error()}
    for name, value in figures.items():
        print(f"{name} {100 * value:.3f} %")
    command.save(options, figures)


def rossli_error() -> float:
    """Largest difference of a kernel from its reference, relative to the kernel or to 0.2.

    Kernels pass through zero, and a reflectance is a sum in which they have weights below one.
    """
    worst = 0.0
    for sun, camera in np.radians(ZENITHS):
        for azimuth in (0.0, math.pi / 3, math.pi):
            one, other = _vector(sun, 0.0), _vector(camera, azimuth)
            volumetric, geometric = kernels(_angles(one, other))
            worst = max(worst, _relative(volumetric[0], _leaves(one, other)))
            if azimuth != math.pi / 3:  # Li's overlap is exact in the principal plane only
                worst = max(worst, _relative(geometric[0], _crowns(sun, camera, azimuth)))
    zenith = np.linspace(0, math.pi / 2, len(kernel_albedos()[0]))
    for table, published in zip(kernel_albedos(), WHITE_SKY, strict=True):
        white = float(np.trapezoid(table * np.sin(2 * zenith), zenith))
        worst = max(worst, _relative(white, published))
    return worst


def glint_error(wind: float = 5.0, zenith: float = math.radians(30)) -> float:
    """Largest relative difference of the energy, mean direction, width and peak of glint."""
    water = Water(wind)
    pairs = zip(_of_factor(water, zenith), _of_facets(wind, zenith, water.refraction), strict=True)
    return max(abs(one / other - 1) for one, other in pairs)


def _leaves(sun: Floats, camera: Floats, count: int = 120) -> float:
    """The Ross-thick kernel: leaves of all directions that scatter equally to both sides.

    3 / 8 Int |l.s| |l.v| dl over the sphere is the mean light that leaves receive and show.
    """
    node, weight = roots_legendre(count)
    leaf = _directions(node, count)
    both = (np.abs(leaf @ sun) * np.abs(leaf @ camera)).mean(1)
    caught = 3 / 8 * 2 * math.pi * float(weight @ both)
    return caught / float(sun[2] + camera[2]) - math.pi / 4


def _crowns(sun: float, camera: float, azimuth: float, count: int = 600) -> float:
    """The Li-sparse kernel: spheres of radius one, two above the ground, and their shadows.

    Area that is neither shaded nor hidden, and crowns that are sunlit and visible, over pi.
    """
    reach = 2 + 2 * max(math.tan(sun), math.tan(camera)) + 1 / math.cos(max(sun, camera))
    x = (np.arange(2 * count) + 0.5) / count * reach - reach
    y = (np.arange(count // 2) + 0.5) / (count // 2)
    x, y = np.meshgrid(x, y)

    def covered(zenith: float, turn: float) -> NDArray[np.bool_]:
        middle = 2 * math.tan(zenith) * math.cos(turn)
        return ((x - middle) * math.cos(zenith)) ** 2 + y**2 < 1

    cell = reach / count * 2 / (count // 2)  # both halves
    shaded, hidden = covered(sun, 0.0), covered(camera, azimuth)
    either = float((shaded | hidden).sum()) * cell
    # Sunlit part of the sphere as the camera sees it: a half-ellipse and half a disc.
    lit = math.pi * (1 + float(_vector(sun, 0.0) @ _vector(camera, azimuth))) / 2
    return (-either + lit / math.cos(camera) / math.cos(sun)) / math.pi


def _of_facets(wind: float, zenith: float, refraction: float, count: int = 600) -> list[float]:
    """Moments of the light that facets reflect, one slope after the other."""
    variance = 0.003 + 0.00512 * wind
    slope = np.linspace(-6, 6, count) * math.sqrt(variance / 2)
    x, y = np.meshgrid(slope, slope)
    share = np.exp(-(x**2 + y**2) / variance)
    share /= share.sum()
    normal = np.stack([-x, -y, np.ones_like(x)], -1)
    sun = _vector(zenith, 0.0)
    shown = np.maximum(normal @ sun, 0)  # area to the Sun, of a facet above one of the horizon
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    outside = np.arccos(np.clip(normal @ sun, 0, 1 - 1e-9))
    inside = np.arcsin(np.sin(outside) / refraction)  # Snell, then Fresnel by angles
    less, more = outside - inside, outside + inside
    mirrored = ((np.sin(less) / np.sin(more)) ** 2 + (np.tan(less) / np.tan(more)) ** 2) / 2
    away = 2 * np.cos(outside)[..., None] * normal - sun
    energy = np.where(away[..., 2] > 0, share * shown * mirrored, 0.0)
    return _moments(energy, away, zenith)


def _of_factor(water: Water, zenith: float, count: int = 300) -> list[float]:
    """The same moments by the reflectance factor, over the hemisphere of the camera."""
    node, weight = roots_legendre(count)
    away = _directions((node + 1) / 2, count)
    sun = _vector(zenith, 0.0)
    phase = away @ sun
    angles = Angles(np.full_like(phase, sun[2]), away[..., 2], phase)
    energy = glint(water, angles) / math.pi * away[..., 2] * sun[2]
    return _moments(energy * weight[:, None] / 2 * math.pi / count, away, zenith)


def _moments(energy: Floats, away: Floats, zenith: float, peak: float = 0.03) -> list[float]:
    """Energy, mean direction, width, and energy within some 0.03 rad of the mirror's direction."""
    total = float(energy.sum())
    mean = (energy[..., None] * away).sum((0, 1)) / total
    spread = (energy[..., None] * (away - mean) ** 2).sum((0, 1)) / total
    aside = ((away - _vector(zenith, math.pi)) ** 2).sum(-1)
    near = float((energy * np.exp(-aside / (2 * peak**2))).sum())
    return [total, float(mean[0]), float(mean[2]), *(float(one) ** 0.5 for one in spread), near]


def _directions(up: Floats, count: int) -> Floats:
    """Unit vectors (n, 2 count, 3) at cosines (n,) from the vertical and all azimuths."""
    azimuth = (np.arange(2 * count) + 0.5) * math.pi / count
    flat = np.sqrt(1 - up[:, None] ** 2)
    level = np.broadcast_to(up[:, None], (len(up), 2 * count))
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), level], -1)


def _vector(zenith: float, azimuth: float) -> Floats:
    across = math.sin(zenith)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), math.cos(zenith)])


def _angles(sun: Floats, camera: Floats) -> Angles:
    return Angles(*(np.array([float(one)]) for one in (sun[2], camera[2], sun @ camera)))


def _relative(value: float, reference: float) -> float:
    return abs(float(value) - reference) / max(abs(reference), 0.2)


if __name__ == "__main__":
    command.run(main)
