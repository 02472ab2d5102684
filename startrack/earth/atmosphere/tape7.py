"""Output of MODTRAN -> rows of a user's table of the air, a CSV file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused, um
from startrack.earth.atmosphere.radiance_table import LIGHT, RATIOS, load_radiance_table
from startrack.io import content, whole

WHAT = "output of MODTRAN (tape7, tape7.scn or CSV)"
# Columns by their names in MODTRAN 3 to 6; a blank inside a name counts as "_".
TITLES = {
    "through": ("TOT_TRANS", "COMBIN_TRANS"),
    "thermal": ("PTH_THRML", "THRML_EM"),
    "scattered": ("SOL_SCAT",),
    "multiple": ("MULT_SCAT",),
    "single": ("SING_SCAT",),
    "reflected": ("GRND_RFLT",),
    "beam": ("DRCT_RFLT",),
    "total": ("TOTAL_RAD",),
}
SPACED = (
    *("TOT TRANS", "COMBIN TRANS", "PTH THRML", "THRML EM", "THRML SCT", "SURF EMIS", "SOL SCAT"),
    *("MULT SCAT", "SING SCAT", "GRND RFLT", "DRCT RFLT", "TOTAL RAD", "REF SOL", "DIR EM"),
    *("TOA SUN", "BBODY T", "WAVLEN MCRN", "WAVLEN NM"),
)
END = -9999.0  # marks the end of rows
SPECTRAL = ("cm-1", "nm", "um")  # units of the first column
OF_TITLE = {"WAVLEN_MCRN": "um", "WAVLEN_NM": "nm"}  # unit of the first column by its title
THERMAL = 5 * um  # from this wavelength on, the ground's reflected light counts as heat of the sky
UNITS = "W / (m2 sr um)"
ROUNDED = 0.01  # relative, of printed numbers of three digits


class RunGeometry(NamedTuple):
    """Geometry of a run of MODTRAN; None: the table does not depend on the value.

    height, altitude  metre: of the ground above the sea, of the sensor above the ground
    sensor_zenith, sun_zenith, azimuth  degree; of the sensor as the ground sees it
    """

    height: float | None = None
    altitude: float | None = None
    sensor_zenith: float | None = None
    sun_zenith: float | None = None
    azimuth: float | None = None


def import_tape7(
    runs: tuple[Path, Path],
    albedos: tuple[float, float],
    out: Path,
    geometry: RunGeometry | None = None,
    unit: str = "cm-1",
    add: bool = False,
) -> Floats:
    """Turn two runs over grounds of different albedo into rows of a user's table.

    G is the light that the ground reflects to the sensor (GRND_RFLT), r the albedo:

        G (1 - r S) = r g,   scattered = path + r a / (1 - r S)

    Two albedos determine S, g, a and path; DRCT_RFLT / r is the direct part of g. g also contains
    heat of the sky that the ground reflects. Up to 5 micrometre, in runs with sunlight, this heat
    counts as light of the sky.

    Source: Verhoef and Bach (2003), Remote Sensing of Environment 87, 23, for the method of two
    albedos.

    runs      two files of the same geometry and spectrum
    albedos   albedos of the ground in both runs, above 0 and different
    out       CSV file
    unit      of the first column: "cm-1" (tape7; radiance in W / cm2 / sr / cm-1), "nm" (tape7.scn;
              uW / cm2 / sr / nm) or "um" (tape7.scn; W / cm2 / sr / um)
    add       whether rows are added to an existing file
    Returns   wavelengths, metre
    Raises    ValueError with the file where it is not such an output, the runs differ, their
              ground does not reflect as the albedos say, or the resulting table is not valid.
    Accuracy  model: the thermal path radiance is taken from the run of smaller albedo. It contains
              ground radiance that the air scatters.
    """
    low, high = sorted(albedos)
    if not 0 < low < high <= 1:
        raise Refused(
            f"albedos must be two different numbers in ]0, 1], got {albedos[0]:g} and "
            f"{albedos[1]:g}"
        )
    if unit not in SPECTRAL:
        raise Refused(f"unit must be one of {', '.join(SPECTRAL)}, got {unit!r}")
    dark, bright = (_read(path, unit) for _, path in sorted(zip(albedos, runs, strict=True)))
    place = dark["wavelength"]
    if len(place) != len(bright["wavelength"]) or not np.allclose(place, bright["wavelength"]):
        raise Refused(f"{runs[0]} and {runs[1]} must have the same wavelengths")
    _require_rise(runs, dark, bright, low, high)
    columns = _solved(dark, bright, low, high)
    given = {} if geometry is None else geometry._asdict()
    axes = {name: value for name, value in given.items() if value is not None}
    heads = ["wavelength [um]"]
    heads += [f"{name} [{'m' if name in ('height', 'altitude') else 'deg'}]" for name in axes]
    heads += [f"{name} [{UNITS}]" if name not in RATIOS else name for name in columns]
    head = ",".join(heads)
    fixed = "".join(f"{value:g}," for value in axes.values())
    lines = [
        f"{node / um:.8g},{fixed}" + ",".join(f"{value:.6g}" for value in row)
        for node, row in zip(place, np.array(list(columns.values())).T, strict=True)
    ]
    before = ""
    if add and out.exists():
        before = content(out, "a table of the air")
        first = before.splitlines()[0]
        if first != head:
            raise Refused(f"{out} must have the columns {head} to add rows, has {first}")
        width = 1 + len(axes)  # wavelength and geometry
        there = {tuple(line.split(",")[:width]) for line in before.splitlines()}
        if twice := [line for line in lines if tuple(line.split(",")[:width]) in there]:
            row = ", ".join(twice[0].split(",")[:width])
            raise Refused(f"{out} must have each geometry once, has {row} already")
    rows = "\n".join(lines) + "\n"
    with whole(out) as draft:
        draft.write_text(f"{head}\n{rows}", encoding="utf-8")
        try:  # the new rows alone: the file may still lack geometries of later runs
            load_radiance_table(draft)
        except Refused as error:
            raise Refused(str(error).replace(str(draft), str(out))) from None
        draft.write_text((before or f"{head}\n") + rows, encoding="utf-8")
    return place


def _require_rise(
    runs: tuple[Path, Path],
    dark: Mapping[str, Floats],
    bright: Mapping[str, Floats],
    low: float,
    high: float,
) -> None:
    """Light that the air sends back to the ground raises GRND_RFLT / albedo with the albedo.

    In the thermal infrared it may fall, because the air also sends back heat of the ground.
    """
    sunlit = dark["wavelength"] < THERMAL
    over = [float((run["reflected"][sunlit] / r).sum()) for run, r in ((dark, low), (bright, high))]
    if over[1] < (1 - ROUNDED) * over[0]:
        raise Refused(
            f"albedos must be those of {runs[0]} and {runs[1]}: GRND_RFLT / albedo must not fall "
            f"with the albedo, got a factor of {over[1] / over[0]:.3g} from {low:g} to {high:g}"
        )


def _solved(
    dark: dict[str, Floats], bright: dict[str, Floats], low: float, high: float
) -> dict[str, Floats]:
    """Columns of a user's table, watt / m^2 / sr / um."""
    over = [dark["reflected"] / low, bright["reflected"] / high]
    added = bright["reflected"] - dark["reflected"]
    rises = added > 0
    mirrored = np.where(rises, (over[1] - over[0]) / np.where(rises, added, 1.0), 0.0)
    mirrored = np.clip(mirrored, 0.0, 1.0)
    white = over[0] * (1 - low * mirrored)
    factors = [albedo / (1 - albedo * mirrored) for albedo in (low, high)]
    around = np.maximum((bright["scattered"] - dark["scattered"]) / (factors[1] - factors[0]), 0.0)
    path = np.maximum(dark["scattered"] - around * factors[0], 0.0)
    direct = np.minimum(dark["beam"] / low, white)
    warm = dark["wavelength"] > THERMAL
    if not (dark["scattered"].any() or dark["beam"].any()):  # a run without sunlight
        warm[:] = True
    sky = np.where(warm, 0.0, white - direct)
    fall = np.where(warm, white - direct, 0.0)
    values = (path, direct, sky, around, mirrored, dark["through"])
    made = dict(zip((*LIGHT, *RATIOS), values, strict=True))
    return made | {"rise": np.maximum(dark["thermal"], 0.0), "fall": fall}


