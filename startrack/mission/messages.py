"""Orbits and attitudes of CCSDS messages in keywords (OEM, AEM) -> their segments."""

import codecs
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Floats, Refused, installed_tables, shown
from startrack.io import read_bytes
from startrack.mission.files import AttitudeSegment, OrbitSegment, joined

LARGEST = 2**29  # byte
# Frames whose axes are those of ICRS within 0.02 arcsec.
INERTIAL = ("ICRF", "ICRF1", "ICRF2", "ICRF3", "GCRF", "EME2000", "J2000")
BODY = re.compile(r"SC_BODY(_\w+)?")
SCALES = {
    "UTC": "utc",
    "TAI": "tai",
    "TT": "tt",
    "TDB": "tdb",
    "TCB": "tcb",
    "TCG": "tcg",
    "UT1": "ut1",
    "GPS": "tai",
}
GPS_BEHIND_TAI = 19.0  # second
DATE = re.compile(r"(\d{4}-)(?:(\d{3})|(\d\d-\d\d))(T\d\d:\d\d:\d\d(?:\.\d*)?)Z?")
# Numbers in a row of each type of attitude that begins with a quaternion.
QUATERNIONS = {
    "QUATERNION": 4,
    "QUATERNION/DERIVATIVE": 8,
    "QUATERNION/RATE": 7,
    "QUATERNION/ANGVEL": 7,
}
CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])
NORM = 1e-3  # by which the norm of a quaternion in a file may differ from 1
HIGHEST_DEGREE = 15
# Limits of a row: speed, metre / second; and relative distance to the next place by which the mean
# of both speeds may miss it. In a low orbit this allows a step of half an hour.
FASTEST, MISSED = 1e5, 0.4


def read_oem(path: Path) -> tuple[OrbitSegment, ...]:
    """The segments of an OEM, in ICRS axes from the Earth's centre.

    Source: CCSDS 502.0-B-3, Orbit Data Messages, section 5, the text in keywords (KVN) of versions
    1.0 to 3.0. Covariances and accelerations are not used.

    Raises  Refused if the file is not an OEM, or has another centre, other axes, a
            keyword, a date or a row that the standard does not allow there, or speeds that are not
            those of its places in km and km / s.
    """
    segments = []
    for part in _segments(path, "OEM", ("1.0", "2.0", "3.0")):
        part.must_be("CENTER_NAME", ("EARTH",))
        part.must_be("REF_FRAME", INERTIAL)
        numbers = 1e3 * part.numbers((6, 9))
        method, degree = part.interpolation(("LAGRANGE", "HERMITE", "LINEAR"), "LAGRANGE", 7)
        time = part.times()
        _require_speeds(part, time, numbers[:, :3], numbers[:, 3:6])
        segments.append(
            OrbitSegment(
                time,
                numbers[:, :3],
                numbers[:, 3:6],
                part.usable(time),
                degree,
                method == "HERMITE",
            )
        )
    return joined(path, segments)


