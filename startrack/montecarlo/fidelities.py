"""CPU time and error of the same trials at each fidelity."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.core import Refused
from startrack.design import Case, Fidelity
from startrack.metrics import Interval, Summary, summarise
from startrack.trial import run_trials


class FidelityResult(NamedTuple):
    """One fidelity, on some trials.

    fidelity    its name
    seconds     of CPU for a trial; the first one, which fills the caches, is not counted
    summary     of its trials; None where it cannot simulate the design
    difference  radian, rms per axis of its errors across minus those of the fidelity `frame`
    refusal     why it cannot, or nothing
    """

    fidelity: Fidelity
    seconds: float
    summary: Summary | None
    difference: float
    refusal: str

    @property
    def across(self) -> Interval:
        """Radian, rms per axis."""
        return self.summary.across if self.summary else Interval(*[math.nan] * 3)


def fidelity_comparison(
    case: Case, seed: int, numbers: Sequence[int], advance: Callable[[int], None]
) -> list[FidelityResult]:
    """Every fidelity on the same trials; `frame`, the reference, is the first."""
    made: list[FidelityResult] = []
    frames: NDArray[np.void] | None = None
    for fidelity in Fidelity:
        try:
            run_trials(case, seed, numbers[:1], fidelity)
        except Refused as error:
            made.append(FidelityResult(fidelity, math.nan, None, math.nan, str(error)))
            advance(len(numbers))
            continue
        began = time.process_time()
        outcomes = run_trials(case, seed, numbers, fidelity)
        seconds = (time.process_time() - began) / len(numbers)
        if frames is None:
            frames = outcomes
        both = outcomes["solved"] & frames["solved"] & ~outcomes["false"] & ~frames["false"]
        between = [outcomes[name][both] - frames[name][both] for name in ("error_x", "error_y")]
        difference = float(np.sqrt(np.mean(np.square(between)))) if both.any() else math.nan
        made.append(FidelityResult(fidelity, seconds, summarise(outcomes), difference, ""))
        advance(len(numbers))
    return made
