"""Results as rows and tables of records, written as JSON, text, Markdown or cells.

A value is declared once, with its field of JSON, its label and its unit; all forms use this.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from startrack.core import arcsec, deg
from startrack.io import aligned
from startrack.metrics.judge import FALSE_ANGLE, STATED, STATED_ALONE, ErrorLimits
from startrack.metrics.summary import Interval, Summary


class DisplayUnit(NamedTuple):
    """Unit and form in which a value is written.

    name  in text
    size  of the unit in text, SI
    json  of the unit in JSON, SI
    """

    name: str
    size: float
    json: float


PURE = DisplayUnit("", 1.0, 1.0)
PERCENT = DisplayUnit("%", 0.01, 1.0)  # a fraction in JSON
ARCSEC = DisplayUnit("arcsec", arcsec, arcsec)
SECOND = DisplayUnit("s", 1.0, 1.0)


@dataclass(frozen=True)
class Row:
    """A figure of a result.

    key    field of JSON, with its unit; the bounds of an interval follow in `key`_95
    value  in SI; an interval, a number or any other value of JSON
    label  its name in text; none: only JSON has it
    unit   of the value
    form   of its number in text, as for `format`
    note   text after the value
    """

    key: str
    value: Any
    label: str = ""
    unit: DisplayUnit = PURE
    form: str = ".3f"
    note: str = ""


@dataclass(frozen=True)
class Column:
    """A column of a table of records.

    key    field of JSON, with its unit; none: it is in text alone
    title  head of the column in text, where its unit is added; none: it is in JSON alone
    of     value of a record, as the value of a `Row`
    """

    key: str
    title: str
    of: Callable[[Any], Any]
    unit: DisplayUnit = PURE
    form: str = ".3f"

    @property
    def head(self) -> str:
        """Title and unit."""
        return f"{self.title} ({self.unit.name})" if self.unit.name else self.title


@dataclass(frozen=True)
class Table:
    """Records that have the same columns."""

    columns: Sequence[Column]
    records: Sequence[Any]

    def json(self) -> list[dict[str, Any]]:
        """An object for each record."""
        return [
            {
                k: v
                for column in self.columns
                if column.key
                for k, v in _fields(column, column.of(record))
            }
            for record in self.records
        ]

    @property
    def head(self) -> list[str]:
        """Titles of the columns that are written."""
        return [column.head for column in self.columns if column.title]

    @property
    def cells(self) -> list[list[str]]:
        """Texts of each record."""
        return [
            [written(column.of(record), column) for column in self.columns if column.title]
            for record in self.records
        ]

    def text(self, words: tuple[int, ...] = (0,)) -> list[str]:
        """Lines, the first one the head; words: columns that begin at the left."""
        return aligned([self.head, *self.cells], words)

    def markdown(self) -> list[str]:
        """Lines of Markdown."""
        return markdown(self.head, self.cells)


def to_json(rows: Iterable[Row]) -> dict[str, Any]:
    """The rows as fields of JSON."""
    return {key: value for row in rows if row.key for key, value in _fields(row, row.value)}


def to_lines(rows: Iterable[Row]) -> list[str]:
    """The rows as lines of text: label, value with its unit, bounds, note."""
    shown = [row for row in rows if row.label]
    values = [_number(_middle(row.value), row) for row in shown]
    width = max((len(row.label) for row in shown), default=0)
    wide = max(map(len, values), default=0)
    return [
        " ".join(
            part
            for part in (
                f"{row.label:{width}}  {value:>{wide}}",
                row.unit.name,
                _bounds(row.value, row),
                row.note,
            )
            if part
        )
        for row, value in zip(shown, values, strict=True)
    ]


def to_cells(rows: Iterable[Row]) -> list[list[str]]:
    """The rows as cells: label and note, value, bounds, unit."""
    return [
        [
            f"{row.label}, {row.note.strip('()')}" if row.note else row.label,
            *(four_digits(end / row.unit.size) for end in vars(row.value).values()),
            row.unit.name,
        ]
        for row in rows
        if isinstance(row.value, Interval) and row.label
    ]


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table of Markdown."""
    lines = ["|" + "".join(f" {cell} |" if cell else " |" for cell in row) for row in (head, *rows)]
    return [lines[0], "|---" * len(head) + "|", *lines[1:]]


