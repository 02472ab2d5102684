"""OEM and AEM, compared with other programs and the formulas of the standards."""

import dataclasses
import textwrap
from pathlib import Path

import astropy.units as u
import numpy as np
import pytest
from astropy.time import Time
from scipy.spatial.transform import Rotation

from startrack import shipped
from startrack.core import Refused, installed_tables
from startrack.mission import load_mission
from startrack.mission.files import read_ck, write_ck
from startrack.mission.instants import law_of, motion_of, path_of
from startrack.mission.messages import read_aem, read_oem
from startrack.mission.parameters import Attitude, MissionOrbit
from tests.mission.messages import (
    message,
    standard_matrix,
    standard_quaternions,
    write_aem,
    write_oem,
)

MISSION = load_mission(shipped("missions/sun-synchronous.toml"), ["time.duration=6 h"]).mission
BEGIN = MISSION.time.begin
QUARTER = "0 0 0.7071067811865476 0.7071067811865476"


def dates(seconds, begin=BEGIN, scale="utc"):
    with installed_tables():
        return tuple((Time(begin, scale=scale) + np.asarray(seconds) * u.s).isot)


def matrices(path, begin, seconds):
    """(n, 3, 3) icrs_to_body of a file, as a mission uses it."""
    law = law_of(Attitude(law="aem", aem=str(path)), begin)
    seconds = np.atleast_1d(np.asarray(seconds, float))
    place = motion_of(MISSION)._place(0.0, 1.0, len(seconds))
    return law(dataclasses.replace(place, second=seconds)).transpose(2, 0, 1)


def segment(rows, **meta):
    """Lines of a segment of an AEM 1.0."""
    keys = {
        "OBJECT_NAME": "X",
        "OBJECT_ID": "2024-001A",
        "REF_FRAME_A": "EME2000",
        "REF_FRAME_B": "SC_BODY_1",
        "ATTITUDE_DIR": "A2B",
        "TIME_SYSTEM": "UTC",
        "START_TIME": "2024-01-01T00:00:00",
        "STOP_TIME": "2024-01-01T01:00:00",
        "ATTITUDE_TYPE": "QUATERNION",
        "QUATERNION_TYPE": "LAST",
    }
    keys |= meta
    lines = [f"{key} = {value}" for key, value in keys.items() if value]
    return "\n".join(["META_START", *lines, "META_STOP", "DATA_START", *rows, "DATA_STOP"])


def aem(path: Path, *segments: str, version: str = "1.0") -> Path:
    head = f"CCSDS_AEM_VERS = {version}\nCREATION_DATE = 2024-01-01T00:00:00\nORIGINATOR = X\n"
    path.write_text(head + "\n".join(segments) + "\n")
    return path


def test_an_attitude_file_is_turned_as_the_standard_has_it(tmp_path):
    """Three attitudes without symmetry, by the matrix of CCSDS 504.0's annex."""
    numbers = np.array([[0.1, -0.5, 0.3, 0.8], [0.4, 0.2, -0.6, 0.1], [-0.3, 0.3, 0.2, -0.9]])
    numbers /= np.linalg.norm(numbers, axis=1)[:, None]
    rows = [
        f"2024-01-01T00:0{k}:00 {' '.join(map(repr, row.tolist()))}"
        for k, row in enumerate(numbers)
    ]
    back = matrices(aem(tmp_path / "a.aem", segment(rows)), "2024-01-01T00:00:00", [0, 60, 120])
    wanted = np.array([standard_matrix(row) for row in numbers])
    assert np.abs(back - wanted).max() < 1e-12
    reverse = aem(tmp_path / "b.aem", segment(rows, ATTITUDE_DIR="B2A"))
    back = matrices(reverse, "2024-01-01T00:00:00", [0, 60, 120])
    assert np.abs(back - wanted.transpose(0, 2, 1)).max() < 1e-12
    other = segment(rows, REF_FRAME_A="SC_BODY_1", REF_FRAME_B="EME2000")
    back = matrices(aem(tmp_path / "c.aem", other), "2024-01-01T00:00:00", [0, 60, 120])
    assert np.abs(back - wanted.transpose(0, 2, 1)).max() < 1e-12
    later = segment(rows, ATTITUDE_DIR="", QUATERNION_TYPE="")
    back = matrices(aem(tmp_path / "d.aem", later, version="2.0"), "2024-01-01T00:00:00", [0, 60])
    assert np.abs(back - wanted[:2]).max() < 1e-12


