"""Case, attitudes and numbers of trials -> outcomes, and the controls beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.case import Case
from startrack.chain import OUTCOMES, observe
from startrack.streams import Streams
from startrack.variance.control import control
from startrack.view import noiseless

AXES = "xyz"
CONTROLS = np.dtype(
    [(f"{name}_{axis}", float) for name in ("linear", "middle", "variance") for axis in AXES]
)


def sample_controlled(
    case: Case, seed: int, numbers: Sequence[int], attitudes: Rotation
) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Outcomes (n,) of whole frames at chosen attitudes, and the `Control` of each.

    A trial that has no control, for lack of bright stars, has one of zero with variance zero,
    which the attitude alone decides, so that nothing is biased.
    """
    outcomes = np.empty(len(numbers), OUTCOMES)
    controls = np.zeros(len(numbers), CONTROLS)
    for k, (number, attitude) in enumerate(zip(numbers, attitudes, strict=True)):
        streams = Streams(seed, number)
        record = observe(case, attitude, streams)
        outcomes[k] = (number, *record.outcome)
        electrons = noiseless(case, record.stars, record.path, attitude, streams)
        image = record.frame.image.astype(float)
        made = control(case, attitude, record.stars, electrons, image)
        if made is not None:
            controls[k] = tuple(np.concatenate(made))
    return outcomes, controls


def squares(outcomes: NDArray[np.void], about: bool = False) -> NDArray[np.float64]:
    """Radian^2, whose mean is the square of the rms across (per axis) or about the boresight.

    Trials without a right attitude count as zero; divide by the availability.
    """
    right = outcomes["solved"] & ~outcomes["false"]
    across = (outcomes["error_x"] ** 2 + outcomes["error_y"] ** 2) / 2
    return np.where(right, outcomes["error_z"] ** 2 if about else across, 0.0)


def surplus(controls: NDArray[np.void], about: bool = False) -> NDArray[np.float64]:
    """Radian^2, of the linearised error: its square less the exact mean of that; zero on average.

    E |e0 + L|^2 = |e0|^2 + var L
    """
    axes = "z" if about else "xy"
    total = np.zeros(len(controls))
    for axis in axes:
        total += controls[f"linear_{axis}"] ** 2 - controls[f"middle_{axis}"] ** 2
        total -= controls[f"variance_{axis}"]
    return total / len(axes)
