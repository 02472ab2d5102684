"""Eclipses and blinded heads by astropy and sgp4 alone, with independent geometry.

Nothing of `blinded` is from startrack.mission. The orbit comes from the package sgp4, axes and
bodies from astropy. An eclipse is a ray through the ellipsoid in Earth-fixed axes. The limb is a
set of points at which rays touch it, and each is lit or dark by its own vertical.
"""

import dataclasses

import astropy.units as u
import numpy as np
from astropy.coordinates import (
    GCRS,
    ICRS,
    ITRS,
    TEME,
    CartesianDifferential,
    CartesianRepresentation,
    SkyCoord,
    get_body_barycentric,
)
from astropy.time import Time
from sgp4.api import Satrec

from startrack import shipped
from startrack.core import deg, installed_tables
from startrack.design import KeepOut
from startrack.mission import load_mission, plan_of
from startrack.mission.parameters import MissionOrbit

# The space station, from the documentation of the package sgp4.
TLE = (
    "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)
BEGIN = "2019-12-10T00:00:00"
POINTS = 720  # of the limb
STRETCH = np.array([1.0, 1.0, 298.257223563 / 297.257223563])  # makes WGS 84 a sphere
RADIUS = 6378137.0  # metre
LIGHT = 299792458.0  # metre / second
TWILIGHT = np.radians(6.0)
PART = 400  # instants at once


def low_heads():
    """The plan of heads on the space station, directed so low that Sun, Moon and lit limb blind
    them."""
    loaded = load_mission(
        shipped("missions/sun-synchronous.toml"), ["time.duration=20 d", 'attitude.yaw="velocity"']
    )
    earth = KeepOut(sun=40 * deg, moon=15 * deg, earth=50 * deg)
    heads = [
        dataclasses.replace(one, azimuth=a * deg, elevation=e * deg, exclusion=earth)
        for one, (a, e) in zip(
            loaded.mission.heads, ((-90, -20), (90, -35), (180, 12)), strict=True
        )
    ]
    mission = dataclasses.replace(
        loaded.mission,
        heads=tuple(heads),
        time=dataclasses.replace(loaded.mission.time, begin=BEGIN),
        orbit=MissionOrbit(tle=TLE),
    )
    return plan_of(dataclasses.replace(loaded, mission=mission), errors=False)


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def between(a, b):
    return np.arccos(np.clip((a * b).sum(axis=-1), -1, 1))


def observed(name, date, gcrs):
    """(n, 3) apparent direction of a body from the spacecraft."""
    observer = GCRS(
        obstime=date,
        obsgeoloc=gcrs.cartesian.without_differentials(),
        obsgeovel=gcrs.velocity.to_cartesian(),
    )
    earth = get_body_barycentric("earth", date, ephemeris="builtin")
    late = 0.0 * u.s
    for _ in range(3):
        body = get_body_barycentric(name, date - late, ephemeris="builtin")
        late = (body - earth).norm().to(u.m) / (LIGHT * u.m / u.s)
    return unit(SkyCoord(ICRS(body)).transform_to(observer).cartesian.xyz.value.T)


def eclipsed(place, line):
    """Whether rays from places (n, 3, metre, Earth-fixed) along lines (n, 3) meet the ellipsoid."""
    p, d = place * STRETCH / RADIUS, unit(line * STRETCH)
    nearest = (p * d).sum(axis=1)
    return (nearest < 0) & ((p * p).sum(axis=1) - nearest**2 < 1)


def limb(place):
    """Where rays touch the ellipsoid, (n, POINTS, 3) metre, and the vertical there."""
    p = place * STRETCH / RADIUS
    size = np.linalg.norm(p, axis=1)[:, None, None]
    out = unit(p)
    side = unit(np.cross(out, [0.3, 0.5, 0.8]))
    turn = np.linspace(0, 2 * np.pi, POINTS, endpoint=False)[:, None]
    ring = np.cos(turn) * side[:, None] + np.sin(turn) * np.cross(out, side)[:, None]
    point = out[:, None] / size + np.sqrt(1 - size**-2) * ring
    return point / STRETCH * RADIUS, unit(point * STRETCH)


def blinded(boresights, limits, second):
    """Eclipse (n,), and for each head a dict of (n,) by cause: sun, moon, earth, ground.

    boresights  (3,) in axes x forward, y against the normal of the orbit, z down
    limits      for each head, of sun, moon, earth and ground: radian
    """
    found = [
        _blinded(boresights, limits, one) for one in np.array_split(second, -(-len(second) // PART))
    ]
    eclipse = np.concatenate([one[0] for one in found])
    heads = [
        {cause: np.concatenate([one[1][h][cause] for one in found]) for cause in found[0][1][h]}
        for h in range(len(boresights))
    ]
    return eclipse, heads


def _blinded(boresights, limits, second):
    with installed_tables():
        date = Time(BEGIN, scale="utc") + second * u.s
        _, place, speed = Satrec.twoline2rv(*TLE).sgp4_array(date.jd1, date.jd2)
        moving = CartesianDifferential(speed.T * u.km / u.s)
        teme = TEME(CartesianRepresentation(place.T * u.km, differentials=moving), obstime=date)
        gcrs = teme.transform_to(GCRS(obstime=date))

        def fixed(lines):
            there = GCRS(CartesianRepresentation(lines.T * u.one), obstime=date)
            return there.transform_to(ITRS(obstime=date)).cartesian.xyz.value.T

        r = gcrs.cartesian.without_differentials().xyz.to_value(u.m).T
        v = gcrs.velocity.d_xyz.to_value(u.m / u.s).T
        sun, moon = observed("sun", date, gcrs), observed("moon", date, gcrs)
        own = teme.transform_to(ITRS(obstime=date)).cartesian.xyz.to_value(u.m).T
        sun_fixed, moon_fixed = fixed(sun), fixed(moon)
        down = unit(-r)
        y = unit(np.cross(down, v))
        x = np.cross(y, down)
        lines = [unit(b[0] * x + b[1] * y + b[2] * down) for b in boresights]
        lines_fixed = [fixed(one) for one in lines]
    dark, no_moon = eclipsed(own, sun_fixed), eclipsed(own, moon_fixed)
    point, vertical = limb(own)
    lit = (vertical * sun_fixed[:, None]).sum(axis=-1) > -np.sin(TWILIGHT)
    to_limb = unit(point - own[:, None])
    heads = []
    for line, there, limit in zip(lines, lines_fixed, limits, strict=True):
        angle = between(to_limb, unit(there)[:, None])
        front = eclipsed(own, there)
        bright = np.where(lit, angle, np.inf).min(axis=1)
        heads.append(
            {
                "sun": (between(line, sun) < limit.sun) & ~dark,
                "moon": (between(line, moon) < limit.moon) & ~no_moon,
                "earth": (bright < limit.earth) | (front & lit.any(axis=1)),
                "ground": (angle.min(axis=1) < limit.ground) | front,
            }
        )
    return dark, heads


def events(own, other):
    """Begins and ends of two series (n,): their number, those without a partner within a step.

    Returns  number of events of both together, number of those whose partner is not within a step,
             and how many of the events agree to the step
    """
    alone = same = count = 0
    for sign in (1, -1):
        mine, theirs = (
            np.flatnonzero(np.diff(one.astype(np.int8)) == sign) for one in (own, other)
        )
        count += len(mine) + len(theirs)
        for a, b in ((mine, theirs), (theirs, mine)):
            gap = np.abs(a[:, None] - b).min(axis=1) if len(b) else np.full(len(a), np.inf)
            alone += int((gap > 1).sum())
            same += int((gap == 0).sum())
    return count, alone, same