def test_a_spacecraft_that_looks_down_has_its_axis_on_the_nadir(tmp_path):
    """The third row of the standard's matrix is body z in ICRS: minus the position, within 1e-9."""
    own = motion_of(MISSION).at(0.0, 5.0, 400)
    turn = Rotation.from_matrix(own.body.transpose(2, 0, 1))
    numbers = standard_quaternions(turn)
    down = np.array([standard_matrix(row)[2] for row in numbers])
    assert np.abs(down + (own.place / np.linalg.norm(own.place, axis=0)).T).max() < 1e-9
    path = tmp_path / "a.aem"
    write_aem(path, dates(own.second), turn)
    law = Attitude(law="aem", aem=str(path))
    flown = motion_of(dataclasses.replace(MISSION, attitude=law)).at(0.0, 2.0, 900)
    reference = motion_of(MISSION).at(0.0, 2.0, 900)
    assert np.abs(flown.body - reference.body).max() < 1e-6
    assert np.abs(flown.rate - reference.rate).max() < 5e-7  # of straight turns in 5 s


def test_one_flight_through_an_aem_and_a_ck_is_the_same_to_spice_and_to_a_mission(tmp_path):
    spiceypy = pytest.importorskip("spiceypy")
    turn = Rotation.from_rotvec(np.outer(np.arange(50), [0.01, -0.004, 0.02]))
    turn = turn * Rotation.from_rotvec([0.4, 1.1, -0.7])
    epochs = dates(np.arange(50.0))
    write_aem(tmp_path / "a.aem", epochs, turn)
    write_ck(tmp_path / "a.bc", Time(list(epochs), scale="utc"), turn.as_quat())
    seconds = np.array([0.0, 10.5, 30.25, 48.9])
    flown = [matrices(tmp_path / name, BEGIN, seconds) for name in ("a.aem", "a.bc")]
    assert np.abs(flown[0] - flown[1]).max() < 1e-7
    spiceypy.kclear()
    spiceypy.furnsh([str(tmp_path / "a.bc"), str(tmp_path / "a.tsc")])
    for second, matrix in zip(seconds, flown[1], strict=True):
        # 69.184 s from UTC to TDB since 2017, and the 1.7 ms of the year that TDB has over TT.
        with installed_tables():
            date = (Time(BEGIN, scale="utc") + second * u.s).tdb
        et = (date.jd1 - 2451545.0) * 86400 + date.jd2 * 86400
        pointing, _ = spiceypy.ckgp(-999000, spiceypy.sce2c(-999, et), 0, "J2000")
        assert np.abs(pointing - matrix).max() < 1e-8
    spiceypy.kclear()


