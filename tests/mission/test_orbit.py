"""Mean elements, orbit files and SPICE kernels, and the interpolation between times."""

import dataclasses
import math
import sys

import astropy.units as u
import numpy as np
import pytest
from astropy.time import Time
from scipy.spatial.transform import Rotation

from startrack import shipped
from startrack.core import Refused, deg, installed_tables
from startrack.mission import load_mission
from startrack.mission.files import read_ck, read_spk, write_ck, write_spk
from startrack.mission.instants import motion_of, path_of, spread
from startrack.mission.parameters import MissionOrbit
from startrack.space import Kepler, sun_synchronous
from tests.mission.messages import write_oem

MISSION = load_mission(shipped("missions/sun-synchronous.toml"), ["time.duration=6 h"]).mission
BEGIN = MISSION.time.begin


@pytest.mark.parametrize("tilt", [0.3, 0.9, 1.72])
def test_rates_are_those_of_sgp4(tilt):
    """sgp4's secular rates, which also have J4 and the square of J2."""
    from sgp4.api import WGS72, Satrec

    axis, e = 7.2e6, 0.02
    record = Satrec()
    mean = 60 * math.sqrt(3.986008e14 / axis**3)
    record.sgp4init(WGS72, "i", 1, 25000.0, 0.0, 0.0, 0.0, e, 0.4, tilt, 0.1, mean, 0.2)
    node, perigee, anomaly = Kepler(axis, e, tilt, 0.2, 0.4, 0.1).rates
    assert node * 60 == pytest.approx(record.nodedot, rel=5e-3)
    assert perigee * 60 == pytest.approx(record.argpdot, rel=1e-2)
    # The mean motion of a two-line element set is itself a mean one, with J2 in it.
    assert anomaly * 60 == pytest.approx(record.mdot, rel=2e-3)


def test_kepler_is_a_solution_of_newton():
    """Without J2, the acceleration by finite differences is GM / r^2."""
    orbit = Kepler(9e6, 0.25, 1.0, 0.3, 0.5, 0.1)
    object.__setattr__(orbit, "rates", (0.0, 0.0, math.sqrt(3.986004418e14 / 9e6**3)))
    second = np.linspace(0, 8000, 50)
    (before, _), (place, speed), (after, _) = (orbit.state(second + d) for d in (-1.0, 0, 1.0))
    pull = -3.986004418e14 * place / np.linalg.norm(place, axis=0) ** 3
    assert np.abs(after - 2 * place + before - pull).max() < 1e-4
    assert np.abs((after - before) / 2 - speed).max() < 1e-2


def test_a_sun_synchronous_orbit_keeps_its_local_time():
    """The published inclination at 600 km, and, by astropy, the mean Sun at the node a year
    later."""
    assert sun_synchronous(6378137.0 + 600e3) / deg == pytest.approx(97.79, abs=0.02)
    orbit = path_of(MissionOrbit(altitude=600e3, local_time=10.5 * 3600), BEGIN)
    for days in (0.0, 365.0):
        with installed_tables():
            date = Time(BEGIN, scale="utc") + days * u.d
            greenwich = date.sidereal_time("mean", "greenwich", model="IAU1982").rad
            utc = (date.utc.jd1 + date.utc.jd2 + 0.5) % 1
        node = orbit.node + orbit.rates[0] * days * 86400
        local = ((node - greenwich) / math.tau + utc) % 1
        assert local * 24 == pytest.approx(10.5, abs=0.01)


def test_places_between_times_are_interpolated():
    """Six points at steps of 60 s in a low orbit: within 1 cm and 10 micrometre / second."""
    path = path_of(MISSION.orbit, BEGIN)

    def states(second):
        return np.concatenate(path.state(second))

    got = spread(states, 123.0, 7.0, 2000, 60.0, 6)
    gap = np.abs(got - states(123.0 + 7.0 * np.arange(2000))).max(axis=1)
    assert gap[:3].max() < 0.01
    assert gap[3:].max() < 1e-5
    coarse = spread(states, 0.0, 100.0, 50, 60.0, 6)
    assert (coarse == states(100.0 * np.arange(50))).all()


def test_an_orbit_file_moves_the_spacecraft_as_its_elements_do(tmp_path):
    course = motion_of(MISSION)
    own = course.at(-60.0, 60.0, 400)
    with installed_tables():
        epochs = tuple((Time(BEGIN, scale="utc") + own.second * u.s).isot)
    write_oem(tmp_path / "a.oem", epochs, own.place.T, own.speed.T)
    flown = motion_of(dataclasses.replace(MISSION, orbit=MissionOrbit(oem=str(tmp_path / "a.oem"))))
    a, b = (one.at(0.0, 10.0, 2000) for one in (course, flown))
    assert np.abs(a.place - b.place).max() < 0.05  # epochs in milliseconds: 7 m / ms, exact here
    assert np.abs(a.body - b.body).max() < 1e-6
    assert np.abs(a.latitude - b.latitude).max() < 1e-6


def test_spice_kernels_give_back_what_was_written(tmp_path):
    """Attitudes within 1e-12, states at and between the written ones; errors as sentences."""
    pytest.importorskip("spiceypy")
    turn = Rotation.from_rotvec(np.outer(np.arange(200), [0.01, -0.004, 0.02]))
    with installed_tables():
        date = Time("2026-03-20T00:00:00", scale="utc") + np.arange(200) * u.s
    write_ck(tmp_path / "a.bc", date, turn.as_quat())
    (back,) = read_ck(tmp_path / "a.bc")
    assert len(back.quaternion) == 200
    again = Rotation.from_quat(back.quaternion)
    assert (again * turn.inv()).magnitude().max() < 1e-12
    assert np.abs((back.date - date).sec).max() < 1e-6
    path = Kepler(7e6, 0.01, 1.0, 0.2, 0.3, 0.4)
    second = 60.0 * np.arange(120)
    place, speed = path.state(second)
    write_spk(tmp_path / "o.bsp", date[0] + second * u.s, place.T, speed.T)
    (orbit,) = read_spk(tmp_path / "o.bsp")
    assert np.abs(orbit.place - place.T).max() < 2e-3  # 0.1 us of a double of seconds since 2000
    (between,) = read_spk(tmp_path / "o.bsp", 20.0)
    assert np.abs(between.place - path.state(np.linspace(0, second[-1], 358))[0].T).max() < 0.1
    (tmp_path / "bad.bsp").write_text("no kernel")
    with pytest.raises(Refused, match="must be a file that SPICE reads"):
        read_spk(tmp_path / "bad.bsp")


def test_spice_is_asked_for_by_name(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "spiceypy", None)
    (tmp_path / "o.bsp").write_text("")
    with pytest.raises(ImportError, match=r"startrack\[spice\]"):
        read_spk(tmp_path / "o.bsp")
