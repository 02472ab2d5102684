"""Catalogue file (fixed width, separated, CSV, FITS, VOTable) -> its columns."""

import io
import math
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Floats, Ints, Refused, require_memory, shown
from startrack.io import (
    TEXT_NEEDED,
    content,
    csv_table,
    first_line,
    in_lower_case,
    read_bytes,
    require_fits,
    unpacked,
)


@dataclass(frozen=True, eq=False)
class Records:
    """Columns of text, and their places in a file.

    path     the file
    columns  texts of each field, one for each star
    line     number of each star's line in the file, from 1
    """

    path: Path
    columns: Mapping[str, list[str]]
    line: list[int]

    def numbers(self, name: str) -> Floats:
        """A column as numbers, NaN where the field is blank.

        Raises  ValueError if a field is not a finite number.
        """
        texts = self.columns[name]
        try:
            values = np.array([float(text) if text.strip() else np.nan for text in texts])
            given = np.array([bool(text.strip()) for text in texts], bool)
            bad = np.flatnonzero(given & ~np.isfinite(values))
        except ValueError:
            bad = np.array(
                [i for i, text in enumerate(texts) if text.strip() and not _number(text)]
            )
        if len(bad):
            where = f"{self.path}, line {self.line[bad[0]]}"
            raise Refused(f"{where}: {name} must be a number, got {texts[bad[0]]!r}")
        return values

    def integers(self, name: str) -> Ints:
        """A column of whole numbers, none of them blank.

        Raises  ValueError if a field is not a whole number.
        """
        values = self.numbers(name)
        wrong = np.flatnonzero(values != np.round(values))
        if len(wrong):
            text = self.columns[name][wrong[0]]
            where = f"{self.path}, line {self.line[wrong[0]]}"
            raise Refused(f"{where}: {name} must be a whole number, got {text!r}")
        if (np.abs(values) >= 2.0**63).any() or np.isnan(values).any():
            raise Refused(f"{self.path}: {name} must be a number of 64 bits in each line")
        return values.astype(np.int64)


def _number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def fixed_width(
    path: Path, fields: Mapping[str, tuple[int, int]], needed: int, record: int
) -> Records:
    """Read a file whose fields have fixed positions in the line.

    path     the file, plain or gzipped
    fields   first and last byte of each field, from 1, as in the CDS's descriptions
    needed   number of bytes that every line must have; blanks after them may be stripped
    record   number of bytes of a whole line
    Returns  the columns
    Raises   ValueError for an empty or truncated file, and for a line that is too short.
    """
    lines = text_lines(path, record)
    for number, line in enumerate(lines, 1):
        if len(line) < needed:
            raise Refused(
                f"{path}, line {number}: must have at least {needed} characters, got {len(line)}"
            )
    columns = {
        name: [line[first - 1 : last] for line in lines] for name, (first, last) in fields.items()
    }
    return Records(path, columns, list(range(1, len(lines) + 1)))


def separated(path: Path, fields: Mapping[str, int], count: int, record: int) -> Records:
    """`fixed_width` for a file whose fields are separated by bars.

    fields   number of each field in the line, from 0
    count    number of fields in a line
    """
    columns: dict[str, list[str]] = {name: [] for name in fields}
    lines = text_lines(path, record)
    for number, line in enumerate(lines, 1):
        row = line.split("|")
        if len(row) != count:
            raise Refused(
                f"{path}, line {number}: must have {count} fields between bars, got {len(row)}"
            )
        for name, place in fields.items():
            columns[name].append(row[place])
    return Records(path, columns, list(range(1, len(lines) + 1)))


def text_lines(path: Path, record: int) -> list[str]:
    """The lines of a text file, plain or gzipped, without line ends.

    record  number of bytes of a whole line; a shorter last line without a line end was truncated
    Raises  ValueError for a file that is empty, truncated, or not text.
    """
    text = content(path)
    lines = text.splitlines()
    if not text.endswith("\n") and len(lines[-1]) < record:
        raise Refused(
            f"{path}, line {len(lines)}: the last line must be whole, got {len(lines[-1])} "
            f"characters and no end of line: the file is truncated"
        )
    return lines


