"""The effects by which pixels depend on each other, or on the frame before: one table of rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from startrack.core import Floats, Refused, Streams
from startrack.detector.parameters import Detector

Change = Callable[[Floats, Detector, Streams], Floats]


class PixelEffect(NamedTuple):
    """An effect that makes pixels depend on each other.

    Where it is present, windows and drawn spots refuse the detector by its key, and the error
    budget says that it leaves the effect out.

    key       of the detector
    present   whether a detector has it
    in_steps  whether charge and signal are then computed step by step
    left_out  what the error budget says of it; "": that is said, or counted, elsewhere
    charge    changes the charge of all pixels at the end of the exposure, electron; None: where it
              stands in `read_out` by itself
    signal    the same of the signal at the input of the converter, electron
    """

    key: str
    present: Callable[[Detector], Any]
    in_steps: bool = True
    left_out: str = ""
    charge: Change | None = None
    signal: Change | None = None


PIXEL_EFFECTS = [
    PixelEffect("blooming", lambda detector: detector.blooming),
    PixelEffect("em_gain", lambda detector: detector.em_gain > 1),
    PixelEffect("pattern", lambda detector: detector.pattern),
    PixelEffect("settling", lambda detector: detector.settling),
    PixelEffect("read_noise_spread", lambda detector: detector.read_noise_spread),
    PixelEffect("lag", lambda detector: detector.lag, in_steps=False),
    PixelEffect("scan", lambda detector: detector.scan, in_steps=False),
    PixelEffect(
        "age.transfer_loss",
        lambda detector: detector.age and detector.age.transfer_loss,
        in_steps=False,
    ),
]


def present(detector: Detector) -> list[PixelEffect]:
    """Those that a detector has."""
    return [effect for effect in PIXEL_EFFECTS if effect.present(detector)]


def in_steps(detector: Detector) -> bool:
    """Whether the number of a pixel depends on other pixels, or pixels differ in read noise."""
    return bool(detector.effects_by_code) or any(one.in_steps for one in present(detector))


def require_independent_pixels(detector: Detector) -> None:
    """Refuse a detector whose pixels depend on each other or on the frame before.

    Raises  Refused with the key of each effect.
    """
    named = [*(effect.key for effect in present(detector)), *detector.effects_by_code]
    if named:
        raise Refused(
            "windows need independent pixels, so that the detector must be "
            f"without {' and '.join(named)}; choose the fidelity frame"
        )


def changed(stage: str, values: Floats, detector: Detector, streams: Streams) -> Floats:
    """Charge or signal after the effects of the table that change it there.

    stage  "charge" or "signal"
    """
    for effect in present(detector):
        change: Change | None = getattr(effect, stage)
        if change:
            values = change(values, detector, streams)
    return values
