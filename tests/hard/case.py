"""A hard case: what is asked of a room, what is expected, and what came."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

Came = float | str


@dataclass(frozen=True)
class Hard:
    """One case.

    expected  an interval for a number; for a sentence, words that it holds
    try_      does it
    fault     why it does not come out as expected, where that is known and not mended yet
    """

    room: str
    name: str
    expected: tuple[float, float] | str
    try_: Callable[[], Came]
    fault: str = ""

    def holds(self, came: Came) -> bool:
        if isinstance(self.expected, str):
            return isinstance(came, str) and self.expected in came
        low, high = self.expected
        return not isinstance(came, str) and low <= came <= high

    @property
    def told(self) -> str:
        """The expectation as text."""
        if isinstance(self.expected, str):
            return f"“{self.expected}”"
        low, high = self.expected
        return f"{low:g}" if low == high else f"{low:g} to {high:g}"


CASES: list[Hard] = []


def hard(
    room: str, name: str, expected: tuple[float, float] | str, fault: str = ""
) -> Callable[[Callable[[], Came]], Callable[[], Came]]:
    """Add a function that returns the result to the list."""

    def add(try_: Callable[[], Came]) -> Callable[[], Came]:
        CASES.append(Hard(room, name, expected, try_, fault))
        return try_

    return add


def refused(action: Callable[[], object]) -> str:
    """The sentence of the error that an action ends with."""
    try:
        action()
    except (ValueError, TypeError) as error:
        return str(error)
    return "nothing was refused"
