"""Heads and instants -> angles to Sun, Moon, Earth and structure; causes of a head's blindness."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from enum import IntFlag
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.attitude import Mounting
from startrack.budget import exclusions
from startrack.core import Flags, Floats, Refused, deg, printed
from startrack.design import Case, Moment, Scope, found_at, replaced_all
from startrack.mission.instants import Instants
from startrack.mission.parameters import Head, HeadTemperature, MissionRadiation, Obstacle
from startrack.observation import platform_jitter
from startrack.population import unit_of
from startrack.space import EarthSeen, angle, cross, dot, unit

SIDES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))  # normal of a side of a box, and its two edges
SUN_RADIUS, MOON_RADIUS = 0.2666 * deg, 0.2591 * deg  # mean, seen from the Earth
# Parts of a design that have a temperature, and its name there.
TEMPERATURES = {
    "instrument.detector.thermal": "temperature",
    "instrument.thermal": "lens",
    "instrument.residual": "temperature",
}
ANGLES: Floats = np.arange(0.5, 120.0, 0.5) * deg  # for the search of a baffle's exclusion
DESIGN_TEMPERATURE = HeadTemperature()


def faces_of(structure: Sequence[Obstacle], instants: Instants) -> list[Floats]:
    """Rectangles of the structure in body axes, (4, 3, n) metre, or (4, 3, 1) if they are fixed.

    A panel that follows the Sun turns about its hinge until its normal is as near to the Sun as
    possible; a side of a box never turns.
    """
    faces = []
    for obstacle in structure:
        corners = [np.array(rectangle) for rectangle in _rectangles(obstacle)]
        if obstacle.hinge is None:
            faces += [rectangle[..., None] for rectangle in corners]
            continue
        axis = np.array(obstacle.hinge) / np.linalg.norm(obstacle.hinge)
        turn, origin = _turn(obstacle, axis, instants), np.array(obstacle.centre)
        faces += [
            np.stack(
                [origin[:, None] + _turned(axis, corner - origin, turn) for corner in rectangle]
            )
            for rectangle in corners
        ]
    return faces


def _rectangles(obstacle: Obstacle) -> list[Floats]:
    """(4, 3) corners in order around each rectangle; a size of zero leaves one."""
    centre, half = np.array(obstacle.centre), np.array(obstacle.size) / 2
    rectangles = []
    for n, a, b in SIDES:
        if not (half[a] and half[b]):
            continue
        for side in (-1, 1) if half[n] else (1,):
            from_centre = np.zeros((4, 3))
            from_centre[:, n] = side * half[n]
            from_centre[:, a] = half[a] * np.array([-1, 1, 1, -1])
            from_centre[:, b] = half[b] * np.array([-1, -1, 1, 1])
            rectangles.append(centre + from_centre)
    return rectangles


def _turn(obstacle: Obstacle, axis: Floats, instants: Instants) -> Floats:
    """(n,) radian about the hinge that bring the thinnest side's normal nearest to the Sun."""
    normal = np.zeros(3)
    normal[int(np.argmin(obstacle.size))] = 1.0
    normal -= axis * (axis @ normal)
    normal /= np.linalg.norm(normal)
    sun = np.stack([dot(row, instants.sun) for row in instants.body])
    return np.arctan2(np.cross(axis, normal) @ sun, normal @ sun)


def _turned(axis: Floats, arm: Floats, turn: Floats) -> Floats:
    """(3, n) a vector turned about an axis by angles (n,), by Rodrigues' formula."""
    along = axis * (axis @ arm)
    return (
        along[:, None]
        + np.outer(arm - along, np.cos(turn))
        + np.outer(np.cross(axis, arm), np.sin(turn))
    )


def nearest(faces: Sequence[Floats], position: Floats, boresight: Floats) -> Floats:
    """Angle from a line of sight to the nearest point of the structure.

    The angle to a rectangle is zero if the line meets it. Otherwise it is the angle to the nearest
    of its four edges, which are arcs of great circles seen from the head.

    faces      of `faces_of`
    position   (3,) metre, of the head's aperture;  boresight  (3,) in body axes
    Returns    (n,) or (1,) radian
    """
    least: Floats = np.full(1, math.pi)
    for corners in faces:
        seen = corners - position[None, :, None]
        line = np.broadcast_to(boresight[:, None], seen.shape[1:])
        rays = [unit(corner) for corner in seen]
        sides, best = [], np.full(seen.shape[-1], math.pi)
        for a, b in itertools.pairwise([*rays, rays[0]]):
            normal = cross(a, b)
            size = np.sqrt(dot(normal, normal))
            normal = normal / np.maximum(size, 1e-12)
            height = dot(line, normal)
            ahead, behind = dot(cross(normal, a), line), dot(cross(b, normal), line)
            between = (ahead >= 0) & (behind >= 0) & (size > 1e-9)
            ends = np.minimum(angle(dot(a, line)), angle(dot(b, line)))
            off = np.abs(np.arcsin(np.clip(height, -1, 1)))
            best = np.minimum(best, np.where(between, off, ends))
            sides.append(height)
        middle = dot(np.sum(rays, axis=0), line) > 0
        inside = (
            np.all(np.array(sides) >= 0, axis=0) | np.all(np.array(sides) <= 0, axis=0)
        ) & middle
        least = np.minimum(least, np.where(inside, 0.0, best))
    return least


