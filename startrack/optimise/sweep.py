"""Values of one or two keys of a design file -> errors, margins and costs of the design at each."""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from startrack.core import (
    DAY,
    Advance,
    Floats,
    Refused,
    Rows,
    optional_package,
    parse,
    printed,
    utc,
    utc_text,
)
from startrack.design import COSTS, Accuracy, Campaign, Design, Fidelity, found_at, load_design
from startrack.metrics import ARCSEC, PERCENT, Column, Interval, Table, four_digits
from startrack.optimise.figures import DesignFigures, Figure, all_by_formula, by_trials, middle
from startrack.optimise.runner import TrialRunner

POINTS = {1: 9, 2: 5}  # points of a range, by the number of keys; chosen by hand
MOST_KEYS, MOST_DESIGNS = 2, 10_000
DIGITS = 6  # significant digits of values between the ends of a range; by hand: readable
QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*((?:[^\W\d]|[°%]).*)?")
DATE = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?)?Z?")


class SweptKey(NamedTuple):
    """A key of a design file and its values.

    name     name of the key, such as "instrument.optics.f_number"
    texts    values in the form of a design file
    unit     common unit of the values; "" for numbers without unit and for words
    numbers  the values in this unit; for dates, hours after the first; None for words
    """

    name: str
    texts: tuple[str, ...]
    unit: str = ""
    numbers: tuple[float, ...] | None = None

    @property
    def label(self) -> str:
        """Last part of the name, and the unit, for tables and pictures."""
        short = self.name.rpartition(".")[2]
        return f"{short} ({self.unit})" if self.unit else short

    @classmethod
    def read(
        cls, text: str, points: int, log: bool = False, design: Design | None = None
    ) -> SweptKey:
        """From KEY=A..B, or from KEY=A,B,C.

        points  number of values of a range, its ends included
        log     whether the values are in equal ratios
        design  design with the key; if its value is a whole number, a range has only whole numbers
        Raises  Refused if the text has another form.
        """
        name, equals, values = (part.strip() for part in text.partition("="))
        if not (name and equals and values):
            raise Refused(f"a key must be KEY=A..B or KEY=A,B,C, got {text!r}")
        ends = values.split("..")
        if len(ends) == 1:
            return cls.of(name, [part.strip() for part in values.split(",")])
        if all(DATE.fullmatch(end.strip()) for end in ends):
            return cls._of_dates(name, ends, points)
        low, high, unit = _range(name, ends)
        if log and low <= 0:
            raise Refused(f"{name} must begin above 0 if values are in equal ratios, got {low}")
        steps = np.geomspace(low, high, points) if log else np.linspace(low, high, points)
        numbers = [low, *(float(f"{step:.{DIGITS}g}") for step in steps[1:-1]), high]
        if design is not None and is_whole(design, name):
            numbers = [float(round(number)) for number in numbers]
        return cls.of(name, dict.fromkeys(_written(number, unit) for number in numbers))

    @classmethod
    def of(cls, name: str, texts: Iterable[str]) -> SweptKey:
        """A key with some values; they are numbers if all are quantities of one kind."""
        every = tuple(texts)
        if "" in every or len(set(every)) < len(every):
            raise Refused(f"{name} must have values, each once, got {', '.join(every)}")
        if all(DATE.fullmatch(text) for text in every):
            return cls(name, every, f"h after {every[0]}", tuple(_hours(every)))
        found = [QUANTITY.fullmatch(text) for text in every]
        if not all(found):
            return cls(name, every)
        unit = found[-1][2] or ""  # type: ignore[index]
        try:
            numbers = tuple(_in_unit(match, unit) for match in found if match)
        except ValueError:
            return cls(name, every)
        return cls(name, every, unit, numbers)

    @classmethod
    def _of_dates(cls, name: str, ends: Sequence[str], points: int) -> SweptKey:
        """A key with dates in equal steps, to the second."""
        first, last = ends[0].strip(), ends[-1].strip()
        length = _hours((first, last))[1]
        if len(ends) != 2 or length <= 0:
            raise Refused(f"{name} must have a range from early to late, got {'..'.join(ends)}")
        middle = (
            utc_text(first, length * DAY / 24 * n / (points - 1)) for n in range(1, points - 1)
        )
        return cls.of(name, dict.fromkeys((first, *middle, last)))

    def at(self, number: float) -> str:
        """A number in the form of a design file; hours as a date, to the second."""
        if DATE.fullmatch(self.texts[0]):
            return utc_text(self.texts[0], number * DAY / 24)
        return _written(float(f"{number:.{DIGITS}g}"), self.unit)