def test_nothing_is_interpolated_over_a_gap(tmp_path):
    """0 deg to 30:00, 90 deg from 40:00; if the next segment begins at once, the later one
    holds."""
    first = segment(["2024-01-01T00:00:00 0 0 0 1", "2024-01-01T00:30:00 0 0 0 1"])
    late = segment([f"2024-01-01T00:40:00 {QUARTER}", f"2024-01-01T01:00:00 {QUARTER}"])
    path = aem(tmp_path / "gap.aem", first, late)
    turned = standard_matrix([float(word) for word in QUARTER.split()])
    back = matrices(path, "2024-01-01T00:00:00", [0, 1800, 2400, 3600])
    assert np.abs(back - [np.eye(3), np.eye(3), turned, turned]).max() < 1e-12
    for second in (1801.0, 2100.0, 2399.0):
        with pytest.raises(Refused, match=r"gap from 2024-\S*T00:30:00 to \S*T00:40:00 UTC, and"):
            matrices(path, "2024-01-01T00:00:00", second)
    with pytest.raises(Refused, match="is asked for at 2024-01-01T00:31:00;"):
        matrices(path, "2024-01-01T00:00:00", [1800.0, 1860.0, 2340.0])
    for second in (-1.0, 3601.0):
        with pytest.raises(Refused, match=r"from 2024-\S*T00:00:00 to \S*T01:00:00 UTC, and asked"):
            matrices(path, "2024-01-01T00:00:00", second)
    with pytest.raises(Refused, match=r"asked for at 2023-12-31T23:59:59\.500"):
        matrices(path, "2024-01-01T00:00:00", -0.5)
    next_ = segment([f"2024-01-01T00:30:00 {QUARTER}", f"2024-01-01T01:00:00 {QUARTER}"])
    path = aem(tmp_path / "next.aem", first, next_)
    back = matrices(path, "2024-01-01T00:00:00", [1799.9, 1800.1])
    assert np.abs(back - [np.eye(3), turned]).max() < 1e-12
    law = Attitude(law="aem", aem=str(path))
    moved = dataclasses.replace(MISSION.time, begin="2024-01-01T00:00:00", duration=3600.0)
    flown = motion_of(dataclasses.replace(MISSION, attitude=law, time=moved)).at(0.0, 10.0, 361)
    assert np.abs(flown.rate).max() < 1e-12  # no rate over the step between two segments
    over = aem(tmp_path / "over.aem", late, first)
    with pytest.raises(Refused, match="must not begin before the one before ends"):
        read_aem(over)
    usable = segment(
        ["2024-01-01T00:00:00 0 0 0 1", "2024-01-01T00:30:00 0 0 0 1"],
        USEABLE_START_TIME="2024-01-01T00:05:00",
        USEABLE_STOP_TIME="2024-001T00:25:00",
    )
    path = aem(tmp_path / "usable.aem", usable)
    matrices(path, "2024-01-01T00:00:00", [300, 1500])
    with pytest.raises(Refused, match=r"given from \S*T00:05:00 to \S*T00:25:00 UTC"):
        matrices(path, "2024-01-01T00:00:00", 1501)


def test_segments_have_their_own_directions_and_orders(tmp_path):
    """Four ways to write one attitude, each with its own keywords."""
    q = np.array([0.1, -0.5, 0.3, 0.8]) / np.linalg.norm([0.1, -0.5, 0.3, 0.8])
    ways = (
        (q, {}),
        (np.roll(q, 1), {"QUATERNION_TYPE": "FIRST"}),
        (q * [-1, -1, -1, 1], {"ATTITUDE_DIR": "B2A"}),
        (q * [-1, -1, -1, 1], {"REF_FRAME_A": "SC BODY 1", "REF_FRAME_B": "ICRF"}),
        ([*q, 1e-3, 0, 0], {"ATTITUDE_TYPE": "QUATERNION/RATE"}),
    )
    parts = []
    for hour, (numbers, meta) in enumerate(ways):
        text = " ".join(repr(float(number)) for number in numbers)
        parts.append(segment([f"2024-01-01T0{hour}:{m}:00 {text}" for m in ("00", "59")], **meta))
    path = aem(tmp_path / "a.aem", *parts)
    back = matrices(path, "2024-01-01T00:00:00", 60.0 + 3600.0 * np.arange(5))
    assert np.abs(back - standard_matrix(q)).max() < 1e-12