class Blind(IntFlag):
    """Why a head has no attitude."""

    SUN = 1
    MOON = 2
    EARTH = 4  # its lit limb is too close
    GROUND = 8  # the Earth, lit or dark, reaches into the field
    SAA = 16
    STRUCTURE = 32  # of the spacecraft, in the field or in sunlight near it


@dataclass(frozen=True)
class BlindingLimits:
    """Angles from the boresight of a head below which it is blind, radian.

    sun, moon  to the centre;  earth  to the lit limb;  ground  to any limb
    structure  to that of the spacecraft in sunlight
    """

    sun: float
    moon: float
    earth: float
    ground: float
    structure: float = 0.0

    def __post_init__(self) -> None:
        if not all(math.isfinite(angle) for angle in (self.sun, self.moon, self.earth)):
            raise Refused(
                "baffle must keep out Sun, Moon and Earth at some angle below 120 deg, or the head "
                "must give its exclusion angles"
            )


@printed
@dataclass(frozen=True, eq=False)
class Mounted:
    """Values of a head for the engine.

    name      of the head
    axes      (3, 3) matrix camera_to_body; its third column is the boresight
    limits    angles at which it is blind
    drift     radian^2, variances across and about the boresight of its alignment: bias and swing
    field     radian, half diagonal of its field
    position  (3,) metre in body axes
    age       second in orbit at the begin of the mission; None: its design does not change with age
    temperature    its temperature over the orbit
    moved     (3,) radian^2 about the camera's axes, of the motion of the platform in an exposure
    """

    name: str
    axes: Floats
    limits: BlindingLimits
    drift: tuple[float, float]
    field: float
    position: Floats
    age: float | None = None
    temperature: HeadTemperature = DESIGN_TEMPERATURE
    moved: Floats = data_field(default_factory=lambda: np.zeros(3))

    def aged(self, second: Floats) -> Floats | None:
        """(n,) second in orbit of a head, at times after the begin of the mission."""
        return None if self.age is None else self.age + second

    def warmer(self, phase: Floats) -> Floats | None:
        """(n,) kelvin above the design's temperature, at phases of the orbit (radian)."""
        temperature = self.temperature
        if not temperature.swing:
            return None
        return temperature.offset + temperature.swing * np.sin(phase + temperature.ahead)

    @property
    def boresight(self) -> Floats:
        """(3,) unit vector in body axes."""
        return self.axes[:, 2]


def mount(head: Head, case: Case) -> Mounted:
    """A head with its design.

    Raises  ValueError if the exclusion angles cannot be found from the design.
    """
    half = case.instrument.camera.half_diagonal
    try:
        limits = limits_of(head, case)
    except Refused as error:
        raise Refused(f"head {head.name}: {error}") from None
    drifts = head.unit is not None and any(law.per is Scope.LIFE for law in case.varying)
    age = head.age if drifts or case.instrument.detector.age is not None else None
    warms = any(found_at(case, part) is not None for part in TEMPERATURES)
    return Mounted(
        name=head.name,
        axes=head.mounting.as_matrix(),
        limits=limits,
        drift=_drift(head.alignment),
        field=half,
        position=np.array(head.position),
        age=age,
        temperature=head.temperature if warms else DESIGN_TEMPERATURE,
        moved=platform_jitter(case),
    )


def state_of(case: Case, head: Head, seed: int, age: float | None, warmer: float) -> Case:
    """The design of a head, or its unit, at an age and a temperature unknown to its tracker.

    age     second in orbit; None: as the design
    warmer  kelvin above the design's temperature
    Raises  ValueError if a parameter refuses its value there.
    """
    if head.unit is not None:
        case = unit_of(case, seed, Moment(head.unit, age=age or 0.0))
    law, values = case.instrument.detector.age, dict[str, Any]()
    if age is not None and law is not None:
        values["instrument.detector.age"] = replace(law, time=age, year=None, launch=None)
    for part, name in TEMPERATURES.items():
        if warmer and found_at(case, part) is not None:
            values[f"{part}.{name}"] = found_at(case, f"{part}.{name}") + warmer
    if not values:
        return case
    return replaced_all(case, values).unit_of(case.design or case)