def _hours(dates: Sequence[str]) -> list[float]:
    """Hours of dates after the first of them; UTC."""
    begin = utc(dates[0])
    return [float((utc(date) - begin).to_value("h")) for date in dates]


def is_whole(design: Design, name: str) -> bool:
    """Whether the value of a key is a whole number; false for an invalid key."""
    try:
        return type(found_at(design.case, name)) is int
    except Refused:
        return False


def _range(name: str, ends: Sequence[str]) -> tuple[float, float, str]:
    """Low end, high end and unit of a range; the unit may be given at the high end alone."""
    first, last = (QUANTITY.fullmatch(ends[at].strip()) for at in (0, -1))
    if len(ends) != 2 or not (first and last):
        raise Refused(
            f"{name} must be a range such as 1.2..2.4 or 20..80 ms, or of dates, got "
            f"{'..'.join(ends)}"
        )
    unit = last[2] or ""
    low, high = _in_unit(first, unit) if first[2] else float(first[1]), float(last[1])
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise Refused(f"{name} must have a range from low to high, got {'..'.join(ends)}")
    return low, high, unit


def _in_unit(match: re.Match[str], unit: str) -> float:
    return float(match[1]) if (match[2] or "") == unit else parse(match[0], unit)


def _written(number: float, unit: str) -> str:
    exact = number.is_integer() and abs(number) < 1e15
    text = str(int(number)) if exact else repr(number)
    return f"{text} {unit}".strip()


class SweptDesign(NamedTuple):
    """The design with one value of each key.

    values   values in the form of a design file
    figures  figures of the design; None if it refuses a value
    refused  why it refuses a value, or empty
    """

    values: tuple[str, ...]
    figures: DesignFigures | None
    refused: str = ""

    def figure(self, name: str) -> Figure:
        """Across, about, availability or stars; NaN where the design refuses a value."""
        return getattr(self.figures, name) if self.figures else math.nan

    def margin(self, name: str) -> Figure:
        """A margin; NaN where there is none."""
        return self.figures.margins.get(name, math.nan) if self.figures else math.nan

    @property
    def least_margin(self) -> tuple[str, float]:
        """The name of the least margin, and its value; NaN where there is none."""
        margins = self.figures.margins if self.figures else {}
        name = min(margins, key=lambda name: middle(margins[name]), default="")
        return name, middle(margins[name]) if name else math.nan

    @property
    def met(self) -> bool:
        """Whether every requirement is met."""
        return bool(self.figures) and not self.least_margin[1] < 0