def require_columns(path: Path, there: Iterable[str], needed: Iterable[str]) -> None:
    """Raise ValueError where a file lacks a column."""
    there = list(there)
    for name in needed:
        if name not in there:
            raise Refused(f"{path} must have the column {name}, got {', '.join(there)}")


def numbers(path: Path, table: Any, name: str) -> Floats:
    """A column of a table as numbers, NaN where it is masked or the table has no such column.

    Raises  ValueError if the column does not hold numbers.
    """
    if name not in table.colnames:
        return np.full(len(table), np.nan)
    column = table[name]
    try:
        values = np.asarray(np.ma.filled(np.ma.asarray(column).astype(float), np.nan))
    except (ValueError, TypeError, OverflowError):
        raise Refused(
            f"{path}: {name} must be numbers, got {shown(column[0])} and others"
        ) from None
    if values.shape != (len(table),):
        raise Refused(f"{path}: {name} must be a number in each row, got {values.shape[1:]}")
    return values


def whole_numbers(path: Path, table: Any, name: str) -> Ints:
    """A column of a table as whole numbers, none of them masked.

    Raises  ValueError if they are not whole numbers: floats would have lost their last digits.
    """
    column = table[name]
    if column.dtype.kind not in "iu" or column.shape != (len(table),):
        first = np.asarray(column[0]).tolist()
        raise Refused(f"{path}: {name} must be whole numbers, got {shown(first)}")
    masked = np.ma.getmaskarray(np.ma.asarray(column))
    if masked.any():
        raise Refused(f"{path}: {name} must be in each row, got none in row {masked.argmax() + 1}")
    return np.asarray(column, np.int64)


def degrees(records: Records, name: str, cuts: tuple[int, int] | None = None) -> Floats:
    """A column of degrees (or hours), minutes and seconds as degrees (or hours).

    cuts     positions in the text where the minutes and the seconds begin, if there are no blanks
             between them; None: they are separated by blanks
    Returns  (n,) number, NaN where the field is blank
    Raises   ValueError if a field is not three numbers, or has 60 minutes or more.
    """
    values = np.full(len(records.line), np.nan)
    for i, text in enumerate(records.columns[name]):
        if text.strip():
            pieces = text.split()
            if cuts is not None:
                pieces = [text[: cuts[0]], text[cuts[0] : cuts[1]], text[cuts[1] :]]
            try:
                degree, minutes, seconds = (float(piece) for piece in pieces)
                if not (0 <= minutes < 60 and 0 <= seconds <= 60):
                    raise ValueError
            except ValueError:
                raise Refused(
                    f"{records.path}, line {records.line[i]}: {name} must be three numbers such "
                    f"as 16 42 58, got {text!r}"
                ) from None
            size = abs(degree) + minutes / 60 + seconds / 3600
            values[i] = -size if text.lstrip().startswith("-") else size
    return values


SEXAGESIMAL = re.compile(
    r"(?P<sign>[-+\u2212]?)(?P<whole>\d{1,3})(?P<first>[:hd\u00b0\s])\s*(?P<minutes>\d{1,2})"
    r"(?:[:m\u2032'\s]\s*(?P<seconds>\d{1,2}(?:\.\d*)?)(?:s|\u2033|\"|'')?|m|\u2032|'|)"
)
HOURS = "h"  # the unit of right ascensions in hours


def angle_texts(path: Path, name: str, texts: Iterable[str]) -> tuple[Floats, str] | None:
    """A column of angles such as 05:14:32.3, 5h14m32.3s, -8d12'06" or "05 14 32.3".

    Returns  the angles as decimal numbers, NaN for an empty field, and their unit by the letters in
             the texts: HOURS, "deg", or "" without letters. None if a field is not such an angle
    Raises   Refused if minutes or seconds are 60 or more, or if units differ from row to row.
    """
    values, units = [], set[str]()
    for row, text in enumerate(texts, 1):
        text = text.strip()
        if not text or text == "--":
            values.append(math.nan)
            continue
        match = SEXAGESIMAL.fullmatch(text)
        if not match:
            return None
        minutes, seconds = float(match["minutes"]), float(match["seconds"] or 0)
        if minutes >= 60 or seconds >= 60:
            raise Refused(
                f"{path}, row {row}: {name} must have minutes and seconds below 60, got {text!r}"
            )
        size = int(match["whole"]) + minutes / 60 + seconds / 3600
        values.append(-size if match["sign"] in ("-", "\u2212") else size)
        units.add({"h": HOURS, "d": "deg", "\u00b0": "deg"}.get(match["first"], ""))
    if not units:
        return None
    if len(units) > 1:
        raise Refused(f"{path}: {name} must have one unit in all rows, got hours and degrees")
    return np.array(values, float), units.pop()


