"""Condition: a further rate, background or age at which a design is judged."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from startrack.core import (
    NON_NEGATIVE,
    POSITIVE,
    YEAR,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    printed,
)
from startrack.design.case import Case
from startrack.design.parameter import with_values
from startrack.design.requirements import Requirements
from startrack.motion import Motion

NOMINAL, REST, MAX_RATE = "nominal", "rest", "max rate"


class Change(Parameters):
    """One parameter that has another value."""

    name: str = parameter('path in the case, such as "instrument.detector.dark_current"')
    value: float | str = parameter("number, text with a unit if the parameter has one, or name")


MAX_ERROR = "limits in this condition; None: those of the requirements"


class Condition(Parameters):
    """A condition in which a design is judged, in addition to the condition of the file itself."""

    name: str = parameter("name in tables and messages")
    weight: float = parameter(
        "weight of its error in the objective, in which the file's own condition has 1; 0: only "
        "its requirements count",
        limit=NON_NEGATIVE,
        default=1.0,
    )
    rate: float | None = parameter(
        "slew rate about the axis of rotation of the design; if the design does not rotate, about "
        "an axis across the boresight at 45 degrees to the columns. None: as the design",
        unit=Unit("rad/s", "deg/s"),
        limit=NON_NEGATIVE,
        default=None,
    )
    background_g: float | None = parameter(
        "background of the sky, magnitude per square arcsecond; None: as the design", default=None
    )
    change: tuple[Change, ...] = parameter(
        "any other parameter, such as the dark current at the end of life", default=()
    )
    max_across: float | None = parameter(
        MAX_ERROR, unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    max_about: float | None = parameter(
        MAX_ERROR, unit=Unit("rad", "arcsec"), limit=POSITIVE, default=None
    )
    min_availability: float | None = parameter(
        "limits in this condition; None: those of the requirements", limit=Range(0, 1), default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name or self.name in (NOMINAL, MAX_RATE):
            raise Refused(
                f"name of a condition must be given and not be {NOMINAL} or {MAX_RATE}, got "
                f"{self.name!r}"
            )

    def of(self, case: Case) -> Case:
        """The case in this condition.

        Raises  ValueError if a change does not fit its parameter.
        """
        if self.rate is not None:
            case = turning(case, self.rate)
        if self.background_g is not None:
            case = replace(case, scene=replace(case.scene, background_g=self.background_g))
        values = {change.name: change.value for change in self.change}
        return with_values(case, values) if values else case

    def requirements(self, needs: Requirements) -> Requirements:
        """The requirements with the limits of this condition."""
        names = ("max_across", "max_about", "min_availability")
        own = {name: limit for name in names if (limit := getattr(self, name)) is not None}
        return replace(needs, **own) if own else needs


@dataclass(frozen=True)
class OverUnits:
    """The units of a design over which its errors are judged.

    fraction  1, fraction of the units whose errors must not exceed the result
    age       second, age of all units
    count     number of units of the analytic budget
    trials    number of trials of each of these units, in a search
    """

    fraction: float
    age: float
    count: int
    trials: int

    @property
    def words(self) -> str:
        """Words after the name of an error that say to which units it refers."""
        units = f"{100 * self.fraction:g} % of units at {self.age / YEAR:g} yr"
        return f"that {units} do not exceed"


@printed
class Judged(NamedTuple):
    """A case with the requirements that judge it.

    name    name of the condition
    case    the design in this condition
    needs   requirements of the case
    weight  1, weight of its error in the objective
    units   units over which its errors are judged; None: the unit as designed
    """

    name: str
    case: Case
    needs: Requirements
    weight: float
    units: OverUnits | None = None


def turning(case: Case, rate: float) -> Case:
    """The case at another slew rate, radian / second, about the same axis."""
    motion = case.instrument.motion
    if motion.rate:
        scale = rate / motion.rate
        x, y, z = scale * motion.rate_x, scale * motion.rate_y, scale * motion.rate_z
    else:
        x, y, z = rate / math.sqrt(2), rate / math.sqrt(2), 0.0
    turned: Motion = replace(motion, rate_x=x, rate_y=y, rate_z=z)
    return replace(case, instrument=replace(case.instrument, motion=turned))


def judged(
    case: Case, needs: Requirements, conditions: Sequence[Condition] = ()
) -> tuple[Judged, ...]:
    """All conditions of a design: its own, the given conditions, rest, and the largest rate.

    Rest and the largest required rate are added with the weight 0 if no other condition has them.

    Raises  ValueError if a condition does not fit the case.
    """
    return tuple(_judged(case, needs, conditions))


def _judged(case: Case, needs: Requirements, conditions: Sequence[Condition]) -> Iterator[Judged]:
    names = [condition.name for condition in conditions]
    if len(set(names)) < len(names):
        raise Refused(f"conditions must have different names, got {', '.join(names)}")
    cases = [case]
    yield Judged(NOMINAL, case, needs, 1.0)
    for condition in conditions:
        try:
            cases.append(condition.of(case))
        except Refused as error:
            raise Refused(f"condition {condition.name}: {error}") from None
        yield Judged(condition.name, cases[-1], condition.requirements(needs), condition.weight)
    rates = [varied.instrument.motion.rate for varied in cases]
    if all(rates):
        yield Judged(REST, turning(case, 0.0), needs, 0.0)
    fastest = needs.max_rate
    if fastest and not any(math.isclose(rate, fastest) for rate in rates):
        yield Judged(MAX_RATE, turning(case, fastest), needs, 0.0)