@pytest.mark.parametrize(
    ("scale", "text", "utc_second"),
    [
        ("UTC", "2024-060T00:00:30Z", 30.0),
        ("UTC", "2024-02-29T00:00:30.25", 30.25),
        # UTC is 37 s behind TAI since 2017, TT 32.184 s ahead of TAI, GPS 19 s behind it
        ("TAI", "2024-02-29T00:01:07", 30.0),
        ("TT", "2024-060T00:01:39.184", 30.0),
        ("GPS", "2024-02-29T00:00:48", 30.0),
    ],
)  # IERS Bulletin C 52; IS-GPS-200, section 3.3.4
def test_dates_are_those_of_their_time_system(tmp_path, scale, text, utc_second):
    rows = [f"{text} 0 0 0 1", f"2024-03-01T00:00:00 {QUARTER}"]
    (part,) = read_aem(aem(tmp_path / "a.aem", segment(rows, TIME_SYSTEM=scale)))
    with installed_tables():
        second = (part.date[0] - Time("2024-02-29T00:00:00", scale="utc")).sec
    assert second == pytest.approx(utc_second, abs=1e-6)


def test_a_leap_second_is_a_second_of_utc_alone(tmp_path):
    rows = ["2016-12-31T23:59:60.5 0 0 0 1", f"2017-001T00:00:00.5 {QUARTER}"]
    (part,) = read_aem(aem(tmp_path / "a.aem", segment(rows)))
    with installed_tables():
        assert (part.date[1] - part.date[0]).sec == pytest.approx(1.0, abs=1e-9)
    for scale, text in (("TAI", rows[0]), ("UTC", rows[0].replace("2016", "2018"))):
        late = ["2019-01-01T00:00:00 0 0 0 1"]
        with pytest.raises(Refused, match="dates must be dates"):
            read_aem(aem(tmp_path / "b.aem", segment([text, *late], TIME_SYSTEM=scale)))


@pytest.mark.parametrize(
    ("meta", "words"),
    [
        ({"ATTITUDE_DIR": ""}, "ATTITUDE_DIR must be A2B or B2A, got none"),
        ({"QUATERNION_TYPE": ""}, "QUATERNION_TYPE must be LAST or FIRST, got none"),
        ({"QUATERNION_TYPE": "MIDDLE"}, "QUATERNION_TYPE must be LAST or FIRST"),
        ({"ATTITUDE_TYPE": "EULER_ANGLE"}, "ATTITUDE_TYPE must be QUATERNION"),
        ({"REF_FRAME_B": "STARTRACKER_1"}, "REF_FRAME_A and REF_FRAME_B must be one of ICRF"),
        ({"REF_FRAME_A": "LVLH"}, "REF_FRAME_A and REF_FRAME_B must be one of ICRF"),
        ({"REF_FRAME_A": "TEME"}, "REF_FRAME_A and REF_FRAME_B must be one of ICRF"),
        ({"TIME_SYSTEM": "MET"}, "TIME_SYSTEM must be UTC or TAI"),
        ({"TIME_SYSTEM": ""}, "TIME_SYSTEM must be UTC or TAI .* got none"),
        ({"INTERPOLATION_METHOD": "SPLINE"}, "INTERPOLATION_METHOD must be LINEAR or LAGRANGE"),
        ({"INTERPOLATION_METHOD": "HERMITE"}, "INTERPOLATION_METHOD must be LINEAR or LAGRANGE"),
        (
            {"INTERPOLATION_METHOD": "LAGRANGE"},
            "INTERPOLATION_DEGREE must be given with INTERPOLATION_METHOD = LAGRANGE, got none",
        ),
    ],
)
def test_what_cannot_be_read_one_way_is_refused(tmp_path, meta, words):
    rows = ["2024-01-01T00:00:00 0 0 0 1", "2024-01-01T00:30:00 0 0 0 1"]
    with pytest.raises(Refused, match=words):
        read_aem(aem(tmp_path / "a.aem", segment(rows, **meta)))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["2024-01-01T00:00:00 0 0 0 1"], "two or more that rise"),
        (["2024-01-01T00:30:00 0 0 0 1", "2024-01-01T00:00:00 0 0 0 1"], "two or more that rise"),
        (["2024-01-01T00:00:00 0 0 1", "2024-01-01T00:30:00 0 0 0 1"], "4 finite numbers each"),
        (["2024-01-01T00:00:00 0 0 0 2", "2024-01-01T00:30:00 0 0 0 1"], "the norm 1, got 2"),
        (["2024-13-01T00:00:00 0 0 0 1", "2024-01-01T00:30:00 0 0 0 1"], "dates must be dates"),
        (["2023-366T00:00:00 0 0 0 1", "2024-01-01T00:30:00 0 0 0 1"], "dates must be dates"),
        (["what is this"], "line 17 must be what an AEM has there"),
    ],
)
def test_bad_rows_of_attitudes_are_refused_by_name(tmp_path, rows, words):
    with pytest.raises(Refused, match=words):
        read_aem(aem(tmp_path / "a.aem", segment(rows)))


