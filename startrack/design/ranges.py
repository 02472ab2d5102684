"""Class of parameters -> the range of each field, as its own checks state it."""

from __future__ import annotations

import ast
import inspect
import math
import sys
import textwrap
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

from startrack.core import (
    finite,
    non_negative,
    one_of,
    one_of_or_code,
    positive,
    whole,
    within,
)

CHECKS = {
    one.__name__: one
    for one in (finite, non_negative, one_of, one_of_or_code, positive, whole, within)
}


class Range(NamedTuple):
    """What the values of a field may be, whatever the other fields are.

    low, high  in SI units, included; infinite where there is no limit
    above      whether `low` itself is not allowed
    choices    the texts of which it must be one; empty where any is allowed
    code       whether it may be code as module:function instead
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    choices: tuple[str, ...] = ()
    code: bool = False

    def holds(self, value: float) -> bool:
        """Whether a number lies within."""
        return self.low <= value <= self.high and not (self.above and value == self.low)


@cache
def ranges_of(kind: type) -> dict[str, Range]:
    """The range of each field that `__post_init__` checks by itself; others are not named.

    Limits that depend on other fields, and conditions between fields, are left out: a value within
    the range may still be refused.
    """
    checks = kind.__dict__.get("__post_init__")
    if checks is None:
        return {}
    return dict(_checked(kind, checks))


def _checked(kind: type, method: Any) -> Iterator[tuple[str, Range]]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(method)))
    for call in _calls(tree.body[0].body):  # type: ignore[attr-defined]
        match call.func:
            case ast.Name(id=name) if name in CHECKS:
                for each in call.keywords:
                    if each.arg and _is_field(each.value, each.arg):
                        yield each.arg, _range(name, call.args, sys.modules[kind.__module__])
            case ast.Attribute(value=ast.Name(id="self"), attr=name) if not call.args:
                yield from _checked(kind, getattr(kind, name))


def _calls(body: list[ast.stmt]) -> Iterator[ast.Call]:
    """Calls that are always made, or always where a field is there."""
    for line in body:
        match line:
            case ast.Expr(value=ast.Call() as call):
                yield call
            case ast.If(test=ast.Compare(ops=[ast.IsNot()])):
                yield from _calls(line.body)


def _is_field(value: ast.expr, name: str) -> bool:
    return isinstance(value, ast.Attribute) and ast.unparse(value) == f"self.{name}"


def _range(check: str, limits: list[ast.expr], module: Any) -> Range:
    if check in ("one_of", "one_of_or_code"):
        choices = tuple(map(str, _value(limits[0], module) or ()))
        return Range(choices=choices, code=check == "one_of_or_code")
    if check in ("positive", "non_negative"):
        return Range(0.0, above=check == "positive")
    if check == "finite":
        return Range()
    low, high = (_value(one, module) for one in limits)
    return Range(-math.inf if low is None else low, math.inf if high is None else high)


def _value(limit: ast.expr, module: Any) -> Any:
    """The value of a limit; None where it depends on the other fields."""
    if any(isinstance(part, ast.Name) and part.id == "self" for part in ast.walk(limit)):
        return None
    return eval(compile(ast.Expression(limit), "", "eval"), vars(module))
