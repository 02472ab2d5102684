"""A problem, one or two of its keys -> objective, margins and costs at each value, and limits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from startrack.core import Advance, Refused, printed
from startrack.metrics import Column, DisplayUnit, Interval, Table, four_digits
from startrack.optimise.figures import Figure, middle
from startrack.optimise.problem_source import ProblemSource
from startrack.optimise.solve_for import KeyLine, Solution, Watch
from startrack.optimise.sweep import MOST_DESIGNS, POINTS, SweptKey, key_columns
from startrack.problem import Margin, Problem, Words

LARGEST = 1 - 1e-12  # largest margin, for a value that may be zero
Load = Callable[[Sequence[str]], Problem]  # the problem of a file with changes KEY=VALUE


class SweptProblem(NamedTuple):
    """The problem with one value of each key.

    values   values in the form of a design file
    value    the objective, in the unit of its words; NaN where there is none
    parts    parts of the value
    margins  as fractions of the limits
    note     why there is no value, or empty
    left_out  effects that the forecast does not count, a phrase each
    """

    values: tuple[str, ...]
    value: Figure
    parts: Mapping[str, Figure]
    margins: Mapping[str, Figure]
    note: str = ""
    left_out: tuple[str, ...] = ()

    @property
    def least(self) -> tuple[str, float]:
        """The name of the least margin, and its value; NaN where there is none."""
        name = min(self.margins, key=lambda one: middle(self.margins[one]), default="")
        return name, middle(self.margins[name]) if name else math.nan

    @property
    def least_text(self) -> str:
        """The least margin, with its name."""
        name, value = self.least
        return f"{value:+.3f} {name}" + " NOT MET" * (value < 0) if name else ""


@printed
@dataclass(frozen=True, eq=False)
class ProblemSweep:
    """A problem over the values of one or two keys.

    rows   one for each pair of values, the last key changing fastest
    words  names and units of the objective
    how    source of the values, in words
    """

    keys: tuple[SweptKey, ...]
    rows: tuple[SweptProblem, ...]
    words: Words
    how: str

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that the forecast of any value does not count, a phrase each."""
        return tuple(dict.fromkeys(phrase for row in self.rows for phrase in row.left_out))

    @property
    def answer(self) -> str:
        """Value with the least objective, and number of values that meet all limits."""
        tried = [row for row in self.rows if math.isfinite(middle(row.value))]
        if not tried:
            return f"no value has a result: {self.rows[0].note}"
        met = [row for row in tried if not row.least[1] < 0]
        best = min(met or tried, key=lambda row: middle(row.value))
        pairs = zip(self.keys, best.values, strict=True)
        place = " and ".join(f"{key.name.rpartition('.')[2]} {value}" for key, value in pairs)
        missed = dict.fromkeys(row.least[0] for row in tried if row.least[1] < 0)
        others = f" (the others miss {', '.join(missed)})" if missed else ""
        shown = f"{_shown(best.value)} {self.words.unit}".strip()
        of_these = "of these " if met and missed else ""
        return (
            f"{len(met)} of {len(self.rows)} values meet the requirements{others}; "
            f"{of_these}{self.words.value} is least at {place}, {shown}"
        )

    @property
    def columns(self) -> Table:
        """A row for each value: objective, parts, margins, reason for a missing result."""
        unit = DisplayUnit(self.words.unit, 1.0, 1.0)
        margins = dict.fromkeys(name for row in self.rows for name in row.margins)
        return Table(
            [
                *key_columns(self.keys),
                Column("value", self.words.value, lambda row: row.value, unit, ".4g"),
                Column("", "least margin", lambda row: row.least_text),
                *(
                    Column(
                        f"part: {name}",
                        "",
                        partial(_part, name=name),
                        DisplayUnit(word, 1.0, 1.0),
                        ".4g",
                    )
                    for name, (_, word) in self.words.parts.items()
                ),
                *(
                    Column(f"margin: {name}", "", partial(_margin, name=name), form="+.3f")
                    for name in margins
                ),
                Column("refused", "", lambda row: row.note),
            ],
            self.rows,
        )


def _part(row: SweptProblem, name: str) -> Figure:
    return row.parts.get(name, math.nan)


def _margin(row: SweptProblem, name: str) -> Figure:
    return row.margins.get(name, math.nan)


