"""Effects of the detector on the pixels of a frame, in the order of the physics.

Each effect is a row of `PIXEL_EFFECTS`. The read-out applies the rows in order. Windows and drawn
spots refuse effects that need whole frames. The error budget lists the effects that it leaves out.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import scipy
from scipy import special

from startrack.core import Floats, Ints, Refused, Streams, call_code, kernel, returned
from startrack.detector.digitise import normals, shot
from startrack.detector.imperfections import offsets, tracks
from startrack.detector.law import EMPTY, nonlinear_signal
from startrack.detector.maps import device_streams, read_noise
from startrack.detector.parameters import Detector


def bloom(charge: Floats, full_well: float) -> Floats:
    """Charge after blooming: half of the excess of each pixel flows up its column, half down.

    The flow fills each pixel to its full well, until no charge is left or the array ends.

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
    """Electrons after the multiplication register, from whole electrons before it.

        x = n + Poisson(Gamma(r n, t)),   r t = g - 1,   1 + t = g (2 g^(-1 / N) - 1)

    In the limit of infinite N, this is the sum of n geometric numbers, the exact law of a register
    that doubles electrons at a constant rate (Yule's process).

    Source: mean and variance for N stages: Robbins and Hadwen (2003), IEEE Trans. Electron Devices
    50, 1227, eq. (9); the shape for high gain: Basden, Haniff and Mackay (2003), MNRAS 345, 985.

    charge    (rows, columns) electron
    Accuracy  model: mean and variance are exact, and no electron is lost; the third cumulant is
              within 0.6 % for 500 stages and 7 % for 100. There is no clock-induced charge.
    """
    gain = detector.em_gain
    if gain == 1:
        return charge
    scale = gain * (2 * gain ** (-1 / detector.em_stages) - 1) - 1
    shape = (gain - 1) / scale
    fraction = streams("multiplication").random(charge.shape)
    more, few = np.empty_like(charge), (charge <= FEW) & (charge == np.rint(charge))
    more[few] = _gamma_quantile(shape, charge[few].astype(int), special.ndtri(fraction[few]))
    more[~few] = special.gammaincinv(shape * charge[~few], fraction[~few])
    # Without tables, because the means of pixels differ too much.
    return charge + shot(scale * more, streams, "multiplied electrons", EMPTY)


FEW = 255  # whole electrons; quantiles are interpolated up to this number
NODES, FARTHEST = 1025, 8.25  # nodes, and range, of standard normal numbers


def _gamma_quantile(shape: float, count: Ints, normal: Floats) -> Floats:
    """Quantiles (n,) of Gamma(shape count, 1) at standard normal numbers; 0 for no electrons.

    The cube root is interpolated, because it is nearly linear in the normal number. Source: Wilson
    and Hilferty (1931), PNAS 17, 684. Accuracy: numerical, 1e-9 of the standard deviation.
    """
    most = 2 ** int(count.max(initial=1)).bit_length() - 1
    root, step = _gamma_roots(shape, most), 2 * FARTHEST / (NODES - 1)
    place = (np.clip(normal, -FARTHEST, FARTHEST) + FARTHEST) / step
    at = np.clip(place.astype(int), 1, NODES - 3)
    u = place - at
    weights = (
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    )
    return np.asarray(sum(w * root[count, at + k - 1] for k, w in enumerate(weights)) ** 3)


@lru_cache(maxsize=8)
def _gamma_roots(shape: float, most: int) -> Floats:
    """Cube roots (most + 1, NODES) of the quantiles that `_gamma_quantile` interpolates."""
    fraction = special.ndtr(np.linspace(-FARTHEST, FARTHEST, NODES))
    root = np.zeros((most + 1, NODES))
    root[1:] = np.cbrt(special.gammaincinv(shape * np.arange(1, most + 1)[:, None], fraction))
    return root


def settle(level: Floats, rest: float) -> Floats:
    """Signal of pixels read one after the other through a channel of limited bandwidth.

        out_i = (1 - rest) in_i + rest out_(i-1)

    It is a first-order low-pass filter with time constant tau, sampled at the end of each pixel's
    time T. At the start of each row it is settled to the first pixel.

    Source: Oppenheim and Schafer, Discrete-Time Signal Processing, on impulse invariance.

    level  (rows, columns) electron, in the order of reading
    rest   1, exp(-T / tau)
    """
    out, _ = scipy.signal.lfilter([1 - rest], [1, -rest], level, axis=1, zi=rest * level[:, :1])
    return out