def written(value: Any, how: Row | Column) -> str:
    """A value with its bounds, without its unit; a text as it is."""
    return " ".join(filter(None, (_number(_middle(value), how), _bounds(value, how))))


def four_digits(value: float) -> str:
    """Four digits, or all digits before the point; words for values that are not finite."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else "open"
    return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"


def bracketed(interval: Interval, form: str, unit: float = 1.0) -> str:
    """An interval as value [low, high], each in this form of `format`, as `end_text`; unit: SI."""
    value, low, high = (end_text(end / unit, form) for end in vars(interval).values())
    return f"{value} [{low}, {high}]"


def end_text(value: float, form: str) -> str:
    """A number in this form of `format`; words where it is not finite: unknown, open."""
    return format(value, form) if math.isfinite(value) else four_digits(value)


def bounds_json(interval: Interval, unit: DisplayUnit = PURE) -> dict[str, float]:
    """An interval as fields of JSON: value, low, high."""
    return {name: value / unit.json for name, value in vars(interval).items()}


def _fields(how: Row | Column, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, Interval):
        low, high = value.low / how.unit.json, value.high / how.unit.json
        return [(how.key, value.value / how.unit.json), (f"{how.key}_95", [low, high])]
    if isinstance(value, np.generic):
        value = value.item()
    return [(how.key, value if how.unit.json == 1.0 else value / how.unit.json)]


def _middle(value: Any) -> Any:
    return value.value if isinstance(value, Interval) else value


def _number(value: Any, how: Row | Column) -> str:
    if isinstance(value, str):
        return value
    scaled = value if how.unit.size == 1.0 else value / how.unit.size
    return end_text(scaled, how.form)


def _bounds(value: Any, how: Row | Column) -> str:
    if not isinstance(value, Interval):
        return ""
    return f"[{_number(value.low, how)}, {_number(value.high, how)}]"


def limits_text(limits: ErrorLimits) -> str:
    """The error of a correct attitude, in words."""
    stated = f"{STATED:g} standard deviations that the tracker states"
    parts = [
        f"{limit / arcsec:.3g} arcsec {name}" if limit else f"{stated}, {name}"
        for name, limit in (("across", limits.across), ("about", limits.about))
    ]
    return stated if limits == STATED_ALONE else " or ".join(parts)


def summary_rows(summary: Summary, limits: ErrorLimits = STATED_ALONE) -> list[Row]:
    """Rows of a summary of trials.

    limits  by which attitudes were judged to be right
    """
    false = f"(off by more than {FALSE_ANGLE / deg:g} deg)"
    off = f"(off by more than {limits_text(limits)})"
    ends = summary.across.high, summary.about.high
    more = "units" if summary.units else "trials"
    few = f"; open: more {more} give an upper bound" if any(map(math.isinf, ends)) else ""
    over = f" over {summary.units} units" if summary.units else ""
    trusted = "(3 if the tracker's covariance is right)"
    return [
        Row(
            "across_rms_arcsec",
            summary.across,
            "error across the boresight",
            ARCSEC,
            note="rms per axis",
        ),
        Row("about_rms_arcsec", summary.about, "error about the boresight", ARCSEC, note="rms"),
        Row(
            "availability",
            summary.availability,
            "availability",
            PERCENT,
            ".2f",
            "(trials with a correct attitude)",
        ),
        Row("false_attitudes", summary.false, "false attitudes", PERCENT, ".2f", false),
        Row(
            "inaccurate_attitudes", summary.inaccurate, "inaccurate attitudes", PERCENT, ".2f", off
        ),
        Row("nees", summary.nees, "error^2 / variance", PURE, ".2f", trusted),
        Row("beyond_ten_sigma", summary.beyond),
        Row("covariance_doubt", summary.doubt),
        Row("stars", summary.stars, "matched stars", PURE, ".1f"),
        Row(
            "trials",
            summary.trials,
            "trials",
            PURE,
            "d",
            f"(intervals: 95 % confidence{over}{few})",
        ),
    ]
