"""CPU time and error of several ways to do the work of a stage, measured in turns."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

Way = Callable[[], Any]

ROUNDS = 5
ENOUGH = 6.0  # second of CPU for the rounds of a stage, after which none begins; chosen by hand


class Clocked(NamedTuple):
    """The answer of a way that works in another process, and its CPU time there."""

    answer: Any
    seconds: float


@dataclass(frozen=True)
class Stage:
    """One task, and how its answers are judged.

    work      what is done, as text
    error     what its error is, with the unit
    ways      name -> the whole work; returns an answer
    judge     an answer -> its error
    limit     lower bound of the error; NaN where unknown
    limit_of  origin of the limit
    pieces    in one call; times are for one of them
    missing   why some ways of startrack are left out, or nothing
    """

    name: str
    work: str
    error: str
    ways: Mapping[str, Way]
    judge: Callable[[Any], float]
    limit: float = math.nan
    limit_of: str = ""
    pieces: int = 1
    missing: str = ""


class Row(NamedTuple):
    """One way through one stage.

    seconds  of CPU for a piece of work, the least of several rounds
    """

    stage: str
    way: str
    peer: bool
    seconds: float
    error: float


def measure(
    stage: Stage, peers: Mapping[str, Way] | None = None, rounds: int = ROUNDS
) -> list[Row]:
    """Measure every way of a stage, of startrack and of the peers, on the same work in turns.

    The first call of each fills caches, and its answer is judged; the result is the smallest time
    of the later ones.
    """
    ways = {**stage.ways, **(peers or {})}
    least, errors = dict.fromkeys(ways, math.inf), dict[str, float]()
    for name, way in ways.items():
        errors[name] = stage.judge(clocked(way).answer)
    began = time.process_time()
    for number in range(rounds):
        if number and time.process_time() - began > ENOUGH:
            break
        for name, way in ways.items():
            least[name] = min(least[name], clocked(way).seconds)
    return [
        Row(stage.name, name, name not in stage.ways, least[name] / stage.pieces, errors[name])
        for name in ways
    ]


def clocked(way: Way) -> Clocked:
    """The answer of a way, and its seconds of CPU."""
    began = time.process_time()
    answer = way()
    if isinstance(answer, Clocked):
        return answer
    return Clocked(answer, time.process_time() - began)
