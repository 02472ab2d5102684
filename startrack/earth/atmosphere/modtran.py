"""Run from output of MODTRAN (.7sc, .tp7, .chn, JSON)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Floats, nm, um
from startrack.earth.atmosphere.runs import Run

# Names of columns, as MODTRAN 4 and 5 (blanks) and 6 (underscores) print them.
NAMES = {
    "wavelength": ("WAVLEN MCRN", "WAVLEN NM", "WAVLEN", "FREQ"),
    "through": ("TOT TRANS", "TRANS", "TOTAL"),
    "rise": ("PTH THRML", "THRML EM"),
    "scattered": ("SOL SCAT", "MULT SCAT"),
    "reflected": ("GRND RFLT",),
    "direct": ("DRCT RFLT",),
}
COLUMN = re.compile(
    r"WAVLEN(?:[ _](?:MCRN|NM))?|FREQ|(?:TOT[ _])?TRANS|PTH[ _]THRML|THRML[ _](?:SCT|EM)|"
    r"SURF[ _]EMIS|(?:SOL|MULT|SING)[ _]SCAT|GRND[ _]RFLT|DRCT[ _]RFLT|TOTAL[ _]RAD|REF[ _]SOL|"
    r"SOL@OBS|DEPTH|DIR[ _]EM|TOA[ _]SUN|BBODY[ _]T\[K\]"
)
NUMBER = re.compile(r"[-+]?\d*\.?\d+(?:[ED][-+]?\d+)?|\*+")
# Columns of a .chn file, counted from 0: the first spectral moment (nm), the channel's width (nm),
# heat of the path and scattered from the ground, single and multiple scattering, the ground's light
# in all and straight from the Sun, and the direct transmittance upwards.
# Source: how ISOFIT 3 reads them (isofit/radiative_transfer/modtran.py).
CHANNEL = {
    "wavelength": (0,), "width": (8,), "rise": (11, 12), "scattered": (14, 15),
    "reflected": (16,), "direct": (17,), "through": (24,),
}  # fmt: skip


def read_modtran(path: Path, albedo: float) -> Run:
    """Read one run.

    albedo   of its ground, which the files do not say
    Returns  Run, in SI whatever the file's units
    Raises   FileNotFoundError; ValueError, with the file, where columns are missing, a row is
             short, or there is none.
    """
    path = Path(path)
    text = path.read_text(encoding="latin-1")
    if path.suffix == ".json":
        columns = _json(path, text)
    elif path.suffix == ".chn":
        columns = _channels(path, text)
    else:
        columns = _tape(path, text)
    order = np.argsort(columns["wavelength"])
    run = Run(albedo, **{name: columns[name][order] for name in Run._fields[1:]})
    for name in Run._fields[1:]:
        if not np.isfinite(getattr(run, name)).all():
            raise ValueError(f"{path}: {name} must be numbers, got some that are not")
    return run


def _tape(path: Path, text: str) -> dict[str, Floats]:
    """The first table of a .7sc or .tp7 file, up to its -9999."""
    lines = text.splitlines()
    start = next((i for i, line in enumerate(lines) if _is_header(line)), None)
    if start is None:
        raise ValueError(f"{path} must have a line with FREQ or WAVLEN and GRND RFLT, got none")
    header = {found[0].replace("_", " "): found.end() for found in COLUMN.finditer(lines[start])}
    rows = []
    for line in lines[start + 1 :]:
        if line.strip().startswith("-9999"):
            break
        found = list(NUMBER.finditer(line.upper()))
        if not found or re.search(r"[A-Z]{3}", line.upper()):
            continue  # a line of units
        rows.append(_row(found, list(header.values())))
    if len(rows) < 2:
        raise ValueError(f"{path} must have two rows or more, got {len(rows)}")
    table = dict(zip(header, np.array(rows).T, strict=True))
    return _scaled(path, table)


def _row(numbers: list[re.Match[str]], ends: list[int]) -> list[float]:
    """Numbers under the column whose name ends nearest; a blank is zero."""
    row = [0.0] * len(ends)
    for number in numbers:
        column = int(np.argmin(np.abs(np.array(ends) - number.end())))
        row[column] = float(number[0].replace("D", "E")) if "*" not in number[0] else np.nan
    return row


def _is_header(line: str) -> bool:
    names = [found[0] for found in COLUMN.finditer(line)]
    return len(names) > 5 and names[0].startswith(("FREQ", "WAVLEN"))


def _json(path: Path, text: str) -> dict[str, Floats]:
    """The first object anywhere inside that holds the columns as lists."""
    try:
        found = _spectra(json.loads(text))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} must be JSON: {error}") from None
    if found is None:
        raise ValueError(f"{path} must hold FREQ or WAVLEN and GRND_RFLT as lists, got none")
    return _scaled(
        path, {key.replace("_", " "): np.array(one, float) for key, one in found.items()}
    )


def _spectra(value: Any) -> dict[str, list[float]] | None:
    if isinstance(value, Mapping):
        columns = {key: one for key, one in value.items() if isinstance(one, list)}
        names = {key.replace("_", " ") for key in columns}
        if names & set(NAMES["wavelength"]) and "GRND RFLT" in names:
            return {key: one for key, one in columns.items() if COLUMN.fullmatch(key)}
    inside = value.values() if isinstance(value, Mapping) else value
    if isinstance(value, Mapping | list):
        for one in inside:
            found = _spectra(one)
            if found:
                return found
    return None


def _scaled(path: Path, table: Mapping[str, Floats]) -> dict[str, Floats]:
    """Columns by our names, in SI: radiance per square centimetre, and wavenumber or micrometre."""
    out: dict[str, Floats] = {}
    for name, known in NAMES.items():
        here = next((one for one in known if one in table), None)
        if here is None:
            raise ValueError(f"{path} must have a column {known[0]}, got {', '.join(table)}")
        out[name] = table[here]
        if name == "wavelength":
            axis = here
    if axis == "FREQ":  # 1 / cm; radiance per wavenumber
        metre = 0.01 / out["wavelength"]
        per = 1e4 * 0.01 / metre**2
    else:
        unit = nm if axis.endswith("NM") else um
        metre = out["wavelength"] * unit
        per = np.full(len(metre), 1e4 / unit)
    out["wavelength"] = metre
    for name in ("rise", "scattered", "reflected", "direct"):
        out[name] = out[name] * per
    return out


def _channels(path: Path, text: str) -> dict[str, Floats]:
    """The first part of a .chn file: its rows begin with a number and are the longest."""
    rows: list[list[float]] = []
    for line in text.splitlines():
        numbers = [float(one[0].replace("D", "E")) for one in _leading(line)]
        if len(numbers) > max(max(columns) for columns in CHANNEL.values()):
            if rows and numbers[0] <= rows[-1][0]:
                break  # the next part begins again
            rows.append(numbers[:25])
    if len(rows) < 2:
        raise ValueError(f"{path} must have two channels of 25 columns or more, got {len(rows)}")
    table = np.array(rows).T
    sums = {name: sum(table[i] for i in columns) for name, columns in CHANNEL.items()}
    out = {name: np.asarray(one, np.float64) for name, one in sums.items()}
    width = out.pop("width") * nm
    out["wavelength"] = out["wavelength"] * nm
    for name in ("rise", "scattered", "reflected", "direct"):
        out[name] = out[name] * 1e4 / width  # watt / cm^2 / sr in the channel
    return out


def _leading(line: str) -> list[re.Match[str]]:
    """Numbers from the start of a line, before its channel's name."""
    found = []
    for word in re.finditer(r"\S+", line.upper()):
        number = NUMBER.fullmatch(word[0])
        if not number or "*" in word[0]:
            break
        found.append(number)
    return found