@printed
@dataclass(frozen=True, eq=False)
class Sweep:
    """A design over the values of one or two keys.

    keys      one or two; the last one changes fastest over the rows
    rows      one for each pair of values
    limits    on errors, in the design's own condition
    how       source of the errors, in words
    asked     whether the design has requirements
    """

    keys: tuple[SweptKey, ...]
    rows: tuple[SweptDesign, ...]
    limits: tuple[Accuracy, ...]
    how: str
    asked: bool

    @property
    def _rows(self) -> list[tuple[str, str]]:
        shown = [
            (", ".join(row.values), row.refused or f"{_shown(row.figure('across'))} arcsec across")
            for row in self.rows
        ]
        return [("answer", self.answer), *shown]

    @property
    def margins(self) -> list[str]:
        """Names of the margins of all designs."""
        every = (row.figures.margins for row in self.rows if row.figures and self.asked)
        return list(dict.fromkeys(name for margins in every for name in margins))

    @property
    def answer(self) -> str:
        """A sentence: value with the least error, values that meet all, deciding requirement."""
        tried = [row for row in self.rows if row.figures and not row.figures.note]
        if not tried:
            note = next(row.figures.note for row in self.rows if row.figures)
            return f"no value has an attitude: {note}"
        met = [row for row in tried if row.met or not self.asked]
        best = min(met or tried, key=lambda row: middle(row.figure("across")))
        pairs = zip(self.keys, best.values, strict=True)
        place = " and ".join(f"{key.name.rpartition('.')[2]} {value}" for key, value in pairs)
        error = f"the error across is least at {place}, {_shown(best.figure('across'))} arcsec"
        if len(tried) > 1 and len({row.figure("across") for row in tried}) == 1:
            error = f"the error across is the same at all values, {error.rpartition(', ')[2]}"
        refused = sum(bool(row.refused) for row in self.rows)
        left = f"; {refused} values are refused" if refused else ""
        if not self.asked:
            return error + left
        missed = dict.fromkeys(row.least_margin[0] for row in tried if not row.met)
        count = f"{len(met)} of {len(self.rows)} values meet the requirements"
        who = "the others" if met else "they"
        others = f" ({who} miss {', '.join(missed)})" if missed else ""
        return f"{count}{others}; {'of these ' if met and missed else ''}{error}{left}"

    @cached_property
    def columns(self) -> Table:
        """A row for each design: values, errors, availability, stars, margins, costs, refusal."""
        short = [
            Column("across_rms_arcsec", "across", lambda row: row.figure("across"), ARCSEC, ".4g"),
            Column("about_rms_arcsec", "about", lambda row: row.figure("about"), ARCSEC, ".4g"),
            Column(
                "availability",
                "availability",
                lambda row: row.figure("availability"),
                PERCENT,
                ".2f",
            ),
            Column("stars", "stars", lambda row: row.figure("stars"), form=".1f"),
        ]
        margins = [
            Column(f"margin: {name}", "", partial(SweptDesign.margin, name=name))
            for name in self.margins
        ]
        costs = [
            Column(f"{name} ({unit})", "", partial(_cost, name=name))
            for name, unit in COSTS.items()
        ]
        worst = Column("", "least margin", _least if self.asked else lambda _: "")
        why = Column("refused", "", lambda row: row.refused or (row.figures and row.figures.note))
        return Table([*key_columns(self.keys), *short, worst, *margins, *costs, why], self.rows)

    @property
    def table(self) -> Rows:
        """A row for each design, SI: values as texts, errors and their bounds, margins."""
        kinds: list[Any] = [(key.name, f"U{max(map(len, key.texts))}") for key in self.keys]
        columns: list[Sequence[Any]] = [
            [row.values[at] for row in self.rows] for at in range(len(self.keys))
        ]
        for name, figures in self._all_figures().items():
            kinds += [(f"{name}{end}", float) for end in ("", "_low", "_high")]
            columns += [*_ends(figures).T]
        table = np.empty(len(self.rows), kinds)
        for (name, _), column in zip(kinds, columns, strict=True):
            table[name] = column
        return table

    def _all_figures(self) -> dict[str, list[Figure]]:
        names = ("across", "about", "availability", "stars")
        figures = {name: [row.figure(name) for row in self.rows] for name in names}
        margins = {
            f"margin: {name}": [row.margin(name) for row in self.rows] for name in self.margins
        }
        return figures | margins

    def to_xarray(self) -> Any:
        """An xarray Dataset with a dimension for each key; errors in radian.

        Raises  ImportError without xarray.
        """
        xarray = optional_package("xarray", "to_xarray needs xarray: python -m pip install xarray")
        axes, shape = [key.name for key in self.keys], [len(key.texts) for key in self.keys]
        coordinates = {
            key.name: (key.name, list(key.numbers or key.texts), {"units": key.unit})
            for key in self.keys
        }
        variables = {
            f"{name}{end}": (
                axes,
                values.reshape(shape),
                {"units": "rad"} if name in ("across", "about") else {},
            )
            for name, figures in self._all_figures().items()
            for end, values in zip(("", "_low", "_high"), _ends(figures).T, strict=True)
        }
        return xarray.Dataset(variables, coordinates, {"how": self.how})

    def csv(self) -> tuple[list[str], list[list[Any]]]:
        """Head and rows of CSV, as `csv_of`."""
        return csv_of(self.columns)


