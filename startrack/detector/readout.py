"""Expected electrons -> digital numbers with all effects: charge, signal, image.

The effects by which pixels depend on each other, or on the frame before, are one table of rows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import scipy
from scipy import special

from startrack.core import Floats, Ints, Refused, Streams, call_code, kernel, returned
from startrack.detector.digitise import digitise, digitise_hit, normals, shot
from startrack.detector.imperfections import offsets, tracks
from startrack.detector.law import Image, Law, Tables, blank, converted, law_of, nonlinear_signal
from startrack.detector.maps import device_streams, read_noise
from startrack.detector.parameters import Detector


def carry(electrons: Floats, before: Floats | None, fraction: float) -> Floats:
    """Expected electrons that are read with a frame, with the residual charge of the one before.

        read = (1 - fraction) electrons + fraction before

    Each electron is left behind independently, so that the numbers remain Poisson numbers.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on deferred charge; here of one
    frame alone.

    electrons  (rows, columns) electron, generated in this frame
    before     (rows, columns) electron, generated in the frame before; None: none
    """
    kept = (1 - fraction) * electrons
    return kept if before is None else kept + fraction * before


def diffuse(electrons: Floats, fraction: float) -> Floats:
    """Expected electrons after crosstalk: a fraction of each pixel's diffuses to each of its sides.

        after = (1 - 4 fraction) electrons + fraction (left + right + above + below)

    Electrons diffuse independently, so that Poisson numbers stay independent Poisson numbers, and
    it is enough to spread their expectations.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on diffusion; here to the nearest
    pixels alone.

    electrons  (rows, columns) electron; none crosses the border of the array
    fraction   1, at most 1/4
    """
    kernel = np.array([[0, fraction, 0], [fraction, 1 - 4 * fraction, fraction], [0, fraction, 0]])
    return np.asarray(cv2.filter2D(electrons, -1, kernel, borderType=cv2.BORDER_REFLECT), float)


def bloom(charge: Floats, full_well: float) -> Floats:
    """Charge after blooming: half of the excess of each pixel flows up its column, half down.

    The flow fills each pixel to its full well, until nothing is left or the array ends.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on blooming.

    charge   (rows, columns) electron
    Returns  (rows, columns) electron, at most full_well; the sum is conserved except for the flow
             out of the array
    """
    wells = np.minimum(charge, full_well)
    for column in np.flatnonzero((charge > full_well).any(axis=0)):
        excess = (charge[:, column] - wells[:, column]) / 2
        _run(wells[:, column], excess, full_well)
        _run(wells[::-1, column], excess[::-1], full_well)
    return wells


@kernel
def _run(wells, excess, full_well):  # type: ignore[no-untyped-def]
    running = 0.0
    for row in range(len(wells)):
        running += excess[row]
        taken = min(running, full_well - wells[row])
        wells[row] += taken
        running -= taken


def multiplied(charge: Floats, detector: Detector, streams: Streams) -> Floats:
    """Electrons after the multiplication register, of whole electrons before it.

        x = n + Poisson(Gamma(r n, t)),   r t = g - 1,   1 + t = g (2 g^(-1 / N) - 1)

    which for N stages without end is the sum of n geometric numbers, the exact law of a register
    that doubles electrons at a constant rate (Yule's process).

    Source: mean and variance for N stages: Robbins and Hadwen (2003), IEEE Trans. Electron Devices
    50, 1227, eq. (9); the shape for high gain: Basden, Haniff and Mackay (2003), MNRAS 345, 985.

    charge    (rows, columns) electron
    Accuracy  model: mean and variance are exact, and no electron is lost; the third cumulant
              within 0.6 % for 500 stages, 7 % for 100. No clock-induced charge.
    """
    gain = detector.em_gain
    if gain == 1:
        return charge
    scale = gain * (2 * gain ** (-1 / detector.em_stages) - 1) - 1
    shape = (gain - 1) / scale
    more, some = np.zeros_like(charge), charge > 0
    fraction = streams("multiplication").random(charge.shape)
    more[some] = scale * special.gammaincinv(shape * charge[some], fraction[some])
    return charge + shot(more, streams, "multiplied electrons")


def settle(level: Floats, rest: float) -> Floats:
    """Signal of pixels read one after the other through a channel of limited bandwidth.

        out_i = (1 - rest) in_i + rest out_(i-1)

    A low-pass filter of first order with time constant tau, sampled at the end of each pixel's time
    T; each row starts settled to its first pixel.

    Source: Oppenheim and Schafer, Discrete-Time Signal Processing, on impulse invariance.

    level  (rows, columns) electron, in the order of reading
    rest   1, exp(-T / tau)
    """
    out, _ = scipy.signal.lfilter([1 - rest], [1, -rest], level, axis=1, zi=rest * level[:, :1])
    return out


@dataclass(frozen=True, eq=False)
class EffectInput:
    """What an effect on a frame is computed from.

    values     (rows, columns), not to be written to: electrons of each pixel at the end of the
               exposure (charge_effects); electrons at the input of the converter, with read noise
               (signal_effects); digital numbers (image_effects)
    detector   its parameters
    generator  random numbers of this trial for this effect alone

    The function returns (rows, columns), the values after the effect, finite; charge must not be
    negative, digital numbers are rounded and clipped to those that the converter has
    """

    values: Floats
    detector: Detector
    generator: np.random.Generator


def after_effects(group: str, values: Floats, detector: Detector, streams: Streams) -> Floats:
    """Values (rows, columns) of a frame after the effects by code, one after the other.

    group   "charge_effects", "signal_effects" or "image_effects"
    Raises  ValueError where a function raises an error, or returns what it must not.
    """
    for name in getattr(detector, group):
        before = np.array(values, float)
        before.flags.writeable = False
        given = EffectInput(before, detector, streams(f"{group} {name}"))
        values = returned(group, name, call_code(group, name, given), values.shape)
        if group == "charge_effects" and (values < 0).any():
            raise ValueError(
                f"instrument.detector.charge_effects {name} must return no negative charge, got "
                f"{values.min():g} electron"
            )
    return values


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
    return bool(detector.effects_by_code) or any(effect.in_steps for effect in present(detector))


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


def read_out(
    electrons: Floats, detector: Detector, streams: Streams, tables: Tables | None = None
) -> Image:
    """The digital image of expected electrons.

    Independent pixels take their numbers in one step. Where charge or signal passes from pixel to
    pixel, or is multiplied, charge and signal are computed step by step.

    electrons  (rows, columns) expectation of photo- and dark electrons
    tables     as `digitise` takes them
    Returns    (rows, columns) digital numbers, in 16 bits or, where these do not hold them, 32
    Accuracy   that of `digitise` and of the effects
    """
    law = law_of(detector)
    if in_steps(detector):
        level = _signal(_charge(electrons, detector, streams), law, detector, streams)
        level = after_effects("signal_effects", level, detector, streams)
        image = blank(electrons.shape, law)
        image[...] = converted(level, law)
        if detector.image_effects:
            after = after_effects("image_effects", image.astype(float), detector, streams)
            image[...] = np.clip(np.rint(after), 0, 2**detector.bits - 1)
        return image
    image = digitise(electrons, law, streams, tables)
    if detector.hits:
        digitise_hit(image, electrons, *_tracks(electrons, detector, streams), law, streams)
    return image


def _charge(electrons: Floats, detector: Detector, streams: Streams) -> Floats:
    """Charge of the pixels at the end of the exposure, electron."""
    charge = shot(electrons, streams)
    if detector.hits:
        pixel, extra = _tracks(electrons, detector, streams)
        charge.ravel()[pixel] += extra
    charge = changed("charge", charge, detector, streams)
    charge = after_effects("charge_effects", charge, detector, streams)
    if detector.blooming:
        return bloom(charge, detector.full_well)
    return np.minimum(charge, detector.full_well)


def _signal(charge: Floats, law: Law, detector: Detector, streams: Streams) -> Floats:
    """Signal at the input of the converter, electron."""
    shape = charge.shape
    charge = multiplied(charge, detector, streams)
    level = nonlinear_signal(charge, law.full_well, law.nonlinearity)
    if detector.reset_noise:
        level += detector.reset_noise * normals(shape, streams, "reset noise")
    if detector.settling:
        level = settle(level, detector.settling)
    if detector.read_noise:
        level += read_noise(detector) * normals(shape, streams, "read noise")
    if detector.pattern:
        for offset in offsets(detector.pattern, shape, device_streams(detector), streams):
            level += offset
    return changed("signal", level, detector, streams)


def _tracks(electrons: Floats, detector: Detector, streams: Streams) -> tuple[Ints, Floats]:
    assert detector.hits
    shape = (electrons.shape[0], electrons.shape[1])
    return tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
