"""Directions and eclipses of a mission, against astropy and sgp4 done step by step."""

import dataclasses
import tomllib
from pathlib import Path

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import (
    GCRS,
    ICRS,
    ITRS,
    TEME,
    CartesianDifferential,
    CartesianRepresentation,
    EarthLocation,
    SkyCoord,
    get_body_barycentric,
)
from astropy.time import Time

from startrack import shipped, space
from startrack.core import LIGHT_SPEED, arcsec, deg, installed_tables
from startrack.mission.engine import at, plan_of
from startrack.mission.heads import Blind
from startrack.mission.instants import motion_of
from startrack.mission.parameters import Attitude, MissionOrbit, ScanLaw, load_mission, save_mission
from tests.mission import independent

EXAMPLE = shipped("missions/sun-synchronous.toml")
TLE, BEGIN = independent.TLE, independent.BEGIN
INSTANTS = 60


@pytest.fixture(scope="module")
def mission():
    loaded = load_mission(EXAMPLE, ["time.duration=20 d"])
    time = dataclasses.replace(loaded.mission.time, begin=BEGIN)
    return dataclasses.replace(loaded.mission, time=time, orbit=MissionOrbit(tle=TLE))


@pytest.fixture(scope="module")
def flight(mission):
    """Instants, and by astropy: place and velocity (n, 3) in GCRS, and the times."""
    course = motion_of(mission)
    second = np.sort(np.random.default_rng(1).uniform(0, 86400 * 20, INSTANTS))
    own = [course.at(one - 70, 10.0, 40) for one in second]  # interpolated, the eighth is asked
    with installed_tables():
        date = Time(BEGIN, scale="utc") + second * u.s
        _, place, speed = course.path.record.sgp4_array(date.jd1, date.jd2)
        teme = TEME(
            CartesianRepresentation(
                place.T * u.km, differentials=CartesianDifferential(speed.T * u.km / u.s)
            ),
            obstime=date,
        )
        gcrs = teme.transform_to(GCRS(obstime=date))
        itrs = teme.transform_to(ITRS(obstime=date))
    return own, date, gcrs, itrs


def together(flight, name):
    return np.stack([getattr(one, name)[..., 7] for one in flight[0]])


def apart(a, b):
    a, b = (one / np.linalg.norm(one, axis=1, keepdims=True) for one in (a, b))
    return 2 * np.arcsin(np.linalg.norm(a - b, axis=1) / 2)


def test_the_place_is_that_of_sgp4(flight):
    there = flight[2].cartesian.xyz.to_value(u.m).T
    assert np.abs(together(flight, "place") - there).max() < 1.0


@pytest.mark.parametrize("name", ["sun", "moon"])
def test_apparent_directions_are_those_of_astropy(flight, name):
    """Light-time, parallax and aberration of the spacecraft, by astropy's own transformation."""
    _, date, gcrs, _ = flight
    with installed_tables():
        observer = GCRS(
            obstime=date,
            obsgeoloc=gcrs.cartesian.without_differentials(),
            obsgeovel=gcrs.velocity.to_cartesian(),
        )
        late = 0.0 * u.s
        earth = get_body_barycentric("earth", date, ephemeris="builtin")
        for _ in range(3):
            body = get_body_barycentric(name, date - late, ephemeris="builtin")
            late = (body - earth).norm().to(u.m) / (LIGHT_SPEED * u.m / u.s)
        seen = SkyCoord(ICRS(body)).transform_to(observer).cartesian.xyz.to_value(u.m).T
    assert apart(together(flight, name), seen).max() < 0.2 * arcsec


def test_the_limb_is_that_of_the_ellipsoid(mission, flight):
    """Against the nearest of 20000 points where lines of sight touch the ellipsoid."""
    plan = plan_of(load_mission(EXAMPLE, ["time.duration=20 d"]), errors=False)
    worst = 0.0
    for own in flight[0][:20]:
        axes = own.pole[:, 7]
        seen = at(plan, own).seen
        place = own.place[:, 7] / 6378137.0
        pole = axes / np.linalg.norm(axes)
        # In axes along the pole, scaled so that the ellipsoid is the unit sphere.
        east = np.cross(pole, [1.0, 0, 0])
        frame = np.stack([np.cross(east, pole), east, pole])
        frame /= np.linalg.norm(frame, axis=1, keepdims=True)
        scale = np.array([1, 1, 1 / (1 - 1 / 298.257223563)])
        p = scale * (frame @ place)
        size = np.linalg.norm(p)
        side = np.cross(p, [0, 0, 1.0])
        side /= np.linalg.norm(side)
        turn = np.linspace(0, 2 * np.pi, 20000)
        ring = p / size**2 + np.sqrt(1 - 1 / size**2) * (
            np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(p / size, side))
        )
        limb = (ring / scale) @ frame - place
        limb /= np.linalg.norm(limb, axis=1, keepdims=True)
        for one in seen:
            nearest = np.arccos((limb @ one.line[:, 7]).max())
            worst = max(worst, abs(abs(one.limb[7]) - nearest))
    assert worst < 2 * arcsec