def impulse_weights(detector: Detector) -> Floats:
    """Contribution of a pixel's charge to its own number and to the pixels read after it.

        w_m = Int_mT^(m+1)T h dt / Int h dt

    The signal of a pixel is held over its time T and sampled at the end; an exponential h gives
    `settle`.

    Returns  (k,) 1, of sum one; [1] without an impulse response
    """
    given = np.array(detector.impulse_response or (1.0,))
    if detector.impulse_step is None:
        return np.asarray(given / given.sum())
    time = detector.impulse_step * np.arange(len(given))
    period = 1 / detector.pixel_rate
    edges = period * np.arange(int(np.ceil(time[-1] / period - 1e-9)) + 1)
    nodes = np.union1d(time, np.minimum(edges, time[-1]))
    below = scipy.integrate.cumulative_trapezoid(np.interp(nodes, time, given), nodes, initial=0)
    return np.diff(np.interp(edges, nodes, below)) / below[-1]


def read_channel(level: Floats, detector: Detector) -> Floats:
    """Signal of pixels (rows, columns) read one after the other through the channel of a detector.

        out_i = sum_m w_m in_(i-m)

    The pixels before the row are assumed to be equal to the row's first pixel.

    Source: Krutz et al. (2011), section 1.
    """
    if detector.settling:
        return settle(level, detector.settling)
    if not detector.impulse_response:
        return level
    weights = impulse_weights(detector)
    before = np.repeat(level[:, :1], len(weights) - 1, axis=1)
    out = scipy.signal.lfilter(weights, [1.0], np.concatenate([before, level], axis=1), axis=1)
    return np.asarray(out[:, len(weights) - 1 :])


def read_out_transfer(detector: Detector, frequency: Floats) -> Floats:
    """MTF of the read-out channel along the columns.

    frequency  (n,) cycle / pixel
    """
    if detector.settling:
        rest = detector.settling
        return np.asarray((1 - rest) / abs(1 - rest * np.exp(-2j * np.pi * frequency)))
    weights = impulse_weights(detector)
    turns = np.exp(-2j * np.pi * np.multiply.outer(frequency, np.arange(len(weights))))
    return np.asarray(abs(turns @ weights))


@dataclass(frozen=True, eq=False)
class EffectInput:
    """Input of an effect on a frame.

    values     (rows, columns), read-only: electrons of each pixel at the end of the exposure
               (charge_effects); electrons at the input of the converter, with read noise
               (signal_effects); digital numbers (image_effects)
    detector   parameters of the detector
    generator  random numbers of this trial for this effect alone

    The function returns (rows, columns), the values after the effect. They must be finite, and
    charge must not be negative. Digital numbers are rounded, and clipped to the converter's range.
    """

    values: Floats
    detector: Detector
    generator: np.random.Generator


def after_effects(group: str, values: Floats, detector: Detector, streams: Streams) -> Floats:
    """Values (rows, columns) of a frame after the effects by user code, in order.

    group   "charge_effects", "signal_effects" or "image_effects"
    Raises  ValueError if a function raises an error, or returns an invalid result.
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


def hits_in(detector: Detector, shape: tuple[int, ...], streams: Streams) -> tuple[Ints, Floats]:
    """Pixels (k,) that particles hit, and their charge (k,) electron; see `tracks`."""
    assert detector.hits
    return tracks(detector.hits, (shape[0], shape[1]), detector.pitch, detector.exposure, streams)


def _add_hits(charge: Floats, detector: Detector, streams: Streams) -> Floats:
    pixel, extra = hits_in(detector, charge.shape, streams)
    hit = charge.copy()
    hit.ravel()[pixel] += extra
    return hit


def _bloom_or_clip(charge: Floats, detector: Detector, streams: Streams) -> Floats:
    if detector.blooming:
        return bloom(charge, detector.full_well)
    return np.minimum(charge, detector.full_well)


def _bend(charge: Floats, detector: Detector, streams: Streams) -> Floats:
    return np.asarray(nonlinear_signal(charge, detector.full_well, detector.nonlinearity))


def _add_reset_noise(signal: Floats, detector: Detector, streams: Streams) -> Floats:
    return signal + detector.reset_noise * normals(signal.shape, streams, "reset noise")


def _settle(signal: Floats, detector: Detector, streams: Streams) -> Floats:
    return read_channel(signal, detector)


def _add_read_noise(signal: Floats, detector: Detector, streams: Streams) -> Floats:
    return signal + read_noise(detector) * normals(signal.shape, streams, "read noise")


def _add_pattern(signal: Floats, detector: Detector, streams: Streams) -> Floats:
    assert detector.pattern
    shape = signal.shape[0], signal.shape[1]
    for offset in offsets(detector.pattern, shape, device_streams(detector), streams):
        signal = signal + offset
    return signal


def _numbers_by_code(numbers: Floats, detector: Detector, streams: Streams) -> Floats:
    after = after_effects("image_effects", numbers, detector, streams)
    return np.clip(np.rint(after), 0, 2**detector.bits - 1)


Change = Callable[[Floats, Detector, Streams], Floats]


class PixelStage(StrEnum):
    """Quantity of the pixels' values at a stage, from light to number (EMVA 1288)."""

    EXPECTED = "expected electrons"
    CHARGE = "charge at the end of the exposure, electron"
    SIGNAL = "signal at the input of the converter, electron"
    IMAGE = "digital numbers"


