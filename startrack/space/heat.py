"""Orbit, Sun and surfaces -> temperatures of a platform and of a head on it over an orbit."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

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
from startrack.space.bodies import barycentric, seen_from
from startrack.space.earth import EARTH_RADIUS, GM, cross, dot, unit
from startrack.space.orbit import Kepler, node_at, sun_synchronous

STEFAN = 5.670374419e-8  # W / (m2 K4), CODATA 2018
SOLAR = 1361.0  # W / m2 at 1 au: Kopp and Lean (2011), Geophysical Research Letters 38, L01706
STEPS = 240  # of an orbit
NEWTON = 30  # steps; some five are enough
FACES = {"+x": (0, 1), "-x": (0, -1), "+y": (1, 1), "-y": (1, -1), "+z": (2, 1), "-z": (2, -1)}


class Heat(Parameters):
    """A box in orbit, and a head that stands outside on one of its faces.

    Its axes: x along the track, z to the Earth. The tube's axis is the normal of the head's face,
    its x and y the other axes of the box, in their order.

        C dT/dt = absorbed + power - emitted - G (T - T of the other)

    Source: Gilmore (2002), Spacecraft Thermal Control Handbook, volume 1, chapters 2 and 15.

    Accuracy  model: two isothermal nodes, a circular orbit, an Earth of even albedo and infrared,
              a cylinder of shadow; albedo as if the whole visible Earth were as bright as below the
              spacecraft; faces do not see each other. numerical: 0.1 K for 240 steps an orbit.
    """

    epoch: str = parameter("UTC, for the place of the Sun", default="2026-03-20T12:00:00")
    altitude: float = parameter(
        "of a circular orbit", unit=Unit("m", "km"), limit=Range(150e3, 4e7), default=600e3
    )
    local_time: float = parameter(
        "of the ascending node, mean solar time",
        unit=Unit("s", "h", clock=True),
        default=10.5 * 3600,
    )
    inclination: float | None = parameter(
        "None: that of a Sun-synchronous orbit",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
        default=None,
    )
    size: tuple[float, ...] = parameter(
        "of the box along x, y and z", unit=Unit("m"), limit=POSITIVE, default=(0.6, 0.6, 0.8)
    )
    absorptance: tuple[float, ...] = parameter(
        "of sunlight, by the faces +x, -x, +y, -y, +z and -z, or one of all",
        limit=Range(0, 1),
        default=(0.3,),
    )
    emittance: tuple[float, ...] = parameter(
        "in the infrared, likewise", limit=Range(0, 1), default=(0.3,)
    )
    capacity: float = parameter("of the platform", unit=Unit("J / K"), limit=POSITIVE, default=60e3)
    power: float = parameter(
        "that its electronics turn into heat", unit=Unit("W"), limit=NON_NEGATIVE, default=60.0
    )
    face: str = parameter("on which the head is", limit=Range(choices=tuple(FACES)), default="-z")
    head_size: tuple[float, ...] = parameter(
        "diameter and length of what stands outside",
        unit=Unit("m", "mm"),
        limit=POSITIVE,
        default=(80e-3, 100e-3),
    )
    head_absorptance: float = parameter(
        "of sunlight, of its tube; under insulation, the part that reaches the tube",
        limit=Range(0, 1),
        default=0.01,
    )
    head_emittance: float = parameter(
        "in the infrared; under insulation, its effective emittance",
        limit=Range(0, 1),
        default=0.02,
    )
    aperture: float = parameter(
        "diameter of the opening, black, which sees space alone",
        unit=Unit("m", "mm"),
        limit=NON_NEGATIVE,
        default=30e-3,
    )
    head_capacity: float = parameter(
        "0.5 kg of aluminium", unit=Unit("J / K"), limit=POSITIVE, default=450.0
    )
    head_power: float = parameter(
        "of its electronics", unit=Unit("W"), limit=NON_NEGATIVE, default=1.0
    )
    conductance: float = parameter(
        "from head to platform", unit=Unit("W / K"), limit=POSITIVE, default=0.2
    )
    albedo: float = parameter("of the Earth", limit=Range(0, 1), default=0.3)
    infrared: float = parameter(
        "of the Earth", unit=Unit("W / m2"), limit=NON_NEGATIVE, default=237.0
    )
    solar: float = parameter("of the Sun", unit=Unit("W / m2"), limit=NON_NEGATIVE, default=SOLAR)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, counts in (
            ("size", (3,)),
            ("head_size", (2,)),
            ("absorptance", (1, 6)),
            ("emittance", (1, 6)),
        ):
            if len(getattr(self, name)) not in counts:
                asked = " or ".join(map(str, counts))
                raise Refused(f"{name} must have {asked} values, got {len(getattr(self, name))}")


class OrbitTemperatures(NamedTuple):
    """Temperatures over an orbit, at n even times from its ascending node on.

    platform, head  (n,) kelvin
    side_x, side_y  (n,) W / m2 that a side of the tube at +x takes up over that at -x, halved
    period          second
    heat            (n,) W that the head takes up from outside, without what it emits
    """

    platform: Floats
    head: Floats
    side_x: Floats
    side_y: Floats
    period: float
    heat: Floats


def view_of_earth(cosine: Floats, distance: float | Floats) -> Floats:
    """View factor of a small plate to the Earth: the fraction of its view, weighted by the cosine.

        cos / H^2 where the whole disc is in view, and by its lens-shaped part beyond,
        1/2 - asin[r / (H s)] / pi + [c acos(-r c / s) - r sqrt(1 - H^2 c^2)] / (pi H^2)

    with c and s cosine and sine of the plate's normal to the nadir, r = sqrt(H^2 - 1).

    cosine    (...) of that angle
    distance  H, from the Earth's centre in its radii
    Source    Gilmore (2002), chapter 2; Howell, A catalog of radiation heat transfer
              configuration factors, B-8.
    """
    rest = np.sqrt(distance**2 - 1)
    c = np.clip(cosine, -1 / distance, 1 / distance)
    s = np.sqrt(1 - c * c)
    part = 0.5 - np.arcsin(np.clip(rest / (distance * s), -1, 1)) / math.pi
    inner = c * np.arccos(np.clip(-rest * c / s, -1, 1))
    inner -= rest * np.sqrt(np.maximum(1 - (distance * c) ** 2, 0.0))
    part += inner / (math.pi * distance**2)
    return np.where(np.abs(cosine) >= 1 / distance, np.maximum(cosine, 0.0) / distance**2, part)


def taken_by_platform(heat: Heat, sunlight: Floats, earth: Floats) -> tuple[Floats, float]:
    """Heat that the platform absorbs, W (n,), and area of a black body that emits the same, m2.

    sunlight, earth  W / m2 (6, n) on its faces +x, -x, +y, -y, +z, -z
    """
    sides = heat.size[1] * heat.size[2], heat.size[0] * heat.size[2], heat.size[0] * heat.size[1]
    area = np.repeat(sides, 2)
    dark = area * np.array(heat.emittance)
    return (area * np.array(heat.absorptance)) @ sunlight + dark @ earth, float(dark.sum())


def taken_by_head(
    heat: Heat, sunlight: Floats, earth: Floats
) -> tuple[Floats, Floats, Floats, float]:
    """Heat (n,) in watt that a head absorbs from outside, `side_x`, `side_y`, black surface.

    `side_x` and `side_y` are those of `OrbitTemperatures`. A tube absorbs as much as a square prism
    of its diameter: exactly for light from one direction.

    sunlight, earth  W / m2 (5, n) on its sides +x, -x, +y, -y and on its end
    """
    diameter, length = heat.head_size
    by_face = heat.head_absorptance * sunlight + heat.head_emittance * earth
    hole, lid = math.pi / 4 * heat.aperture**2, math.pi / 4 * diameter**2
    taken = diameter * length * by_face[:4].sum(axis=0)
    taken = taken + max(lid - hole, 0.0) * by_face[4] + hole * earth[4]
    shines = heat.head_emittance * (math.pi * diameter * length + max(lid - hole, 0.0)) + hole
    return taken, (by_face[0] - by_face[1]) / 2, (by_face[2] - by_face[3]) / 2, shines


@lru_cache(maxsize=64)
def orbit_temperatures(heat: Heat) -> OrbitTemperatures:
    """The periodic temperatures of a platform and its head.

    Raises  ValueError if no orbit of this altitude is Sun-synchronous.
    """
    sunlight, earth, period = _incident(heat)
    taken, dark = taken_by_platform(heat, sunlight, earth)
    axis, sign = FACES[heat.face]
    x, y = (other for other in range(3) if other != axis)
    faces = [2 * x, 2 * x + 1, 2 * y, 2 * y + 1, 2 * axis + (sign < 0)]
    head, side_x, side_y, shines = taken_by_head(heat, sunlight[faces], earth[faces])
    power = np.stack([taken + heat.power, head + heat.head_power])
    capacity = np.array([heat.capacity, heat.head_capacity])
    shine = STEFAN * np.array([dark, shines])
    platform, outside = _periodic(power, shine, capacity, heat.conductance, period)
    return OrbitTemperatures(platform, outside, side_x, side_y, period, head)


def _incident(heat: Heat) -> tuple[Floats, Floats, float]:
    """W / m2 (6, n) of sunlight, direct and from the Earth, and of infrared; the period."""
    axis = EARTH_RADIUS + heat.altitude
    tilt = sun_synchronous(axis) if heat.inclination is None else heat.inclination
    node = node_at(heat.epoch, heat.local_time)
    period = math.tau * math.sqrt(axis**3 / GM)
    place, speed = Kepler(axis, 0.0, tilt, node, 0.0, 0.0).state(np.arange(STEPS) * period / STEPS)
    date = core.utc(heat.epoch).tdb
    sun = seen_from(barycentric("earth", date.jd), date.jd, "sun").direction
    down, pole = unit(-place), unit(cross(place, speed))
    body = np.stack([cross(-pole, down), -pole, down])  # x, y, z; y against the orbit's normal
    normal = np.concatenate([np.stack([row, -row]) for row in body])
    return *incident(heat, normal, place, sun[:, None]), period


def incident(heat: Heat, normal: Floats, place: Floats, sun: Floats) -> tuple[Floats, Floats]:
    """W / m2 (f, n) of sunlight, direct and from the Earth, and of infrared, on plates in orbit.

    normal  (f, 3, n) unit vectors;  place  (3, n) metre from the Earth's centre
    sun     (3, n) or (3, 1) unit vectors
    """
    distance = np.sqrt(dot(place, place))
    down = -place / distance
    up = -(down * sun).sum(axis=0)
    lit = (up > 0) | (distance * np.sqrt(np.maximum(1 - up * up, 0.0)) > EARTH_RADIUS)
    to_sun, below = (normal * sun).sum(axis=1), (normal * down).sum(axis=1)
    seen = view_of_earth(below, distance / EARTH_RADIUS)
    sunlight = heat.solar * (
        np.maximum(to_sun, 0.0) * lit + heat.albedo * seen * np.maximum(up, 0.0)
    )
    return sunlight, heat.infrared * seen


@kernel
def march(power, shines, capacity, conductance, step, kelvin, out):  # type: ignore[no-untyped-def]
    """Temperatures of a platform (node 0) and of heads on it, by steps that are implicit.

        C dT/dt = power - shines T^4 - G (T - T of the other)

    power     (k, n) W, absorbed and dissipated;  shines  (k,) W / K4;  capacity  (k,) J / K
    kelvin    (k,) at the begin; is written to;  out  (k, n) at the times of `power`; is written to
    Accuracy  numerical: first order in the step over C / G.
    """
    nodes, count = power.shape
    for n in range(count):
        flow = 0.0
        for k in range(1, nodes):
            flow += conductance * (kelvin[k] - kelvin[0])
        platform = kelvin[0]
        for k in range(nodes):
            cold = kelvin[k]
            slope = 4 * shines[k] * cold**3 + conductance * (1 if k else nodes - 1)
            gain = power[k, n] - shines[k] * cold**4
            gain += conductance * (platform - cold) if k else flow
            kelvin[k] = cold + step * gain / (capacity[k] + step * slope)
            out[k, n] = kelvin[k]


def _periodic(
    heat: Floats, shines: Floats, capacity: Floats, conductance: float, period: float
) -> Floats:
    """Temperatures (2, n) that return after a period: trapezoidal steps, solved by Newton.

    heat    (2, n) W;  shines  (2,) W / K4;  capacity  (2,) J / K
    """
    count = heat.shape[1]
    step = period / count
    ahead = np.roll(np.eye(count), 1, axis=1)
    change, middle = (ahead - np.eye(count)) / step, (ahead + np.eye(count)) / 2
    given = heat @ middle.T
    kelvin = np.full((2, count), (heat.sum(axis=0).mean() / shines.sum()) ** 0.25)
    for _ in range(NEWTON):
        flow = conductance * (kelvin[0] - kelvin[1]) * np.array([[1.0], [-1.0]])
        lost = shines[:, None] * kelvin**4 + flow
        error = capacity[:, None] * (kelvin @ change.T) - given + lost @ middle.T
        slope = 4 * shines[:, None] * kelvin**3 + conductance
        own = [capacity[k] * change + middle * slope[k] for k in (0, 1)]
        both = np.block([[own[0], -conductance * middle], [-conductance * middle, own[1]]])
        moved = np.linalg.solve(both, error.ravel()).reshape(2, count)
        kelvin = kelvin - moved
        if np.abs(moved).max() < 1e-6:
            break
    return kelvin
