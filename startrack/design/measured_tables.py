"""Tables of a detector or of stars that somebody measured -> the figures of a design they tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from startrack.catalog import csv_table, table_numbers
from startrack.core import Floats, Refused, shown

TRANSFER, STARS = "photon transfer", "star table"
TABLES = TRANSFER, STARS
# Columns by their meaning, in lower case; the first that a table has is taken.
COLUMNS: Mapping[str, tuple[str, ...]] = {
    "mean": ("mean", "mean_dn", "signal_dn"),
    "variance": ("variance", "variance_dn2", "temporal_variance"),
    "spatial": ("spatial", "spatial_variance", "spatial_variance_dn2"),
    "magnitude": ("magnitude", "magnitude_g", "g"),
    "electrons": ("electrons", "star_electrons"),
    "signal": ("signal", "signal_dn"),
    "snr": ("snr", "signal_to_noise"),
    "noise": ("centroid_noise", "centroid_noise_px", "noise_px"),
}
OF_TABLE = {
    TRANSFER: ("mean", "variance", "spatial"),
    STARS: ("magnitude", "electrons", "signal", "snr", "noise"),
}
ANY_SIGN = "mean", "variance", "spatial", "magnitude"  # columns that may be zero or below it
QUANTISATION = 1 / 12  # digital number squared
LEAST_DARK = 0.24  # digital number squared, below which quantisation hides it: EMVA 1288, 6.6
SATURATED = 0.1  # of the largest variance, below which the brightest level is saturated; by hand
LINEAR = 0.7  # of the light of the largest variance, to which the line is fitted: EMVA 1288, 6.6
FEWEST = 3  # levels of light on the line
FITS = 5  # of a line whose weights are by the line before
LEAST = 0.003  # of the logarithm of a figure, by which formula and reduction differ; by hand
GROUPS, OF_GROUP = 4, 3  # of stars by magnitude, and how many each has at least
SINGLE = 0.1  # of the logarithm of a figure of one star; by hand


class MeasuredFigure(NamedTuple):
    """A figure of a table: its number, the sigma of its logarithm, the magnitude of the star."""

    figure: str
    number: float
    sigma: float
    magnitude: float | None = None


def with_measured_tables(told: list[Any], folder: Path) -> list[Any]:
    """Entries of `[[told]]`, with the figures of a table for each that names one as `file`.

    A factor of the entry is that by which all of them may be wrong, beside what the table says.

    folder  in which the files are
    Raises  Refused, with the file, where there is no such table.
    """
    found = list[Any]()
    for number, entry in enumerate(told):
        named = isinstance(entry, dict) and entry.get("figure") in TABLES
        if not named and not (isinstance(entry, dict) and "file" in entry):
            found.append(entry)
            continue
        place = f"told[{number}]"
        if not named:
            raise Refused(f"{place}.file must be left out but of the figures {', '.join(TABLES)}")
        if not isinstance(name := entry.get("file"), str):
            raise Refused(
                f"{place}.file must be the name of a table of {entry['figure']}, got {shown(name)}"
            )
        if more := entry.keys() - {"figure", "file", "factor", "source"}:
            raise Refused(f"{place}.{min(more)} must be left out of a {entry['figure']}")
        common = entry.get("factor", 1.0)
        if isinstance(common, bool) or not isinstance(common, int | float) or not common >= 1:
            raise Refused(f"{place}.factor must be a number of 1 or more, got {shown(common)}")
        path = folder / name
        reduce = reduced_transfer if entry["figure"] == TRANSFER else reduced_stars
        for one in reduce(path):
            sigma = math.hypot(one.sigma, LEAST, math.log(common))
            table = {"figure": one.figure, "number": one.number, "factor": math.exp(sigma)}
            table |= {} if one.magnitude is None else {"magnitude": one.magnitude}
            found.append(table | {"source": entry.get("source", path.name)})
    return found


def reduced_transfer(path: Path) -> list[MeasuredFigure]:
    """Gain, read noise, PRNU and full well of a table of levels of even light.

        s^2 = read^2 + 1 / 12 + K (mean - dark mean),   s_spatial^2 = s_0^2 + (prnu signal)^2

    in digital numbers, with the system gain K, the inverse of `gain`; the full well is the signal
    of the brightest level, where hardly any variance is left of the largest: of the pixel or of the
    converter, whichever ends first. A dark variance below 0.24 says
    nothing, for quantisation decides it.

    Source: EMVA 1288, release 4.0, 6.6 (photon transfer) and 8.2 (PRNU).

    path    of a table with `mean` and `variance` in time and, where it has one, `spatial`: variance
            between pixels, of means over many frames. The level of the least mean is dark.
    Raises  Refused where the file is no such table, or its variance does not grow with the light.
    """
    table = _columns(path, TRANSFER, ("mean", "variance"))
    order = np.argsort(table["mean"])
    mean, variance = table["mean"][order], table["variance"][order]
    signal = mean - mean[0]
    top = int(np.argmax(variance))
    line = (signal <= LINEAR * signal[top]) & (np.arange(len(mean)) < max(top, 1))
    if line.sum() < FEWEST + 1:
        raise Refused(
            f"{path} must have a dark level and {FEWEST} of light, below {LINEAR:.0%} of the light "
            f"of the largest variance, got {int(line.sum())} levels there"
        )
    (dark, slope), errors = _line(signal[line], variance[line])
    if not slope > 0:
        raise Refused(f"{path} must have a variance that grows with the mean, got {slope:.3g}")
    found = [MeasuredFigure("gain", 1 / slope, errors[1] / slope)]
    if dark >= LEAST_DARK:
        read = math.sqrt(dark - QUANTISATION)
        found.append(MeasuredFigure("read noise", read, errors[0] / 2 / read**2))
    if "spatial" in table:
        spatial = table["spatial"][order]
        (_, square), errors = _line(signal[line] ** 2, spatial[line])
        if square > 3 * errors[1]:
            found.append(MeasuredFigure("PRNU", math.sqrt(square), errors[1] / 2 / square))
    if variance[-1] < SATURATED * variance[top]:
        found.append(MeasuredFigure("full well", float(signal[-1]) / slope, errors[1] / slope))
    return found


def reduced_stars(path: Path) -> list[MeasuredFigure]:
    """Light, SNR and centroid noise of a table of stars.

    path    of a table with `magnitude`, Gaia's G, and some of `electrons` or `signal` (digital
            number) of an exposure in the tracker's box, `snr`, the former over its standard
            deviation, and `centroid_noise`, pixel rms of an axis
    Returns  light of a star of G = 0, the mean over all; SNR and centroid noise of up to four
             groups of stars of like magnitude, each the mean of its logarithms
    Raises   Refused where the file is no such table, or has none of these.
    """
    table = _columns(path, STARS, ("magnitude",))
    magnitude = table["magnitude"]
    found = list[MeasuredFigure]()
    for column, figure in (("electrons", "star electrons"), ("signal", "star signal")):
        if column in table:
            light = np.log(table[column]) + 0.4 * math.log(10) * magnitude
            found.append(_mean(figure, light, magnitude)._replace(magnitude=None))
    order = np.argsort(magnitude, kind="stable")
    groups = np.array_split(order, max(min(GROUPS, len(order) // OF_GROUP), 1))
    for column, figure in (("snr", "SNR"), ("noise", "centroid noise")):
        if column in table:
            logarithm = np.log(table[column])
            found += [_mean(figure, logarithm[group], magnitude[group]) for group in groups]
    if not found:
        names = ", ".join(COLUMNS[name][0] for name in ("electrons", "signal", "snr", "noise"))
        raise Refused(f"{path} must have one of the columns {names}")
    return found


def _columns(path: Path, what: str, needed: tuple[str, ...]) -> dict[str, Floats]:
    """Columns of a table by their meaning, positive but where zero means something."""
    table = csv_table(path, ended=False, what=f"a {what}")
    found = dict[str, Floats]()
    for name in OF_TABLE[what]:
        there = next((one for one in COLUMNS[name] if one in table.colnames), None)
        if there is None:
            if name in needed:
                got = shown(", ".join(table.colnames))
                raise Refused(f"{path} must have a column {COLUMNS[name][0]}, got {got}")
            continue
        values = np.asarray(table_numbers(path, table, there), float)
        good = np.isfinite(values) & (name in ANY_SIGN or values > 0)
        if not good.all():
            row, must = int(np.argmin(good)), "finite" if name in ANY_SIGN else "positive"
            raise Refused(
                f"{path}: {there} must be {must} in each row, got {values[row]:g} in row {row + 1}"
            )
        found[name] = values
    return found


def _line(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Offset and slope of a line through points of equal relative error, and their sigmas."""
    model, found = np.column_stack([np.ones(len(x)), x]), np.array([y.min(), 0.0])
    weight = 1 / np.maximum(y, 1e-12)
    for _ in range(FITS):
        found = np.linalg.lstsq(model * weight[:, None], y * weight)[0]
        weight = 1 / np.maximum(model @ found, 1e-3 * y.mean())
    off = (y - model @ found) * weight
    scaled = model * weight[:, None]
    square = float(off @ off) / max(len(x) - 2, 1)
    return found, np.sqrt(square * np.linalg.inv(scaled.T @ scaled).diagonal())


def _mean(figure: str, logarithm: Floats, magnitude: Floats) -> MeasuredFigure:
    """A figure of stars, by the mean of its logarithm; its error by their scatter about a line."""
    at = float(magnitude.mean())
    if len(logarithm) < OF_GROUP or np.ptp(magnitude) == 0:
        spread = float(logarithm.std(ddof=1)) if len(logarithm) > 1 else 0.0
        sigma = max(spread, SINGLE) / math.sqrt(len(logarithm))
    else:
        left = logarithm - np.polyval(np.polyfit(magnitude, logarithm, 1), magnitude)
        sigma = float(np.sqrt(left @ left / (len(left) - 2) / len(left)))
    return MeasuredFigure(figure, math.exp(float(logarithm.mean())), sigma, round(at, 4))