def test_latitude_and_longitude_are_those_of_astropy(flight):
    with installed_tables():
        where = EarthLocation(*flight[3].cartesian.xyz)
    assert np.abs(together(flight, "latitude") - where.lat.rad).max() < 0.001 * deg
    across = together(flight, "longitude") - where.lon.rad
    assert np.abs((across + np.pi) % (2 * np.pi) - np.pi).max() < 0.01 * deg


def test_geodetic_latitude_is_that_of_astropy_at_any_height():
    latitude, height = (
        part.ravel() for part in np.meshgrid(np.linspace(-90, 90, 91), [0, 4e5, 2e6, 36e6])
    )
    place = EarthLocation.from_geodetic(7.0, latitude, height)
    found = space.geodetic_latitude(np.array([axis.to_value("m") for axis in place.geocentric]))
    assert np.abs(found / deg - latitude).max() < 4e-7


def test_laws_point_where_they_say(mission):
    """Each law at some instants: its axis, an orthonormal matrix, and a consistent rate."""
    laws = {
        "nadir": Attitude(yaw="ground"),
        "sun-yaw": Attitude(yaw="sun"),
        "inertial": Attitude(law="inertial", quaternion=(0.5, 0.5, 0.5, 0.5)),
        "sun": Attitude(law="sun", axis=(0.0, 1.0, 1.0)),
        "target": Attitude(law="target", latitude=0.6, longitude=0.2),
        "scan": Attitude(scan=ScanLaw(amplitude=0.3, period=400.0)),
    }
    day = dataclasses.replace(mission.time, duration=86400.0)
    for name, law in laws.items():
        course = motion_of(dataclasses.replace(mission, attitude=law, time=day))
        own = course.at(1000.0, 1.0, 700)
        body = own.body
        product = np.einsum("ikn,jkn->ijn", body, body) - np.eye(3)[..., None]
        assert np.abs(product).max() < 1e-9, name
        assert np.allclose(np.linalg.det(body.transpose(2, 0, 1)), 1), name
        turned = np.einsum("ikn,jkn->ijn", body[..., 2:], body[..., :-2])
        spin = (
            np.stack(
                [
                    turned[1, 2] - turned[2, 1],
                    turned[2, 0] - turned[0, 2],
                    turned[0, 1] - turned[1, 0],
                ]
            )
            / 4
        )
        assert np.abs(spin - own.rate[:, 1:-1]).max() < 2e-4, name
        if name in ("nadir", "sun-yaw"):
            down = -own.place / np.linalg.norm(own.place, axis=0)
            assert np.abs(body[2] - down).max() < 1e-12
        if name == "sun":
            line = (body[1] + body[2]) / np.sqrt(2)
            assert np.degrees(np.arccos((line * own.sun).sum(axis=0))).max() < 0.01  # aberration


def test_a_ground_target_is_in_the_middle():
    """By astropy, the place on the ground in GCRS is on the z axis."""
    loaded = load_mission(EXAMPLE, ["time.duration=1 d"])
    law = Attitude(law="target", latitude=0.5, longitude=-1.0, height=300.0)
    course = motion_of(dataclasses.replace(loaded.mission, attitude=law))
    own = course.at(0.0, 30.0, 2880)
    with installed_tables():
        date = Time(loaded.mission.time.begin, scale="utc") + own.second * u.s
        there = EarthLocation.from_geodetic(-1.0 * u.rad, 0.5 * u.rad, 300 * u.m)
        target = np.array(there.get_gcrs(date).cartesian.xyz.to_value(u.m))
    line = target - own.place
    up = (line * target).sum(axis=0) < -0.05 * np.linalg.norm(line, axis=0) * 6.4e6
    assert 20 < up.sum() < 400
    assert apart(line.T[up], own.body[2].T[up]).max() < 20 * arcsec


