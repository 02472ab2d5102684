"""Measured tables of a detector's photon transfer or of stars -> measured figures of a design."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
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
# Dark variance (digital number squared) below which quantisation hides the read noise: EMVA 1288,
# 6.6.
LEAST_DARK = 0.24
# Fraction of the largest variance below which the brightest level is saturated. Chosen by hand: the
# variance of a saturated level is almost zero; just below saturation it is almost the largest.
SATURATED = 0.1
# Fraction of the signal of the largest variance up to which the line is fitted: EMVA 1288, 6.6.
LINEAR = 0.7
FEWEST_LEVELS = 3  # least number of levels with light on the line
REWEIGHTINGS = 5  # fits of a line, each weighted by the variances of the previous fit
# Least sigma of the logarithm of each figure, because formula and reduction differ by about this.
# Chosen by hand.
LEAST_SIGMA = 0.003
GROUPS, FEWEST_STARS = 4, 3  # groups of stars by magnitude, and the least number of stars of each
SINGLE_SIGMA = 0.1  # sigma of the logarithm of a figure of one star; chosen by hand


class MeasuredFigure(NamedTuple):
    """A figure from a measured table.

    figure     name of the figure, one of `FRAME_FIGURES`
    number     value in its unit
    sigma      1, standard deviation of its logarithm
    magnitude  Gaia's G of its star; None if the figure does not refer to a magnitude
    """

    figure: str
    number: float
    sigma: float
    magnitude: float | None = None


def with_measured_tables(told: list[Any], folder: Path) -> list[Any]:
    """Entries of `[[told]]`; an entry that names a measured table is replaced by its figures.

    The `factor` of such an entry is a common error of all its figures, in addition to the scatter
    within the table.

    folder  folder of the files
    Raises  Refused, with the file, if there is no such table.
    """
    entries = list[Any]()
    for number, entry in enumerate(told):
        names_table = isinstance(entry, dict) and (entry.get("figure") in TABLES or "file" in entry)
        if names_table:
            entries += _figures_of_table(entry, f"told[{number}]", folder)
        else:
            entries.append(entry)
    return entries


def _figures_of_table(
    entry: Mapping[str, Any], place: str, folder: Path
) -> Iterator[dict[str, Any]]:
    """Entries of `[[told]]` for the figures of the table that an entry names.

    place  place of the entry, for messages
    """
    if (kind := entry.get("figure")) not in TABLES:
        raise Refused(f"{place}.file must be left out except for the figures {', '.join(TABLES)}")
    if not isinstance(name := entry.get("file"), str):
        raise Refused(f"{place}.file must be the name of a table of {kind}, got {shown(name)}")
    if more := entry.keys() - {"figure", "file", "factor", "source"}:
        raise Refused(f"{place}.{min(more)} must be left out of a {kind}")
    common = entry.get("factor", 1.0)
    if isinstance(common, bool) or not isinstance(common, int | float) or not common >= 1:
        raise Refused(f"{place}.factor must be a number of 1 or more, got {shown(common)}")
    path = folder / name
    reduce = reduced_transfer if kind == TRANSFER else reduced_stars
    for measured in reduce(path):
        sigma = math.hypot(measured.sigma, LEAST_SIGMA, math.log(common))
        table = {"figure": measured.figure, "number": measured.number, "factor": math.exp(sigma)}
        if measured.magnitude is not None:
            table["magnitude"] = measured.magnitude
        yield table | {"source": entry.get("source", path.name)}


def reduced_transfer(path: Path) -> list[MeasuredFigure]:
    """Gain, read noise, PRNU and full well from a table of levels of uniform light.

        s^2 = read^2 + 1 / 12 + K (mean - dark mean),   s_spatial^2 = s_0^2 + (prnu signal)^2

    All values are in digital numbers. K is the system gain, the inverse of `gain`. The full well,
    of the pixel or of the converter, is the signal of the brightest level, if the variance of this
    level has collapsed. A dark variance below 0.24 gives no read noise, because it is mostly
    quantisation noise.

    Source: EMVA 1288, release 4.0, 6.6 (photon transfer) and 8.2 (PRNU).

    path    path of a table with `mean`, temporal `variance` and optionally `spatial`: variance
            between pixels, of means over many frames. The level with the lowest mean is dark.
    Raises  Refused if the file is not such a table, or its variance does not grow with the light.
    """
    table = _columns(path, TRANSFER, ("mean", "variance"))
    order = np.argsort(table["mean"])
    mean, variance = table["mean"][order], table["variance"][order]
    signal = mean - mean[0]
    top = int(np.argmax(variance))
    line = (signal <= LINEAR * signal[top]) & (np.arange(len(mean)) < max(top, 1))
    if line.sum() < FEWEST_LEVELS + 1:
        raise Refused(
            f"{path} must have a dark level and {FEWEST_LEVELS} levels with light, below "
            f"{LINEAR:.0%} of the light of the largest variance, got {int(line.sum())} levels there"
        )
    (dark, slope), errors = _line(signal[line], variance[line])
    if not slope > 0:
        raise Refused(f"{path} must have a variance that grows with the mean, got {slope:.3g}")
    figures = [MeasuredFigure("gain", 1 / slope, errors[1] / slope)]
    if dark >= LEAST_DARK:
        read = math.sqrt(dark - QUANTISATION)
        figures.append(MeasuredFigure("read noise", read, errors[0] / 2 / read**2))
    if "spatial" in table:
        spatial = table["spatial"][order]
        (_, square), errors = _line(signal[line] ** 2, spatial[line])
        if square > 3 * errors[1]:
            figures.append(MeasuredFigure("PRNU", math.sqrt(square), errors[1] / 2 / square))
    if variance[-1] < SATURATED * variance[top]:
        figures.append(MeasuredFigure("full well", float(signal[-1]) / slope, errors[1] / slope))
    return figures


def reduced_stars(path: Path) -> list[MeasuredFigure]:
    """Light, SNR and centroid noise from a table of stars.

    path     path of a table with `magnitude`, Gaia's G, and some of these columns: `electrons` or
             `signal` (digital number) of an exposure in the tracker's box; `snr`, this light over
             its standard deviation; `centroid_noise`, pixel rms per axis
    Returns  light of a star of G = 0, mean over all stars; SNR and centroid noise of up to four
             groups of stars of similar magnitude, each the mean of the logarithms
    Raises   Refused if the file is not such a table, or has none of these columns.
    """
    table = _columns(path, STARS, ("magnitude",))
    magnitude = table["magnitude"]
    figures = list[MeasuredFigure]()
    for column, figure in (("electrons", "star electrons"), ("signal", "star signal")):
        if column in table:
            light = np.log(table[column]) + 0.4 * math.log(10) * magnitude
            figures.append(_mean(figure, light, magnitude)._replace(magnitude=None))
    order = np.argsort(magnitude, kind="stable")
    groups = np.array_split(order, max(min(GROUPS, len(order) // FEWEST_STARS), 1))
    for column, figure in (("snr", "SNR"), ("noise", "centroid noise")):
        if column in table:
            logarithm = np.log(table[column])
            figures += [_mean(figure, logarithm[group], magnitude[group]) for group in groups]
    if not figures:
        names = ", ".join(COLUMNS[name][0] for name in ("electrons", "signal", "snr", "noise"))
        raise Refused(f"{path} must have one of the columns {names}")
    return figures


def _columns(path: Path, what: str, needed: tuple[str, ...]) -> dict[str, Floats]:
    """Columns (n,) of a table by their meaning; finite, and positive unless in ANY_SIGN.

    what    kind of table, one of TABLES
    needed  meanings of the columns that it must have
    """
    table = csv_table(path, ended=False, what=f"a {what}")
    columns = dict[str, Floats]()
    for meaning in OF_TABLE[what]:
        head = next((head for head in COLUMNS[meaning] if head in table.colnames), None)
        if head is None:
            if meaning in needed:
                got = shown(", ".join(table.colnames))
                raise Refused(f"{path} must have a column {COLUMNS[meaning][0]}, got {got}")
            continue
        values = np.asarray(table_numbers(path, table, head), float)
        good = np.isfinite(values) & (meaning in ANY_SIGN or values > 0)
        if not good.all():
            row, must = int(np.argmin(good)), "finite" if meaning in ANY_SIGN else "positive"
            raise Refused(
                f"{path}: {head} must be {must} in each row, got {values[row]:g} in row {row + 1}"
            )
        columns[meaning] = values
    return columns


def _line(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Offset and slope (2,) of a line through points of equal relative error, and their sigmas."""
    model, line = np.column_stack([np.ones(len(x)), x]), np.array([y.min(), 0.0])
    weight = 1 / np.maximum(y, 1e-12)
    for _ in range(REWEIGHTINGS):
        line = np.linalg.lstsq(model * weight[:, None], y * weight)[0]
        weight = 1 / np.maximum(model @ line, 1e-3 * y.mean())
    residual = (y - model @ line) * weight
    weighted = model * weight[:, None]
    variance = float(residual @ residual) / max(len(x) - 2, 1)
    return line, np.sqrt(variance * np.linalg.inv(weighted.T @ weighted).diagonal())


def _mean(figure: str, logarithm: Floats, magnitude: Floats) -> MeasuredFigure:
    """A figure of stars, by the mean of its logarithm, at the mean of their magnitudes.

    Its sigma follows from the scatter of the logarithms about a line over magnitude. For fewer than
    FEWEST_STARS stars, or stars of one magnitude, it follows from the scatter about the mean.
    """
    count = len(logarithm)
    if count < FEWEST_STARS or np.ptp(magnitude) == 0:
        spread = float(logarithm.std(ddof=1)) if count > 1 else 0.0
        sigma = max(spread, SINGLE_SIGMA) / math.sqrt(count)
    else:
        residual = logarithm - np.polyval(np.polyfit(magnitude, logarithm, 1), magnitude)
        sigma = float(np.sqrt(residual @ residual / (count - 2) / count))
    mean_magnitude = round(float(magnitude.mean()), 4)
    return MeasuredFigure(figure, math.exp(float(logarithm.mean())), sigma, mean_magnitude)