def read_aem(path: Path) -> tuple[AttitudeSegment, ...]:
    """The segments of an AEM, each by its own keywords.

    The matrix of the standard, by which Q1 Q2 Q3 QC take components in frame A to components in B,

        [[Q1^2 - Q2^2 - Q3^2 + QC^2, 2 (Q1 Q2 + Q3 QC), 2 (Q1 Q3 - Q2 QC)], ...],

    is the transpose of that of SciPy's rotation with the same numbers.

    Source: CCSDS 504.0-B-1 and 504.0-B-2, Attitude Data Messages, section 4 and the annex of
    conventions; the text in keywords (KVN) of versions 1.0 and 2.0.

    Raises  Refused, one sentence, where the file is none, holds anything but quaternions between an
            inertial frame and the spacecraft's body, or has a keyword, a date or a row that the
            standard does not allow there.
    """
    segments, bodies = [], set[str]()
    for part in _segments(path, "AEM", ("1.0", "2.0")):
        kind = part.must_be("ATTITUDE_TYPE", tuple(QUATERNIONS))
        forward, body = _direction(part)
        bodies.add(body)
        if len(bodies) > 1:
            raise part.refused("REF_FRAME_A and REF_FRAME_B", "name one body in all segments", body)
        columns = part.numbers((QUATERNIONS[kind],))
        derivative = columns[:, 4:8] if kind == "QUATERNION/DERIVATIVE" else None
        methods = ("LINEAR", "LAGRANGE", *(("HERMITE",) if derivative is not None else ()))
        method, degree = part.interpolation(methods, "LINEAR", 1)
        numbers = _scalar_last(part, columns[:, :4])
        norm = np.linalg.norm(numbers, axis=1)
        if (np.abs(norm - 1) > NORM).any():
            off = norm[np.abs(norm - 1).argmax()]
            raise part.refused("quaternions", "have the norm 1", f"{off:g}")
        slopes = None
        if method == "HERMITE" and derivative is not None:
            slopes = _scalar_last(part, derivative)
        if forward:  # SciPy's rotation of these numbers turns from the body to the stars
            numbers = numbers * CONJUGATE
            slopes = None if slopes is None else slopes * CONJUGATE
        time = part.times()
        segments.append(AttitudeSegment(time, numbers, part.usable(time), degree, slopes))
    return joined(path, segments)


@dataclass
class _Segment:
    """Keywords and rows of a segment, and the file and line for messages."""

    path: Path
    version: str
    line: int
    meta: dict[str, str] = field(default_factory=dict)
    rows: list[list[str]] = field(default_factory=list)

    def refused(self, key: str, rule: str, value: Any) -> Refused:
        place = f"{self.path}, segment of line {self.line}"
        return Refused(f"{place}: {key} must {rule}, got {value}", key=key, rule=rule, value=value)

    def get(self, key: str) -> str:
        """A keyword in capitals, with underscores; "" where it is not given."""
        return self.meta.get(key, "").upper().replace(" ", "_")

    def must_be(self, key: str, values: Sequence[str]) -> str:
        value = self.get(key)
        if value not in values:
            got = shown(self.meta[key]) if key in self.meta else "none"
            raise self.refused(key, f"be {' or '.join(values)}", got)
        return value

    def interpolation(self, methods: Sequence[str], usual: str, degree: int) -> tuple[str, int]:
        """Method and degree of the polynomials between the rows."""
        key = "INTERPOLATION_METHOD" if "INTERPOLATION_METHOD" in self.meta else "INTERPOLATION"
        method = self.must_be(key, methods) if key in self.meta else usual
        given = self.meta.get("INTERPOLATION_DEGREE")
        if given is None and key in self.meta and method != "LINEAR":
            raise self.refused("INTERPOLATION_DEGREE", f"be given with {key} = {method}", "none")
        text = given or str(1 if method == "LINEAR" else degree)
        if not text.isdecimal() or not 1 <= int(text[:3]) <= HIGHEST_DEGREE:
            raise self.refused(
                "INTERPOLATION_DEGREE", f"be a whole number from 1 to {HIGHEST_DEGREE}", shown(text)
            )
        number = int(text)
        if key in self.meta and method == "LINEAR" and number != 1:
            raise self.refused("INTERPOLATION_DEGREE", "be 1 with LINEAR", number)
        if method == "HERMITE" and number % 2 == 0:
            raise self.refused("INTERPOLATION_DEGREE", "be odd with HERMITE", number)
        return method, number

    def numbers(self, counts: Sequence[int]) -> Floats:
        """(n, k) of the rows, after their dates; k is one of the counts, the same in all rows."""
        rule = f"hold a date and {' or '.join(map(str, counts))} finite numbers each"
        if not self.rows:
            raise self.refused("rows of data", rule, "none")
        width = len(self.rows[0])
        for row in self.rows:
            if len(row) != width or width - 1 not in counts:
                raise self.refused("rows of data", rule, shown(" ".join(row)))
        try:
            numbers = np.array([[float(value) for value in row[1:]] for row in self.rows])
        except ValueError as error:
            raise self.refused("rows of data", rule, error) from None
        if not np.isfinite(numbers).all():
            raise self.refused("rows of data", rule, "one that is not finite")
        return numbers

    def dates(self, texts: Sequence[str]) -> Any:
        """Astropy's Time of dates as the calendar's or as days of the year.

        A second 60 is one where the time scale has a leap second there.
        """
        from astropy.time import TimeDelta

        scale = self.must_be("TIME_SYSTEM", tuple(SCALES))
        time = _time(texts, SCALES[scale])
        if time is None:
            rule = "be dates such as 2026-03-20T12:00:00 or 2026-079T12:00:00"
            wrong = next(text for text in texts if _time([text], SCALES[scale]) is None)
            raise self.refused("dates", f"{rule} in {scale}", shown(wrong))
        return time + TimeDelta(GPS_BEHIND_TAI, format="sec") if scale == "GPS" else time

    def times(self) -> Any:
        """The dates of the rows."""
        time = self.dates([row[0] for row in self.rows])
        if len(self.rows) < 2 or ((time[1:] - time[:-1]).sec <= 0).any():
            raise self.refused("dates", "be two or more that rise", f"those of {len(time)} rows")
        return time

    def usable(self, time: Any) -> tuple[Any, Any]:
        """First and last time at which the segment may be used: those of its rows, or within."""
        ends = []
        for end, pick, own in (("START", max, time[0]), ("STOP", min, time[-1])):
            keys = (f"{word}_{end}_TIME" for word in ("USEABLE", "USABLE"))
            given = [self.meta[key] for key in keys if key in self.meta]
            ends.append(pick([own, *self.dates(given)]) if given else own)
        if ends[0] > ends[1]:
            raise self.refused("USEABLE_START_TIME", "leave rows before USEABLE_STOP_TIME", "none")
        return ends[0], ends[1]


