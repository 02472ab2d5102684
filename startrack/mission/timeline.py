"""Plan of a mission, some of its steps -> a table with a row for each step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import arcsec, deg
from startrack.io import save_netcdf
from startrack.mission.engine import CHUNK, Chunk, Plan, at
from startrack.mission.files import (
    Attitudes,
    Ephemeris,
    of_ephemeris_time,
    to_ephemeris_time,
    write_ck,
    write_spk,
)

DECIMALS = 5  # of a degree: 0.04 arcsec


def timeline(
    plan: Plan, every: int = 1, advance: Callable[[int], None] = lambda _: None
) -> NDArray[np.void]:
    """A row for each step, or for each of so many; angles in degrees.

    Errors are rms, in arcseconds, with the alignment of each head; infinite without an attitude.

    every   of so many steps one is kept, from the first on
    Returns a structured array; `blind` of a head is the sum of its Blind, 0 where it is valid
    """
    time = plan.loaded.mission.time
    step, count = time.step * every, -(-time.steps // every)
    parts = []
    for first in range(0, count, CHUNK):
        size = min(CHUNK, count - first)
        chunk = at(plan, plan.motion.at(first * step, step, size), first)
        parts.append(_rows(plan, chunk))
        advance(size)
    return np.concatenate(parts)


def write_kernels(plan: Plan, every: int, orbit: Path, attitude: Path) -> None:
    """Write where the spacecraft is and how it points, at each of so many steps, for SPICE.

    Raises  ImportError without spiceypy
    """
    time = plan.loaded.mission.time
    own = plan.motion.at(0.0, time.step * every, max(-(-time.steps // every), 2))
    begin = to_ephemeris_time((time.begin,), "utc")[0]
    epoch = of_ephemeris_time(begin + own.second)
    write_spk(orbit, Ephemeris(epoch, "tdb", own.place.T, own.speed.T))
    turn = Rotation.from_matrix(own.body.transpose(2, 0, 1))
    write_ck(attitude, Attitudes(epoch, "tdb", turn.as_quat()))


UNITS = {"deg": "degree", "arcsec": "arcsec", "second": "s"}


def save_timeline(path: Path, table: NDArray[np.void]) -> None:
    """Write a timeline as NetCDF (classic format), which xarray, MATLAB and IDL read.

    Each column is a variable over the dimension `time`, with its unit; `blind` is a number.
    """
    names = table.dtype.names or ()
    plain = {name: name.replace("/", "_") for name in names}
    save_netcdf(
        path,
        {plain[name]: table[name].astype(np.float64) for name in names},
        {
            plain[name]: (UNITS.get(name.rpartition("_")[2], "1"), name.replace("_", " "))
            for name in names
        },
        ("time",),
    )


def _rows(plan: Plan, chunk: Chunk) -> NDArray[np.void]:
    own = chunk.instants
    columns = {
        "second": own.second,
        "latitude_deg": own.latitude / deg,
        "longitude_deg": own.longitude / deg,
        "orbit_phase_deg": own.phase / deg,
        "eclipse": chunk.shadow.sun,
        "valid_heads": np.sum([view.blind == 0 for view in chunk.seen], axis=0),
    }
    for head, seen in zip(plan.heads, chunk.seen, strict=True):
        columns |= {
            f"{head.name}_ra_deg": np.arctan2(seen.line[1], seen.line[0]) / deg % 360,
            f"{head.name}_dec_deg": np.arcsin(np.clip(seen.line[2], -1, 1)) / deg,
            f"{head.name}_sun_deg": seen.sun / deg,
            f"{head.name}_moon_deg": seen.moon / deg,
            f"{head.name}_limb_deg": seen.limb / deg,
            f"{head.name}_lit_limb_deg": seen.earth / deg,
            f"{head.name}_blind": seen.blind,
        }
    if chunk.variance is not None:
        for head, (across, about, _) in zip(plan.heads, chunk.errors, strict=True):
            columns[f"{head.name}_across_arcsec"] = np.sqrt(across) / arcsec
            columns[f"{head.name}_about_arcsec"] = np.sqrt(about) / arcsec
        for axis, square in zip("xyz", chunk.variance, strict=True):
            columns[f"fused_{axis}_arcsec"] = np.sqrt(square) / arcsec
    table = np.empty(len(own.second), [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        table[name] = values.round(DECIMALS) if values.dtype.kind == "f" else values
    return table
