"""Orbits and attitudes in files of other programs, compared with the values that these programs
read.

The packages ccsds-ndm, oem, sgp4 and spiceypy write the files; variants that none of them writes
follow the text of the standard (CCSDS 502.0-B and 504.0-B). Reference values come from the same
packages: attitudes by the matrix of CCSDS 504.0 from the components named by ccsds-ndm, states by
oem's interpolation, TEME by sgp4 and astropy, kernels by spiceypy.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import astropy.units as u
import numpy as np
from astropy.coordinates import GCRS, TEME, CartesianDifferential, CartesianRepresentation
from astropy.time import Time, TimeDelta
from meant_check import Check, checked
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack import Refused, shipped
from startrack.core import installed_tables
from startrack.mission import Attitude, MissionOrbit, load_mission, motion_of, path_of
from startrack.space import two_line_record

BEGIN = "2026-03-20T12:00:00"
TURN = 1e-9  # largest error of an element of a matrix
CLOCK_TURN = 1e-6  # the same, through a clock with ticks of 15 microseconds
PLACE = 1.0  # metre, for seconds since 2000 as a double and interpolation by other formulas
TEME_PLACE = 30.0  # metre, difference of the Earth's axes by interpolated tables and by astropy
COUNT, STEP = 21, 60.0  # number of rows of a file, and seconds between them
GPS_SECONDS = 19.0  # TAI minus GPS


def checks(folder: Path, quick: bool) -> Iterator[Check]:
    """Comparisons of files written into a folder; about a tenth of them in a quick run."""
    matrix = [*_aem_cases(), *_oem_cases(), *_kernel_cases(), *_tle_cases()]
    for number, (kind, name, compare) in enumerate(matrix):
        if not quick or number % 10 == 0:
            path = folder / f"{kind.lower()}-{number:03d}"
            yield checked(kind, name, lambda compare=compare, path=path: compare(path))


Compare = Callable[[Path], str | None]
Case = tuple[str, str, Compare]
Matrices = NDArray[np.float64]


def _attitudes() -> Rotation:
    """icrs_to_body of the rows of a file: a rotation about an oblique axis, from an oblique
    attitude."""
    angle = 2e-3 * STEP * np.arange(COUNT)
    return Rotation.from_rotvec(np.outer(angle, [0.6, -0.48, 0.64])) * Rotation.from_rotvec(
        [0.4, 1.1, -0.7]
    )


def _dates(
    scale: str, form: str, first: float = 0.0, count: int = COUNT, begin: str = BEGIN
) -> list[str]:
    """Dates of rows in a time system, at intervals of STEP, as calendar date ("date") or day of the
    year."""
    with installed_tables():
        second = TimeDelta(first + STEP * np.arange(count), format="sec")
        time = Time(begin, scale="utc") + second
        if scale == "GPS":
            time = time.tai - TimeDelta(GPS_SECONDS, format="sec")
        else:
            time = getattr(time, scale.lower())
        time.precision = 9
        calendar = list(map(str, time.isot))
        days = list(map(str, time.yday))
    if form.startswith("day"):
        calendar = [f"{day[:4]}-{day[5:8]}T{day[9:]}" for day in days]
    if form.endswith("short"):
        calendar = [date.partition(".")[0] for date in calendar]
    return [date + "Z" * form.endswith("Z") for date in calendar]


def _standard_matrix(q1: float, q2: float, q3: float, qc: float) -> Matrices:
    """From frame A to frame B. Source: CCSDS 504.0-B-1, annex on conventions."""
    skew = np.array([[0.0, -q3, q2], [q3, 0.0, -q1], [-q2, q1, 0.0]])
    vector = np.array([q1, q2, q3])
    return np.asarray(
        (qc * qc - vector @ vector) * np.eye(3) + 2 * np.outer(vector, vector) - 2 * qc * skew
    )


def _text(
    kind: str, version: str, segments: Sequence[tuple[dict[str, str], list[str]]], head: str = ""
) -> str:
    """A message from segments of keywords and rows."""
    lines = [f"CCSDS_{kind}_VERS = {version}", f"CREATION_DATE = {BEGIN}", "ORIGINATOR = X", head]
    for meta, rows in segments:
        lines += ["META_START", *(f"{key} = {value}" for key, value in meta.items() if value)]
        body = ["DATA_START", *rows, "DATA_STOP"] if kind == "AEM" else rows
        lines += ["META_STOP", *body]
    return "\n".join([line for line in lines if line] + [""])


def _aem_meta(dates: Sequence[str], changes: dict[str, str]) -> dict[str, str]:
    return {
        "OBJECT_NAME": "X",
        "OBJECT_ID": "2026-001A",
        "REF_FRAME_A": "EME2000",
        "REF_FRAME_B": "SC_BODY_1",
        "ATTITUDE_DIR": "A2B",
        "TIME_SYSTEM": "UTC",
        "START_TIME": dates[0],
        "STOP_TIME": dates[-1],
        "ATTITUDE_TYPE": "QUATERNION",
        "QUATERNION_TYPE": "LAST",
    } | changes


def _components(
    direction: str, stars_first: bool, order: str, turn: Rotation
) -> NDArray[np.float64]:
    """Components (n, 4) of rows: from A to B of the keywords, by the matrix of the standard."""
    to_body = (direction == "A2B") == stars_first
    numbers = (turn.inv() if to_body else turn).as_quat()
    return np.roll(numbers, 1, axis=1) if order == "FIRST" else numbers


def _rows(dates: Sequence[str], numbers: NDArray[np.float64]) -> list[str]:
    return [
        f"{date} {' '.join(f'{value:.16g}' for value in row)}"
        for date, row in zip(dates, numbers.tolist(), strict=True)
    ]


def _aem_cases() -> Iterator[Case]:
    frames = (("EME2000", "SC_BODY_1"), ("SC_BODY_1", "ICRF"), ("GCRF", "SC_BODY_2"))
    for (a, b), direction, order in itertools.product(frames, ("A2B", "B2A"), ("LAST", "FIRST")):
        changes = {"REF_FRAME_A": a, "REF_FRAME_B": b}
        changes |= {"ATTITUDE_DIR": direction, "QUATERNION_TYPE": order}
        yield "AEM", f"{a} to {b}, {direction}, scalar {order}", _aem(changes)
    for scale in ("UTC", "TAI", "TT", "TDB", "TCB", "UT1", "GPS"):
        yield "AEM", f"TIME_SYSTEM {scale}", _aem({"TIME_SYSTEM": scale})
    for form in ("day", "dateZ", "dayZ", "date short", "day short"):
        yield "AEM", f"dates as {form}", _aem({}, form=form)
    for kind, more in (("DERIVATIVE", 4), ("RATE", 3)):
        changes = {"ATTITUDE_TYPE": f"QUATERNION/{kind}"}
        yield "AEM", f"type QUATERNION/{kind}", _aem(changes, more=more, other=False)
    for key in ("LINEAR", "LAGRANGE", "HERMITE"):
        degree = "1" if key == "LINEAR" else "7"
        changes = {"INTERPOLATION_METHOD": key, "INTERPOLATION_DEGREE": degree}
        yield "AEM", f"interpolation {key}", _aem(changes)
    yield (
        "AEM",
        "version 2.0",
        _aem({"ATTITUDE_DIR": "", "QUATERNION_TYPE": ""}, "2.0", other=False),
    )
    rate = {"ATTITUDE_DIR": "", "QUATERNION_TYPE": "", "ATTITUDE_TYPE": "QUATERNION/ANGVEL"}
    yield "AEM", "version 2.0, QUATERNION/ANGVEL", _aem(rate, "2.0", more=3, other=False)
    yield "AEM", "comments, blank lines, windows ends of lines", _aem({}, windows=True)
    yield "AEM", "byte-order mark", _aem({}, mark=True)
    usable = {"USEABLE_START_TIME": "2026-03-20T12:04:00", "USEABLE_STOP_TIME": "2026-079T12:16:00"}
    yield "AEM", "useable times", _aem(usable)
    for name, second in (
        ("QUATERNION_TYPE", {"QUATERNION_TYPE": "FIRST"}),
        ("ATTITUDE_DIR", {"ATTITUDE_DIR": "B2A"}),
        ("nothing", {}),
        ("TIME_SYSTEM", {"TIME_SYSTEM": "TAI"}),
    ):
        yield "AEM", f"two segments that differ in {name}", _aem_segments(second)
    for changes in (
        {"ATTITUDE_TYPE": "EULER_ANGLE", "EULER_ROT_SEQ": "321"},
        {"REF_FRAME_A": "TEME"},
        {"REF_FRAME_A": "ITRF-97"},
        {"REF_FRAME_B": "RTN"},
        {"REF_FRAME_B": "STARTRACKER_1"},
        {"TIME_SYSTEM": "SCLK"},
    ):
        key, value = next(iter(changes.items()))
        yield "AEM", f"{key} = {value}, which is legal", _aem(changes, other=False)
    yield "AEM", "XML", _aem({}, xml=True)


def _matrices(path: Path, seconds: Any) -> Matrices:
    """icrs_to_body of an attitude file, as read for a mission."""
    mission = load_mission(shipped("missions/sun-synchronous.toml")).mission
    time = replace(mission.time, begin=BEGIN, duration=60.0, step=60.0)
    law = Attitude(law="aem", aem=str(path))
    motion = motion_of(replace(mission, time=time, attitude=law))
    return np.concatenate(
        [motion.at(float(second), 60.0, 1).body.transpose(2, 0, 1) for second in seconds]
    )


def _differs(got: Any, want: Any, tolerance: float, unit: str = "") -> str | None:
    off = float(np.abs(np.asarray(got) - want).max())
    return None if off <= tolerance else f"{off:.3g} {unit} off, more than {tolerance:g}"


def _aem(
    changes: dict[str, str],
    version: str = "1.0",
    form: str = "date",
    more: int = 0,
    other: bool = True,
    windows: bool = False,
    mark: bool = False,
    xml: bool = False,
) -> Compare:
    """A file of one segment, rewritten by ccsds-ndm if it supports the variant."""

    def compare(path: Path) -> str | None:
        from ccsds_ndm.ndm_io import NDMFileFormats, NdmIo

        path = path.with_suffix(".aem")
        dates = _dates(changes.get("TIME_SYSTEM", "UTC").replace("SCLK", "UTC"), form)
        meta = _aem_meta(dates, changes)
        stars_first = not meta["REF_FRAME_A"].startswith("SC")
        direction, order = meta["ATTITUDE_DIR"] or "A2B", meta["QUATERNION_TYPE"] or "LAST"
        numbers = _components(direction, stars_first, order, _attitudes())
        rows = _rows(dates, np.hstack([numbers, np.zeros((COUNT, more))]))
        if meta["ATTITUDE_TYPE"] == "EULER_ANGLE":
            rows = _rows(dates, np.full((COUNT, 3), 1.0))
        text = _text("AEM", version, [(meta, rows)], "COMMENT a = b")
        wanted = _attitudes().as_matrix()
        if other:  # written and read by ccsds-ndm: components by name
            message = NdmIo().from_string(text)
            text = NdmIo().to_string(message, NDMFileFormats.XML if xml else NDMFileFormats.KVN)
            states = (
                state.quaternion_state.quaternion
                for state in message.body.segment[0].data.attitude_state
            )
            named = np.array([_standard_matrix(q.q1, q.q2, q.q3, q.qc) for q in states])
            wanted = named if (direction == "A2B") == stars_first else named.transpose(0, 2, 1)
        ends = "\r\n" if windows else "\n"
        content = text.replace("\n", f"{ends}COMMENT x{ends}{ends}" if windows else "\n", 9)
        path.write_bytes(b"\xef\xbb\xbf" * mark + content.encode())
        seconds, kept = STEP * np.arange(COUNT), slice(None)
        if "USEABLE_START_TIME" in meta:
            kept = slice(4, 17)
        tolerance = TURN if form.endswith("short") or meta["TIME_SYSTEM"] == "UTC" else 1e-8
        return _differs(_matrices(path, seconds[kept]), wanted[kept], tolerance)

    return compare


def _aem_segments(changes: dict[str, str]) -> Compare:
    """Two segments with a gap of nine minutes: both are read, and values in the gap are refused."""

    def compare(path: Path) -> str | None:
        from ccsds_ndm.ndm_io import NDMFileFormats, NdmIo

        path, parts = path.with_suffix(".aem"), []
        both: tuple[tuple[float, dict[str, str]], ...] = ((0.0, {}), (STEP * (COUNT + 8), changes))
        for first, own in both:
            dates = _dates(own.get("TIME_SYSTEM", "UTC"), "date", first)
            meta = _aem_meta(dates, own)
            numbers = _components(meta["ATTITUDE_DIR"], True, meta["QUATERNION_TYPE"], _attitudes())
            parts.append((meta, _rows(dates, numbers)))
        message = NdmIo().from_string(_text("AEM", "1.0", parts))
        path.write_text(NdmIo().to_string(message, NDMFileFormats.KVN))
        seconds = STEP * np.array([*range(COUNT), *range(COUNT + 8, 2 * COUNT + 8)])
        wanted = np.concatenate([_attitudes().as_matrix()] * 2)
        return _differs(_matrices(path, seconds), wanted, 1e-8) or _has_a_gap(
            lambda: _matrices(path, [STEP * (COUNT + 3)])
        )

    return compare


def _has_a_gap(read: Callable[[], Any]) -> str | None:
    try:
        read()
    except Refused as refusal:
        return None if "gap" in str(refusal) else f"another refusal: {refusal}"
    return "a value where there is a gap"


def _oem_meta(dates: Sequence[str], changes: dict[str, str]) -> dict[str, str]:
    return {
        "OBJECT_NAME": "X",
        "OBJECT_ID": "2026-001A",
        "CENTER_NAME": "EARTH",
        "REF_FRAME": "EME2000",
        "TIME_SYSTEM": "UTC",
        "START_TIME": dates[0],
        "STOP_TIME": dates[-1],
    } | changes


def _states() -> NDArray[np.float64]:
    """States (n, 6), km and km / s, of an inclined circular orbit of 7,000 km, by formula."""
    rate = np.sqrt(398600.4418 / 7000.0**3)
    angle = rate * STEP * np.arange(COUNT)
    first, second = np.array([0.8, 0.6, 0.0]), np.array([-0.36, 0.48, 0.8])
    place = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second)
    speed = np.outer(-np.sin(angle), first) + np.outer(np.cos(angle), second)
    return np.hstack([7000.0 * place, 7000.0 * rate * speed])


COVARIANCE = """COVARIANCE_START
EPOCH = 2026-03-20T12:01:00
COV_REF_FRAME = RTN
1e-3
0 1e-3
0 0 1e-3
0 0 0 1e-9
0 0 0 0 1e-9
0 0 0 0 0 1e-9
COVARIANCE_STOP"""


def _oem_cases() -> Iterator[Case]:
    methods = [(method, degree) for method in ("LAGRANGE", "HERMITE") for degree in (3, 5, 7)]
    for writer, (method, degree) in itertools.product(
        ("oem", "ccsds-ndm"), [*methods, ("LAGRANGE", 6)]
    ):
        changes = {"INTERPOLATION": method, "INTERPOLATION_DEGREE": str(degree)}
        yield "OEM", f"{method} {degree}, by {writer}", _oem(changes, writer)
    for scale in ("UTC", "TAI", "TT", "TDB", "UT1", "GPS"):
        yield "OEM", f"TIME_SYSTEM {scale}", _oem({"TIME_SYSTEM": scale}, "oem")
    for frame in ("ICRF", "GCRF", "EME2000", "TEME", "ITRF-97", "TOD"):
        yield "OEM", f"REF_FRAME {frame}", _oem({"REF_FRAME": frame}, "oem")
    for version in ("1.0", "2.0", "3.0"):
        yield "OEM", f"version {version}", _oem({}, "", version=version)
    for form in ("day", "dateZ", "day short"):
        yield "OEM", f"dates as {form}", _oem({}, "ccsds-ndm", form=form)
    yield "OEM", "with accelerations", _oem({}, "oem", acceleration=True)
    yield "OEM", "with covariances", _oem({}, "oem", tail=COVARIANCE)
    yield "OEM", "about the Moon", _oem({"CENTER_NAME": "MOON"}, "oem")
    yield "OEM", "a frame of an epoch", _oem({"REF_FRAME_EPOCH": "2000-01-01T12:00:00"}, "oem")
    yield "OEM", "XML", _oem({}, "xml")
    usable = {
        "USEABLE_START_TIME": "2026-03-20T12:04:00",
        "USEABLE_STOP_TIME": "2026-03-20T12:16:00",
    }
    yield "OEM", "useable times", _oem(usable, "oem")


def _oem(
    changes: dict[str, str],
    writer: str,
    version: str = "2.0",
    form: str = "date",
    acceleration: bool = False,
    tail: str = "",
) -> Compare:
    """A file written by the package oem or ccsds-ndm; states between rows by oem."""

    def compare(path: Path) -> str | None:
        import oem
        from ccsds_ndm.ndm_io import NDMFileFormats, NdmIo

        source, path = path.with_suffix(".txt"), path.with_suffix(".oem")
        scale = changes.get("TIME_SYSTEM", "UTC")
        dates, numbers = _dates(scale, form), _states()
        if acceleration:
            pull = -398600.4418 / 7000.0**3 * numbers[:, :3]
            numbers = np.hstack([numbers, pull])
        rows = [*_rows(dates, numbers), *([tail] if tail else [])]
        text = _text("OEM", version, [(_oem_meta(dates, changes), rows)], "COMMENT a = b")
        source.write_text(text)
        if writer == "oem" and scale != "GPS":
            with installed_tables():
                oem.OrbitEphemerisMessage.open(source).save_as(path, file_format="kvn")
        elif writer in ("ccsds-ndm", "xml"):
            form_ = NDMFileFormats.XML if writer == "xml" else NDMFileFormats.KVN
            path.write_text(NdmIo().to_string(NdmIo().from_string(text), form_))
        else:
            path.write_text(text)
        seconds = np.array([241.0, 250.5, 333.0, 600.0, 777.0, 950.0])
        place, speed = path_of(MissionOrbit(oem=str(path)), BEGIN).state(seconds)
        if writer and scale != "GPS" and not form.startswith("day") and version != "3.0":
            with installed_tables():
                theirs = oem.OrbitEphemerisMessage.open(path)
                time = Time(BEGIN, scale="utc") + TimeDelta(seconds, format="sec")
                time = getattr(time, scale.lower())
                states = [theirs(moment) for moment in time]
            wanted = [
                np.array([getattr(state, name) for state in states]).T
                for name in ("position", "velocity")
            ]
        else:  # states between rows by the formula of the circle
            rate = np.sqrt(398600.4418 / 7000.0**3)
            first, second = np.array([[0.8, 0.6, 0.0]]).T, np.array([[-0.36, 0.48, 0.8]]).T
            cosine, sine = np.cos(rate * seconds), np.sin(rate * seconds)
            wanted = [
                7000.0 * (first * cosine + second * sine),
                7000.0 * rate * (second * cosine - first * sine),
            ]
        return _differs(place, 1e3 * wanted[0], PLACE, "m") or _differs(
            speed, 1e3 * wanted[1], 0.05, "m/s"
        )

    return compare


def _kernel_cases() -> Iterator[Case]:
    for kind, frame in itertools.product((1, 2, 3), ("J2000", "ECLIPJ2000", "GALACTIC")):
        yield "CK", f"type {kind} in {frame}", _ck(kind, frame)
    yield "CK", "type 3 of two intervals", _ck(3, "J2000", gap=True)
    yield "CK", "type 3 in two segments that meet", _ck(3, "J2000", segments=2)
    yield "CK", "with angular velocities", _ck(3, "J2000", rates=True)
    yield "CK", "of an instrument of a spacecraft", _ck(3, "J2000", instrument=-77001)
    yield "CK", "the clock counts TT", _ck(3, "J2000", system=2)
    for kind in (5, 8, 9, 12, 13):
        yield "SPK", f"type {kind}", _spk(kind, "J2000")
    yield "SPK", "type 9 in ECLIPJ2000", _spk(9, "ECLIPJ2000")
    yield "SPK", "two segments of other orbits", _spk(13, "J2000", segments=2)


CLOCK = """KPL/SCLK
\\begindata
SCLK_KERNEL_ID          = ( @2000-01-01 )
SCLK_DATA_TYPE_{n}       = ( 1 )
SCLK01_TIME_SYSTEM_{n}   = ( {system} )
SCLK01_N_FIELDS_{n}      = ( 2 )
SCLK01_MODULI_{n}        = ( 10000000000 65536 )
SCLK01_OFFSETS_{n}       = ( 0 0 )
SCLK01_OUTPUT_DELIM_{n}  = ( 1 )
SCLK_PARTITION_START_{n} = ( 0.0 )
SCLK_PARTITION_END_{n}   = ( 6.5536E+14 )
SCLK01_COEFFICIENTS_{n}  = ( 0.0 {begin}.0 1.0 )
\\begintext
"""


def _ephemeris_second() -> float:
    """Seconds of TDB after J2000 at BEGIN, by astropy."""
    with installed_tables():
        date = Time(BEGIN, scale="utc").tdb
    return float((date.jd1 - 2451545.0) * 86400 + date.jd2 * 86400)


def _ck(
    kind: int,
    frame: str,
    gap: bool = False,
    segments: int = 1,
    rates: bool = False,
    instrument: int = -77000,
    system: int = 1,
) -> Compare:
    def compare(path: Path) -> str | None:
        import spiceypy as spice

        path = path.with_suffix(".bc")
        begin = int(_ephemeris_second()) - 10
        path.with_suffix(".tsc").write_text(CLOCK.format(n=77, begin=begin, system=system))
        spice.kclear()
        spice.furnsh(str(path.with_suffix(".tsc")))
        if system == 2:  # as in the leap second kernel naif0012.tls
            spice.pdpool("DELTET/DELTA_T_A", [32.184])
            spice.pdpool("DELTET/K", [1.657e-3])
            spice.pdpool("DELTET/EB", [1.671e-2])
            spice.pdpool("DELTET/M", [6.239996, 1.99096871e-7])
        et = _ephemeris_second() + STEP * np.arange(COUNT)
        clock = np.array([spice.sce2c(-77, one) for one in et])
        to_frame = spice.pxform("J2000", frame, 0.0)
        wanted = _attitudes().as_matrix()
        turns = np.array([spice.m2q(matrix @ to_frame.T) for matrix in wanted])
        spin = np.tile([1e-3, 0.0, 0.0] if rates else [0.0, 0.0, 0.0], (COUNT, 1))
        handle = spice.ckopn(str(path), "x", 0)
        cuts = np.linspace(0, COUNT - 1, segments + 1).astype(int)
        for low, high in itertools.pairwise(cuts):
            part = slice(low, high + 1)
            count, ends = high + 1 - low, (clock[low], clock[high])
            own = clock[part], np.ascontiguousarray(turns[part]), spin[part]
            if kind == 1:
                spice.ckw01(handle, *ends, instrument, frame, rates, "x", count, *own)
            elif kind == 2:
                q, starts = own[1][:-1].copy(), own[0][:-1].copy()
                relative = Rotation.from_matrix(
                    [a.T @ b for a, b in zip(wanted[part][1:], wanted[part][:-1], strict=True)]
                )
                back = np.array(
                    [to_frame @ vector / STEP for vector in -relative.inv().as_rotvec()]
                )
                spice.ckw02(
                    handle,
                    *ends,
                    instrument,
                    frame,
                    "x",
                    count - 1,
                    starts,
                    own[0][1:].copy(),
                    q,
                    np.ascontiguousarray(-back),
                    np.full(count - 1, 1 / 65536),
                )
            else:
                begins = own[0][[0, 12]] if gap else own[0][:1]
                spice.ckw03(
                    handle, *ends, instrument, frame, rates, "x", count, *own, len(begins), begins
                )
        spice.ckcls(handle)
        spice.furnsh(str(path))
        seconds = STEP * np.arange(COUNT - 1) + (0.0 if gap or kind == 1 else 17.0)
        if gap:
            seconds = np.delete(seconds, 11)
        theirs = []
        for second in seconds:
            tick = spice.sce2c(-77, _ephemeris_second() + second)
            tolerance = 1.0 if kind == 1 else 0.5
            theirs.append(spice.ckgp(instrument, tick, tolerance, "J2000")[0])
        spice.kclear()
        mine = _matrices(path, seconds)
        return _differs(mine, np.array(theirs), CLOCK_TURN) or (
            _has_a_gap(lambda: _matrices(path, [STEP * 11.5])) if gap else None
        )

    return compare


def _spk(kind: int, frame: str, segments: int = 1) -> Compare:
    def compare(path: Path) -> str | None:
        import spiceypy as spice

        path = path.with_suffix(".bsp")
        spice.kclear()
        et = _ephemeris_second() + STEP * np.arange(COUNT)
        turn = spice.pxform("J2000", frame, 0.0)
        states = np.hstack([_states()[:, :3] @ turn.T, _states()[:, 3:] @ turn.T])
        handle = spice.spkopn(str(path), "x", 0)
        cuts = np.linspace(0, COUNT - 1, segments + 1).astype(int)
        for k, (low, high) in enumerate(itertools.pairwise(cuts)):
            part, count = slice(low, high + 1), int(high + 1 - low)
            own = np.ascontiguousarray(states[part] * (1 + 0.01 * k))  # a different orbit for each
            head = handle, -77, 399, frame, et[low], et[high], "x"
            if kind == 5:
                spice.spkw05(*head, 398600.4418, count, own, et[part])
            elif kind in (8, 12):
                write = spice.spkw08 if kind == 8 else spice.spkw12
                write(*head, 7, count, own, et[low], STEP)
            else:
                write = spice.spkw09 if kind == 9 else spice.spkw13
                write(*head, 7, count, own, et[part].copy())
        spice.spkcls(handle)
        spice.furnsh(str(path))
        seconds = np.array([0.0, 33.0, 300.0, 595.0, 605.0, 1111.0])
        theirs = np.array(
            [spice.spkgeo(-77, _ephemeris_second() + t, "J2000", 399)[0] for t in seconds]
        )
        spice.kclear()
        place, speed = path_of(MissionOrbit(oem=str(path)), BEGIN).state(seconds)
        return _differs(place.T, 1e3 * theirs[:, :3], PLACE, "m") or _differs(
            speed.T, 1e3 * theirs[:, 3:], 0.05, "m/s"
        )

    return compare


FIRST = "1 25544U 98067A   26079.50000000  .00002182  00000-0  48567-4 0  9990"
SECOND = "2 25544  51.6443  93.0000 0014563 300.0000 180.0000 15.50103472202482"


def _tle_cases() -> Iterator[Case]:
    variants: tuple[tuple[str, dict[str, Any]], ...] = (
        ("of the ISS", {}),
        ("of an eccentric orbit", {"ecco": 0.7, "no_kozai": 0.0087}),
        ("of a geostationary orbit", {"inclo": 1e-3, "ecco": 1e-4, "no_kozai": 0.004375}),
        ("of a polar orbit", {"inclo": 1.7}),
        ("with drag", {"bstar": 1e-3}),
        ("of a retrograde orbit", {"inclo": 2.5}),
        ("of a number with a letter", {"satnum": 101234}),
    )
    for name, changes in variants:
        yield "TLE", f"{name}, by sgp4's exporter", _tle(changes)
    yield "TLE", "of the type of SGP4-XP", _tle({}, ephemeris="4")


def _with_checksum(line: str) -> str:
    total = sum(int(c) if c.isdecimal() else c == "-" for c in line[:68])
    return f"{line[:68]}{total % 10}"


def _tle(changes: dict[str, Any], ephemeris: str = "0") -> Compare:
    def compare(path: Path) -> str | None:
        from sgp4.api import WGS72, Satrec
        from sgp4.exporter import export_tle

        record = two_line_record((_with_checksum(FIRST), _with_checksum(SECOND)))
        names = ("bstar", "ndot", "nddot", "ecco", "argpo", "inclo", "mo", "no_kozai", "nodeo")
        values = {name: getattr(record, name) for name in names} | {
            name: value for name, value in changes.items() if name in names
        }
        again = Satrec()
        epoch = record.jdsatepoch - 2433281.5 + record.jdsatepochF
        again.sgp4init(WGS72, "i", changes.get("satnum", 25544), epoch, *values.values())
        again.classification, again.intldesg = "U", "98067A"
        lines = export_tle(again)
        if ephemeris != "0":
            lines = _with_checksum(f"{lines[0][:62]}{ephemeris}{lines[0][63:]}"), lines[1]
        path.with_suffix(".tle").write_text("\n".join(lines))
        mission = load_mission(shipped("missions/sun-synchronous.toml")).mission
        time = replace(mission.time, begin=BEGIN, duration=7200.0, step=600.0)
        mine = motion_of(replace(mission, orbit=MissionOrbit(tle=tuple(lines)), time=time)).at(
            0.0, 600.0, 12
        )
        theirs = Satrec.twoline2rv(*lines)
        with installed_tables():
            date = Time(BEGIN, scale="utc") + TimeDelta(mine.second, format="sec")
            code, place, speed = theirs.sgp4_array(date.jd1, date.jd2)
            assert not code.any()
            state = CartesianRepresentation(
                *(place.T * u.km), differentials=CartesianDifferential(*(speed.T * u.km / u.s))
            )
            there = TEME(state, obstime=date).transform_to(GCRS(obstime=date))
        wanted = there.cartesian.xyz.to_value(u.m)
        return _differs(mine.place, wanted, TEME_PLACE, "m")

    return compare
