"""Ephemerides and attitudes as CCSDS messages (OEM, AEM) and as SPICE kernels (SPK, CK).

The kernels need the extra `spice`.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Floats, installed_tables, optional_package, shown, utc
from startrack.io import read_bytes, regular_file, save_text, whole

LARGEST = 2**29  # byte
INERTIAL = ("ICRF", "EME2000", "J2000", "GCRF", "ICRF3")  # the same within 0.02 arcsec
SCALES = {"UTC": "utc", "TAI": "tai", "TT": "tt", "TDB": "tdb", "UT1": "ut1"}
BODY = -999  # number of the spacecraft in files that are written
EARTH, FRAME = 399, "J2000"  # the axes of ICRS in SPICE
TICKS = 65536  # a second, of the clock of a written CK
ORBIT_STEP, ATTITUDE_STEP = 60.0, 1.0  # second between two states that are read
MOST = 2_000_000  # states of a file
DEGREE = 7  # of the interpolation of a written SPK


@dataclass(frozen=True, eq=False)
class Ephemeris:
    """States of an orbit ephemeris message, in ICRS axes from the Earth's centre.

    epoch   as the file has them
    scale   time scale, by astropy's name
    place   (n, 3) metre
    speed   (n, 3) metre / second
    degree  of the interpolation
    """

    epoch: tuple[str, ...]
    scale: str
    place: Floats
    speed: Floats
    degree: int = 7


@dataclass(frozen=True, eq=False)
class Attitudes:
    """Quaternions of an attitude ephemeris message.

    epoch       as the file has them
    scale       time scale, by astropy's name
    quaternion  (n, 4) x, y, z, w of icrs_to_body
    degree      of the interpolation; the attitude itself is interpolated at constant rates
    """

    epoch: tuple[str, ...]
    scale: str
    quaternion: Floats
    degree: int = 1


def seconds_after(begin: str, table: Ephemeris | Attitudes) -> Floats:
    """(n,) SI seconds of the dates of a file after a time, UTC."""
    from astropy.time import Time

    with installed_tables():
        return np.asarray((Time(list(table.epoch), scale=table.scale) - utc(begin)).sec)


def read_oem(path: Path) -> Ephemeris:
    """The states of all segments of an OEM.

    Source: CCSDS 502.0-B-3, Orbit Data Messages, section 5, the text in keywords (KVN).

    Raises  ValueError, one sentence, where the file is none, or has another centre or other axes.
    """
    meta, rows = _read(path, "CCSDS_OEM_VERS", "OEM")
    _one_of(path, meta, "CENTER_NAME", ("EARTH",))
    _one_of(path, meta, "REF_FRAME", INERTIAL)
    numbers = 1e3 * _numbers(path, rows, 6)
    dates, scale, degree = tuple(row[0] for row in rows), _scale(path, meta), _degree(path, meta, 7)
    return Ephemeris(dates, scale, numbers[:, :3], numbers[:, 3:6], degree)


def read_aem(path: Path) -> Attitudes:
    """The quaternions of all segments of an AEM.

    Source: CCSDS 504.0-B-2, Attitude Data Messages, section 4, the text in keywords (KVN).

    Raises  ValueError, one sentence, where the file is none, or holds anything but quaternions
            between an inertial frame and the body.
    """
    meta, rows = _read(path, "CCSDS_AEM_VERS", "AEM")
    if meta.get("ATTITUDE_TYPE", "").upper() != "QUATERNION":
        raise ValueError(
            f"{path} must have ATTITUDE_TYPE = QUATERNION, got {shown(meta.get('ATTITUDE_TYPE'))}"
        )
    ends = [meta.get(f"REF_FRAME_{end}", "").upper() for end in "AB"]
    forward = meta.get("ATTITUDE_DIR", "A2B").upper() == "A2B"
    if (ends[0] in INERTIAL) == (ends[1] in INERTIAL):
        raise ValueError(
            f"{path} must have one of {', '.join(INERTIAL)} as REF_FRAME_A or REF_FRAME_B, and the "
            f"body as the other, got {ends[0]!r} and {ends[1]!r}"
        )
    numbers = _numbers(path, rows, 4)
    if meta.get("QUATERNION_TYPE", "LAST").upper() == "FIRST":
        numbers = np.roll(numbers, -1, axis=1)
    norm = np.linalg.norm(numbers, axis=1)
    if (np.abs(norm - 1) > 1e-3).any():
        raise ValueError(f"{path} must hold quaternions of norm 1, got {norm.min():g}")
    if forward != (ends[0] in INERTIAL):  # the file turns from the body to the stars
        numbers = numbers * [-1, -1, -1, 1]
    return Attitudes(
        tuple(row[0] for row in rows), _scale(path, meta), numbers, _degree(path, meta, 1)
    )


def _read(path: Path, first: str, kind: str) -> tuple[dict[str, str], list[list[str]]]:
    """Keywords and rows of numbers; all segments must have the same frames and time scale."""
    try:
        text = read_bytes(path, f"a CCSDS {kind}", LARGEST).decode("ascii", "replace")
    except OSError as error:
        raise ValueError(str(error) if error.errno is None else f"{path}: {error}") from None
    lines = [line.strip() for line in text.splitlines()]
    if not any(line.startswith(first) for line in lines[:50]):
        raise ValueError(f"{path} must be a CCSDS {kind} in keywords, with {first}, got none")
    meta, rows, covariance = dict[str, str](), list[list[str]](), False
    for line in lines:
        if not line or line.startswith("COMMENT"):
            continue
        if line in ("COVARIANCE_START", "COVARIANCE_STOP"):
            covariance = line == "COVARIANCE_START"
        elif covariance:
            continue
        elif "=" in line:
            key, _, value = (part.strip() for part in line.partition("="))
            frames = ("REF_FRAME", "REF_FRAME_A", "REF_FRAME_B", "TIME_SYSTEM", "CENTER_NAME")
            if key in frames and meta.get(key, value) != value:
                raise ValueError(f"{path} must have one {key} in all segments, got {shown(value)}")
            meta[key] = value
        elif line[0].isdigit():
            rows.append(line.split())
    if not rows:
        raise ValueError(f"{path} must hold rows of data, got none")
    return meta, rows


def _one_of(path: Path, meta: dict[str, str], key: str, values: Sequence[str]) -> None:
    if meta.get(key, "").upper() not in values:
        wanted = " or ".join(values)
        raise ValueError(f"{path} must have {key} = {wanted}, got {shown(meta.get(key))}")


def _scale(path: Path, meta: dict[str, str]) -> str:
    _one_of(path, meta, "TIME_SYSTEM", tuple(SCALES))
    return SCALES[meta["TIME_SYSTEM"].upper()]


def _degree(path: Path, meta: dict[str, str], usual: int) -> int:
    text = meta.get("INTERPOLATION_DEGREE", str(usual))
    if not text.isdecimal() or not 1 <= int(text[:3]) <= 15:
        raise ValueError(f"{path} must have INTERPOLATION_DEGREE from 1 to 15, got {shown(text)}")
    return int(text)


def _numbers(path: Path, rows: list[list[str]], count: int) -> Floats:
    try:
        numbers = np.array([[float(value) for value in row[1 : count + 1]] for row in rows])
    except ValueError as error:
        raise ValueError(f"{path} must hold rows of numbers: {error}") from None
    if numbers.ndim != 2 or numbers.shape[1] != count or not math.isfinite(numbers.sum()):
        raise ValueError(f"{path} must hold a date and {count} finite numbers in each row")
    return numbers


@contextmanager
def _kernel(path: Path) -> Iterator[tuple[Any, str]]:
    """The package, and the name of a new file that stands in the place of `path` in the end."""
    with _spice(str(path)) as spice, whole(path) as draft:
        draft.unlink(missing_ok=True)
        yield spice, str(draft)


@contextmanager
def _spice(what: str) -> Iterator[Any]:
    """The package, with nothing loaded; its errors as sentences.

    Raises  ImportError without it; ValueError where it refuses a file.
    """
    needed = f"{what} needs spiceypy: python -m pip install 'startrack[spice]'"
    spiceypy = optional_package("spiceypy", needed)
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
    with _kernel(path) as (spice, draft):
        handle = spice.spkopn(draft, "startrack", 0)
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
        states = np.array([spice.spkgeo(bodies[0], time, FRAME, EARTH)[0] for time in times])
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
    with _kernel(path) as (spice, draft):
        handle = spice.ckopn(draft, "startrack", 0)
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
        ends = [spice.sct2e(body, tick) for tick in (first, last)]
        clock = _records(path, spice)
        if clock is None:
            times = _times(path, ends[0], ends[1], step)
            clock = np.clip([spice.sce2c(body, time) for time in times], first, last)
        else:
            times = np.array([spice.sct2e(body, tick) for tick in clock])
        quaternions = [spice.m2q(spice.ckgp(parts[0], tick, 0.0, FRAME)[0]) for tick in clock]
    return Attitudes(of_ephemeris_time(times), "tdb", np.roll(np.array(quaternions), -1, axis=1))


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
