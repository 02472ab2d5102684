"""A class of parameters -> each field as it is declared: type, unit, range, meaning, default.

A field is declared once; checks, readers, writers and help all use this declaration:

    class Sensor(Parameters):
        exposure: float = parameter("time of one frame", unit=Unit("s", "ms"), limit=POSITIVE)
        fill_factor: float = parameter(
            "fraction of a pixel that detects", limit=Range(0.01, 1), default=1.0
        )
"""

import dataclasses
import math
import os
import types
import typing
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, dataclass_transform

from startrack.core import extension
from startrack.core.checks import (
    Refused,
    finite,
    non_negative,
    one_of,
    positive,
    refusal,
    whole,
    within,
)
from startrack.core.units import Unit

NUMBER_OR_TEXT = float | str
FileState = tuple[str, int, int] | None


class Range(NamedTuple):
    """Values that a field, or each item of a list, may have, whatever the other fields are.

    low, high  in SI units, included; infinite where there is no limit
    above      whether `low` itself is not allowed
    choices    the texts of which it must be one; empty where any is allowed
    code       group of code that it may name instead, as module:function; "" for none
    free       whether it may be any other text, too; the user of the value checks it
    file       function from its text to the path of a file, on whose content a result depends
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    choices: Collection[str] = ()
    code: str = ""
    free: bool = False
    file: Callable[[str], Path] | None = None

    def holds(self, value: float) -> bool:
        """Whether a number lies within."""
        return self.low <= value <= self.high and not (self.above and value == self.low)

    def check(self, name: str, value: Any, integer: bool) -> None:
        """Refuse a value outside."""
        named: dict[str, Any] = {name: value}
        if self.file or self.free:
            return
        if self.code:
            extension.one_of_or_code(self.choices, **named)
        elif self.choices:
            one_of(self.choices, **named)
        elif integer and math.isinf(self.low + self.high):
            whole(-(2**63), 2**63 - 1, **named)
            if not self.holds(value):
                bound = f"least {self.low}" if math.isinf(self.high) else f"most {self.high}"
                raise refusal(name, f"must be at {bound}", value)
        elif integer:
            whole(int(self.low), int(self.high), **named)
        else:
            if self.low == 0 and (self.above or math.isinf(self.high)):
                (positive if self.above else non_negative)(**named)
            if math.isfinite(self.high):
                within(self.low, self.high, **named)
            finite(**named)
            if not self.holds(value):
                raise refusal(name, f"must be above {self.low:g}", value)


FINITE = Range()
POSITIVE = Range(0.0, above=True)
NON_NEGATIVE = Range(0.0)
FILE = Range(file=Path)


class Field(NamedTuple):
    """A field of a parameter object.

    kind      its type without None and without a unit
    unit      None where it has none
    required  whether it must be given
    default   its value where it is not; None where it must be
    open      whether it may be infinite or NaN in a file, as its default is
    range     None where its class does not check it by itself
    meaning   "" if it adds nothing to the name
    """

    kind: Any
    unit: Unit | None
    required: bool
    default: Any = None
    open: bool = False
    range: Range | None = None
    meaning: str = ""


STATED = "parameter"  # key of a declaration in the metadata of its field


def parameter(
    meaning: str = "",
    *,
    unit: Unit | None = None,
    limit: Range | None = None,
    default: Any = dataclasses.MISSING,
    default_factory: Any = dataclasses.MISSING,
    **options: Any,
) -> Any:
    """Declare a field of `Parameters`.

    meaning           one sentence or less, for the reference of keys
    unit              in the object and in files; None: a number without unit, or no number
    limit             the values that it may have
    default           its value where it is not given; without one it must be given
    default_factory   called for its value where it is not given
    options           further arguments of `dataclasses.field`
    """
    return dataclasses.field(
        default=default,
        default_factory=default_factory,
        metadata={STATED: (unit, limit, meaning)},
        **options,
    )


@cache
def fields_of(kind: type) -> Mapping[str, Field]:
    """The fields of a parameter object that a file may give, by name; none that is `computed`."""
    hints = typing.get_type_hints(kind, include_extras=True)
    fields = {}
    for entry in dataclasses.fields(kind):
        if not entry.init or entry.metadata.get("computed"):
            continue
        about = _field(hints[entry.name], entry)
        default, made = entry.default, entry.default_factory
        required = default is made is dataclasses.MISSING
        if default is dataclasses.MISSING:
            default = None if made is dataclasses.MISSING else made()
        beyond = isinstance(default, float) and not math.isfinite(default)
        fields[entry.name] = about._replace(required=required, default=default, open=beyond)
    return types.MappingProxyType(fields)


def _field(hint: Any, entry: dataclasses.Field[Any]) -> Field:
    kind, unit = bare(hint)
    stated, limit, meaning = entry.metadata.get(STATED, (None, None, ""))
    return Field(kind, stated or unit, required=True, range=limit, meaning=meaning)


def bare(hint: Any) -> tuple[Any, Unit | None]:
    """The type inside `X | None` and `Annotated[X, Unit(...)]`, in either order, and its unit."""
    unit = None
    while True:
        inner = _not_none(hint)
        if typing.get_origin(inner) is Annotated:
            inner, unit = typing.get_args(inner)
        if inner is hint:
            return inner, unit
        hint = inner


def _not_none(kind: Any) -> Any:
    """The type inside `X | None`."""
    if kind == NUMBER_OR_TEXT:
        return kind
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        return next(part for part in typing.get_args(kind) if part is not types.NoneType)
    return kind


def unit_of(kind: type, name: str) -> Unit | None:
    """The unit of a field, None where it has none."""
    return fields_of(kind)[name].unit


@cache
def _rules(kind: type) -> tuple[tuple[str, Range, bool, bool, Unit | None], ...]:
    """Rules of the fields: name, range, whether it is an integer, whether a list, unit."""
    return tuple(
        (name, field.range, field.kind is int, typing.get_origin(field.kind) is tuple, field.unit)
        for name, field in fields_of(kind).items()
        if field.range
    )


@cache
def _floats(kind: type) -> tuple[str, ...]:
    """Names of the fields that are single numbers of any size."""
    return tuple(name for name, field in fields_of(kind).items() if field.kind is float)


@dataclass_transform(frozen_default=True, field_specifiers=(parameter, dataclasses.field))
class Parameters:
    """Its subclasses are frozen dataclasses that check their fields where they are built.

    A whole number that is given for a `float` becomes one. A name of code by an entry point becomes
    its module:function. A class with rules between fields has a `__post_init__` of its own, which
    calls this one first. A class whose fields name files has a field `_files` with the state of the
    files, so that cached results of an object are not used after its file has changed.
    """

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    def __init_subclass__(cls, *, eq: bool = True) -> None:
        dataclasses.dataclass(frozen=True, eq=eq)(cls)

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for name in _floats(kind):
            if type(value := getattr(self, name)) is int and abs(value) < 2**63:
                object.__setattr__(self, name, float(value))
        for name, limits, integer, several, unit in _rules(kind):
            value = getattr(self, name)
            if value is None:
                continue
            if limits.code:
                full = partial(extension.full_name, limits.code, limits.choices)
                value = tuple(map(full, value)) if several else full(value)
                object.__setattr__(self, name, value)
            for item in value if several else (value,):
                try:
                    limits.check(name, item, integer)
                except Refused as reason:
                    raise reason.in_unit(unit.si if unit else "") from None
        if "_files" in kind.__dataclass_fields__:
            named = (getattr(self, name) for name, limits, *_ in _rules(kind) if limits.file)
            object.__setattr__(self, "_files", tuple(map(_state, named)))


def _state(file: Any) -> FileState:
    """Place, time of the last change and size of a file; None if no file has this name."""
    if not isinstance(file, str):
        return None
    try:
        status = os.stat(file)
    except (OSError, ValueError):
        return None
    return os.path.abspath(file), status.st_mtime_ns, status.st_size


def code_in(value: Any, place: str = "") -> Iterator[tuple[str, str, str]]:
    """Key, group and name of all code that a parameter object names."""
    for key, rule, name in _named_in(value, place):
        if rule.code and extension.is_code(name):
            yield key, rule.code, name


def described(value: Any) -> str:
    """All values of a parameter object that differ from their defaults, with all digits.

    So that a new parameter changes no text of a design that does not name it.
    """
    if dataclasses.is_dataclass(value):
        inner = [
            f"{field.name}={described(getattr(value, field.name))}"
            for field in dataclasses.fields(value)
            if field.init and not _is_default(field, getattr(value, field.name))
        ]
        return f"{type(value).__name__}({', '.join(inner)})"
    if isinstance(value, tuple):
        return f"({', '.join(described(part) for part in value)})"
    return repr(value)


def _is_default(field: dataclasses.Field[Any], value: Any) -> bool:
    default = field.default if field.default is not dataclasses.MISSING else None
    if field.default_factory is not dataclasses.MISSING:
        default = field.default_factory()
    return type(value) is type(default) and bool(value == default)


def inputs_of(value: Any) -> dict[str, str]:
    """Digests of the files and of the user code that a parameter object names, by key and name.

    A result depends on them as on the values of the object. Files shipped with startrack are not
    included.
    """
    digests = {}
    for key, rule, name in _named_in(value):
        if rule.code and extension.is_code(name):
            digests[f"{key} {name}"] = extension.origin_of(key, name).digest
        elif rule.file and name and (path := rule.file(name)).is_file():
            digests[f"{key} {name}"] = extension.file_digest(path)
    return digests


def _named_in(value: Any, place: str = "") -> Iterator[tuple[str, Range, str]]:
    kind: Any = type(value)
    for name, field in fields_of(kind).items():
        inner = getattr(value, name)
        where = f"{place}.{name}" if place else name
        for item in inner if isinstance(inner, tuple) else (inner,):
            if field.range and (field.range.code or field.range.file):
                yield where, field.range, item
            elif hasattr(item, "__dataclass_fields__"):
                yield from _named_in(item, where)


class CarriesCode(Parameters):
    """A parameter object that processes exchange, with the list of user code that may run.

    The receiving process may then run what the sending process was allowed to run.
    """

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "allowed code": extension.sent_with(code_in(self))}

    def __setstate__(self, state: dict[str, Any]) -> None:
        extension.received(state.pop("allowed code"))
        self.__dict__.update(state)