def fits_table(path: Path) -> tuple[Any, dict[str, Any]]:
    """The first table of a FITS file; checksums in the file are checked.

    path     the file
    Returns  its header, and its columns by name in lower case, in the machine's byte order
    Raises   ValueError for a file that is truncated, damaged, or has no table.
    """
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyUserWarning, AstropyWarning

    try:
        with warnings.catch_warnings():
            # Violations of the standard in header cards are harmless. But astropy also only warns
            # of a truncated or damaged file.
            warnings.simplefilter("ignore", AstropyUserWarning)
            warnings.filterwarnings("error", ".*(truncated|verification failed)", AstropyWarning)
            data = unpacked(path, read_bytes(path, "a star catalogue"), 2)
            require_fits(path, data)
            with fits.open(io.BytesIO(data), checksum=True, memmap=False) as file:
                tables = [unit for unit in file if isinstance(unit, fits.BinTableHDU)]
                if not tables:
                    raise Refused("it has no table")
                header, data = tables[0].header, tables[0].data
                columns = {
                    name.lower(): data[name].astype(data[name].dtype.newbyteorder("="))
                    for name in data.names
                }
    except (MemoryError, FileNotFoundError):
        raise
    except Exception as error:  # of any class, from astropy and numpy
        raise Refused(f"{path} must be a whole FITS table, got: {first_line(error)}") from None
    return header, columns


AXES = "axes"  # key of a column's `meta`: axes of its places, as the file says them
NROWS = re.compile(rb"<TABLE\b[^>]*\bnrows=[\"'](\d+)")


def votable(path: Path) -> Any:
    """The first table of a VOTable file.

    path     the file
    Returns  an astropy table
    Raises   ValueError for a file that is truncated, has no table, or has fewer rows than declared.
    """
    from astropy.io.votable import parse
    from astropy.io.votable.exceptions import VOWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VOWarning)  # files of archives cause warnings, too
            data = read_bytes(path, "a star catalogue")
            require_memory(len(data) * TEXT_NEEDED, f"{path}, a VOTable of {len(data)} bytes,")
            file = parse(io.BytesIO(data))
            first = file.get_first_table()
            table = first.to_table()
            systems = {system.ID: system for system in file.iter_coosys()}
            for name, part in zip(table.colnames, first.fields, strict=True):
                if system := systems.get(part.ref):
                    table[name].meta[AXES] = f"{system.system} {system.equinox}"
    except (MemoryError, FileNotFoundError):
        raise
    except Exception as error:  # of any class, from expat, astropy and numpy
        raise Refused(f"{path} must be a whole VOTable, got: {first_line(error)}") from None
    said = NROWS.search(data)  # declared number of rows, which astropy does not check
    if said and int(said[1]) != len(table):
        raise Refused(f"{path} must have the {int(said[1])} rows it declares, got {len(table)}")
    return in_lower_case(path, table)


def any_table(path: Path) -> Any:
    """Read a table of a FITS, VOTable, ECSV or CSV file, recognised by its first bytes.

    Raises  ValueError for a file that is not such a table, or is truncated.
    """
    from astropy.table import Table
    from astropy.units import Unit

    with path.open("rb") as file:
        start = file.read(200)
    if start.startswith(b"SIMPLE"):
        header, columns = fits_table(path)
        table = Table(columns)
        axes = " ".join(str(header[key]) for key in ("RADESYS", "EQUINOX") if key in header)
        for column in table.columns.values():
            column.meta[AXES] = axes
        for number in range(1, int(header["TFIELDS"]) + 1):
            name, unit = header.get(f"TTYPE{number}", ""), header.get(f"TUNIT{number}")
            if unit and str(name).lower() in columns:
                table[str(name).lower()].unit = Unit(str(unit), parse_strict="silent")
        return table
    if start.lstrip().startswith(b"<"):
        return votable(path)
    return csv_table(path)
