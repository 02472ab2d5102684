"""Orbits and the Sun against independent sources."""

import numpy as np
import pytest

from startrack.core import Refused, deg
from startrack.earth.geometry import Orbit, TwoLines, fly, sun_zenith_below
from startrack.earth.terrain import geodetic, up
from startrack.space import sun_direction

pytest.importorskip("sgp4")

# The ISS, the example of the documentation of the package sgp4.
FIRST = "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991"
SECOND = "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482"


def test_the_axes_turn_with_the_earth():
    """TEME to ITRS is a turn by Greenwich mean sidereal time but for the motion of the pole.

    The pole moves by 0.5 arcsec at most, 17 m here. (Vallado et al. 2006, appendix C.)
    """
    from sgp4.propagation import gstime

    orbit = TwoLines(FIRST, SECOND)
    record = orbit.satellite()
    second = np.array([0.0, 3000.0, 50000.0])
    flight = fly(orbit, second)
    for n in range(3):
        fraction = record.jdsatepochF + second[n] / 86400
        _, teme, _ = record.sgp4(record.jdsatepoch, fraction)
        angle = gstime(record.jdsatepoch + fraction)
        turn = np.array(
            [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
        )
        # UT1 - UTC was -0.17 s in December 2019: 80 m along the equator.
        np.testing.assert_allclose(flight.position[n], 1e3 * turn @ teme, atol=110)


def test_velocities_are_the_slopes_of_positions():
    orbit = Orbit("2026-06-21T10:00:00", node=1.0, anomaly=2.0)
    flight = fly(orbit, np.array([99.0, 100.0, 101.0]))
    slope = (flight.position[2] - flight.position[0]) / 2
    np.testing.assert_allclose(flight.velocity[1], slope, atol=0.02)
    fixed = flight.icrs_to_itrs.inv().apply(flight.position)
    inertial = flight.icrs_to_itrs[1].apply((fixed[2] - fixed[0]) / 2)
    np.testing.assert_allclose(flight.inertial[1], inertial, atol=0.02)


def test_an_orbit_keeps_its_height_and_inclination():
    """Except for the short-period terms of J2: about 10 km in height."""
    orbit = Orbit("2026-06-21T10:00:00", altitude=600e3, inclination=1.0)
    second = np.linspace(0, 5800, 60)
    flight = fly(orbit, second)
    radius = np.linalg.norm(flight.position, axis=1)
    assert np.abs(radius - 6378137 - 600e3).max() < 15e3
    assert np.abs(geodetic(flight.position)[1]).max() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("epoch", "declination"),
    [
        ("2026-03-20T14:46:00", 0.0),
        ("2026-06-21T08:25:00", 23.437),
        ("2026-12-21T20:50:00", -23.437),
    ],
)
def test_the_sun_at_equinox_and_solstice(epoch, declination):
    """Moments of the seasons of 2026, to the minute, from the US Naval Observatory."""
    sun = sun_direction(epoch)
    assert np.degrees(np.arcsin(sun[2])) == pytest.approx(declination, abs=0.002)


def test_the_sun_at_noon_stands_south_of_greenwich():
    """On 16 April the equation of time is zero."""
    sun = sun_direction("2026-04-15T12:00:00")
    assert np.degrees(np.arctan2(sun[1], sun[0])) == pytest.approx(0.0, abs=0.1)


def test_elements_that_cannot_be():
    with pytest.raises(ValueError, match="epoch must be a time such as"):
        Orbit("yesterday")
    with pytest.raises(ValueError, match="perigee above 80 km"):
        Orbit("2026-06-21T10:00:00", altitude=600e3, eccentricity=0.2)
    with pytest.raises(ValueError, match="anomaly must be finite, got nan"):
        Orbit("2026-06-21T10:00:00", anomaly=float("nan"))
    with pytest.raises(ValueError, match="line 1 of tle must end in its checksum 1"):
        TwoLines(FIRST[:-1] + "5", SECOND)
    with pytest.raises(ValueError, match="line 2 of tle must have 69 characters"):
        TwoLines(FIRST, FIRST)
    other = with_checksum(SECOND[:2] + "54321" + SECOND[7:])
    with pytest.raises(ValueError, match="both lines of tle must be of one satellite"):
        TwoLines(FIRST, other)
    assert FIRST[62] == "0"
    with pytest.raises(ValueError, match=r"ephemeris type of tle .* must be 0, .* got 4"):
        TwoLines(with_checksum(FIRST[:62] + "4" + FIRST[63:]), SECOND)


