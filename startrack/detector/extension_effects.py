"""Charge, signal or image of a frame -> the same after effects that are not part of startrack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from startrack.core import Floats, Streams, call_code, returned
from startrack.detector.parameters import Detector


@dataclass(frozen=True, eq=False)
class EffectInput:
    """What an effect on a frame is computed from.

    values     (rows, columns), not to be written to: electrons of each pixel at the end of the
               exposure (charge_effects); electrons at the input of the converter, with read noise
               (signal_effects); digital numbers (image_effects)
    detector   its parameters
    generator  random numbers of this trial for this effect alone
    """

    values: Floats
    detector: Detector
    generator: np.random.Generator


class Effect(Protocol):
    """An effect of one's own, which a design lists in `instrument.detector.charge_effects`,
    `signal_effects` or `image_effects`; those of a list follow one another.

    Returns  (rows, columns), the values after the effect, finite; charge must not be negative,
             digital numbers are rounded and clipped to those that the converter has
    """

    def __call__(self, given: EffectInput, /) -> ArrayLike:
        """Apply the effect; it draws all random numbers from the generator."""


def after_effects(
    group: str, names: tuple[str, ...], values: Floats, detector: Detector, streams: Streams
) -> Floats:
    """Values (rows, columns) of a frame after effects, one after the other.

    group   "charge_effects", "signal_effects" or "image_effects"
    Raises  ValueError where a function raises an error, or returns what it must not.
    """
    for name in names:
        held = np.array(values, float)
        held.flags.writeable = False
        given = EffectInput(held, detector, streams(f"{group} {name}"))
        values = returned(group, name, call_code(group, name, given), values.shape)
        if group == "charge_effects" and (values < 0).any():
            raise ValueError(
                f"instrument.detector.charge_effects {name} must return no negative charge, got "
                f"{values.min():g} electron"
            )
    return values
