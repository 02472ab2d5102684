"""Random numbers -> lines of jitter, by code that is not part of startrack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from startrack.core import POINTS, Floats, call_code, returned

GROUP = "jitters"


@dataclass(frozen=True, eq=False)
class JitterInput:
    """What jitter is drawn from.

    exposure   second
    generator  random numbers of this trial for this jitter alone
    """

    exposure: float
    generator: np.random.Generator


class Jitter(Protocol):
    """A jitter of one's own, which a design lists in `instrument.motion.jitter`.

    Returns  (k, 7): frequency in hertz, then for the camera's axes x, y and z the amplitudes of the
             cosines and those of the sines in radian, all at the middle of the exposure
    """

    def __call__(self, given: JitterInput, /) -> ArrayLike:
        """Draw the lines of one trial; the same for the same random numbers."""


def lines_by_code(
    name: str, exposure: float, generator: np.random.Generator
) -> tuple[Floats, NDArray[np.complex128]]:
    """Frequencies (k,) hertz and complex amplitudes (k, 3) radian of a function of a design.

    Raises  ValueError where the function raises an error, or returns what it must not.
    """
    found = call_code(GROUP, name, JitterInput(exposure, generator))
    lines = returned(GROUP, name, found, (-1, 7))
    if (lines[:, 0] < 0).any():
        raise ValueError(f"{POINTS[GROUP]} {name} must return no negative frequency")
    return lines[:, 0], lines[:, 1:4] - 1j * lines[:, 4:]
