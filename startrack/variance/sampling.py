"""How a campaign's trials are made: how much of each, where they look, with a control or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.case import Case, Fidelity
from startrack.chain import OUTCOMES, trials
from startrack.checks import one_of
from startrack.variance.attitudes import at_random, by_sobol
from startrack.variance.sample import sample_controlled, surplus

ATTITUDES = ("random", "sobol")
SURPLUS = [("surplus_across", float), ("surplus_about", float)]


@dataclass(frozen=True)
class Sampling:
    """What every trial of a campaign is.

    fidelity   how much of it is made
    attitudes  "random": independent; "sobol": scrambled points that fill the sphere evenly
    control    whether it comes with its control variate, which whole frames alone have
    """

    fidelity: Fidelity = Fidelity.FRAME
    attitudes: str = "random"
    control: bool = False

    def __post_init__(self) -> None:
        one_of(ATTITUDES, attitudes=self.attitudes)
        if self.control and self.fidelity is not Fidelity.FRAME:
            raise ValueError(f"control needs fidelity frame, got {self.fidelity}")

    def __str__(self) -> str:
        named = [f"fidelity {self.fidelity}"]
        named += ["Sobol attitudes"] * (self.attitudes == "sobol")
        return ", ".join(named + ["control"] * self.control)

    @property
    def dtype(self) -> np.dtype[Any]:
        """`trial`, the fields of Outcome, and with a control its surplus (radian^2)."""
        return np.dtype(OUTCOMES.descr + SURPLUS) if self.control else OUTCOMES

    def look(self, seed: int, numbers: Sequence[int]) -> Rotation:
        """The attitudes icrs_to_camera of some trials."""
        return (by_sobol if self.attitudes == "sobol" else at_random)(seed, numbers)

    def trials(self, case: Case, seed: int, numbers: Sequence[int]) -> NDArray[np.void]:
        """Outcomes (n,) of some trials, each the same whichever others are asked for.

        Errors  as `startrack.chain.trials` and `startrack.variance.control`
        """
        if not self.control:
            look = None if self.attitudes == "random" else self.look(seed, numbers)
            return trials(case, seed, numbers, self.fidelity, look)
        outcomes, controls = sample_controlled(case, seed, numbers, self.look(seed, numbers))
        table = np.empty(len(numbers), self.dtype)
        table[list(OUTCOMES.names or ())] = outcomes
        table["surplus_across"], table["surplus_about"] = surplus(controls), surplus(controls, True)
        return table
