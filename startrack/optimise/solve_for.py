"""A key of a design file, a limit -> the values of the key at which the design just meets it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import scipy

from startrack import verification
from startrack.core import Advance, Refused, printed
from startrack.design import (
    Campaign,
    Case,
    Design,
    Fidelity,
    Objective,
    load_design,
    number_at,
    unit_at,
)
from startrack.metrics import Interval, four_digits
from startrack.optimise.figures import Figure, all_by_formula, by_trials, middle
from startrack.optimise.forecast import blind, name_by_condition
from startrack.optimise.runner import TrialRunner
from startrack.optimise.sweep import SweptKey, design_or_refusal, is_whole

WIDEST = 10.0  # factor below and above the value of a design; chosen by hand
POINTS = 25  # designs at which the formula is computed; by hand: two closer roots are not found
TOLERANCE = 1e-4  # relative tolerance of a root by formula
STEPS = 6  # of the correction by trials, at most
SETTLED = 0.05  # tolerance of a corrected root, in half widths of the margin's interval
# Keys of [campaign.requirements], by the names of the margins that they make.
LIMITS = {
    "mass": "max_mass",
    "power": "max_power",
    "volume": "max_volume",
    "data rate": "max_data_rate",
    "cost": "max_cost",
    "update rate": "min_update_rate",
    "availability": "min_availability",
    "stars in the sky": "min_stars",
}
ERRORS = "across", "about"
Watch = Callable[[str], object]


class LimitCrossing(NamedTuple):
    """A value at which a margin is zero.

    value    value in the unit of the key, with the interval of 95 % by trials; without trials, a
             number. An end of the interval beyond the examined values is not finite
    formula  the value by formula alone
    above    whether the limit is met above this value
    tried    whether trials correct the formula; never for mass, power and other costs
    """

    value: Figure
    formula: float
    above: bool
    tried: bool


@printed
@dataclass(frozen=True, eq=False)
class Solution:
    """Values of a key at which a design just meets a limit.

    key        key with the values at which the formula is computed
    margin     name of the margin
    until      the limit in the words of the user
    margins    margins by formula at these values, in order, without values that are refused
    refused    why the design refuses some values, or empty
    left_out   effects that the formula does not count, a phrase each; for a star tracker
               `budget` tells them
    crossings  in order of their values
    how        deciding quantity, in words
    """

    key: SweptKey
    margin: str
    until: str
    margins: Mapping[float, float]
    crossings: tuple[LimitCrossing, ...]
    how: str
    refused: str = ""
    left_out: tuple[str, ...] = ()

    @property
    def _rows(self) -> list[tuple[str, str]]:
        return [("answer", self.answer), ("by", self.how)]

    @property
    def answer(self) -> str:
        """Sentence with the values, or on their absence."""
        name = self.key.name
        if self.crossings:
            texts = list(map(self._root_text, self.crossings))
            return f"{self.until}: {name} must be {' or '.join(self._spans(texts))}{self._left}"
        ends = " to ".join(self._text(end) for end in (min(self.margins), max(self.margins)))
        kept = min(self.margins.values()) >= 0
        far = (min if kept else max)(self.margins, key=self.margins.__getitem__)
        side = "at least" if kept else "at most"
        at = f"margin {self.margins[far]:+.3f} {side}, at {self._text(far)}"
        word = "every" if kept else "no"
        return f"{self.until}: kept at {word} value of {name} from {ends} ({at}){self._left}"

    @property
    def _left(self) -> str:
        if not self.refused:
            return ""
        assert self.key.numbers is not None
        count = len(self.key.numbers) - len(self.margins)
        return f"; {count} of {len(self.key.numbers)} values are refused ({self.refused})"

    def _spans(self, texts: Sequence[str]) -> Iterator[str]:
        """The ranges in which the limit is met."""
        low = None
        for crossing, text in zip(self.crossings, texts, strict=True):
            if crossing.above:
                low = text
            else:
                yield f"at most {text}" if low is None else f"from {low} to {text}"
                low = None
        if low is not None:
            yield f"at least {low}"

    def _root_text(self, crossing: LimitCrossing) -> str:
        number = middle(crossing.value)
        if math.isfinite(number):
            return self._text(crossing.value)
        side, end = ("below", min) if number < 0 else ("above", max)
        return (
            f"a value {side} {self._text(end(self.margins))}, by trials "
            f"({self._text(crossing.formula)} by formula)"
        )

    def _text(self, value: Figure) -> str:
        shown = four_digits(middle(value))
        if isinstance(value, Interval):
            shown += f" [{four_digits(value.low)}, {four_digits(value.high)}]"
        return f"{shown} {self.key.unit}".strip()


def read_limit(until: str) -> tuple[str, list[str]]:
    """The name of a limit's margin, and the changes of a design file that add the limit.

    until   "across=5 arcsec", "about-99.73=60 arcsec", "availability=99 %", "mass=0.3 kg" and the
            like, with " (CONDITION)" behind the name for another condition than the design's own;
            or the name of a margin of the design
    Raises  Refused for other texts.
    """
    name, equals, limit = (part.strip() for part in until.rpartition("="))
    if not equals:
        return until.strip(), []
    if not limit:
        raise Refused(f"a limit must have a value, such as 'mass=0.3 kg', got {until!r}")
    base, bracket, condition = name.partition(" (")
    place = "campaign.requirements"
    if base in LIMITS:
        return name, [f"{place}.{LIMITS[base]}={limit}"]
    axes = base.partition(" ")[0].partition("-")[0]
    if axes not in ERRORS or "+" in base:
        raise Refused(
            f"a limit must be of {', '.join(ERRORS)}, such as across-99.73, or of "
            f"{', '.join(LIMITS)}, got {until!r}"
        )
    objective = Objective.read(base)
    level = "rms" if objective.fraction is None else f"{100 * objective.fraction:.10g} %"
    kind = "radial" if objective.radial else "per axis"
    changes = [f"max_{axes}={limit}", f"level={level}", f"kind={kind}"]
    return f"{axes}{bracket}{condition}", [f"{place}.{change}" for change in changes]


def scaled(name: str, margin: float) -> float:
    """A margin; for an error ln(limit / error), so that trials differ from the formula by a
    shift."""
    error = name.partition(" (")[0] in ERRORS
    return -math.log1p(-margin) if error and margin < 1 else margin


@dataclass(frozen=True, eq=False)
class KeyLine:
    """A design along a key.

    key       key with the examined values
    whole     whether the values of the key are whole numbers
    expected  function: number -> margin by formula, on the scale on which trials differ from it by
              a shift. Raises Refused if the design refuses the number
    tried     function: number -> margin by trials, with its interval; None without trials
    known     examined numbers, and the margins there on this scale, in order
    watch     called with each value that is tried, with its unit, before its trials
    """

    key: SweptKey
    whole: bool
    expected: Callable[[float], float]
    tried: Callable[[float], Interval] | None
    known: list[tuple[float, float]]
    watch: Watch | None = None

    def crossings(self) -> tuple[LimitCrossing, ...]:
        """Values at which the margin is zero."""
        return tuple(
            self._crossing((low, high), after >= 0)
            for (low, before), (high, after) in itertools.pairwise(self.known)
            if (before >= 0) != (after >= 0)
        )

    def _crossing(self, bracket: tuple[float, float], above: bool) -> LimitCrossing:
        """A root in a bracket, corrected by trials."""
        formula = number = self.root(bracket, above)
        if self.tried is None:
            return LimitCrossing(self._kept(number, above), formula, above, tried=False)
        shifts = [0.0] * 3
        for _ in range(STEPS):
            if self.watch:
                self.watch(f"{four_digits(number)} {self.key.unit}".strip())
            found = self.tried(number)
            seen = [found.value, found.low, found.high]
            expected = self.expected(number)
            shifts = [end - expected for end in seen]
            half = (seen[2] - seen[1]) / 2
            if abs(seen[0]) <= max(SETTLED * half if math.isfinite(half) else 0.0, TOLERANCE):
                break
            number = self.root(bracket, above, shifts[0])
            if not math.isfinite(number):
                break
        ends = sorted(self.root(bracket, above, shift) for shift in shifts[1:])
        kept = Interval(*(self._kept(end, above) for end in (number, *ends)))
        return LimitCrossing(kept, formula, above, tried=True)

    def _kept(self, number: float, above: bool) -> float:
        """The last whole number that meets the limit, if the key has whole numbers."""
        if not self.whole or not math.isfinite(number):
            return number
        return float(math.ceil(number) if above else math.floor(number))

    def root(self, bracket: tuple[float, float], above: bool, shift: float = 0.0) -> float:
        """Value at which formula + shift is zero, in the bracket or beyond it; infinite if none.

        above  whether the margin grows
        """
        ends = [number for number, _ in self.known]
        low, high = (ends.index(end) for end in bracket)
        values = [value + shift for _, value in self.known]
        while (values[low] >= 0) == (values[high] >= 0):
            up = (values[low] < 0) == above
            low, high = (high, high + 1) if up else (low - 1, low)
            if not 0 <= low < high < len(ends):
                return math.inf if up else -math.inf
        found = scipy.optimize.brentq(
            lambda number: self.expected(number) + shift,
            ends[low],
            ends[high],
            xtol=TOLERANCE * max(abs(ends[low]), abs(ends[high])),
            rtol=TOLERANCE,
        )
        return float(found)


def solve_for(
    path: Path | str,
    key: str,
    until: str,
    changes: Sequence[str] = (),
    points: int = POINTS,
    log: bool = False,
    trials: int = 1000,
    fidelity: Fidelity | None = None,
    runner: TrialRunner | None = None,
    progress: Advance | None = None,
    watch: Watch | None = None,
) -> Solution:
    """The values of a key at which a design just meets a limit: where a margin is zero.

        startrack.solve_for("mine.toml", "instrument.optics.f_number=1.2..4", "across=5 arcsec")

    The margin is computed by formula at the points of the range. Between two points with margins of
    opposite sign, a root is found by Brent's method. Trials at the root, which have the same skies
    and noise at every value, then correct the formula: an error by a factor, the availability by a
    difference. The corrected formula has a new root. This is repeated until the root moves by less
    than 5 % of half its interval. The ends of the interval are the roots if the correction is by
    the ends of the 95 % interval of these trials.

    path      of a design file
    key       "KEY=A..B", or "KEY" for a tenth to ten times the value of the design, in equal ratios
    until     the limit, see `read_limit`
    changes   over the values of the file, "KEY=VALUE" each
    points    of the range
    log       whether they are in equal ratios
    trials    at each value; 0: the formula alone
    fidelity  of the trials; None: that of the campaign, window without one
    runner    whose workers compute designs and trials and whose ledger keeps them
    progress  called with the number of designs that were just done by formula
    watch     called with each value that is tried, with its unit, before its trials, and then with
              the number of trials done
    Raises    Refused if the key or the limit is invalid, or the design refuses every value.
    Accuracy  numerical: 1e-4 of the value by formula. Two roots between two neighbouring points are
              not found. statistical: the interval, with the slope of the formula.
    """
    path, runner = Path(path), runner or TrialRunner(1)
    margin, limits = read_limit(until)
    every = [*changes, *limits]
    if "=" not in key:
        key, log = _around(load_design(path, every), key), True
    start = design_or_refusal(path, every)  # which may need a value of the key
    designed = start if isinstance(start, Design) else None
    for limit in limits if designed is None else ():
        _, found, rule = str(start).partition(f"{limit.partition('=')[0]} ")
        if found:
            raise Refused(f"until {until!r}: the limit {rule}")
    values = SweptKey.read(key, points, log, designed)
    if values.numbers is None:
        raise Refused(f"{values.name} must have numbers, got {', '.join(values.texts)}")
    whole = designed is not None and is_whole(designed, values.name)
    along = _MarginAlongKey(
        path=path,
        changes=every,
        key=values,
        whole=whole,
        margin=margin,
        runner=runner,
        trials=trials,
        fidelity=fidelity,
        watch=watch,
    )
    margins, refused = along.margins(progress)
    decided = trials and _decided_by_trials(margin)
    line = KeyLine(
        values,
        whole,
        along.by_formula,
        along.by_trials if decided else None,
        [(number, scaled(margin, value)) for number, value in margins.items()],
        watch,
    )
    how = "formula"
    if decided:
        kind = fidelity or along.design(next(iter(margins)))[1].fidelity
        how += f", corrected by {trials} trials of fidelity {kind}, seed {runner.seed}"
    return Solution(
        key=values,
        margin=margin,
        until=until,
        margins=margins,
        crossings=line.crossings(),
        how=how,
        refused=refused,
    )


@dataclass(frozen=True, eq=False)
class _MarginAlongKey:
    """A margin of the designs that differ in the value of one key; arguments as for `solve_for`.

    whole  whether the values of the key are whole numbers
    """

    path: Path
    changes: Sequence[str]
    key: SweptKey
    whole: bool
    margin: str
    runner: TrialRunner
    trials: int
    fidelity: Fidelity | None
    watch: Watch | None

    def design(self, number: float) -> tuple[Case, Campaign]:
        """The design at a number, and its campaign. Raises Refused if the design refuses it."""
        text = self.key.at(round(number) if self.whole else number)
        design = design_or_refusal(self.path, [*self.changes, f"{self.key.name}={text}"])
        if isinstance(design, Refused):
            raise design
        return design.case, design.campaign or Campaign()

    def by_trials(self, number: float) -> Interval:
        """The margin by trials, `scaled`."""
        case, campaign = self.design(number)
        kind = self.fidelity or campaign.fidelity
        value, done = f"{four_digits(number)} {self.key.unit}".strip(), 0

        def advance(count: float) -> None:
            nonlocal done
            done += round(count)
            if self.watch:
                self.watch(f"{value}, {done} done")

        tried = by_trials(case, campaign, self.runner, self.trials, kind, advance)
        found = tried.margins[self.margin]
        assert isinstance(found, Interval)
        return Interval(*(scaled(self.margin, end) for end in (found.value, found.low, found.high)))

    def by_formula(self, number: float) -> float:
        """The margin by formula, `scaled`. Raises Refused if the design refuses the number."""
        [value] = _by_formula([self.design(number)], self.margin, self.runner)
        if isinstance(value, Refused):
            raise value
        return scaled(self.margin, value)

    def margins(self, progress: Advance | None) -> tuple[dict[float, float], str]:
        """Margins by formula at the values of the key, and why others are refused; or "".

        Raises  Refused if the design refuses every value.
        """
        assert self.key.numbers is not None
        designs, reason = dict[float, tuple[Case, Campaign]](), Refused("")
        for number in sorted(self.key.numbers):
            try:
                designs[number] = self.design(number)
            except Refused as error:
                reason = error
        found = _by_formula(list(designs.values()), self.margin, self.runner, progress)
        margins = dict[float, float]()
        for number, value in zip(designs, found, strict=True):
            if isinstance(value, Refused):
                reason = value
            else:
                margins[number] = value
        if not margins:
            raise reason
        return margins, str(reason)


def _decided_by_trials(margin: str) -> bool:
    return margin.partition(" (")[0] in (*ERRORS, "availability")


def _by_formula(
    asked: Sequence[tuple[Case, Campaign]],
    margin: str,
    runner: TrialRunner,
    progress: Advance | None = None,
) -> list[float | Refused]:
    """A margin of designs by formula, or why a formula refuses one.

    Raises  Refused if the designs have no such margin.
    """
    for names in _margin_names(asked):
        if margin not in names:
            raise Refused(
                f"a limit must be such as across=5arcsec, or a margin of the design "
                f"({', '.join(names)}), got {margin!r}"
            )
    if not _decided_by_trials(margin):
        return [_cost_margin(case, campaign, margin) for case, campaign in asked]
    return [
        figures if isinstance(figures, Refused) else middle(figures.margins[margin])
        for figures in all_by_formula(list(asked), runner, progress)
    ]


def _cost_margin(case: Case, campaign: Campaign, margin: str) -> float | Refused:
    try:
        return verification.margins(campaign.requirements, case)[margin]
    except Refused as reason:
        return reason


def _margin_names(asked: Sequence[tuple[Case, Campaign]]) -> Iterator[list[str]]:
    """Names of the margins of the first design that is not refused."""
    for case, campaign in asked:
        try:
            names = list(verification.margins(campaign.requirements, case))
            for condition in campaign.judged(case):
                names += name_by_condition(condition.name, blind(condition.needs))
        except Refused:
            continue
        yield names
        return


def _around(design: Design, name: str) -> str:
    """A range around the value of a design."""
    try:
        value = number_at(design.case, name)
    except Refused as reason:
        raise Refused(f"{name} must have a range, as KEY=A..B: {reason}") from None
    if not value > 0:
        raise Refused(f"{name} must have a range, as KEY=A..B, where the design has {value:g}")
    unit = unit_at(design.case, name)
    shown, word = (unit.of(value), unit.shown) if unit else (value, "")
    low, high = (f"{end:.6g}" for end in (shown / WIDEST, shown * WIDEST))
    return f"{name}={low}..{high} {word}".strip()