def _require_speeds(part: _Segment, time: Any, place: Floats, speed: Floats) -> None:
    """Refuse speeds in another unit or direction than the places, and places in metre."""
    with installed_tables():
        step = (time[1:] - time[:-1]).sec
    rule = "be in km and km / s, and the speeds those of the places"
    fastest = np.linalg.norm(speed, axis=1).max()
    if fastest > FASTEST:
        raise part.refused("rows of data", rule, f"a speed of {fastest / 1e3:.4g} km / s")
    way, mean = np.diff(place, axis=0), step[:, None] * (speed[1:] + speed[:-1]) / 2
    of_rows = step * np.maximum(*np.linalg.norm([speed[1:], speed[:-1]], axis=2))
    longest = np.maximum(np.linalg.norm(way, axis=1), of_rows)
    # The middle one of the steps, as a manoeuvre may lie in others.
    missed = np.median(np.linalg.norm(way - mean, axis=1) / np.maximum(longest, 1e-3))
    if missed > MISSED:
        raise part.refused(
            "rows of data", rule, f"places that the speeds miss by {100 * missed:.3g} % of a step"
        )


def _time(texts: Sequence[str], scale: str) -> Any:
    """Astropy's Time of dates; None if a date is invalid in this time scale."""
    from astropy.time import Time

    try:
        with installed_tables():
            warnings.filterwarnings("error", message=".*after end of day.*")
            return Time([_calendar(text) for text in texts], format="isot", scale=scale)
    except (ValueError, Warning):
        return None


def _calendar(text: str) -> str:
    """A date without its day of the year and without Z."""
    match = DATE.fullmatch(text)
    if not match:
        raise ValueError(shown(text))
    year, day, month_and_day, clock = match.groups()
    if day is None:
        return f"{year}{month_and_day}{clock}"
    begin = date(max(int(year[:4]), 1), 1, 1)
    there = begin + timedelta(int(day) - 1)
    if there.year != begin.year:
        raise ValueError(shown(text))
    return f"{there.isoformat()}{clock}"