def test_other_bodies_and_cut_files_are_refused(tmp_path):
    rows = ["2024-01-01T00:00:00 0 0 0 1", "2024-01-01T00:30:00 0 0 0 1"]
    late = [row.replace("T00", "T01") for row in rows]
    both = aem(tmp_path / "a.aem", segment(rows), segment(late, REF_FRAME_B="SC_BODY_2"))
    with pytest.raises(Refused, match="name one body in all segments, got SC_BODY_2"):
        read_aem(both)
    whole = aem(tmp_path / "b.aem", segment(rows)).read_text()
    (tmp_path / "b.aem").write_text(whole.replace("DATA_STOP", ""))
    with pytest.raises(Refused, match="ends within one"):
        read_aem(tmp_path / "b.aem")
    (tmp_path / "c.aem").write_text('<?xml version="1.0"?>')
    with pytest.raises(Refused, match=r"CCSDS_AEM_VERS = 1\.0 or 2\.0 in its first line"):
        read_aem(tmp_path / "c.aem")
    (tmp_path / "d.aem").write_text(whole, encoding="utf-16")
    with pytest.raises(Refused, match="must be text in ASCII or UTF-8, but is in UTF-16"):
        read_aem(tmp_path / "d.aem")
    (tmp_path / "e.aem").write_text("\n")
    with pytest.raises(Refused, match="must be a CCSDS AEM, but is empty"):
        read_aem(tmp_path / "e.aem")


def test_polynomials_of_attitudes_go_through_the_numbers_of_their_degree(tmp_path):
    """A swing of 4 s with a row each second: degree 7 is within 2e-3 of the law, linear within
    0.1."""
    angle = 0.5 * np.sin(2 * np.pi * np.arange(21.0) / 8)
    turn = Rotation.from_rotvec(np.outer(angle, [0, 0.6, 0.8]))
    rows = [
        f"{date} {' '.join(map(repr, row.tolist()))}"
        for date, row in zip(
            dates(np.arange(21.0), "2024-01-01T00:00:00"), standard_quaternions(turn), strict=True
        )
    ]
    between = np.arange(5, 15) + 0.5
    truth = 0.5 * np.sin(2 * np.pi * between / 8)
    errors = []
    for keys in ({}, {"INTERPOLATION_METHOD": "LAGRANGE", "INTERPOLATION_DEGREE": "7"}):
        path = aem(tmp_path / "a.aem", segment(rows, **keys))
        seen = Rotation.from_matrix(matrices(path, "2024-01-01T00:00:00", between))
        errors.append(np.abs(seen.as_rotvec() @ [0, 0.6, 0.8] - truth).max())
    assert 0.02 < errors[0] < 0.1
    assert errors[1] < 5e-4


def states():
    """(n, 3) metre and metre / second on a circular orbit every 300 s, by its formula."""
    angle = 300.0 * np.arange(20) * 1.0586e-3
    along, across = np.cos(angle), np.sin(angle)
    zero = np.zeros_like(angle)
    place = 7.0e6 * np.stack([along, 0.6 * across, 0.8 * across], axis=1)
    return place, 7.0e6 * 1.0586e-3 * np.stack([-across, 0.6 * along, 0.8 * along], axis=1), zero


