"""No result depends on today's date or on a network, and dates beyond the tables have an error."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.time import Time
from astropy.utils import iers
from scipy.spatial.transform import Rotation

from startrack.core.units import arcsec, deg, installed_tables, utc
from startrack.earth.geometry import Aircraft, TwoLines, fly
from startrack.space import sun_direction
from tests.cli import every_command
from tests.cli.test_cli import COMMANDS

SPIN = 7.292115e-5  # rad / s
EARTH_RADIUS = 6378137.0  # metre
YEARS = (2020, 2040)
# What records when, or for how long, it was worked on.
NOT_COMPARED = (".sqlite", ".html", "bench.json", "bench.md", "bench.png")


def icrs_to_itrs(date: str) -> Rotation:
    return fly(Aircraft(date, 10 * deg, 47 * deg, 3e3, speed=100.0), np.zeros(1)).icrs_to_itrs[0]


@pytest.fixture(
    scope="module", params=[pytest.param(part, marks=pytest.mark.slow) for part in ("quick", "all")]
)
def folders(request, tmp_path_factory):
    """The files that the commands write in each year; a quick run has only the commands with
    dates."""
    folder, years = tmp_path_factory.mktemp("years"), [str(year) for year in YEARS]
    quick = request.param == "quick" and hasattr(os, "fork")
    for some in [years] if quick else [[year] for year in years]:
        command = [sys.executable, "-W", "error", every_command.__file__, request.param, folder]
        ended = subprocess.run([*command, *some], capture_output=True, text=True)
        assert ended.returncode == 0, f"{some}: {ended.stderr[-5000:]}"
    return [folder / str(year) for year in YEARS]


def test_the_example_has_every_command():
    named = {line.split()[0] for line in every_command.COMMANDS.strip().splitlines()}
    # These end when somebody leaves: tests/cli/test_serve.py and tests/page.
    assert named == {*COMMANDS, "earth"} - {"serve", "page"}
    for part in ("geometry", "render", "process", "terrain"):
        assert f"\nearth {part} " in every_command.COMMANDS
    for words in every_command.DATED_COMMANDS:
        assert f"\n{words} " in every_command.COMMANDS


def test_no_command_depends_on_the_date_or_the_network(folders):
    """All files except the recorded times are equal to the bit."""
    names = [
        sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
        for folder in folders
    ]
    assert names[0] == names[1]
    compared = [name for name in names[0] if not name.endswith(NOT_COMPARED)]
    written = {"dated/frame.fits", "dated/trials.csv", "geometry/geometry.nc", "render/mir.fits"}
    assert written <= set(compared)
    for name in compared:
        assert_equal(*(folder / name for folder in folders))


def assert_equal(one: Path, other: Path) -> None:
    if one.name == "summary.json":
        read = [json.loads(path.read_text()) for path in (one, other)]
        assert [found.pop("trials_per_s", None) is None for found in read].count(True) in (0, 2)
        assert read[0] == read[1], one
    else:
        assert one.read_bytes() == other.read_bytes(), one


def earth_rotation(date: str) -> Rotation:
    """The rotation from ICRS to ITRS with UT1 = UTC and no polar motion, to 0.5 arcsec.

    IERS Conventions (2010), eq. (5.10), (5.15), (5.16), largest terms of tables 5.2a and 5.2b.
    """
    jd = np.datetime64(date, "ms").astype(float) / 86400e3 + 2440587.5
    days = jd - 2451545.0
    t = days / 36525
    node, moon, elongation, sun = np.radians(
        [
            125.04455501 - 1934.13626197 * t,
            93.27209062 + 483202.01745772 * t,
            297.85019547 + 445267.11144694 * t,
            357.52910918 + 35999.05029114 * t,
        ]
    )
    angles = [node, 2 * (moon - elongation + node), 2 * (moon + node), 2 * node, sun]
    x = -0.016617 + 2004.191898 * t - 0.4297829 * t**2 - 0.19861834 * t**3
    y = -0.006951 - 0.025896 * t - 22.4072747 * t**2 + 0.00190059 * t**3
    x += np.sin(angles) @ [-6.84431844, -0.52390804, -0.09055222, 0.08216876, 0.05870702]
    y += np.cos(angles) @ [9.20523626, 0.57303342, 0.09784669, -0.08961824, 0.0]
    x, y = x * arcsec, y * arcsec
    a = 0.5 + (x * x + y * y) / 8
    celestial = [
        [1 - a * x * x, -a * x * y, x],
        [-a * x * y, 1 - a * y * y, y],
        [-x, -y, 1 - a * (x * x + y * y)],
    ]
    angle = 2 * np.pi * ((0.7790572732640 + 0.00273781191135448 * days) + days % 1)
    spin = Rotation.from_rotvec([0, 0, -angle - x * y / 2])
    return spin * Rotation.from_matrix(celestial).inv()


@pytest.mark.parametrize(
    "date", ["2010-03-01T06:00:00", "2045-06-21T10:00:00", "2060-10-05T21:00:00"]
)
def test_the_earth_turns_as_the_iau_says_also_beyond_the_table(date):
    """The limits are 0.9 s for UT1 - UTC, in the table and beyond it, and 0.5 arcsec for the
    pole."""
    difference = (icrs_to_itrs(date) * earth_rotation(date).inv()).as_rotvec()
    assert abs(difference[2]) / SPIN < 0.9
    assert np.hypot(*difference[:2]) < 1.0 * arcsec
    with installed_tables():
        held = float(iers.IERS_Auto.open().ut1_utc(Time(date)).value)
    assert -difference[2] / SPIN == pytest.approx(held, abs=0.5 * arcsec / SPIN)


@pytest.mark.parametrize(
    ("end", "date"),
    [
        ("2005-07-01", "2017-02-01T00:00:00"),  # five leap seconds later
        ("2016-07-01", "2017-02-01T00:00:00"),  # one leap second later
        ("2016-07-01", "2024-07-01T12:00:00"),
        ("2024-07-01", "2026-02-01T00:00:00"),
    ],
)
def test_beyond_the_table_its_last_value_is_kept_within_the_stated_error(monkeypatch, end, date):
    """The table is cut off before the date of an observed Earth orientation."""
    full = iers.IERS_Auto.open()
    known = icrs_to_itrs(date)
    short = full[full["MJD"].value < Time(end).mjd]
    monkeypatch.setattr(iers.IERS_Auto, "iers_table", short)
    difference = (icrs_to_itrs(date) * known.inv()).as_rotvec()
    with installed_tables():
        last, true = short["UT1_UTC"][-1].value, full.ut1_utc(Time(date)).value
    assert -difference[2] / SPIN == pytest.approx(last - true, abs=1e-4)
    assert abs(difference[2]) < SPIN * (0.9 + abs(last))
    assert np.hypot(*difference[:2]) < 0.31 * arcsec


def test_a_leap_second_is_nothing_to_stars_and_little_to_bodies():
    """One second of time: the stated angles, from the observer's own motion."""
    from startrack.catalog.apparent import earth_observer
    from startrack.scene.ephemeris import observer_of
    from startrack.scene.parameters import Scene

    dates = "2040-03-01T00:00:00", "2040-03-01T00:00:01"
    seen = [observer_of(Scene(lights=("sun",), date=date), None) for date in dates]
    assert np.linalg.norm(seen[1].position - seen[0].position) == pytest.approx(30e3, rel=0.03)
    for name, most in (("sun", 0.045), ("moon", 0.6), ("venus", 0.06), ("mars", 0.06)):
        first, second = (one.see(name).direction for one in seen)
        assert np.linalg.norm(np.cross(first, second)) < most * arcsec
    turn = earth_observer(2040.0 + 1 / 86400 / 365.25).velocity - earth_observer(2040.0).velocity
    assert np.linalg.norm(turn) / 299792458 < 1e-5 * arcsec


def test_dates_far_beyond_the_tables_are_taken():
    assert np.degrees(np.arcsin(sun_direction("2045-06-21T00:00:00Z")[2])) == pytest.approx(
        23.433, abs=0.005
    )
    first = "1 25544U 98067A   45343.69339541  .00001764  00000-0  38792-4 0  9990"
    second = "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482"
    pytest.importorskip("sgp4")
    assert TwoLines(first, second).epoch.startswith("2045-12-09T16:38:29")
    assert utc("2099-01-01").jd == 2487704.5


def test_what_is_no_date():
    with pytest.raises(
        ValueError, match=r"epoch must be a time such as 2026-06-21T10:00:00, got 'yesterday'"
    ):
        utc("yesterday")


def test_the_settings_of_the_caller_come_back():
    before = iers.conf.auto_download, iers.conf.auto_max_age, iers.conf.iers_degraded_accuracy
    with installed_tables():
        with installed_tables():
            pass
        assert (iers.conf.auto_download, iers.conf.auto_max_age) == (False, None)
    after = iers.conf.auto_download, iers.conf.auto_max_age, iers.conf.iers_degraded_accuracy
    assert after == before
