"""Heads and instants -> angles to Sun, Moon and Earth, and what makes each head blind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntFlag
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.attitude import Mounting
from startrack.budget import exclusions
from startrack.core import Floats, Refused, deg
from startrack.design import Case, Moment, Scope, found_at, replaced_all
from startrack.mission.instants import Instants
from startrack.mission.parameters import Head, Obstacle, Radiation, Warmth
from startrack.mission.structure import faces_of, nearest
from startrack.population import unit_of
from startrack.space import EarthSeen, angle, dot, from_body

SUN_RADIUS, MOON_RADIUS = 0.2666 * deg, 0.2591 * deg  # mean, seen from the Earth
# Parts of a design that have a temperature, and its name there.
TEMPERATURES = {
    "instrument.detector.thermal": "temperature",
    "instrument.thermal": "lens",
    "instrument.residual": "temperature",
}
ANGLES: Floats = np.arange(0.5, 120.0, 0.5) * deg  # at which a baffle's exclusion is sought


class Blind(IntFlag):
    """Why a head has no attitude."""

    SUN = 1
    MOON = 2
    EARTH = 4  # its lit limb is too close
    GROUND = 8  # the Earth, lit or dark, reaches into the field
    SAA = 16
    STRUCTURE = 32  # of the spacecraft, in the field or in sunlight near it


@dataclass(frozen=True, eq=False)
class Limits:
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
        if not all(math.isfinite(one) for one in (self.sun, self.moon, self.earth)):
            raise Refused(
                "baffle must keep out Sun, Moon and Earth at some angle below 120 deg, or the head "
                "must give its exclusion angles"
            )


NO_WARMTH = Warmth()


@dataclass(frozen=True, eq=False)
class Mounted:
    """A head as the engine needs it.

    name      of the head
    axes      (3, 3) matrix camera_to_body; its third column is the boresight
    limits    angles at which it is blind
    drift     radian^2, variances across and about the boresight of its alignment: bias and swing
    field     radian, half diagonal of its field
    position  (3,) metre in body axes
    age       second in orbit at the begin of the mission; None: its design has no law of age, or
              is as it is at all times
    warmth    its temperature over the orbit
    """

    name: str
    axes: Floats
    limits: Limits
    drift: tuple[float, float]
    field: float
    position: Floats
    age: float | None = None
    warmth: Warmth = NO_WARMTH

    def aged(self, second: Floats) -> Floats | None:
        """(n,) second in orbit, at times after the begin of the mission."""
        return None if self.age is None else self.age + second

    def warmer(self, phase: Floats) -> Floats | None:
        """(n,) kelvin above the design's temperature, at phases of the orbit (radian)."""
        warmth = self.warmth
        if not warmth.swing:
            return None
        return warmth.offset + warmth.swing * np.sin(phase + warmth.ahead)

    @property
    def boresight(self) -> Floats:
        """(3,) unit vector in body axes."""
        return self.axes[:, 2]


def mount(head: Head, case: Case) -> Mounted:
    """A head with its design.

    Raises  ValueError where the exclusion angles cannot be found from the design.
    """
    half = case.instrument.camera.half_diagonal
    try:
        limits = limits_of(head, case)
    except Refused as error:
        raise Refused(f"head {head.name}: {error}") from None
    age = head.age if ages(case, head) else None
    warmth = head.temperature if warms(case) else Warmth()
    return Mounted(
        head.name,
        head.mounting.as_matrix(),
        limits,
        _drift(head.alignment),
        half,
        np.array(head.position),
        age,
        warmth,
    )


def ages(case: Case, head: Head) -> bool:
    """Whether the design of a head has a law of age: of its detector, or of the unit's numbers."""
    drifts = head.unit is not None and any(one.per is Scope.LIFE for one in case.variation)
    return case.instrument.detector.age is not None or drifts


def warms(case: Case) -> bool:
    """Whether the design has a law of temperature: of its detector, its lens, or over its field."""
    return any(found_at(case, name) is not None for name in TEMPERATURES)


def state_of(case: Case, head: Head, seed: int, age: float | None, warmer: float) -> Case:
    """The design of a head, or its unit, at an age and a temperature that its tracker knows not.

    age     second in orbit; None: as the design
    warmer  kelvin above the design's temperature
    Raises  ValueError where a parameter refuses its value there.
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
    found = exclusions(case, ANGLES, altitude)
    return {name: one.least() for name, one in found.items()}


def _drift(mounting: Mounting) -> tuple[float, float]:
    """Mean squares of the alignment's error over an orbit, across (per axis) and about."""
    x, y, z = (
        getattr(mounting, axis) ** 2 + getattr(mounting, f"swing_{axis}") ** 2 / 2 for axis in "xyz"
    )
    return (x + y) / 2, z


def limits_of(head: Head, case: Case) -> Limits:
    """The angles at which a head is blind: its own, else of its design's baffle, else of the field.

    Raises  ValueError where the baffle keeps a body out at no angle.
    """
    given, half = head.exclusion, case.instrument.camera.half_diagonal
    least = {"sun": half + SUN_RADIUS, "moon": half + MOON_RADIUS, "earth": half}
    missing = [name for name in least if getattr(given, name) is None]
    if missing and case.instrument.baffle is not None:
        found = _of_baffle(case, given.altitude)
        least |= {name: max(found[name], least[name]) for name in missing}
    least |= given.angles
    clear = least["earth"] if head.clear is None else max(head.clear, half)
    return Limits(least["sun"], least["moon"], least["earth"], half, clear)


@dataclass(frozen=True, eq=False)
class Seen:
    """What one head sees at n instants.

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
    """What the Earth hides at n instants.

    sun, moon  (n,) whether the Earth hides their centres
    earth      the Earth
    faces      of the spacecraft's own structure, of `faces_of`
    """

    sun: NDArray[np.bool_]
    moon: NDArray[np.bool_]
    earth: EarthSeen
    faces: Sequence[Floats] = ()


def shadow_of(instants: Instants, structure: Sequence[Obstacle] = ()) -> Shadow:
    """Eclipses by the ellipsoid of the Earth, without refraction; where the structure is."""
    earth = EarthSeen(instants.place, instants.pole, instants.sun)
    hidden = []
    for body in (instants.sun, instants.moon):
        theta, radius, _ = earth.limb(body)
        hidden.append(theta < radius)
    return Shadow(hidden[0], hidden[1], earth, faces_of(structure, instants))


def inside(radiation: Radiation, instants: Instants) -> NDArray[np.bool_]:
    """(n,) whether the spacecraft is above the box of the South Atlantic anomaly."""
    (south, north), (west, east) = radiation.latitude, radiation.longitude
    longitude = (instants.longitude - west) % math.tau
    found = (instants.latitude > south) & (instants.latitude < north)
    return np.asarray(found & (longitude < east - west))


def look(head: Mounted, instants: Instants, shadow: Shadow, saa: NDArray[np.bool_] | None) -> Seen:
    """The angles of one head, and why it is blind.

    saa  (n,) where the anomaly blinds it; None: nowhere
    """
    line = from_body(instants.body, head.boresight)
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
    return Seen(line, sun, moon, earth, limb, blind)