@pytest.mark.parametrize(
    ("method", "degree"), [("LAGRANGE", 7), ("LAGRANGE", 6), ("HERMITE", 7), ("HERMITE", 3)]
)
def test_states_between_those_of_a_file_are_as_oem_reads_them(tmp_path, method, degree):
    """The package oem interpolates the same file; with 5 min between states the methods differ."""
    oem = pytest.importorskip("oem")
    place, speed, _ = states()
    keys = {"CENTER_NAME": "EARTH", "REF_FRAME": "EME2000"}
    keys |= {"INTERPOLATION": method, "INTERPOLATION_DEGREE": str(degree)}
    epochs = dates(300.0 * np.arange(20), "2024-01-01T00:00:00")
    lines = message("OEM", "2.0", epochs, keys, np.hstack([place, speed]) / 1e3)
    (tmp_path / "a.oem").write_text("\n".join([*lines, ""]))
    theirs = oem.OrbitEphemerisMessage.open(tmp_path / "a.oem")
    path = path_of(MissionOrbit(oem=str(tmp_path / "a.oem")), "2024-01-01T00:00:00")
    seconds = np.array([0.0, 1470.0, 2222.0, 3000.0])
    mine = path.state(seconds)
    for k, second in enumerate(seconds):
        state = theirs(Time("2024-01-01T00:00:00", scale="utc") + second * u.s)
        assert mine[0][:, k] == pytest.approx(1e3 * state.position, abs=1e-2)
        assert mine[1][:, k] == pytest.approx(1e3 * state.velocity, abs=1e-4)


def test_an_orbit_is_not_interpolated_over_a_gap_or_a_manoeuvre(tmp_path):
    """Two segments with different velocities meet at 20 min, a third begins 10 min later."""
    keys = {"CENTER_NAME": "EARTH", "REF_FRAME": "EME2000"}
    lines = []
    for begin, speed in ((0.0, 1.0), (1200.0, 5.0), (3000.0, 9.0)):
        second = begin + 60.0 * np.arange(21)
        since = second - begin
        rows = [[7000 + speed * t, 0, 0, speed, 0, 0] for t in since]
        epochs = dates(second, "2024-01-01T00:00:00")
        lines += message("OEM", "2.0", epochs, keys, rows, header=not lines)
        lines += ["COVARIANCE_START", f"EPOCH = {epochs[0]}", "COV_REF_FRAME = RTN", "1e-3"]
        lines += ["0 1e-3", "COVARIANCE_STOP", "COMMENT nothing = here"]
    (tmp_path / "a.oem").write_text("\n".join(lines))
    orbit = MissionOrbit(oem=str(tmp_path / "a.oem"))
    path = path_of(orbit, "2024-01-01T00:00:00")
    place, speed = path.state(np.array([1190.0, 1210.0, 3010.0]))
    assert place[0] == pytest.approx(1e3 * np.array([7000 + 1190, 7000 + 50, 7000 + 90]), abs=1e-3)
    assert speed[0] == pytest.approx([1e3, 5e3, 9e3], abs=1e-6)
    with pytest.raises(Refused, match="gap from 2024-01-01T00:40:00 to 2024-01-01T00:50:00 UTC"):
        path.state(np.array([2700.0]))
    time = dataclasses.replace(MISSION.time, begin="2024-01-01T00:00:00", duration=2420.0)
    motion = motion_of(dataclasses.replace(MISSION, orbit=orbit, time=time))
    motion.at(2390.0, 10.0, 2)
    with pytest.raises(Refused, match=r"orbit\.oem must hold the mission's time: it has a gap"):
        motion.at(2390.0, 10.0, 3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CCSDS_OEM_VERS", "CCSDS_OPM_VERS", "must be a CCSDS OEM"),
        ("= EARTH", "= MOON", "CENTER_NAME must be EARTH"),
        ("= ICRF", "= TEME", "REF_FRAME must be ICRF or"),
        ("= UTC", "= MET", "TIME_SYSTEM must be UTC"),
        ("7000 0 0", "7000 x 0", "6 or 9 finite numbers each"),
        ("7000 0 0", "7000 nan 0", "6 or 9 finite numbers each"),
        ("7000 0 0", "7000 0", "6 or 9 finite numbers each"),
        ("DEGREE = 7", "DEGREE = 99", "from 1 to 15"),
        ("= LAGRANGE", "= LINEAR", "must be 1 with LINEAR"),
        ("META_STOP", "META_STOP\nCOVARIANCE_START", "ends within one: in its covariance"),
    ],
)
def test_orbit_files_are_refused_by_name(tmp_path, old, new, words):
    file = tmp_path / "a.oem"
    place, speed = np.array([[7e6, 0, 0]] * 2), np.array([[0, 7e3, 0]] * 2)
    write_oem(file, ("2026-01-01T00:00:00", "2026-01-01T00:01:00"), place, speed)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(Refused, match=words):
        read_oem(file)


