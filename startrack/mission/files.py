"""Segments of orbits and attitudes; their SPICE kernels (SPK, CK; extra `spice`)."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from startrack.core import DAY, Floats, Refused, installed_tables, optional_package, printed, utc
from startrack.io import read_bytes, regular_file, save_text, whole

BODY = -999  # number of the spacecraft in files that are written
EARTH, FRAME = 399, "J2000"  # the axes of ICRS in SPICE
TICKS = 65536  # a second, of the clock of a written CK
ORBIT_STEP, ATTITUDE_STEP = 60.0, 1.0  # second between two states that are read
# Difference between TDB and TT, by the leap second kernel naif0012.tls of NAIF.
DELTET = {"DELTA_T_A": [32.184], "K": [1.657e-3], "EB": [1.671e-2], "M": [6.239996, 1.99096871e-7]}
LARGEST_CLOCK = 2**26  # byte
MOST = 2_000_000  # states of a file
DEGREE = 7  # of the interpolation of a written SPK


@dataclass(frozen=True, eq=False)
class OrbitSegment:
    """States of an orbit in ICRS axes from the Earth's centre, between which it is interpolated.

    date     (n,) astropy's Time, rising
    place    (n, 3) metre
    speed    (n, 3) metre / second
    usable   first and last Time at which there is a state
    degree   of the polynomials
    hermite  whether they go through the speeds, too
    """

    date: Any
    place: Floats
    speed: Floats
    usable: tuple[Any, Any]
    degree: int = DEGREE
    hermite: bool = False


@printed
@dataclass(frozen=True, eq=False)
class AttitudeSegment:
    """Attitudes between which they are interpolated.

    date        (n,) astropy's Time, rising
    quaternion  (n, 4) x, y, z, w of icrs_to_body, as SciPy has them
    usable      first and last Time at which there is an attitude
    degree      of the polynomials through the quaternions; 1: at constant rates
    slope       (n, 4) quaternion / second, through which the polynomials go, too; None: they do not
    """

    date: Any
    quaternion: Floats
    usable: tuple[Any, Any]
    degree: int = 1
    slope: Floats | None = None


Segment = TypeVar("Segment", OrbitSegment, AttitudeSegment)


def seconds_after(begin: str, date: Any) -> Floats:
    """SI seconds of astropy's Time after a time in UTC, not seconds of its own scale."""
    with installed_tables():
        return np.asarray((date.tai - utc(begin).tai).sec)


def joined(path: Path, segments: Sequence[Segment]) -> tuple[Segment, ...]:
    """The segments, checked: each has two or more rows at rising times and does not overlap the
    next.

    A segment may begin when the one before ends.

    Raises  Refused
    """
    if not segments:
        raise Refused(f"{path} must hold one segment or more, got none")
    with installed_tables():
        for number, segment in enumerate(segments, 1):
            steps = (segment.date[1:] - segment.date[:-1]).sec
            if len(segment.date) < 2 or (steps <= 0).any():
                raise Refused(f"{path}, segment {number} must hold two or more rising times")
            if number > 1 and (segment.usable[0] - segments[number - 2].usable[1]).sec < -1e-6:
                raise Refused(
                    f"{path}, segment {number} must not begin before the one before ends, got "
                    f"{segment.usable[0].isot} and {segments[number - 2].usable[1].isot}"
                )
    return tuple(segments)


@contextmanager
def _kernel(path: Path) -> Iterator[tuple[Any, str]]:
    """The package, and the name of a new file that replaces `path` at the end."""
    with _spice(str(path)) as spice, whole(path) as draft:
        draft.unlink(missing_ok=True)
        yield spice, str(draft)


@contextmanager
def _spice(what: str) -> Iterator[Any]:
    """The package, with nothing loaded; its errors as sentences.

    Raises  ImportError without it; ValueError if it refuses a file.
    """
    needed = f"{what} needs spiceypy: python -m pip install 'startrack[spice]'"
    spiceypy = optional_package("spiceypy", needed)
    spiceypy.kclear()
    try:
        yield spiceypy
    except spiceypy.utils.exceptions.SpiceyError as error:
        reason = getattr(error, "short", "") or type(error).__name__
        raise Refused(f"{what} must be a file that SPICE reads, but: {reason}") from None
    finally:
        spiceypy.kclear()


def to_ephemeris_time(date: Any) -> Floats:
    """Second of TDB after J2000, as SPICE counts, of astropy's Time."""
    with installed_tables():
        return np.asarray((date.tdb.jd1 - 2451545.0) * DAY + date.tdb.jd2 * DAY)


def of_ephemeris_time(second: Floats) -> Any:
    """Astropy's Time of seconds of TDB after J2000."""
    from astropy.time import Time

    whole_days, rest = np.divmod(second, DAY)
    with installed_tables():
        return Time(2451545.0 + whole_days, rest / DAY, format="jd", scale="tdb")


