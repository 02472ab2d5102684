"""A catalogue's text file enters; columns of text and numbers leave, or one sentence that refuses.

The older catalogues are plain text, one star a line, with fields at fixed bytes or between bars.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from startrack.values import Floats, Ints


@dataclass(frozen=True, eq=False)
class Records:
    """Columns of text, and where they come from.

    path     the file
    columns  the text of each field, one entry a star
    line     the number in the file of each star's line, from 1
    """

    path: Path
    columns: Mapping[str, list[str]]
    line: list[int]

    def numbers(self, name: str) -> Floats:
        """A column as numbers, NaN where the field is blank.

        Errors  ValueError where a field is no finite number.
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
            raise ValueError(f"{where}: {name} must be a number, got {texts[bad[0]]!r}")
        return values

    def integers(self, name: str) -> Ints:
        """A column of whole numbers, none of them blank.

        Errors  ValueError where a field is no whole number.
        """
        values = self.numbers(name)
        wrong = np.flatnonzero(values != np.round(values))
        if len(wrong):
            text = self.columns[name][wrong[0]]
            where = f"{self.path}, line {self.line[wrong[0]]}"
            raise ValueError(f"{where}: {name} must be a whole number, got {text!r}")
        return values.astype(np.int64)


def _number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def fixed_width(
    path: Path, fields: Mapping[str, tuple[int, int]], needed: int, record: int
) -> Records:
    """Read a file whose fields stand at fixed bytes.

    path     the file, plain or gzipped
    fields   first and last byte of each field, from 1, as the CDS writes them
    needed   bytes that every line must have; what follows may be blank and stripped
    record   bytes of a whole line
    Returns  the columns
    Errors   ValueError for an empty or a cut file and for a line that is too short.
    """
    lines = text_lines(path, record)
    for number, line in enumerate(lines, 1):
        if len(line) < needed:
            raise ValueError(
                f"{path}, line {number}: must have at least {needed} characters, got {len(line)}"
            )
    columns = {
        name: [line[first - 1 : last] for line in lines] for name, (first, last) in fields.items()
    }
    return Records(path, columns, list(range(1, len(lines) + 1)))


def separated(path: Path, fields: Mapping[str, int], count: int, record: int) -> Records:
    """Read a file whose fields stand between bars.

    path     the file, plain or gzipped
    fields   place of each field in the line, from 0
    count    fields in a line
    record   bytes of a whole line
    Returns  the columns
    Errors   ValueError for an empty or a cut file and for a line with another number of fields.
    """
    columns: dict[str, list[str]] = {name: [] for name in fields}
    lines = text_lines(path, record)
    for number, line in enumerate(lines, 1):
        row = line.split("|")
        if len(row) != count:
            raise ValueError(
                f"{path}, line {number}: must have {count} fields between bars, got {len(row)}"
            )
        for name, place in fields.items():
            columns[name].append(row[place])
    return Records(path, columns, list(range(1, len(lines) + 1)))


def text_lines(path: Path, record: int) -> list[str]:
    """The lines of a text file, plain or gzipped.

    path     the file
    record   bytes of a whole line; a last line that is shorter and has no end was cut
    Returns  the lines without their ends
    Errors   ValueError for a file that is empty, cut, or not text.
    """
    text = content(path)
    lines = text.splitlines()
    if not text.endswith("\n") and len(lines[-1]) < record:
        raise ValueError(
            f"{path}, line {len(lines)}: the last line must be whole, got {len(lines[-1])} "
            f"characters and no end of line: the file is cut"
        )
    return lines


def content(path: Path) -> str:
    """The text of a file, plain or gzipped.

    Errors  ValueError for a file that is empty, cut, or not text.
    """
    data = path.read_bytes()
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.decompress(data)
        except (EOFError, OSError) as error:
            raise ValueError(f"{path} must be a whole gzip file, got: {error}") from None
    if not data.strip():
        raise ValueError(f"{path} must hold stars, got an empty file")
    if b"\0" in data:
        raise ValueError(f"{path} must be text, got a zero byte at {data.index(0)}")
    return data.decode("latin-1")
