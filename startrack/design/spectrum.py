"""Table of a design -> the same table with power spectra of jitter from the files that it names."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from startrack.core import Refused, parse
from startrack.io import read_bytes

PLACE = "instrument.motion.broadband"
UNITS = "Hz", "arcsec2 / Hz"  # units of columns if the header names none
HEAD = re.compile(r"[^(\[]*[(\[](.*)[)\]]\s*")
# Units other than UNITS that a header names without brackets.
LOOSE = re.compile(
    r"(?<![a-z])([munpkµμ]?rad|arcmin|deg|[mu]?as|[mu]arcsec|db|[km]hz)(?![a-z])", re.IGNORECASE
)
FREQUENCY = re.compile(r"freq|f(?![a-z])|hz", re.IGNORECASE)  # first cell of the names of columns
# Words of a comment on what the spectrum was made from.
SOURCE = re.compile(
    r"(?<![a-z])(?:not|from|convert\w*|integra\w*|squared|doubled|input|model)(?![a-z])",
    re.IGNORECASE,
)
# Quantities that are no one-sided power spectral density of an angle, as headers name them.
OTHERS = re.compile(
    r"(?:two|2|double)[-\s]?sided|\basd\b|amplitude[-\s]spectr\w*|sqrt|\u221a|rt\s?hz"
    r"|hz\s*(?:\^|\*\*)\s*\(?(?:-?0?\.5|-?1/2)"
    r"|(?:rate|velocity|acceleration)[-\s](?:psd|density|spectr\w*)"
    r"|(?:psd|density|spectr\w*)\s+of\s+(?:the\s+)?(?:\w+\s+)?(?:rates?|velocity|acceleration)"
    r"|angular[-\s](?:rate|velocity|acceleration)|(?<![a-z])g\s*(?:\^|\*\*)?2\s*/\s*hz",
    re.IGNORECASE,
)


def with_spectra(table: Any, folder: Path) -> None:
    """Replace `file` of each table of `instrument.motion.broadband` by frequency and density.

    The file has two columns, separated by commas, semicolons or blanks: frequency and one-sided
    power spectral density. A header such as "frequency (Hz), density (urad2 / Hz)", with or without
    a # before it, names the units. Without a header they are Hz and arcsec2 / Hz. Other lines that
    begin with # are ignored.

    table   table of a whole design, changed in place
    folder  folder of the file
    Raises  ValueError, with file and line, if there is no such file, if it is not such a table, or
            if a line before the numbers names another unit without brackets or another quantity,
            such as an amplitude or a two-sided density.
    """
    match table:
        case {"instrument": {"motion": {"broadband": list(entries)}}}:
            pass
        case _:
            return
    for number, entry in enumerate(entries):
        if not (isinstance(entry, dict) and "file" in entry):
            continue
        if "frequency" in entry or "density" in entry:
            raise Refused(
                f"{PLACE}[{number}]: frequency and density must be left out if file is given"
            )
        if not isinstance(name := entry.pop("file"), str):
            raise Refused(f"{PLACE}[{number}].file must be the name of a file, got {name!r}")
        columns = _columns(folder / name)
        entry["frequency"], entry["density"] = (list(column) for column in columns)


def _columns(path: Path) -> tuple[list[str], list[str]]:
    """Frequencies and densities, each with its unit."""
    units, frequency, density = list(UNITS), list[str](), list[str]()
    for line, text in _lines(path):
        cells = _cells(text.lstrip("# "))
        if text.startswith("#") or (not frequency and _number(cells[0]) is None):
            if not frequency:
                units = _units(path, line, cells, units)
            continue
        if len(cells) != 2 or None in (_number(cells[0]), _number(cells[1])):
            raise Refused(f"{path}, line {line}: must have a frequency and a density, got {cells}")
        frequency.append(f"{cells[0]} {units[0]}")
        density.append(f"{cells[1]} {units[1]}")
    if len(frequency) < 2:
        raise Refused(f"{path} must have two or more lines of frequency and density")
    return frequency, density


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line that is not empty."""
    try:
        lines = read_bytes(path, "a table of a spectrum").decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise Refused(f"{path} must be a table of a spectrum as text: {error}") from None
    except OSError as error:
        raise Refused(str(error) if error.errno is None else f"{path}: {error}") from None
    for number, line in enumerate(lines, 1):
        if text := line.strip():
            yield number, text


def _cells(text: str) -> list[str]:
    separated = re.split(r"\s*[,;]\s*", text)
    if len(separated) > 1:
        return separated
    bracketed = re.findall(r"[^(\[]*[(\[][^)\]]*[)\]]", text)  # "f (Hz)  S (arcsec2 / Hz)"
    return bracketed if len(bracketed) == len(UNITS) else text.split()


def _units(path: Path, line: int, cells: list[str], before: list[str]) -> list[str]:
    """The units that a header names; if it names none, the units of the lines before it."""
    names, text = FREQUENCY.match(cells[0]), " ".join(cells)
    if (other := OTHERS.search(text)) and (names or not SOURCE.search(text)):
        raise Refused(
            f"{path}, line {line}: must name a one-sided power spectral density of an angle, got "
            f"{other[0]!r}"
        )
    found = [match[1] if (match := HEAD.fullmatch(cell)) else "" for cell in cells]
    bare = " ".join(cell for cell, unit in zip(cells, found, strict=True) if not unit)
    if names and (loose := LOOSE.search(bare)):
        raise Refused(
            f"{path}, line {line}: must name its units in brackets, such as 'frequency (Hz), "
            f"density (urad2 / Hz)', got {loose[0]!r} without them"
        )
    if not any(found) or len(found) != len(UNITS):
        return before
    units = [unit or usual for unit, usual in zip(found, UNITS, strict=True)]
    try:
        for unit, usual in zip(units, ("Hz", "rad2 / Hz"), strict=True):
            parse(f"1 {unit}", usual)
    except ValueError as error:
        raise Refused(f"{path}, line {line}: units of frequency and density {error}") from None
    return units


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