def write_spk(path: Path, date: Any, place: Floats, speed: Floats) -> None:
    """Write an SPK of one segment of type 9 (Lagrange), of the body -999 about the Earth.

    date          (n,) astropy's Time
    place, speed  (n, 3) metre and metre / second, ICRS axes
    """
    times, states = to_ephemeris_time(date), np.hstack([place, speed]) / 1e3
    with _kernel(path) as (spice, draft):
        handle = spice.spkopn(draft, "startrack", 0)
        degree = min(DEGREE, len(times) - 1)
        spice.spkw09(
            handle,
            BODY,
            EARTH,
            FRAME,
            times[0],
            times[-1],
            "startrack",
            degree,
            len(times),
            np.ascontiguousarray(states),
            times,
        )
        spice.spkcls(handle)


def read_spk(path: Path, step: float = ORBIT_STEP) -> tuple[OrbitSegment, ...]:
    """The states of the only body in an SPK, relative to the Earth, at equal steps.

    Segments are those of the file, so that no state is interpolated across a manoeuvre.

    step    second, at most, between two states
    Raises  ImportError without spiceypy; Refused if the file is none, has several bodies or no
            place relative to the Earth, or is too long.
    """
    with _spice(str(path)) as spice:
        _require_kernel(path, "SPK")
        bodies = sorted(spice.spkobj(str(path)))
        if len(bodies) != 1:
            raise Refused(f"{path} must have one body, got {bodies[:9]}")
        cover = spice.spkcov(str(path), bodies[0])
        spice.furnsh(str(path))
        segments, count = [], 0
        for first, last, inside in _pieces(path, spice, cover, 1e-3):
            times = _times(path, first, last, step)
            count = _counted(path, count + len(times), step)
            at = np.append(times[:-1], inside)
            states = 1e3 * np.array([spice.spkgeo(bodies[0], t, FRAME, EARTH)[0] for t in at])
            usable = tuple(of_ephemeris_time(times[[0, -1]]))
            segments.append(
                OrbitSegment(of_ephemeris_time(at), states[:, :3], states[:, 3:], usable)
            )
    return joined(path, segments)


def clock_of(path: Path) -> Path:
    """The SCLK kernel of a CK: the same name with .tsc."""
    return path.with_suffix(".tsc")


def write_ck(path: Path, date: Any, quaternion: Floats) -> None:
    """Write a CK of one segment of type 3, of the instrument -999000, and its clock beside it.

    date        (n,) astropy's Time
    quaternion  (n, 4) x, y, z, w of icrs_to_body, as SciPy has them
    """
    times = to_ephemeris_time(date)
    begin = math.floor(times[0])
    clock = (times - begin) * TICKS
    scalar_first = np.ascontiguousarray(np.roll(quaternion, 1, axis=1))  # as SPICE has them
    save_text(clock_of(path), _CLOCK.format(number=-BODY, begin=begin, ticks=TICKS))
    with _kernel(path) as (spice, draft):
        handle = spice.ckopn(draft, "startrack", 0)
        spice.ckw03(
            handle,
            clock[0],
            clock[-1],
            BODY * 1000,
            FRAME,
            avflag=False,
            segid="startrack",
            nrec=len(clock),
            sclkdp=clock,
            quats=scalar_first,
            avvs=np.zeros((len(clock), 3)),
            nints=1,
            starts=clock[:1],
        )
        spice.ckcls(handle)


def read_ck(path: Path, step: float = ATTITUDE_STEP) -> tuple[AttitudeSegment, ...]:
    """The attitudes of the only instrument in a CK; its clock file is in the same folder (.tsc).

    Segments, and the intervals in which they are interpolated, are those of the file. The attitudes
    of a single segment of type 3 are its records; those of other segments are read at equal steps.

    step    second, at most, between two attitudes that are no records
    Raises  ImportError without spiceypy; Refused if a file is none, has several instruments, or
            is too long.
    """
    clock_file = regular_file(clock_of(path), "the clock kernel (SCLK) of a CK")
    if "KERNELS_TO_LOAD" in read_bytes(clock_file, "an SCLK", LARGEST_CLOCK).decode("latin-1"):
        raise Refused(f"{clock_file} must be a clock kernel that names no other files")
    with _spice(str(path)) as spice:
        _require_kernel(path, "CK")
        parts = sorted(spice.ckobj(str(path)))
        if len(parts) != 1:
            raise Refused(f"{path} must have one instrument, got {parts[:9]}")
        spice.furnsh([str(path), str(clock_file)])
        for name, numbers in DELTET.items():  # of a clock that counts TT
            spice.pdpool(f"DELTET/{name}", numbers)
        cover = spice.ckcov(
            str(path), parts[0], needav=False, level="INTERVAL", tol=0.0, timsys="SCLK"
        )
        body = parts[0] // 1000 if parts[0] % 1000 == 0 else -(-parts[0] // 1000)
        records = _records(path, spice)
        segments, count = [], 0
        for first, last, inside in _pieces(path, spice, cover, 1.0):
            ends = [spice.sct2e(body, tick) for tick in (first, last)]
            if first == last:
                raise Refused(
                    f"{path} must hold attitudes between which others follow, got one of a single "
                    "instant (a CK of type 1 has no others)"
                )
            if records is None:
                times = _times(path, ends[0], ends[1], step)
                clock = np.clip([spice.sce2c(body, time) for time in times], first, inside)
            else:
                clock = records[(records >= first) & (records <= last)]
            count = _counted(path, count + len(clock), step)
            dates = of_ephemeris_time(np.array([spice.sct2e(body, tick) for tick in clock]))
            turns = [spice.m2q(spice.ckgp(parts[0], tick, 0.0, FRAME)[0]) for tick in clock]
            usable = tuple(of_ephemeris_time(np.array(ends)))
            scalar_last = np.roll(np.array(turns).reshape(-1, 4), -1, axis=1)
            segments.append(AttitudeSegment(dates, scalar_last, usable))
    return joined(path, segments)