class PixelEffect(NamedTuple):
    """An effect of the detector on the pixels of a frame.

    key         key of the detector
    stage       stage whose values it changes
    present     function: whether a detector has it
    change      function: values (rows, columns) of the stage -> values after the effect, a new
                array. None: the effect needs more inputs and is applied elsewhere (`lag`, `scan`
                and `mosaic` in the exposure; `age` before the read-out; the spread of the read
                noise with the read noise)
    whole_frame  whether pixels with this effect depend on each other, on the previous frame or on
                 their place; windows and drawn spots refuse such a detector by its key
    noise       whether it adds noise that does not depend on the signal
    left_out    phrase of the error budget; "": the effect is named or counted elsewhere
    """

    key: str
    stage: PixelStage
    present: Callable[[Detector], Any]
    change: Change | None = None
    whole_frame: bool = True
    noise: bool = False
    left_out: str = ""


EXPECTED, CHARGE, SIGNAL, IMAGE = PixelStage
CODE = "charge_effects", "signal_effects", "image_effects"  # keys with lists of user code

# Insert a new effect at its place in the physics.
PIXEL_EFFECTS = [
    PixelEffect("scan", EXPECTED, lambda detector: detector.scan),
    PixelEffect(
        "mosaic",
        EXPECTED,
        lambda detector: detector.mosaic,
        left_out="the colours of single pixels: each has the mean of a cell of four "
        "(instrument.detector.mosaic)",
    ),
    PixelEffect("lag", EXPECTED, lambda detector: detector.lag),
    PixelEffect(
        "age.transfer_loss", EXPECTED, lambda detector: detector.age and detector.age.transfer_loss
    ),
    PixelEffect("hits", CHARGE, lambda detector: detector.hits, _add_hits, whole_frame=False),
    PixelEffect(
        "charge_effects",
        CHARGE,
        lambda detector: detector.charge_effects,
        partial(after_effects, "charge_effects"),
    ),
    PixelEffect("full_well", CHARGE, lambda detector: True, _bloom_or_clip, whole_frame=False),
    PixelEffect("blooming", CHARGE, lambda detector: detector.blooming),
    PixelEffect("em_gain", SIGNAL, lambda detector: detector.em_gain > 1, multiplied),
    PixelEffect(
        "nonlinearity", SIGNAL, lambda detector: detector.nonlinearity, _bend, whole_frame=False
    ),
    PixelEffect(
        "reset_noise",
        SIGNAL,
        lambda detector: detector.reset_noise,
        _add_reset_noise,
        whole_frame=False,
        noise=True,
    ),
    PixelEffect("settling", SIGNAL, lambda detector: detector.settling, _settle),
    PixelEffect("impulse_response", SIGNAL, lambda detector: detector.impulse_response, _settle),
    PixelEffect(
        "read_noise",
        SIGNAL,
        lambda detector: detector.read_noise,
        _add_read_noise,
        whole_frame=False,
        noise=True,
    ),
    PixelEffect("read_noise_spread", SIGNAL, lambda detector: detector.read_noise_spread),
    PixelEffect("pattern", SIGNAL, lambda detector: detector.pattern, _add_pattern, noise=True),
    PixelEffect(
        "signal_effects",
        SIGNAL,
        lambda detector: detector.signal_effects,
        partial(after_effects, "signal_effects"),
    ),
    PixelEffect("image_effects", IMAGE, lambda detector: detector.image_effects, _numbers_by_code),
]


def present(detector: Detector) -> Iterator[PixelEffect]:
    """The effects that a detector has, in the order of the physics."""
    return (effect for effect in PIXEL_EFFECTS if effect.present(detector))


def need_whole_frame(detector: Detector) -> list[PixelEffect]:
    """The effects of a detector that windows and drawn spots do not support."""
    return [effect for effect in present(detector) if effect.whole_frame]


def require_independent_pixels(detector: Detector) -> None:
    """Refuse a detector with effects that need the whole frame.

    Raises  Refused with the key of each effect, or the names of user code.
    """
    effects = [effect.key for effect in need_whole_frame(detector)]
    named = [*(key for key in effects if key not in CODE), *detector.effects_by_code]
    if named:
        raise Refused(
            "windows need independent pixels, so that the detector must be "
            f"without {' and '.join(named)}; choose the fidelity frame"
        )


def after(stage: PixelStage, values: Floats, detector: Detector, streams: Streams) -> Floats:
    """Values (rows, columns) after all effects of a stage that a detector has."""
    for effect in present(detector):
        if effect.stage is stage and effect.change:
            values = effect.change(values, detector, streams)
    return values


def added_noise(detector: Detector, streams: Streams) -> Floats:
    """Noise (rows, columns) that does not depend on the signal, electron at the converter.

    It has the same draws as in the read-out; the channel does not filter it.
    """
    noise = np.zeros((detector.rows, detector.columns))
    for effect in present(detector):
        if effect.noise and effect.change:
            noise = effect.change(noise, detector, streams)
    return noise
