"""Bytes of a text file from any program -> text; tables of separated columns -> their columns.

A file may come from a spreadsheet: with a byte-order mark, in UTF-16, with semicolons or tabs
between columns and commas in numbers.
"""

import codecs
import csv
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from startrack.core import Refused, require_memory, shown
from startrack.io.reading import read_bytes, unpacked

TEXT_NEEDED = 5  # bytes of memory for a byte of text; Tycho-2 takes 2.5 GB for 0.5 GB
MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
LOOKED_AT = 2000  # bytes, for zeros
DELIMITERS = ",;\t"
EXPONENT = r"(?:[eEdD][-+]?\d+)?"
COMMA = re.compile(rf"[-+]?\d*,\d+{EXPONENT}")  # a number as most of Europe writes it
POINT = re.compile(rf"[-+]?\d*\.\d+{EXPONENT}")
BOTH = re.compile(r"[-+]?\d{1,3}(?:\.\d{3})+,\d+|[-+]?\d{1,3}(?:,\d{3})+\.\d+")


def decoded(data: bytes, path: Path) -> str:
    """The text of a file, without its byte-order mark.

    UTF-8; UTF-16 with a mark, or without a mark if every second byte is zero, as in text of western
    letters. Other text is read with one byte per letter (ISO 8859-1).

    Raises  Refused for zeros that are not of UTF-16, or an incomplete last letter.
    """
    name, start = "", 0
    for mark, encoding in MARKS:
        if data.startswith(mark):
            name, start = encoding, len(mark)
    if not name and b"\0" in data[:LOOKED_AT]:
        name = _without_mark(data)
    try:
        text = data[start:].decode(name or "utf-8")
    except UnicodeDecodeError as error:
        if name:
            raise Refused(f"{path} must be text of {name}, got {error.reason}") from None
        text = data.decode("latin-1")
    if "\0" in text:
        raise Refused(f"{path} must be text, got a zero byte at {text.index(chr(0))}")
    return text


def _without_mark(data: bytes) -> str:
    """The order of UTF-16 by the side on which the zeros of its letters are; "" for neither."""
    start = data[: LOOKED_AT // 2 * 2]
    even, odd = start[0::2].count(0), start[1::2].count(0)
    if odd > 0.8 * len(start[1::2]) and even == 0:
        return "utf-16-le"
    if even > 0.8 * len(start[0::2]) and odd == 0:
        return "utf-16-be"
    return ""


def with_points(text: str) -> str:
    """A number with a decimal comma as one with a decimal point; other text as it is."""
    return text.replace(",", ".") if COMMA.fullmatch(text) else text


def content(path: Path, what: str = "a star catalogue") -> str:
    """The text of a file, plain or gzipped.

    what    it must be, for the message
    Raises  Refused for a file that is empty, or not text.
    """
    data = unpacked(path, read_bytes(path, what), TEXT_NEEDED)
    require_memory(len(data) * TEXT_NEEDED, f"{path}, {what} of {len(data)} bytes,")
    if not data.strip():
        raise Refused(f"{path} must hold {what}, got an empty file")
    return decoded(data, path)


def csv_table(path: Path, ended: bool = True, what: str = "a star catalogue") -> Any:
    """Read a CSV file, plain or gzipped, or an ECSV file: the reader of all such tables.

    Between columns are commas, semicolons or tabs, whichever the first line has. Numbers may have
    decimal commas where commas are not between columns, or within quotes.

    ended   whether the last line must have an end, without which the file may have been cut
    what    it must be, for the message
    Returns an astropy table, with names in lower case
    Raises  Refused for a file that is empty, cut, whose rows differ in length, that has two columns
            of one name, numbers with commas and others with points, or groups of digits
            ("1,234.5").
    """
    from astropy.io import ascii

    text = content(path, what)
    if ended and not text.endswith(("\n", "\r")):
        lines = text.splitlines()
        raise Refused(
            f"{path}, line {len(lines)}: the last line must end, got {lines[-1][-20:]!r} and no "
            "end of line: the file is cut"
        )
    if text.startswith("# %ECSV"):
        kind, options = "ecsv", dict[str, Any]()
    else:
        text, delimiter = _uniform(path, text.replace("\r\n", "\n").replace("\r", "\n"))
        # Astropy would number a second column of the same name.
        _refuse_repeated(path, next(csv.reader([_head(text)], delimiter=delimiter), []))
        # Not "csv", which would fill up rows that are too short.
        kind = "basic"
        options = {"delimiter": delimiter, "fill_values": [("", "0"), ("null", "0")]}
    try:
        table = ascii.read(text, format=kind, guess=False, **options)
    except MemoryError:
        raise
    except Exception as error:  # of the parts of its parsers, which each raise their own
        raise Refused(
            f"{path} must be a table of comma-separated rows, got: {first_line(error)}"
        ) from None
    return in_lower_case(path, table)


def _head(text: str) -> str:
    """The line with the names of the columns."""
    return next((line for line in text.split("\n") if line.strip() and line[0] != "#"), "")


def _uniform(path: Path, text: str) -> tuple[str, str]:
    """The text with decimal points, and the separator of its columns."""
    lines = text.split("\n")
    if lines[0].strip().lower().startswith("sep=") and len(lines[0].strip()) == 5:
        text = "\n".join(lines[1:])  # of a spreadsheet: "sep=;"
    head = _head(text)
    bare = re.sub(r'"[^"]*"', "", head)
    delimiter = max(DELIMITERS, key=bare.count)
    if delimiter == "," and '"' not in text:
        return text, delimiter
    if "," not in text.replace(head, "", 1):
        return text, delimiter
    rows = list(csv.reader(text.split("\n"), delimiter=delimiter, skipinitialspace=True))
    fields = [field.strip() for row in rows for field in row]
    commas = [field for field in fields if COMMA.fullmatch(field)]
    if not commas:
        _refuse_groups(path, fields)
        return text, delimiter
    points = [field for field in fields if POINT.fullmatch(field)]
    if points:
        raise Refused(
            f"{path} must have decimal points or decimal commas, not both, got {points[0]} and "
            f"{commas[0]}"
        )
    _refuse_groups(path, fields)
    made = "\n".join(
        delimiter.join(_quoted(with_points(field.strip()), delimiter) for field in row)
        for row in rows
    )
    return made + "\n", delimiter


def _quoted(field: str, delimiter: str) -> str:
    if delimiter in field or '"' in field:
        return '"' + field.replace('"', '""') + '"'
    return field


def _refuse_groups(path: Path, fields: list[str]) -> None:
    grouped = next((field for field in fields if BOTH.fullmatch(field)), None)
    if grouped:
        raise Refused(f"{path} must have numbers without groups of digits, got {grouped}")


def in_lower_case(path: Path, table: Any) -> Any:
    """The table with the names of its columns in lower case.

    Raises  Refused if two columns have the same name.
    """
    table.rename_columns(table.colnames, _refuse_repeated(path, table.colnames))
    return table


def _refuse_repeated(path: Path, columns: Iterable[str]) -> list[str]:
    """Names of columns in lower case, each once."""
    names = [name.strip().lower() for name in columns]
    for name in filter(None, names):
        if names.count(name) > 1:
            raise Refused(f"{path} must have one column {shown(name)}, got {names.count(name)}")
    return names


def first_line(error: Exception) -> str:
    """The first line of a library's message, or the name of its exception."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