def _read(path: Path, unit: str) -> dict[str, Floats]:
    """Columns of a run by the keys of TITLES: wavelength in metre, radiance in W / m2 / sr / um."""
    lines = content(path, WHAT).splitlines()
    marks = [n for n, line in enumerate(lines) if _titles(line)]
    if not marks:
        raise Refused(f"{path} must be {WHAT}, has no line with FREQ and TOTAL_RAD")
    if len(marks) > 1:
        raise Refused(f"{path} must have one run, has {len(marks)}")
    titles = _titles(lines[marks[0]])
    if (said := OF_TITLE.get(titles[0][0], unit)) != unit:
        raise Refused(
            f"{path}: unit must be {said}, that of its first column {titles[0][0]}, got {unit!r}"
        )
    rows = list[list[float]]()
    for line in lines[marks[0] + 1 :]:
        row = _numbers(line, titles)
        if row is None:
            continue
        if row[0] == END:
            break
        rows.append(row)
    if len(rows) < 3:
        raise Refused(f"{path} must have three rows of numbers or more, has {len(rows)}")
    table = np.array(rows)
    columns = {}
    for key, names in TITLES.items():
        index = next((n for n, (name, _) in enumerate(titles) if name in names), None)
        if index is not None:
            columns[key] = table[:, index]
    if "scattered" not in columns and "multiple" in columns:  # MODTRAN 6
        columns["scattered"] = columns["multiple"] + columns.get("single", 0.0)
    for key in ("through", "thermal", "reflected"):
        if key not in columns:
            raise Refused(f"{path} must have a column {' or '.join(TITLES[key])}")
    dark = np.zeros(len(table))
    place = 1e-2 / table[:, 0] if unit == "cm-1" else table[:, 0] * (1e-9 if unit == "nm" else um)
    if not ((place > 0.2 * um) & (place < 50 * um)).all():
        raise Refused(
            f"{path}: wavelengths must lie in [0.2, 50] um, got {place.min() / um:.4g} to "
            f"{place.max() / um:.4g} um of a first column in {unit}"
        )
    order = np.argsort(place)
    radiance = np.full(len(table), {"nm": 10.0, "um": 1e4}.get(unit, 1.0))
    if unit == "cm-1":
        radiance = table[:, 0] ** 2  # W / cm2 / sr / cm-1 -> W / m2 / sr / um
    kept = {key: columns.get(key, dark) * radiance for key in TITLES if key != "through"}
    kept |= {"through": columns["through"], "wavelength": place}
    return {key: values[order] for key, values in kept.items()}