def _require_kernel(path: Path, kind: str) -> None:
    """Refuse files that are no binary kernel of a kind: SPICE would load the files that a text
    kernel names."""
    with open(regular_file(path, f"a {kind}"), "rb") as file:
        begin = file.read(8)
    if begin not in (f"DAF/{kind}".ljust(8).encode(), b"NAIF/DAF"):
        raise Refused(
            f"{path} must be a file that SPICE reads, {kind}, got one that begins with {begin!r}"
        )


def _records(path: Path, spice: Any) -> Floats | None:
    """Clock of the records of a CK of one segment of type 3; None of any other.

    Source: CK Required Reading of SPICE: the segment ends with the clock of its records, a
    directory of every hundredth, those of the begins of intervals with theirs, and both numbers.
    """
    handle = spice.dafopr(str(path))
    try:
        spice.dafbfs(handle)
        segments = []
        while spice.daffna():
            segments.append(spice.dafus(spice.dafgs(5), 2, 6)[1])
        if len(segments) != 1 or segments[0][2] != 3:
            return None
        last = int(segments[0][5])
        parts, count = (int(number) for number in spice.dafgda(handle, last - 1, last))
        after = 2 + parts + (parts - 1) // 100 + (count - 1) // 100
        return np.asarray(spice.dafgda(handle, last - after - count + 1, last - after))
    finally:
        spice.dafcls(handle)


def _pieces(path: Path, spice: Any, cover: Any, instant: float) -> list[tuple[float, float, float]]:
    """Times in which a kernel is smooth: first, last, and the last that is surely within.

    They are the intervals of its coverage, cut where a segment of the file begins or ends.

    instant  by which the last is moved inside where another follows at once
    """
    cuts = set[float]()
    handle = spice.dafopr(str(path))
    try:
        spice.dafbfs(handle)
        while spice.daffna():
            cuts.update(float(time) for time in spice.dafus(spice.dafgs(5), 2, 6)[0])
    finally:
        spice.dafcls(handle)
    pieces = []
    for number in range(spice.wncard(cover)):
        first, last = map(float, spice.wnfetd(cover, number))
        ends = [first, *sorted(cut for cut in cuts if first < cut < last), last]
        for begin, end in pairwise(ends):
            inside = end if end == last else max(end - instant, begin + (end - begin) / 2)
            pieces.append((begin, end, inside))
    return pieces


def _times(path: Path, first: float, last: float, step: float) -> Floats:
    count = max(math.ceil((last - first) / step - 1e-6), 1) + 1
    return np.linspace(first, last, _counted(path, count, step))


def _counted(path: Path, count: int, step: float) -> int:
    if count > MOST:
        raise Refused(f"{path} must have at most {MOST} states of {step:g} s, got {count}")
    return count


_CLOCK = """KPL/SCLK

A clock that counts seconds of TDB from {begin} s after J2000, in {ticks} ticks.

\\begindata
SCLK_KERNEL_ID           = ( @2000-01-01 )
SCLK_DATA_TYPE_{number}        = ( 1 )
SCLK01_TIME_SYSTEM_{number}    = ( 1 )
SCLK01_N_FIELDS_{number}       = ( 2 )
SCLK01_MODULI_{number}         = ( 10000000000 {ticks} )
SCLK01_OFFSETS_{number}        = ( 0 0 )
SCLK01_OUTPUT_DELIM_{number}   = ( 1 )
SCLK_PARTITION_START_{number}  = ( 0.0 )
SCLK_PARTITION_END_{number}    = ( 6.5536E+14 )
SCLK01_COEFFICIENTS_{number}   = ( 0.0 {begin}.0 1.0 )
\\begintext
"""