@lru_cache(maxsize=8)
def _of_baffle(case: Case, altitude: float) -> dict[str, float]:
    """The exclusion angles of a design with a baffle, radian."""
    return {name: body.least() for name, body in exclusions(case, ANGLES, altitude).items()}


def _drift(mounting: Mounting) -> tuple[float, float]:
    """Mean squares of the alignment's error over an orbit, across (per axis) and about."""
    x, y, z = (
        getattr(mounting, axis) ** 2 + getattr(mounting, f"swing_{axis}") ** 2 / 2 for axis in "xyz"
    )
    return (x + y) / 2, z


def limits_of(head: Head, case: Case) -> BlindingLimits:
    """The angles at which a head is blind: the given ones, else the baffle's, else the field's.

    Raises  ValueError if the baffle keeps a body out at no angle.
    """
    given, half = head.exclusion, case.instrument.camera.half_diagonal
    least = {"sun": half + SUN_RADIUS, "moon": half + MOON_RADIUS, "earth": half}
    missing = [name for name in least if getattr(given, name) is None]
    if missing and case.instrument.stray is not None:
        of_baffle = _of_baffle(case, given.altitude)
        least |= {name: max(of_baffle[name], least[name]) for name in missing}
    least |= given.angles
    clear = least["earth"] if head.clear is None else max(head.clear, half)
    return BlindingLimits(least["sun"], least["moon"], least["earth"], half, clear)


@dataclass(frozen=True, eq=False)
class HeadView:
    """View of one head at n instants.

    line             (3, n) boresight, ICRS axes
    sun, moon        (n,) radian to their centres
    earth            (n,) radian to the nearest lit point of the limb, infinite where it is dark
    limb             (n,) radian to the nearest limb, negative in front of the Earth
    blind            (n,) Blind, as numbers
    """

    line: Floats
    sun: Floats
    moon: Floats
    earth: Floats
    limb: Floats
    blind: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Shadow:
    """Part of the sky that the Earth hides at n instants.

    sun, moon  (n,) whether the Earth hides their centres
    earth      the Earth
    faces      of the spacecraft's own structure, of `faces_of`
    """

    sun: Flags
    moon: Flags
    earth: EarthSeen
    faces: Sequence[Floats] = ()


def shadow_of(instants: Instants, structure: Sequence[Obstacle] = ()) -> Shadow:
    """Eclipses by the ellipsoid of the Earth, without refraction; and the places of the
    structure."""
    earth = EarthSeen(instants.place, instants.pole, instants.sun)
    hidden = []
    for body in (instants.sun, instants.moon):
        theta, radius, _ = earth.limb(body)
        hidden.append(theta < radius)
    return Shadow(hidden[0], hidden[1], earth, faces_of(structure, instants))


def in_anomaly(radiation: MissionRadiation, instants: Instants) -> Flags | None:
    """(n,) whether the South Atlantic anomaly, a box, blinds all heads; None: nowhere."""
    if radiation.saa != "blind":
        return None
    (south, north), (west, east) = radiation.latitude, radiation.longitude
    longitude = (instants.longitude - west) % math.tau
    between = (instants.latitude > south) & (instants.latitude < north)
    return np.asarray(between & (longitude < east - west))


def look(head: Mounted, instants: Instants, shadow: Shadow, saa: Flags | None) -> HeadView:
    """The angles of one head, and the causes of its blindness.

    saa  (n,) where the anomaly blinds it; None: nowhere
    """
    line = dot(instants.body, head.boresight)
    sun, moon = angle(dot(line, instants.sun)), angle(dot(line, instants.moon))
    theta, radius, height = shadow.earth.limb(line)
    limb = theta - radius
    earth = shadow.earth.lit(theta, radius, height)
    limits = head.limits
    blind = ((sun < limits.sun) & ~shadow.sun) * np.uint8(Blind.SUN)
    blind |= ((moon < limits.moon) & ~shadow.moon) * np.uint8(Blind.MOON)
    blind |= (earth < limits.earth) * np.uint8(Blind.EARTH)
    blind |= (limb < limits.ground) * np.uint8(Blind.GROUND)
    if shadow.faces:
        near = nearest(shadow.faces, head.position, head.boresight)
        limit = np.where(shadow.sun, limits.ground, limits.structure)
        blind |= (near < limit) * np.uint8(Blind.STRUCTURE)
    if saa is not None:
        blind |= saa * np.uint8(Blind.SAA)
    return HeadView(line, sun, moon, earth, limb, blind)
