"""Seed and number -> as many cases, each with its verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random

from tests.fuzz.arena import SECONDS, Arena, Case, Verdict
from tests.fuzz.exchange import EXCHANGES, whole_exchanges
from tests.fuzz.grammar import WEIGHTS, Draw, Kind, any_case, whole_cases
from tests.fuzz.surroundings import SURROUNDINGS, whole_surroundings

ALL = (*WEIGHTS, *EXCHANGES, *SURROUNDINGS)


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
    compiled: Path | None = None,
) -> list[Path]:
    """Judge new cases of a seed until there are enough, or the report raises Enough.

    Returns  what was written outside of the worker's folder, where it is seen: as root

    report   called with each case and its verdict
    kinds    of cases, each as often as it stands there
    primed   whether each command is first run once, so that no case waits for its compilation
    compiled  as of `Arena`
    fault    that the worker has on purpose, one of `worker.FAULTS`; empty for none
    """
    with Arena(seconds, fault=fault, compiled=compiled) as arena:
        for case in (*whole_cases(), *whole_exchanges(), *whole_surroundings()) if primed else ():
            arena.prime(case)

        for case_number in range(number):
            # Of its own random numbers, so that a case stays the same where others change.
            case = any_case(Draw(Random(f"{start} {case_number}")), tuple(kinds))
            try:
                report(case, arena.judge(case))
            except Enough:
                break
        return arena.outside()