def key_columns(keys: Sequence[SweptKey]) -> list[Column]:
    """A column for each key, of rows with `values`."""
    return [
        Column(key.name, key.name.rpartition(".")[2], partial(_value, at=at))
        for at, key in enumerate(keys)
    ]


def _value(row: Any, at: int) -> str:
    return str(row.values[at])


def csv_of(table: Table) -> tuple[list[str], list[list[Any]]]:
    """Head and rows of CSV; a cell without a number is empty."""
    records = table.json()
    names = dict.fromkeys(name for record in records for name in record)
    head = [
        f"{name}_{end}" if name.endswith("_95") else name
        for name in names
        for end in (("low", "high") if name.endswith("_95") else ("",))
    ]
    rows = []
    for record in records:
        cells = [_cells(record.get(name), name) for name in names]
        rows.append([cell for some in cells for cell in some])
    return head, rows


def _cells(value: Any, name: str) -> list[Any]:
    values = value or [None, None] if name.endswith("_95") else [value]
    return ["" if part is None or part != part else part for part in values]


def _cost(row: SweptDesign, name: str) -> float:
    return row.figures.costs[name] if row.figures else math.nan


def _least(row: SweptDesign) -> str:
    name, value = row.least_margin
    if not name:
        return row.refused and "REFUSED"
    return f"{value:+.3f} {name}" + " NOT MET" * (value < 0)


def _shown(figure: Figure) -> str:
    unit = ARCSEC.size
    if isinstance(figure, Interval):
        ends = ", ".join(four_digits(end / unit) for end in (figure.low, figure.high))
        return f"{four_digits(figure.value / unit)} [{ends}]"
    return four_digits(figure / unit)


def _ends(figures: Sequence[Figure]) -> Floats:
    """Value, low and high (n, 3); NaN where there is no interval."""
    return np.array(
        [
            (figure.value, figure.low, figure.high)
            if isinstance(figure, Interval)
            else (figure, math.nan, math.nan)
            for figure in figures
        ]
    )


def _swept_keys(
    keys: Sequence[str], points: int | None, log: bool, start: Design | None
) -> tuple[SweptKey, ...]:
    """The keys with their values; refused if they are the same or make too many designs."""
    count = points or POINTS[len(keys)]
    swept = tuple(SweptKey.read(key, count, log, start) for key in keys)
    if len({key.name for key in swept}) < len(swept):
        raise Refused(f"keys must differ, got {swept[0].name} twice")
    number = math.prod(len(key.texts) for key in swept)
    if number > MOST_DESIGNS:
        raise Refused(f"keys must make at most {MOST_DESIGNS} designs, got {number}")
    return swept