def _direction(part: _Segment) -> tuple[bool, str]:
    """Whether the standard's matrix turns components in ICRS into components in the body; the
    body."""
    ends = [part.get(f"REF_FRAME_{end}") for end in "AB"]
    stars, body = (ends[0], ends[1]) if ends[0] in INERTIAL else (ends[1], ends[0])
    if stars not in INERTIAL or not BODY.fullmatch(body):
        rule = f"be one of {', '.join(INERTIAL)}, and the body, as SC_BODY_1"
        raise part.refused("REF_FRAME_A and REF_FRAME_B", rule, f"{ends[0]!r} and {ends[1]!r}")
    given = "ATTITUDE_DIR" in part.meta or part.version == "1.0"  # 2.0 has A to B alone
    along = part.must_be("ATTITUDE_DIR", ("A2B", "B2A")) if given else "A2B"
    return (along == "A2B") == (ends[0] in INERTIAL), body


def _scalar_last(part: _Segment, numbers: Floats) -> Floats:
    given = "QUATERNION_TYPE" in part.meta or part.version == "1.0"  # 2.0 has the scalar last
    order = part.must_be("QUATERNION_TYPE", ("LAST", "FIRST")) if given else "LAST"
    return np.roll(numbers, -1, axis=1) if order == "FIRST" else numbers


def _segments(path: Path, kind: str, versions: Sequence[str]) -> list[_Segment]:
    """Read the lines of a message; blocks of covariances and comments are left out."""
    try:
        content = read_bytes(path, f"a CCSDS {kind}", LARGEST)
    except OSError as error:
        raise Refused(str(error) if error.errno is None else f"{path}: {error}") from None
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise Refused(f"{path} must be text in ASCII or UTF-8, but is in UTF-16")
    text = content.decode("utf-8-sig", "replace")
    if not text.strip():
        raise Refused(f"{path} must be a CCSDS {kind}, but is empty")
    first, version, segments = f"CCSDS_{kind}_VERS", "", list[_Segment]()
    place = "header"  # header, meta, between, data, covariance
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if not line or line.split()[0] == "COMMENT":
            continue
        key, equals, value = (word.strip() for word in line.partition("="))
        if not version:
            if key != first or value not in versions:
                raise Refused(
                    f"{path} must be a CCSDS {kind} in keywords, with {first} = "
                    f"{' or '.join(versions)} in its first line, got {shown(line)}"
                )
            version = value
        elif (
            line == "META_START"
            and place in ("header", "between", "data")
            and (place != "data" or kind == "OEM")
        ):
            segments.append(_Segment(path, version, number))
            place = "meta"
        elif line == "META_STOP" and place == "meta":
            place = "data" if kind == "OEM" else "between"
        elif line == "DATA_START" and place == "between" and not segments[-1].rows:
            place = "data"
        elif line == "DATA_STOP" and place == "data" and kind == "AEM":
            place = "between"
        elif line == "COVARIANCE_START" and place == "data" and kind == "OEM":
            place = "covariance"
        elif line == "COVARIANCE_STOP" and place == "covariance":
            place = "data"
        elif place == "meta" and equals:
            if segments[-1].meta.setdefault(key, value) != value:
                raise segments[-1].refused(key, "have one value", shown(value))
        elif place == "data" and line[0].isdigit():
            segments[-1].rows.append(line.split())
        elif place != "covariance" and not (place == "header" and equals):
            raise Refused(
                f"{path}, line {number} must be what an {kind} has there, got {line[:60]!r}"
            )
    last = "data" if kind == "OEM" else "between"
    if place != last:
        raise Refused(f"{path} must hold whole segments, but ends within one: in its {place}")
    return segments
