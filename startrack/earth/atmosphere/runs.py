"""BandTable from runs of MODTRAN or libRadtran over three albedos."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, nm
from startrack.earth.atmosphere.bands import BandTable, require_response

TOLERANCE = 1e-9  # metre, by which wavelengths of runs may differ


class Run(NamedTuple):
    """One run: a ground of one albedo, one position of Sun and sensor.

    albedo      1
    wavelength  (k,) metre, rising
    through     (k,) 1, transmittance from the ground to the sensor
    direct      (k,) watt / m^2 / sr / m, sunlight that the ground reflects straight to the sensor
    reflected   (k,) likewise, with the light of the sky
    scattered   (k,) likewise, that the air scatters to the sensor, including light from the ground
    rise        (k,) likewise, heat of the air
    """

    albedo: float
    wavelength: Floats
    through: Floats
    direct: Floats
    reflected: Floats
    scattered: Floats
    rise: Floats


class Place(NamedTuple):
    """Where a run's ground, sensor and Sun are: metre, radian, radian, radian, as in AirTable."""

    height: float
    sensor: float
    sun: float
    azimuth: float


def from_runs(runs: Mapping[Place, Sequence[Run]]) -> tuple[Floats, BandTable]:
    """Separate the ground from the air, at each node of a full grid.

        direct(rho) = rho D,  reflected(rho) = rho (D + K) / (1 - rho S),
        scattered(rho) = P + rho A / (1 - rho S)

    S comes from the light that the ground sends at the two albedos; where there is none, it is 0.

    runs     three of each node, of which one is black
    Returns  (k,) metre, and a BandTable whose bands are these wavelengths: watt / m^2 / sr / m
    Raises    ValueError where nodes are missing in their grid, wavelengths differ, or albedos do
              not do.
    Accuracy  model: reflected thermal radiance of the sky counts as diffuse light, as the
              programs print it. numerical: exact for runs that follow the closed form.
    """
    axes = [sorted({place[i] for place in runs}) for i in range(4)]
    shape = tuple(len(axis) for axis in axes)
    if len(runs) != np.prod(shape):
        raise ValueError(
            f"runs must fill their grid of {' x '.join(map(str, shape))} places, got {len(runs)}"
        )
    wavelength = next(iter(runs.values()))[0].wavelength
    count = len(wavelength)
    path = np.empty((*shape, count))
    direct, sky, around = np.empty((3, *shape[:3], count))
    through, rise = np.empty((2, *shape[:2], count))
    backscatter = np.empty((shape[0], count))
    for place, three in runs.items():
        h, v, s, p = (axis.index(value) for axis, value in zip(axes, place, strict=True))
        black, *lit = _sorted(three, wavelength)
        path[h, v, s, p] = black.scattered
        spherical = _spherical([one.reflected / one.albedo for one in lit], lit)
        half = lit[-1]
        bounce = 1 - half.albedo * spherical
        direct[h, v, s] = half.direct / half.albedo
        sky[h, v, s] = np.maximum(half.reflected / half.albedo * bounce - direct[h, v, s], 0)
        around[h, v, s] = (half.scattered - black.scattered) / half.albedo * bounce
        through[h, v], rise[h, v], backscatter[h] = black.through, black.rise, spherical
    height, sensor, sun, azimuth = (np.array(axis, np.float64) for axis in axes)
    return wavelength, BandTable(
        height, sensor, sun, azimuth, path, direct, sky, around, backscatter, through, rise,
        0 * rise,
    )  # fmt: skip


def gather(wavelength: Floats, table: BandTable, response: Floats) -> BandTable:
    """The same table in bands.

    response  (b, k) 1 / metre or 1 over the wavelengths, as for `in_bands`
    """
    require_response(response, wavelength)
    weights = response * np.gradient(wavelength)
    fractions = weights / weights.sum(-1, keepdims=True)
    nodes = ("height", "sensor", "sun", "azimuth")
    mean = ("backscatter", "through")
    parts = {}
    for field in fields(BandTable):
        values = getattr(table, field.name)
        if field.name in nodes or values is None:
            parts[field.name] = values
        else:
            parts[field.name] = values @ (fractions if field.name in mean else weights).T
    return BandTable(**parts)


def _sorted(three: Sequence[Run], wavelength: Floats) -> list[Run]:
    """By their albedo, the black one first."""
    ordered = sorted(three, key=lambda run: run.albedo)
    albedos = [run.albedo for run in ordered]
    if len(ordered) != 3 or albedos[0] != 0 or not 0 < albedos[1] < albedos[2] <= 1:
        raise ValueError(f"albedo must be 0 and two others up to 1, got {albedos}")
    for run in ordered:
        if run.wavelength.shape != wavelength.shape or (
            np.abs(run.wavelength - wavelength).max() > TOLERANCE
        ):
            raise ValueError("wavelengths of all runs must be the same")
    return ordered


def _spherical(per_albedo: list[Floats], lit: list[Run]) -> Floats:
    """S from a quantity q / (1 - rho S) at two albedos."""
    first, second = per_albedo
    low, high = (run.albedo for run in lit)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (second - first) / (high * second - low * first)
    return np.clip(np.nan_to_num(found), 0, 1)


COLUMNS = ("lambda", "zout", "edir", "edn", "uu")
MILLIWATT_PER_NM = 1e6  # watt / m^2 / m, the unit of libRadtran's solar spectra


def read_uvspec(
    path: Path, albedo: float, black: Path, sun: float, sensor: float,
    unit: float = MILLIWATT_PER_NM,
) -> Run:  # fmt: skip
    """Read one run with `output_user lambda zout edir edn uu` and `zout sur toa`.

        t(sensor) = (edir / edir(toa))^(cos sun / cos sensor)
        reflected = albedo (edir + edn) t / pi,  direct = albedo edir t / pi

    albedo       of its ground
    black        the run over black ground, in the same air
    sun, sensor  radian, zenith angles
    unit         watt / m^2 / m, of the file's irradiance
    Returns      Run, without heat
    Raises       FileNotFoundError; ValueError, with the file, where it has other columns, or not
                 two heights at each wavelength.
    Accuracy     model: the transmittance is Beer's, which holds where lines of gases are resolved.
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
