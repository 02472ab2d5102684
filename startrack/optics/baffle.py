"""Baffles: stray light of Sun, Moon and Earth past them, their transmittance by their geometry."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import (
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    kernel,
    parameter,
)
from startrack.optics.parameters import Optics

MAP_NODES = 17  # nodes along a side of the map of stray light: 1 % error between them
ALUMINIUM = 2700.0  # kg / m^3
WALL = 1e-3  # metre, of tube and vanes
PATHS = 16384  # number of paths from the lens; chosen by hand: time against noise
BOUNCES = 6  # bounces of each path; after them black paint leaves 1e-8 of the light
PLACES = 16  # number of paths whose places on the lens are used for light off edges
AZIMUTHS = 48  # points on the edge of each vane
NODES = 40  # number of angles of the curve
GRAZING = math.radians(89.5)  # last angle of the curve; beyond it no light enters
DARK = 1e-16  # transmittance beyond the last angle
# Of polished and clean lenses: the width of the core (radian) and the slope of a Harvey law.
SHOULDER, SLOPE = 0.02, -1.5
NOTHING, LENS = -1, -2  # codes of a ray's target other than vanes, wall and floor


class Baffle(Parameters):
    """Point-source transmittance (PST) of a baffle and the lens behind it.

    The PST is the irradiance on the detector over the irradiance of a distant source at the
    entrance, normal to its rays. It is given without the transmission of the glass, which applies
    to stray light and stars alike.
    """

    angle: tuple[float, ...] = parameter(
        "radian between the source and the line of sight, increasing",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
    )
    transmittance: tuple[float, ...] = parameter(
        "positive; its logarithm is linear between the angles, constant outside", limit=POSITIVE
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.angle) != len(self.transmittance) or not self.angle:
            raise Refused(
                "angle and transmittance must have the same length of one or more, got "
                f"{len(self.angle)} and {len(self.transmittance)}"
            )
        if any(low >= high for low, high in pairwise(self.angle)):
            raise Refused(f"angle must increase, got {self.angle}")

    def __call__(self, angle: Floats) -> Floats:
        """Transmittance (...) at angles (...) in radian."""
        return np.exp(np.interp(angle, self.angle, np.log(self.transmittance)))


def stray_light(
    light: core.Light, baffle: Baffle, optics: Optics, icrs_to_camera: Rotation, camera: core.Camera
) -> core.Light:
    """The light with stray light, as diffuse light of the same irradiance on the detector.

        radiance = irradiance PST(angle) focal_length^2 / area

    because a background of radiance L has the irradiance L area / focal_length^2 on the detector.

    Accuracy  model: stray light at a point of the frame depends only on the angle between the
              source and the line of sight of that point; no ghosts. A source in the field has the
              first value of the curve. numerical: 1 % between the 17 x 17 nodes of its map, if the
              curve is not steeper than a decade in half a frame.
    """
    line = icrs_to_camera.inv().apply(camera.lattice(MAP_NODES))
    spread = optics.focal_length**2 / optics.area
    stray = []
    for source in light.stray_sources:
        angle = np.arccos(np.clip(line @ source.direction.T, -1, 1))
        fraction = (baffle(angle) @ source.fraction * spread).reshape(MAP_NODES, MAP_NODES)
        stray.append(core.DiffuseLight(source.photon_irradiance, fraction))
    return replace(light, diffuse=(*light.diffuse, *stray))


class BaffleTube(Parameters):
    """A cylinder with vanes before the lens, painted black inside, and the scattering of the lens.

    The edges of the vanes lie on the cone that leaves the field free, so that the lens sees no lit
    side of a vane. Each vane hides the wall behind it from the lens. The number of vanes follows
    from length and diameter.
    """

    length: float = parameter("from the lens to the entrance", unit=Unit("m", "mm"), limit=POSITIVE)
    diameter: float | None = parameter(
        "diameter of the wall; None: a quarter larger than the entrance",
        unit=Unit("m", "mm"),
        limit=POSITIVE,
        default=None,
    )
    reflectance: float = parameter(
        "diffuse reflectance of the black paint; 0.03 to 0.06 for paints for space",
        limit=Range(0, 1),
        default=0.05,
    )
    edge: float = parameter(
        "thickness of the edges of the vanes",
        unit=Unit("m", "um"),
        limit=NON_NEGATIVE,
        default=50e-6,
    )
    scatter: float = parameter(
        "total fraction of light that the surfaces of the lens scatter",
        limit=Range(0, 0.5),
        default=1e-3,
    )

    def shape(self, lens: float, field: float) -> Shape:
        """The vanes of a tube before a lens.

        lens    metre, diameter of its entrance pupil
        field   radian, the half diagonal
        Raises  Refused if the wall is not wider than the entrance.
        """
        radius, slope = lens / 2, math.tan(field)
        entrance = radius + self.length * slope
        wall = self.diameter / 2 if self.diameter else 1.25 * entrance
        if wall <= entrance:
            raise Refused(
                "tube.diameter must be wider than the entrance that leaves the field free, "
                f"{2e3 * entrance:.4g} mm, got {2e3 * wall:.4g} mm"
            )
        height = [min(wall - radius, self.length)]  # the length of the first cell equals its depth
        while height[-1] < self.length:
            edge = radius + height[-1] * slope
            height.append(height[-1] * (wall + radius) / (edge + radius))
        height[-1] = self.length
        at = np.array(height)
        return Shape(radius, wall, at, radius + at * slope)

    def mass(self, lens: float, field: float) -> float:
        """Mass, kilogram, of walls and vanes of aluminium, 1 mm thick."""
        shape = self.shape(lens, field)
        discs = math.pi * float((shape.wall**2 - shape.edge**2).sum())
        return ALUMINIUM * WALL * (2 * math.pi * shape.wall * self.length + discs)

    def volume(self, lens: float, field: float) -> float:
        """Volume of the cylinder, cubic metre."""
        return math.pi * self.shape(lens, field).wall ** 2 * self.length

    def cutoff(self, lens: float, field: float) -> float:
        """Radian: at larger angles no light falls directly on the lens."""
        shape = self.shape(lens, field)
        return math.atan((shape.edge[-1] + shape.radius) / self.length)


@core.printed
class Shape(NamedTuple):
    """Radius of the lens and of the wall; height above the lens and edge of each vane (n,), metre.

    The last vane is the entrance.
    """

    radius: float
    wall: float
    height: Floats
    edge: Floats


@lru_cache(maxsize=64)
def transmittance_of(tube: BaffleTube, lens: float, field: float, f_number: float) -> Baffle:
    """The point-source transmittance of a tube and the lens behind it.

        PST = (T_direct B(angle) + integral of T_scattered B) pi / (4 N^2)

    The first stage T is the light on the lens, over the light at the entrance. Its parts are:
    direct light; light that vanes, wall and floor scatter diffusely to the lens (by paths backwards
    from the lens, connected to the Sun at each point); and light off the edges of the vanes, all of
    which are visible from the lens. The second stage is scattering by the lens to the detector: its
    BSDF B by Harvey's law, into the cone of the f-number N.

    Source    E. Fest (2013), Stray Light Analysis and Control, SPIE, ch. 4 and 7: first-order
              estimates, Harvey's law for polished surfaces; placing of vanes ch. 9.
    Arguments as for `BaffleTube.shape`; `f_number` of the lens
    Accuracy  model: paint scatters by Lambert's law, also at grazing incidence, where real paint
              reflects more; the lens scatters like clean surfaces; no housing behind the lens.
              numerical: 6 % rms beyond the cutoff, by `PATHS` fixed paths. The paths are equal for
              all tubes, so that the curve changes smoothly with the geometry. It takes 0.1 s.
    """
    shape, slope = tube.shape(lens, field), SLOPE / 2
    cutoff = min(tube.cutoff(lens, field), (field + GRAZING) / 2)
    near = np.linspace(field, cutoff, NODES // 3)
    far = np.linspace(cutoff, GRAZING, NODES - len(near) + 1)[1:]
    angle = np.concatenate([near, far])
    from scipy.stats.qmc import Sobol  # half a second, for designs with a tube alone

    size = 2 + 2 * BOUNCES
    random = Sobol(size, rng=np.random.default_rng(0)).random(PATHS)
    direct = _direct_light(*shape, angle, random)
    scattered = _scattered_light(*shape, angle, random, slope)
    edges = tube.edge * _light_off_edges(*shape, angle, random[:PLACES], slope)
    paint = tube.reflectance ** np.arange(1, BOUNCES + 1)
    bsdf = (1 + (np.sin(angle) / SHOULDER) ** 2) ** slope
    light = direct * bsdf + scattered @ paint + tube.reflectance * edges
    pst = _per_steradian(tube.scatter) * light * math.pi / (4 * f_number**2)
    return Baffle((*angle.tolist(), math.pi / 2), (*np.maximum(pst, DARK).tolist(), DARK))


def _per_steradian(scatter: float) -> float:
    """1 / sr, the BSDF on the axis of a Harvey law from its total scattered light."""
    power = SLOPE / 2 + 1
    law = SHOULDER**2 / power * (_harvey(1.0, power) - 1)  # integral of 2 sine B over the sine
    return scatter / (math.pi * law)


@kernel
def _met(
    radius: float,
    wall: float,
    height: Floats,
    edge: Floats,
    x: float,
    y: float,
    z: float,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, int]:
    """Distance to the object that a ray meets, and the code of the object.

    The code is NOTHING, LENS, the number of a vane, n + 1 for the wall, or n + 2 for the floor
    around the lens.
    """
    count, length = len(height), height[-1]
    nearest, what, least = math.inf, NOTHING, 1e-9 * height[-1]
    if dz != 0.0:
        for k in range(count):
            t = (height[k] - z) / dz
            if least < t < nearest:
                r2 = (x + t * dx) ** 2 + (y + t * dy) ** 2
                if edge[k] ** 2 <= r2 <= wall * wall * (1 + 1e-9):
                    nearest, what = t, k
        t = -z / dz
        if least < t < nearest:
            r2 = (x + t * dx) ** 2 + (y + t * dy) ** 2
            if r2 <= wall * wall * (1 + 1e-9):
                nearest, what = t, LENS if r2 < radius * radius else count + 2
    a, b = dx * dx + dy * dy, x * dx + y * dy
    if a > 0.0:
        under = b * b - a * (x * x + y * y - wall * wall)
        if under > 0.0:
            t = (-b + math.sqrt(under)) / a
            if least < t < nearest and 0.0 <= z + t * dz <= length:
                nearest, what = t, count + 1
    return nearest, what


@kernel
def _harvey(sine: float, slope: float) -> float:
    return (1 + (sine / SHOULDER) ** 2) ** slope


@kernel
def _lit(
    radius: float,
    wall: float,
    height: Floats,
    edge: Floats,
    x: float,
    y: float,
    z: float,
    angle: float,
) -> bool:
    """Whether a point sees the Sun, which is in the plane of x and z."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return _met(radius, wall, height, edge, x, y, z, sine, 0.0, cosine)[1] == NOTHING


