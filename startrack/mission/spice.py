"""SPICE kernels of orbit (SPK) and attitude (CK), written and read; extra `spice`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Floats, installed_tables
from startrack.io import regular_file, save_text, whole
from startrack.mission.ccsds import Attitudes, Ephemeris

BODY = -999  # number of the spacecraft in files that are written
EARTH, FRAME = 399, "J2000"  # the axes of ICRS in SPICE
TICKS = 65536  # a second, of the clock of a written CK
ORBIT_STEP, ATTITUDE_STEP = 60.0, 1.0  # second between two states that are read
MOST = 2_000_000  # states of a file
DEGREE = 7  # of the interpolation of a written SPK


@contextmanager
def _spice(what: str) -> Iterator[Any]:
    """The package, with nothing loaded; its errors as sentences.

    Raises  ImportError without it; ValueError where it refuses a file.
    """
    try:
        import spiceypy
    except ImportError:
        raise ImportError(
            f"{what} needs spiceypy: python -m pip install 'startrack[spice]'"
        ) from None
    spiceypy.kclear()
    try:
        yield spiceypy
    except spiceypy.utils.exceptions.SpiceyError as error:
        reason = getattr(error, "short", "") or type(error).__name__
        raise ValueError(f"{what} must be a file that SPICE reads, but: {reason}") from None
    finally:
        spiceypy.kclear()


def to_ephemeris_time(epoch: tuple[str, ...], scale: str) -> Floats:
    """Second of TDB after J2000, as SPICE counts."""
    from astropy.time import Time

    with installed_tables():
        date = Time(list(epoch), scale=scale).tdb
        return np.asarray((date.jd1 - 2451545.0) * 86400 + date.jd2 * 86400)


def of_ephemeris_time(second: Floats) -> tuple[str, ...]:
    """Dates in TDB, to the nanosecond."""
    from astropy.time import Time

    whole_days, rest = np.divmod(second, 86400.0)
    with installed_tables():
        date = Time(2451545.0 + whole_days, rest / 86400, format="jd", scale="tdb", precision=9)
        return tuple(map(str, date.isot))


def write_spk(path: Path, ephemeris: Ephemeris) -> None:
    """Write an SPK of one segment of type 9 (Lagrange), of the body -999 about the Earth."""
    times = to_ephemeris_time(ephemeris.epoch, ephemeris.scale)
    states = np.hstack([ephemeris.place, ephemeris.speed]) / 1e3
    with _spice(str(path)) as spice, whole(path) as draft:
        draft.unlink(missing_ok=True)
        handle = spice.spkopn(str(draft), "startrack", 0)
        degree = min(DEGREE, len(times) - 1)
        spice.spkw09(
            handle, BODY, EARTH, FRAME, times[0], times[-1], "startrack", degree, len(times),
            np.ascontiguousarray(states), times,
        )  # fmt: skip
        spice.spkcls(handle)


def read_spk(path: Path, step: float = ORBIT_STEP) -> Ephemeris:
    """The states of the one body of an SPK, relative to the Earth, at equal steps.

    step    second, at most, between two states
    Raises  ImportError without spiceypy; ValueError where the file is none, has several bodies or
            no place relative to the Earth, or is too long.
    """
    regular_file(path, "an SPK")
    with _spice(str(path)) as spice:
        bodies = sorted(spice.spkobj(str(path)))
        if len(bodies) != 1:
            raise ValueError(f"{path} must have one body, got {bodies[:9]}")
        first, last = _window(path, spice, spice.spkcov(str(path), bodies[0]))
        spice.furnsh(str(path))
        times = _times(path, first, last, step)
        states = np.array([spice.spkgeo(bodies[0], one, FRAME, EARTH)[0] for one in times])
    states *= 1e3
    return Ephemeris(of_ephemeris_time(times), "tdb", states[:, :3], states[:, 3:])


def clock_of(path: Path) -> Path:
    """The SCLK kernel of a CK: the same name with .tsc."""
    return path.with_suffix(".tsc")


def write_ck(path: Path, attitudes: Attitudes) -> None:
    """Write a CK of one segment of type 3, of the instrument -999000, and its clock beside it."""
    times = to_ephemeris_time(attitudes.epoch, attitudes.scale)
    begin = math.floor(times[0])
    clock = (times - begin) * TICKS
    quaternion = np.roll(attitudes.quaternion, 1, axis=1)  # SPICE has the scalar first
    save_text(clock_of(path), _CLOCK.format(number=-BODY, begin=begin, ticks=TICKS))
    with _spice(str(path)) as spice, whole(path) as draft:
        draft.unlink(missing_ok=True)
        handle = spice.ckopn(str(draft), "startrack", 0)
        spice.ckw03(
            handle, clock[0], clock[-1], BODY * 1000, FRAME, False, "startrack", len(clock),
            clock, np.ascontiguousarray(quaternion), np.zeros((len(clock), 3)), 1, clock[:1],
        )  # fmt: skip
        spice.ckcls(handle)


def read_ck(path: Path, step: float = ATTITUDE_STEP) -> Attitudes:
    """The attitudes of the one instrument of a CK; its clock is beside it (.tsc).

    Those of a single segment of type 3 are its records; others are taken at equal steps.

    step    second, at most, between two attitudes that are no records
    Raises  ImportError without spiceypy; ValueError where a file is none, has several instruments
            or gaps, or is too long.
    """
    regular_file(path, "a CK")
    regular_file(clock_of(path), "the clock kernel (SCLK) of a CK")
    with _spice(str(path)) as spice:
        parts = sorted(spice.ckobj(str(path)))
        if len(parts) != 1:
            raise ValueError(f"{path} must have one instrument, got {parts[:9]}")
        spice.furnsh([str(path), str(clock_of(path))])
        cover = spice.ckcov(str(path), parts[0], False, "INTERVAL", 0.0, "SCLK")
        first, last = _window(path, spice, cover)
        body = parts[0] // 1000 if parts[0] % 1000 == 0 else -(-parts[0] // 1000)
        ends = [spice.sct2e(body, one) for one in (first, last)]
        clock = _records(path, spice)
        if clock is None:
            times = _times(path, ends[0], ends[1], step)
            clock = np.clip([spice.sce2c(body, one) for one in times], first, last)
        else:
            times = np.array([spice.sct2e(body, one) for one in clock])
        found = [spice.m2q(spice.ckgp(parts[0], one, 0.0, FRAME)[0]) for one in clock]
    return Attitudes(of_ephemeris_time(times), "tdb", np.roll(np.array(found), -1, axis=1))


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
        parts, count = (int(one) for one in spice.dafgda(handle, last - 1, last))
        after = 2 + parts + (parts - 1) // 100 + (count - 1) // 100
        return np.asarray(spice.dafgda(handle, last - after - count + 1, last - after))
    finally:
        spice.dafcls(handle)


def _window(path: Path, spice: Any, cover: Any) -> tuple[float, float]:
    count = spice.wncard(cover)
    if count != 1:
        raise ValueError(f"{path} must have one time without gaps, got {count}")
    first, last = spice.wnfetd(cover, 0)
    return float(first), float(last)


def _times(path: Path, first: float, last: float, step: float) -> Floats:
    count = max(math.ceil((last - first) / step - 1e-6), 1) + 1
    if count > MOST:
        raise ValueError(f"{path} must have at most {MOST} states of {step:g} s, got {count}")
    return np.linspace(first, last, count)


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
