"""Orbit, pointing, place -> the orbit on which the camera looks at the place at the epoch."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar, root

from startrack import core
from startrack.core import DAY, Floats, Refused
from startrack.earth.geometry.orbit import Aircraft, Carrier, Orbit, TwoLines
from startrack.earth.geometry.sight import Pointing, sight
from startrack.earth.terrain import EQUATORIAL, ConstantHeight

AXIS = core.Camera(1, 1, 1000.0)  # whose only pixel looks along the optical axis
NEAR = 0.1  # metre, largest distance from the place; chosen by hand
ANOMALIES = 72  # anomalies of a turn; the search for the least distance begins at the nearest
SOLAR_RATE = 2 * math.pi / DAY  # rad / s, rate of the mean Sun over the ground


def axis_place(carrier: Carrier, pointing: Pointing, height: float = 0.0) -> tuple[float, float]:
    """Longitude and latitude (radian) of the ground on the optical axis at the epoch.

    height  metre above the ellipsoid
    Raises  Refused if the axis misses the Earth.
    """
    hits, _ = ConstantHeight(height).meet(
        sight(AXIS, np.zeros((1, 2)), np.zeros(1), carrier, pointing)
    )
    if not hits.hit[0]:
        raise Refused("pointing must let the optical axis meet the Earth, but it misses it")
    return float(hits.place[0, 0]), float(hits.place[0, 1])


def aimed(
    carrier: Carrier,
    pointing: Pointing,
    longitude: float,
    latitude: float,
    height: float = 0.0,
    ascending: bool = False,
) -> Carrier:
    """The carrier, moved so that its camera looks at a place at the epoch.

    For an orbit, node and anomaly change. A local time fixes the node against the Sun; then epoch
    (by up to half a day) and anomaly change. For an aircraft, the start changes.

    longitude, latitude  radian, geodetic, of the ground on the optical axis
    height               metre above the ellipsoid
    ascending            whether the satellite flies north over the place
    Raises    Refused for two-line elements, whose passes are fixed, for `ascending` with an
              aircraft, and if the orbit does not reach the place.
    Accuracy  numerical: 0.1 m on the ground, for the flight of `fly`.
    """
    if isinstance(carrier, TwoLines):
        raise Refused(
            "tle must be replaced by orbit: two-line elements fix place and time of the flight"
        )
    if ascending and isinstance(carrier, Aircraft):
        raise Refused("ascending must be left out for an aircraft, which flies along its heading")
    core.finite(longitude=longitude, latitude=latitude, height=height)
    if not abs(latitude) <= math.pi / 2:
        raise Refused(f"latitude must lie within 90 deg, got {latitude / core.deg:g} deg")
    if not -math.pi <= longitude <= 2 * math.pi:
        raise Refused(f"longitude must lie in [-180, 360] deg, got {longitude / core.deg:g} deg")

    def missed(found: Carrier) -> Floats:
        """Distance (2,) from the place, east and north, in Earth radii."""
        over, up = axis_place(found, pointing, height)
        east = math.remainder(longitude - over, 2 * math.pi) * math.cos(latitude)
        return np.array([east, latitude - up])

    def moved(place: Floats) -> Carrier:
        if isinstance(carrier, Aircraft):
            return replace(carrier, longitude=float(place[0]), latitude=float(place[1]))
        return _moved(carrier, float(place[0]), float(place[1]))

    begin = np.array([longitude, latitude])
    if isinstance(carrier, Orbit):
        anomaly = _argument(carrier, latitude, ascending) - carrier.perigee
        over, _ = axis_place(moved(np.array([0.0, anomaly])), pointing, height)
        begin = np.array([math.remainder(longitude - over, 2 * math.pi), anomaly])
    found = root(lambda place: missed(moved(place)), begin, tol=1e-12)
    result = moved(found.x)
    off = EQUATORIAL * float(np.hypot(*missed(result)))
    if off < NEAR:
        return result
    least = EQUATORIAL * _least(lambda anomaly: float(missed(moved(np.array([0.0, anomaly])))[1]))
    if least < NEAR:
        raise Refused("the place must lie where the search for a pass ends, but it found none")
    raise Refused(
        "the orbit must pass the place, but wherever its node is, its camera comes no nearer than "
        f"{least / 1e3:.3g} km"
    )


def _least(off: Callable[[float], float]) -> float:
    """Least norm of a function of an anomaly (radian)."""
    step = 2 * math.pi / ANOMALIES
    nearest = min(range(ANOMALIES), key=lambda n: abs(off(n * step))) * step
    found = minimize_scalar(
        lambda anomaly: abs(off(anomaly)),
        bounds=(nearest - step, nearest + step),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(found.fun)


def _argument(orbit: Orbit, latitude: float, ascending: bool) -> float:
    """Argument of latitude (radian) of a satellite at about a latitude, or as near as the orbit
    gets."""
    tilt = orbit.resolved().inclination
    ratio = math.sin(latitude) / math.sin(tilt) if math.sin(tilt) else math.inf
    argument = math.asin(min(max(ratio, -1.0), 1.0))
    return argument if ascending else math.pi - argument


def _moved(orbit: Orbit, turn: float, anomaly: float) -> Orbit:
    """The orbit turned about the Earth's axis, with its satellite at an anomaly (radian)."""
    anomaly %= 2 * math.pi
    if orbit.local_time is None:
        return replace(orbit, node=(orbit.node + turn) % (2 * math.pi), anomaly=anomaly)
    from astropy.time import TimeDelta

    with core.installed_tables():
        later = core.utc(orbit.epoch) - TimeDelta(turn / SOLAR_RATE, format="sec")
        later.precision = 6
        return replace(orbit, epoch=str(later.isot), anomaly=anomaly)