def with_checksum(line):
    total = sum(int(c) if c.isdecimal() else c == "-" for c in line[:68])
    return f"{line[:68]}{total % 10}"


def test_the_epoch_keeps_its_microseconds():
    """A millisecond is 7.7 m of orbit; the last digit of two-line elements is 0.9 ms."""
    orbit = TwoLines(FIRST, SECOND)
    record = orbit.satellite()
    seconds = 86400 * 0.69339541
    hours, rest = divmod(seconds, 3600)
    minutes, rest = divmod(rest, 60)
    assert orbit.epoch == f"2019-12-09T{int(hours):02d}:{int(minutes):02d}:{rest:09.6f}"
    assert record.jdsatepochF == pytest.approx(0.69339541, abs=1e-12)


def test_local_time_and_day_give_the_elements():
    """Sentinel-2: 786 km, 98.62 degree, 10:30 descending, so 22:30 at the ascending node."""
    orbit = Orbit("2026-06-21T10:00:00", 786e3, local_time=22.5 * 3600, day=80.5).resolved()
    assert orbit.epoch.startswith("2026-03-21T10:00:00")
    assert orbit.inclination / deg == pytest.approx(98.55, abs=0.1)
    flight = fly(orbit, np.linspace(0, 6000, 601))
    _, latitude, _ = geodetic(flight.position)
    node = int(np.argmax((latitude[:-1] < 0) & (latitude[1:] >= 0)))
    longitude = geodetic(flight.position[node : node + 1])[0][0] / deg
    hour = (10 + flight.second[node] / 3600 + longitude / 15) % 24
    assert hour == pytest.approx(22.5, abs=0.05)
    assert Orbit("2026-06-21T10:00:00").resolved() == Orbit("2026-06-21T10:00:00")


@pytest.mark.parametrize(
    ("latitude", "ascending", "day"), [(47, False, 172), (-30, True, 10), (0, False, 300)]
)
def test_the_sun_below_is_that_of_the_flight(latitude, ascending, day):
    """Against the pass itself, propagated by SGP4, and the Sun at that instant."""
    orbit = Orbit("2026-06-21T12:00:00", 600e3, local_time=22.0 * 3600, day=day).resolved()
    second = np.arange(0.0, 5900.0, 5.0)
    flight = fly(orbit, second)
    longitude, there, _ = geodetic(flight.position)
    above = there > latitude * deg
    crosses = (~above[:-1] & above[1:]) if ascending else (above[:-1] & ~above[1:])
    n = int(np.argmax(crosses))
    sun = sun_direction(orbit.epoch, float(second[n]))
    zenith = np.arccos(up(longitude[n : n + 1], there[n : n + 1])[0] @ sun)
    found = sun_zenith_below(orbit, latitude * deg, ascending)
    assert found / deg == pytest.approx(zenith / deg, abs=0.3)


def test_a_latitude_out_of_reach_and_an_orbit_that_is_not_synchronous_are_refused():
    with pytest.raises(Refused, match=r"at most 51\.64 deg, got 60 deg"):
        sun_zenith_below(TwoLines(FIRST, SECOND), 60 * deg, True)
    with pytest.raises(Refused, match="local_time must be left out above 5972 km"):
        Orbit("2026-06-21T10:00:00", 7000e3, local_time=36000.0)
    with pytest.raises(Refused, match="day must lie in"):
        Orbit("2026-06-21T10:00:00", day=400)
