"""Seed and number -> so many cases, each with its verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.arena import SECONDS, Arena, Case, Verdict
from tests.fuzz.exchange import ALL, whole_exchanges
from tests.fuzz.grammar import Kind, cases, whole_cases


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
    enough: list[bool] = []
    with Arena(seconds, fault=fault) as arena:
        for case in (*whole_cases(), *whole_exchanges()) if primed else ():
            arena.prime(case)

        @seed(start)
        @settings(
            max_examples=number, deadline=None, database=None, phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )  # fmt: skip
        @given(cases(tuple(kinds)))
        def run(case: Case) -> None:
            # Not raised through Hypothesis, which would run the case again to shrink it.
            if not enough:
                try:
                    report(case, arena.judge(case))
                except Enough:
                    enough.append(True)

        run()