def test_eclipses_of_a_circular_orbit():
    """Their length at a known beta angle for a spherical Earth: the closed form of textbooks."""
    loaded = load_mission(EXAMPLE, ["time.duration=2 d", "time.step=5 s"])
    plan = plan_of(loaded, errors=False)
    own = plan.motion.at(0.0, 5.0, 30000)
    chunk = at(plan, own)
    normal = np.cross(own.place[:, 0], own.speed[:, 0])
    beta = np.pi / 2 - apart(normal[None], own.sun[:, 0][None])[0]
    size = np.linalg.norm(own.place[:, 0])
    expected = np.arccos(np.sqrt(1 - (6371e3 / size) ** 2) / np.cos(beta)) / np.pi
    assert chunk.shadow.sun.mean() == pytest.approx(expected, rel=0.02)


def test_a_head_near_the_sun_is_blind(mission):
    """The Sun blinds a Sun-pointing head outside of eclipses, and nothing else does."""
    loaded = load_mission(EXAMPLE, ["time.duration=1 d"])
    law = Attitude(law="sun", axis=tuple(loaded.mission.heads[0].mounting.as_matrix()[:, 2]))
    turned = dataclasses.replace(loaded.mission, attitude=law)
    plan = plan_of(dataclasses.replace(loaded, mission=turned), errors=False)
    chunk = at(plan, plan.motion.at(0.0, 20.0, 4000))
    sun = (chunk.seen[0].blind & Blind.SUN) > 0
    assert (sun == ~chunk.shadow.sun).all()
    assert sun.any()
    assert not sun.all()


def test_a_written_mission_may_move(tmp_path):
    """The user's files are named from the folder, shipped designs by name; both are read back."""
    own = tmp_path / "designs" / "mine.toml"
    own.parent.mkdir()
    own.write_text(shipped("designs/noise_only.toml").read_text())
    text = Path(EXAMPLE).read_text()
    (tmp_path / "mission.toml").write_text(
        text.replace("designs/noise_only.toml", "designs/mine.toml", 1)
    )
    first = load_mission(tmp_path / "mission.toml")
    out = tmp_path / "out" / "placed.toml"
    save_mission(out, first.mission)
    assert str(tmp_path) not in out.read_text()
    assert [one["design"] for one in tomllib.loads(out.read_text())["heads"]] == [
        "../designs/mine.toml",
        *["designs/noise_only.toml"] * 2,
    ]
    moved = tmp_path.parent / f"{tmp_path.name}-moved"
    tmp_path.rename(moved)
    again = load_mission(moved / "out" / "placed.toml")
    assert [one.case for one in again.designs] == [one.case for one in first.designs]
    assert again.mission.orbit == first.mission.orbit


def test_files_of_missions_are_refused_by_name(tmp_path):
    text = Path(EXAMPLE).read_text()
    for old, new, words in (
        ('altitude = "600 km"', 'altitude = "60 km"', "perigee above 80 km"),
        ('local_time = "10.5 h"', "", "orbit.inclination or local_time must be given"),
        ('law = "nadir"', 'law = "sideways"', "attitude.law must be"),
        ('name = "up-right"', 'name = "up-left"', "different names"),
        ('step = "10 s"', 'step = "10 km"', "time.step must have a unit"),
        ('altitude = "600 km"', 'tle = ["a", "b"]', "line 1 of tle"),
    ):
        file = tmp_path / "mission.toml"
        assert old in text
        file.write_text(text.replace(old, new, 1))
        with pytest.raises(ValueError, match=words):
            load_mission(file)


def test_eclipses_and_blindings_begin_and_end_as_in_another_program():
    """Each begin and end is within one step of astropy and sgp4 with independent geometry."""
    plan, total = independent.low_heads(), 0
    own = at(plan, plan.motion.at(11 * 86400.0, 10.0, 1000))
    eclipse, heads = independent.blinded(
        [one.boresight for one in plan.heads],
        [one.limits for one in plan.heads],
        own.instants.second,
    )
    count, alone, _ = independent.events(own.shadow.sun, eclipse)
    assert (count >= 5, alone) == (True, 0)
    for seen, other in zip(own.seen, heads, strict=True):
        for cause, blind in other.items():
            count, alone, _ = independent.events((seen.blind & Blind[cause.upper()]) > 0, blind)
            assert alone == 0, cause
            total += count
    assert total >= 20
