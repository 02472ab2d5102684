"""CCSDS orbit (OEM) and attitude (AEM) ephemeris messages, read and written as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from startrack.core import Floats, installed_tables, shown, utc
from startrack.io import read_bytes, save_text

LARGEST = 2**29  # byte
INERTIAL = ("ICRF", "EME2000", "J2000", "GCRF", "ICRF3")  # the same within 0.02 arcsec
SCALES = {"UTC": "utc", "TAI": "tai", "TT": "tt", "TDB": "tdb", "UT1": "ut1"}


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
    meta, rows = _read(path, "CCSDS_OEM_VERS", "OEM", {"CENTER_NAME": ("EARTH",)})
    _one_of(path, meta, "REF_FRAME", INERTIAL)
    numbers = _numbers(path, rows, 6)
    return Ephemeris(
        tuple(row[0] for row in rows),
        _scale(path, meta),
        1e3 * numbers[:, :3],
        1e3 * numbers[:, 3:6],
        _degree(path, meta, 7),
    )


def read_aem(path: Path) -> Attitudes:
    """The quaternions of all segments of an AEM.

    Source: CCSDS 504.0-B-2, Attitude Data Messages, section 4, the text in keywords (KVN).

    Raises  ValueError, one sentence, where the file is none, or holds anything but quaternions
            between an inertial frame and the body.
    """
    meta, rows = _read(path, "CCSDS_AEM_VERS", "AEM", {})
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


def write_aem(path: Path, attitudes: Attitudes, name: str = "SPACECRAFT") -> None:
    """Write an AEM that `read_aem` reads back to the same quaternions.

    Source: CCSDS 504.0-B-2; frames EME2000, from which ICRS differs by 0.02 arcsec, to SC_BODY_1.
    """
    begin, end = attitudes.epoch[0], attitudes.epoch[-1]
    head = [
        "CCSDS_AEM_VERS = 2.0",
        f"CREATION_DATE = {begin}",  # of the data, so that the file is the same on every day
        "ORIGINATOR = STARTRACK",
        "META_START",
        f"OBJECT_NAME = {name}",
        f"OBJECT_ID = {name}",
        "REF_FRAME_A = ICRF",
        "REF_FRAME_B = SC_BODY_1",
        f"TIME_SYSTEM = {attitudes.scale.upper()}",
        f"START_TIME = {begin}",
        f"STOP_TIME = {end}",
        "ATTITUDE_TYPE = QUATERNION",
        "INTERPOLATION_METHOD = LINEAR",
        f"INTERPOLATION_DEGREE = {attitudes.degree}",
        "META_STOP",
        "DATA_START",
    ]
    rows = [
        " ".join([epoch, *(f"{value:.17g}" for value in row)])
        for epoch, row in zip(attitudes.epoch, attitudes.quaternion, strict=True)
    ]
    save_text(path, "\n".join([*head, *rows, "DATA_STOP", ""]))


def write_oem(path: Path, ephemeris: Ephemeris, name: str = "SPACECRAFT") -> None:
    """Write an OEM that `read_oem` reads back to the same states. Source: CCSDS 502.0-B-3."""
    begin, end = ephemeris.epoch[0], ephemeris.epoch[-1]
    head = [
        "CCSDS_OEM_VERS = 2.0",
        f"CREATION_DATE = {begin}",
        "ORIGINATOR = STARTRACK",
        "META_START",
        f"OBJECT_NAME = {name}",
        f"OBJECT_ID = {name}",
        "CENTER_NAME = EARTH",
        "REF_FRAME = ICRF",
        f"TIME_SYSTEM = {ephemeris.scale.upper()}",
        f"START_TIME = {begin}",
        f"STOP_TIME = {end}",
        "INTERPOLATION = LAGRANGE",
        f"INTERPOLATION_DEGREE = {ephemeris.degree}",
        "META_STOP",
    ]
    states = np.concatenate([ephemeris.place, ephemeris.speed], axis=1) / 1e3
    rows = [
        " ".join([epoch, *(f"{value:.17g}" for value in row)])
        for epoch, row in zip(ephemeris.epoch, states, strict=True)
    ]
    save_text(path, "\n".join([*head, *rows, ""]))


def _read(
    path: Path, first: str, kind: str, needed: dict[str, tuple[str, ...]]
) -> tuple[dict[str, str], list[list[str]]]:
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
    for key, values in needed.items():
        _one_of(path, meta, key, values)
    if not rows:
        raise ValueError(f"{path} must hold rows of data, got none")
    return meta, rows


def _one_of(path: Path, meta: dict[str, str], key: str, values: Sequence[str]) -> None:
    if meta.get(key, "").upper() not in values:
        raise ValueError(
            f"{path} must have {key} = {' or '.join(values)}, got {shown(meta.get(key))}"
        )


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
