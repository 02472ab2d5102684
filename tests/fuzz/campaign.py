"""Seed and number -> so many cases, each with its verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from random import Random

from tests.fuzz.arena import SECONDS, Arena, Case, Verdict
from tests.fuzz.exchange import ALL, whole_exchanges
from tests.fuzz.grammar import Draw, Kind, any_case, whole_cases


class Enough(Exception):
    """No further cases are needed."""


def run_cases(
    number: int,
    start: int,
    report: Callable[[Case, Verdict], object],
    seconds: float = SECONDS,
    kinds: Iterable[Kind] = ALL,
    fault: str = "",
    primed: bool = True,
) -> None:
    """Judge new cases of a seed until there are enough, or the report raises Enough.

    report   called with each case and its verdict
    kinds    of cases, each as often as it stands there
    primed   whether each command is first run once, so that no case waits for its compilation
    fault    that the worker has on purpose, one of `worker.FAULTS`; empty for none
    """
    with Arena(seconds, fault=fault) as arena:
        for case in (*whole_cases(), *whole_exchanges()) if primed else ():
            arena.prime(case)

        for case_number in range(number):
            # Of its own random numbers, so that a case stays the same where others change.
            case = any_case(Draw(Random(f"{start} {case_number}")), tuple(kinds))
            try:
                report(case, arena.judge(case))
            except Enough:
                break