def _titles(line: str) -> list[tuple[str, int]]:
    """Names of columns and their ends, in a header line; empty for other lines."""
    line = line.upper()
    for name in SPACED:
        line = re.sub(name.replace(" ", " +"), lambda own: own[0].replace(" ", "_"), line)
    names = [(re.sub("_+", "_", own[0]), own.end()) for own in re.finditer(r"[^\s,]+", line)]
    bare = {name for name, _ in names}
    return names if bare & {"TOTAL_RAD", "TOT_TRANS", "COMBIN_TRANS"} and len(names) > 3 else []


def _numbers(line: str, titles: list[tuple[str, int]]) -> list[float] | None:
    """The numbers of a row, 0 for a blank; None for other lines."""
    words = re.split(r"[\s,]+", line.strip().strip(","))
    try:
        if words[0] and float(words[0]) == END:
            return [END]
        if len(words) == len(titles):
            return [float(word) for word in words]
        if "," in line or len(words) > len(titles) or not words[0]:
            return None
        begins = [0, *(end for _, end in titles[:-1])]
        ends = [*(end for _, end in titles[:-1]), len(line)]
        cells = [line[begin:end].strip() for begin, end in zip(begins, ends, strict=True)]
        return [float(cell) if cell else 0.0 for cell in cells]
    except ValueError:
        return None
