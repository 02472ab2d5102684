"""Sampling: fidelity and attitudes of the trials of a campaign, and their control variate."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Parameters, Range, Refused, Rows, Streams, parameter
from startrack.design import Case, Fidelity
from startrack.montecarlo.attitudes import at_random, by_sobol
from startrack.montecarlo.control import control
from startrack.observation import expected_electrons
from startrack.population import AS_DESIGNED, AsDesigned, Units
from startrack.trial import OUTCOMES, observe

AXES = "xyz"
CONTROLS = np.dtype(
    [(f"{name}_{axis}", float) for name in ("linear", "middle", "variance") for axis in AXES]
)


def sample_controlled(
    case: Case, seed: int, numbers: Sequence[int], attitudes: Rotation
) -> tuple[Rows, Rows]:
    """Outcomes (n,) of whole frames at chosen attitudes, and the `Control` of each.

    A trial without a control, for lack of bright stars, has a control of zero with variance zero.
    This depends only on the attitude, so there is no bias.
    """
    outcomes = np.empty(len(numbers), OUTCOMES)
    controls = np.zeros(len(numbers), CONTROLS)
    for k, (number, attitude) in enumerate(zip(numbers, attitudes, strict=True)):
        streams = Streams(seed, number)
        record = observe(case, attitude, streams)
        outcomes[k] = (number, *record.outcome)
        electrons = expected_electrons(case, record.stars, record.path, attitude, streams)
        image = record.frame.image.astype(float)
        made = control(case, attitude, record.stars, electrons, image)
        if made is not None:
            controls[k] = tuple(np.concatenate(made))
    return outcomes, controls


def squares(outcomes: Rows, about: bool = False) -> Floats:
    """Radian^2 for each trial; the mean is the square of the rms across (per axis) or about.

    Trials without a correct attitude count as zero; divide by the availability.
    """
    correct = outcomes["solved"] & ~outcomes["false"]
    across = (outcomes["error_x"] ** 2 + outcomes["error_y"] ** 2) / 2
    return np.where(correct, outcomes["error_z"] ** 2 if about else across, 0.0)


def surplus(controls: Rows, about: bool = False) -> Floats:
    """Radian^2, of the linearised error: its square minus the exact mean of it; zero on average.

    E |e0 + L|^2 = |e0|^2 + var L
    """
    axes = "z" if about else "xy"
    total = np.zeros(len(controls))
    for axis in axes:
        total += controls[f"linear_{axis}"] ** 2 - controls[f"middle_{axis}"] ** 2
        total -= controls[f"variance_{axis}"]
    return total / len(axes)


ATTITUDES = ("random", "sobol")
SURPLUS = [("surplus_across", float), ("surplus_about", float)]


class Sampling(Parameters):
    """Method by which the trials of a campaign are sampled.

    fidelity   of each trial
    attitudes  "random": independent; "sobol": scrambled points that fill the sphere evenly
    control    whether each has a control variate, which needs whole frames
    units      order of the trials over different units; or the unit as designed for all
    """

    fidelity: Fidelity = Fidelity.FRAME
    attitudes: str = parameter(limit=Range(choices=ATTITUDES), default="random")
    control: bool = False
    units: AsDesigned | Units = AS_DESIGNED

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.control and self.fidelity is not Fidelity.FRAME:
            raise Refused(f"control needs fidelity frame, got {self.fidelity}")
        if self.control and self.units != AS_DESIGNED:
            raise Refused("control must be left out where units vary")

    def __str__(self) -> str:
        named = [f"fidelity {self.fidelity}"]
        named += ["Sobol attitudes"] * (self.attitudes == "sobol")
        return ", ".join([*named, *self.units.words, *["control"] * self.control])

    @property
    def block(self) -> int:
        """Largest number of trials for a worker, and for a write to disk."""
        return self.units.block

    @property
    def dtype(self) -> np.dtype[Any]:
        """`trial`, the fields of Outcome, and, with a control, its surplus (radian^2)."""
        return np.dtype(OUTCOMES.descr + SURPLUS) if self.control else self.units.dtype

    def attitudes_of(self, seed: int, numbers: Sequence[int]) -> Rotation:
        """The attitudes icrs_to_camera of some trials."""
        return (by_sobol if self.attitudes == "sobol" else at_random)(seed, numbers)

    def trials(self, case: Case, seed: int, numbers: Sequence[int]) -> Rows:
        """Outcomes (n,) of some trials; each does not depend on which others are run.

        Raises  as `startrack.run_trials` and `control`
        """
        attitudes = self.attitudes_of(seed, numbers)
        if not self.control:
            return self.units.run(case, seed, numbers, self.fidelity, attitudes)
        outcomes, controls = sample_controlled(case, seed, numbers, attitudes)
        table = np.empty(len(numbers), self.dtype)
        table[list(OUTCOMES.names or ())] = outcomes
        table["surplus_across"], table["surplus_about"] = (
            surplus(controls),
            surplus(controls, about=True),
        )
        return table
