"""Margin, Expectation, Judgement, Words, Bounds: results of a problem for the engines."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from startrack.core import Floats, Refused, printed
from startrack.metrics import Interval


@printed
class Margin(NamedTuple):
    """A value and its limit.

    value, limit  in one unit, SI
    most          whether the limit is from above
    unit          as a text; "" for a pure number
    """

    value: float
    limit: float
    most: bool = True
    unit: str = ""

    @property
    def relative(self) -> float:
        """1 - load, where the load is the part of the limit that is used; met from 0 on.

        The load of a limit from above is value / limit, of one from below limit / value.
        """
        if not self.most:
            return 1 - self.limit / self.value if self.value > 0 else -math.inf
        if self.limit > 0:
            return 1 - self.value / self.limit
        return 0.0 if self.value <= self.limit else -math.inf

    @property
    def value_text(self) -> str:
        """Value with its unit."""
        return f"{self.value:.4g} {self.unit}".strip()

    @property
    def limit_text(self) -> str:
        """Limit in words."""
        return f"{'at most' if self.most else 'at least'} {self.limit:.4g}"

    @property
    def text(self) -> str:
        """Value and limit in words."""
        return f"{self.value_text}, {self.limit_text}"


@printed
class Expectation(NamedTuple):
    """Values that are expected by formula.

    value     the objective, in the unit of `Words`, above 0; not finite without a value
    margins   those that trials decide, by the names of limits
    parts     what the value is made of, by names
    left_out  effects that the formulas leave out, in words
    """

    value: float
    margins: Mapping[str, Margin]
    parts: Mapping[str, float] = {}
    left_out: tuple[str, ...] = ()


@printed
class Judgement(NamedTuple):
    """Values that trials show.

    value    the objective, with its interval
    margins  by the names of limits: of the value, of the end of its interval that is nearer to the
             limit, and of the other end
    parts    parts of the value, with intervals
    """

    value: Interval
    margins: Mapping[str, tuple[Margin, Margin, Margin]]
    parts: Mapping[str, Interval] = {}


@printed
class Words(NamedTuple):
    """Names and units of an objective and of its parts.

    value  name of the objective
    unit   of it, as a text
    parts  name and unit of each part
    """

    value: str
    unit: str
    parts: Mapping[str, tuple[str, str]] = {}


NO_MARKS: Mapping[str, Floats] = {}


@printed
class TrialImage(NamedTuple):
    """An image of a trial, or of the truth or the result that belongs to it.

    name     in words
    unit     of the values, as a text; "" for a pure number
    values   (rows, columns); numbers of classes, where there are classes; NaN: nothing
    marks    (n, 2) pixel, columns first, by what they mark
    classes  their names
    scale    images of a trial with the same scale are drawn with the same range of colours; "": the
             image has its own
    """

    name: str
    unit: str
    values: Floats
    marks: Mapping[str, Floats] = NO_MARKS
    classes: tuple[str, ...] = ()
    scale: str = ""


@printed
class TrialView(NamedTuple):
    """Images of a trial, and what they show in words."""

    images: tuple[TrialImage, ...]
    text: str


@printed
class Bounds(NamedTuple):
    """A variable of a search.

    name       of the parameter
    low, high  SI
    start      its value in the problem as it is, SI
    log        whether the range is searched by its logarithm
    unit       unit for output, as a text
    size       of this unit, SI
    whole      whether the value is rounded to a whole number
    """

    name: str
    low: float
    high: float
    start: float
    log: bool = False
    unit: str = ""
    size: float = 1.0
    whole: bool = False

    def shown(self, value: float) -> str:
        """A value (SI) as a person reads it."""
        return f"{value / self.size:.5g} {self.unit}".strip()

    def value(self, place: float) -> float:
        """The value at a place of the unit interval."""
        if self.log:
            value = self.low * (self.high / self.low) ** place
        else:
            value = self.low + place * (self.high - self.low)
        return round(value) if self.whole else value

    def place(self, value: float) -> float:
        """Inverse of `value`, within the unit interval."""
        if self.log:
            part = math.log(value / self.low) / math.log(self.high / self.low)
        else:
            part = (value - self.low) / (self.high - self.low)
        return min(max(part, 0.0), 1.0)

    def check(self) -> None:
        """Refuse a range that cannot be searched or does not contain the start."""
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise Refused(f"{self.name} must have low < high, got {self.low:g} and {self.high:g}")
        if self.log and self.low <= 0:
            raise Refused(f"low of {self.name} must be above 0 on a log scale, got {self.low:g}")
        if not self.low <= self.start <= self.high:
            raise Refused(
                f"{self.name} must start within [{self.shown(self.low)}, {self.shown(self.high)}], "
                f"got {self.shown(self.start)}"
            )
