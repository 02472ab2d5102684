"""Output of libRadtran's uvspec -> Run."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from startrack.scene.air.runs import Run
from startrack.units import nm

Floats = NDArray[np.float64]

COLUMNS = ("lambda", "zout", "edir", "edn", "uu")
MILLIWATT_PER_NM = 1e6  # watt / m^2 / m, the unit of libRadtran's own solar spectra


def read_uvspec(
    path: Path, albedo: float, black: Path, sun: float, sensor: float,
    unit: float = MILLIWATT_PER_NM,
) -> Run:  # fmt: skip
    """Read one run with `output_user lambda zout edir edn uu` and `zout sur toa`.

        t(sensor) = (edir / edir(toa))^(cos sun / cos sensor)
        reflected = albedo (edir + edn) t / pi,  direct = albedo edir t / pi

    albedo       of its ground
    black        the run over black ground, which knows the same air without it
    sun, sensor  radian, zenith angles
    unit         watt / m^2 / m, of the file's irradiance
    Returns      Run, without heat
    Errors       FileNotFoundError; ValueError, with the file, where it has other columns, or not
                 two heights at each wavelength. model: the transmittance is Beer's, which holds
                 where lines of gases are resolved.
    """
    ground, top = _levels(path, unit)
    through = _transmittance(*_levels(black, unit), sun, sensor)
    down = ground[:, 2] + ground[:, 3]
    reflected = albedo * down * through / math.pi
    return Run(
        albedo, ground[:, 0] * nm, through, albedo * ground[:, 2] * through / math.pi, reflected,
        top[:, 4] - reflected, 0 * through,
    )  # fmt: skip


def _levels(path: Path, unit: float) -> tuple[Floats, Floats]:
    """Rows (k, 5) at the ground and at the top, radiometric columns in SI."""
    try:
        rows = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path} must be columns of numbers: {error}") from None
    if rows.shape[1] != len(COLUMNS):
        raise ValueError(
            f"{path} must have the columns {' '.join(COLUMNS)}, got {rows.shape[1]} of them"
        )
    rows[:, 2:] *= unit
    heights = np.unique(rows[:, 1])
    levels = [rows[rows[:, 1] == height] for height in heights]
    if len(levels) != 2 or len(levels[0]) != len(levels[1]):
        raise ValueError(f"{path} must have two heights, sur and toa, got {heights.tolist()}")
    return levels[0], levels[1]


def _transmittance(ground: Floats, top: Floats, sun: float, sensor: float) -> Floats:
    beam = np.clip(ground[:, 2] / top[:, 2], 1e-300, 1)
    return np.exp(np.log(beam) * math.cos(sun) / math.cos(sensor))