def sweep_problem(
    load: Load,
    keys: Sequence[str],
    source: ProblemSource,
    points: int | None = None,
    log: bool = False,
    trials: int = 0,
    progress: Advance | None = None,
) -> ProblemSweep:
    """The objective and the margins of a problem at each value of one or two keys, as `sweep`.

    source  source with the seed, the workers and the ledger
    trials  number of trials of each design, the same trials at every value; 0: by formula
    Raises  Refused for an invalid key, or if every value is refused.
    """
    if not 1 <= len(keys) <= len(POINTS):
        raise Refused(f"keys must be one or two, got {len(keys)}")
    swept = tuple(SweptKey.read(key, points or POINTS[len(keys)], log) for key in keys)
    every = list(itertools.product(*(key.texts for key in swept)))
    if len(every) > MOST_DESIGNS:
        raise Refused(f"keys must make at most {MOST_DESIGNS} designs, got {len(every)}")
    rows, words, reason = list[SweptProblem](), None, Refused("")
    for values in every:
        changes = [f"{key.name}={value}" for key, value in zip(swept, values, strict=True)]
        try:
            problem = load(changes)
            row = _figures(values, problem, source, trials)
            words = words or problem.text()
        except Refused as error:
            reason, row = error, SweptProblem(values, math.nan, {}, {}, str(error))
        rows.append(row)
        if progress:
            progress(1)
    if words is None:
        raise reason
    how = f"{trials} trials, seed {source.seed}" if trials else "formula"
    return ProblemSweep(swept, tuple(rows), words, how)


def _figures(
    values: tuple[str, ...], problem: Problem, source: ProblemSource, trials: int
) -> SweptProblem:
    margins: dict[str, Figure] = _relative(problem.costs())
    expected = problem.expect()
    if trials:
        judged = problem.judge(source.rows(problem, trials))
        margins |= {name: _interval(some) for name, some in judged.margins.items()}
        return SweptProblem(values, judged.value, judged.parts, margins, "", expected.left_out)
    margins |= _relative(expected.margins)
    return SweptProblem(values, expected.value, expected.parts, margins, "", expected.left_out)


def _relative(margins: Mapping[str, Margin]) -> dict[str, Figure]:
    return {name: margin.relative for name, margin in margins.items()}


def _interval(margins: Sequence[Margin]) -> Interval:
    value, *ends = (margin.relative for margin in margins)
    return Interval(value, min(ends), max(ends))


def _shown(figure: Figure) -> str:
    if isinstance(figure, Interval):
        ends = ", ".join(map(four_digits, (figure.low, figure.high)))
        return f"{four_digits(figure.value)} [{ends}]"
    return four_digits(figure)


def solve_problem_for(
    load: Load,
    key: str,
    margin: str,
    source: ProblemSource,
    points: int = 25,
    log: bool = False,
    trials: int = 1000,
    progress: Advance | None = None,
    watch: Watch | None = None,
) -> Solution:
    """The values of a key at which a margin of a problem is zero, as `solve_for`.

    Trials correct the formula by a factor on the used fraction of the limit.

    key      "KEY=A..B"
    margin   name of a margin
    Raises   Refused for an invalid key or margin, or if every value is refused.
    """
    values = SweptKey.read(key, points, log)
    if values.numbers is None:
        raise Refused(f"{values.name} must have numbers, got {', '.join(values.texts)}")

    def at(number: float) -> Problem:
        return load([f"{values.name}={values.at(number)}"])

    left_out = dict[str, None]()

    def expected_at(number: float) -> float:
        problem = at(number)
        margins = costs = problem.costs()
        if margin not in costs:
            expected = problem.expect()
            margins = {**costs, **expected.margins}
            left_out.update(dict.fromkeys(expected.left_out))
        if margin not in margins:
            names = ", ".join(margins)
            raise Refused(f"a limit must be the name of a margin ({names}), got {margin!r}")
        return margins[margin].relative

    def tried_at(number: float) -> Interval:
        problem = at(number)
        judged = problem.judge(source.rows(problem, trials))
        found = _interval(judged.margins[margin])
        return Interval(*map(_scaled, (found.value, found.low, found.high)))

    margins, reason = dict[float, float](), Refused("")
    for number in sorted(values.numbers):
        try:
            margins[number] = expected_at(number)
        except Refused as error:
            reason = error
        if progress:
            progress(1)
    if not margins:
        raise reason
    by_trials = trials and margin not in at(next(iter(margins))).costs()
    line = KeyLine(
        values,
        whole=False,
        expected=lambda number: _scaled(expected_at(number)),
        tried=tried_at if by_trials else None,
        known=[(number, _scaled(value)) for number, value in margins.items()],
        watch=watch,
    )
    how = f"formula, corrected by {trials} trials, seed {source.seed}" if by_trials else "formula"
    crossings = line.crossings()
    return Solution(values, margin, margin, margins, crossings, how, left_out=tuple(left_out))


def _scaled(margin: float) -> float:
    """ln of the limit over its used part; in this quantity trials and formula differ by a shift."""
    return -math.log1p(-min(margin, LARGEST)) if math.isfinite(margin) else margin