@kernel
def _on_lens(radius: float, random: Floats) -> tuple[float, float]:
    """A place on the lens by two uniform numbers."""
    r, turn = radius * math.sqrt(random[0]), 2 * math.pi * random[1]
    return r * math.cos(turn), r * math.sin(turn)


@kernel
def _direct_light(
    radius: float, wall: float, height: Floats, edge: Floats, angle: Floats, random: Floats
) -> Floats:
    """Irradiance (a,) of the lens by direct light, over the irradiance normal to the Sun's rays.

    angle   (a,) radian, of the Sun
    random  (n, m) uniform numbers, the first two of which are a place on the lens
    """
    light = np.zeros(len(angle))
    for n in range(len(random)):
        x, y = _on_lens(radius, random[n])
        for k in range(len(angle)):
            if _lit(radius, wall, height, edge, x, y, 0.0, angle[k]):
                light[k] += math.cos(angle[k]) / len(random)
    return light


@kernel
def _scattered_light(
    radius: float,
    wall: float,
    height: Floats,
    edge: Floats,
    angle: Floats,
    random: Floats,
    slope: float,
) -> Floats:
    """Irradiance (a, bounces) after 1, 2, ... bounces off surfaces of reflectance one.

    It is weighted by the BSDF of the lens over the BSDF on its axis.

    angle   (a,) radian; the first is that of the corner of the field
    random  (n, 2 + 2 bounces) uniform numbers of n paths: place on the lens, direction, and
            directions after each bounce except the last
    """
    paths, bounces, count = len(random), random.shape[1] // 2 - 1, len(height)
    light, power = np.zeros((len(angle), bounces)), slope + 1
    first, last = _harvey(math.sin(angle[0]), power), _harvey(1.0, power)
    share = SHOULDER**2 / power * (last - first)
    for n in range(paths):
        x, y = _on_lens(radius, random[n])
        z, nx, ny, nz = 0.0, 0.0, 0.0, 1.0
        for bounce in range(bounces):
            # Cosine distribution about the normal, with any two directions across it.
            square, around = random[n, 2 + 2 * bounce], 2 * math.pi * random[n, 3 + 2 * bounce]
            if bounce == 0:  # weighted by the BSDF, outside the field, where the lens sees the sky
                square = ((first + square * (last - first)) ** (1 / power) - 1) * SHOULDER**2
            sine = math.sqrt(min(square, 1.0))
            cosine = math.sqrt(1 - sine * sine)
            if abs(nz) > 0.5:
                ux, uy, uz = 1.0, 0.0, 0.0
            else:
                ux, uy, uz = -ny, nx, 0.0
            vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
            across, along = sine * math.cos(around), sine * math.sin(around)
            dx = across * ux + along * vx + cosine * nx
            dy = across * uy + along * vy + cosine * ny
            dz = across * uz + along * vz + cosine * nz
            distance, what = _met(radius, wall, height, edge, x, y, z, dx, dy, dz)
            if what in (NOTHING, LENS):
                break
            x, y, z = x + distance * dx, y + distance * dy, z + distance * dz
            if what == count + 1:
                nx, ny, nz = -x / wall, -y / wall, 0.0
            else:
                nx, ny, nz = 0.0, 0.0, 1.0 if dz < 0 else -1.0
            for k in range(len(angle)):
                facing = math.sin(angle[k]) * nx + math.cos(angle[k]) * nz
                if facing > 0.0 and _lit(radius, wall, height, edge, x, y, z, angle[k]):
                    light[k, bounce] += facing * share / paths
    return light