def sweep(
    path: Path | str,
    *keys: str,
    changes: Sequence[str] = (),
    points: int | None = None,
    log: bool = False,
    trials: int = 0,
    fidelity: Fidelity | None = None,
    runner: TrialRunner | None = None,
    progress: Advance | None = None,
) -> Sweep:
    """Errors, margins and costs of a design at each value of one or two keys.

        startrack.sweep("mine.toml", "instrument.optics.f_number=1.2..2.4", trials=1000)

    Each value overrides the value of the file, as for `load_design`. All designs have trials of the
    same skies and noise. A value that the design refuses is a row with the reason.

    path      of a design file
    keys      "KEY=A..B" for a range, "KEY=A,B,C" for a list of numbers, names, files or products
    changes   over the values of the file, "KEY=VALUE" each, for all designs
    points    of a range, its ends included; None: 9 of one key, 5 of each of two
    log       whether the points of a range are in equal ratios
    trials    of each design and condition; 0: the analytic budget alone
    fidelity  of the trials; None: that of the campaign, window without one
    runner    whose workers compute designs and trials and whose ledger keeps them
    progress  called with the number of designs that were just done
    Raises    Refused for an invalid key, or if the design refuses every value.
    Accuracy  by formula: that of the budget. By trials: intervals of 95 %, each for a single value.
    """
    if not 1 <= len(keys) <= MOST_KEYS:
        raise Refused(f"keys must be one or two, got {len(keys)}")
    path, runner = Path(path), runner or TrialRunner(1)
    start = design_or_refusal(path, changes)
    swept = _swept_keys(keys, points, log, start if isinstance(start, Design) else None)
    combinations = list(itertools.product(*(key.texts for key in swept)))
    designs = [
        design_or_refusal(
            path,
            [*changes, *(f"{key.name}={value}" for key, value in zip(swept, values, strict=True))],
        )
        for values in combinations
    ]
    loaded = [design for design in designs if isinstance(design, Design)]
    if not loaded:
        raise next(design for design in designs if isinstance(design, Refused))
    for note in dict.fromkeys(design.case.saturation_note for design in loaded):
        if note:
            warnings.warn(note, stacklevel=2)
    campaign = loaded[0].campaign
    fidelity = fidelity or (campaign or Campaign()).fidelity
    figures = _figures(designs, runner, trials, fidelity, progress)
    rows = tuple(
        SweptDesign(values, None, str(found))
        if isinstance(found, Refused)
        else SweptDesign(values, found)
        for values, found in zip(combinations, figures, strict=True)
    )
    if all(row.refused for row in rows):
        raise Refused(rows[0].refused)
    how = f"{trials} trials of fidelity {fidelity}, seed {runner.seed}" if trials else "formula"
    over = campaign.over_units(loaded[0].case) if campaign else None
    if over:
        how += f"; the errors are those {over.words}"
    limits = campaign.requirements.accuracy if campaign else ()
    return Sweep(swept, rows, limits, how, campaign is not None)


def swept_designs(keys: Sequence[str], points: int | None = None) -> int:
    """The number of designs of a sweep; where a key takes whole numbers, the largest possible one.

    Raises  Refused for an invalid key.
    """
    count = points or POINTS.get(len(keys), 1)
    return math.prod(len(SweptKey.read(key, count).texts) for key in keys)


def design_or_refusal(path: Path, changes: Sequence[str]) -> Design | Refused:
    """The design of a file with some changes, or why it is refused."""
    try:
        return load_design(path, changes)
    except Refused as reason:
        return Refused(str(reason).removeprefix("--set: "))  # a key of the sweep is no option


def _figures(
    designs: Sequence[Design | Refused],
    runner: TrialRunner,
    trials: int,
    fidelity: Fidelity,
    progress: Advance | None,
) -> Iterator[DesignFigures | Refused]:
    """Figures of each design, in order."""
    asked = [(d.case, d.campaign or Campaign()) for d in designs if isinstance(d, Design)]
    known = iter([] if trials else all_by_formula(asked, runner, progress))
    for design in designs:
        if isinstance(design, Refused):
            yield design
            continue
        if not trials:
            yield next(known)
            continue
        try:
            campaign = design.campaign or Campaign()
            yield by_trials(design.case, campaign, runner, trials, fidelity)
        except Refused as reason:
            yield reason
        if progress:
            progress(1)