@pytest.mark.parametrize("step", [10, 600, 1700])
def test_an_orbit_in_other_units_than_km_is_refused(tmp_path, step):
    """A circular orbit of 7000 km with a period of 5829 s, and typical errors of programs that
    export it."""
    file, rate = tmp_path / "a.oem", np.sqrt(3.986004418e14 / 7e6**3)
    angle = rate * step * np.arange(12.0)
    place = 7e6 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    speed = 7e6 * rate * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    times = dates(step * np.arange(12.0))
    write_oem(file, times, place, speed)
    (segment,) = read_oem(file)
    np.testing.assert_allclose(segment.speed, speed, rtol=1e-12)
    for of_place, of_speed in [(1, 0), (1, -1), (1, 1e-3), (1, 1e3), (1e3, 1), (1e3, 1e3)]:
        write_oem(file, times, of_place * place, of_speed * speed)
        with pytest.raises(Refused, match="must be in km and km / s, and the speeds those of"):
            read_oem(file)


def test_segments_and_gaps_of_a_ck_stay(tmp_path):
    """A CK of two intervals, written by spiceypy, gives two segments."""
    spiceypy = pytest.importorskip("spiceypy")
    turn = Rotation.from_rotvec(np.outer(np.arange(40.0), [0.01, 0.02, 0.0]))
    write_ck(tmp_path / "a.bc", Time(list(dates(np.arange(40.0)))), turn.as_quat())  # its clock
    (tmp_path / "a.bc").unlink()
    handle = spiceypy.ckopn(str(tmp_path / "a.bc"), "test", 0)
    clock = 65536.0 * np.concatenate([np.arange(20.0), np.arange(30.0, 40.0)])
    quaternions = np.roll(turn.as_quat(), 1, axis=1)[np.r_[0:20, 30:40]]
    spiceypy.ckw03(
        handle,
        clock[0],
        clock[-1],
        -999000,
        "J2000",
        False,
        "test",
        30,
        clock,
        np.ascontiguousarray(quaternions),
        np.zeros((30, 3)),
        2,
        clock[[0, 20]],
    )
    spiceypy.ckcls(handle)
    parts = read_ck(tmp_path / "a.bc")
    assert [len(part.date) for part in parts] == [20, 10]
    with pytest.raises(Refused, match="it has a gap from"):
        matrices(tmp_path / "a.bc", BEGIN, 25.0)
    text = (tmp_path / "a.tsc").read_text()
    loads = textwrap.dedent("\n\\begindata\nKERNELS_TO_LOAD = ( 'other.tf' )\n\\begintext\n")
    (tmp_path / "a.tsc").write_text(text + loads)
    with pytest.raises(Refused, match="names no other files"):
        read_ck(tmp_path / "a.bc")