@kernel
def _light_off_edges(
    radius: float,
    wall: float,
    height: Floats,
    edge: Floats,
    angle: Floats,
    random: Floats,
    slope: float,
) -> Floats:
    """Irradiance (a,) by light off the edges of vanes, per reflectance and metre of thickness."""
    light = np.zeros(len(angle))
    for j in range(len(height)):
        for m in range(AZIMUTHS):
            turn = 2 * math.pi * (m + 0.5) / AZIMUTHS
            x, y, z = edge[j] * math.cos(turn), edge[j] * math.sin(turn), height[j]
            weight = 0.0
            for n in range(len(random)):
                px, py = _on_lens(radius, random[n])
                away = math.sqrt((x - px) ** 2 + (y - py) ** 2 + z * z)
                towards = ((x - px) * math.cos(turn) + (y - py) * math.sin(turn)) / away
                if towards > 0.0:
                    bsdf = _harvey(math.sqrt(1 - (z / away) ** 2), slope)
                    weight += towards * (z / away) / away**2 * bsdf / len(random)
            for k in range(len(angle)):
                facing = -math.sin(angle[k]) * math.cos(turn)
                inside = 1 - 1e-6  # just off its edge, above the vane
                if facing > 0.0 and _lit(
                    radius, wall, height, edge, inside * x, inside * y, z, angle[k]
                ):
                    light[k] += 2 * edge[j] / AZIMUTHS * weight * facing
    return light
