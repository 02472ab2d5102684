"""Expected electrons -> digital numbers with all effects: charge, signal, image."""

import numpy as np

from startrack.core import Floats, Ints, Streams
from startrack.detector import pixel_effects
from startrack.detector.digitise import digitise, digitise_hit, normals, shot
from startrack.detector.imperfections import offsets, tracks
from startrack.detector.law import Image, Law, Tables, blank, converted, law_of, nonlinear_signal
from startrack.detector.maps import device_streams, read_noise
from startrack.detector.parameters import Detector


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
    if pixel_effects.in_steps(detector):
        level = _signal(_charge(electrons, detector, streams), law, detector, streams)
        level = pixel_effects.after_effects(
            "signal_effects", detector.signal_effects, level, detector, streams
        )
        image = blank(electrons.shape, law)
        image[...] = converted(level, law)
        if detector.image_effects:
            after = pixel_effects.after_effects(
                "image_effects", detector.image_effects, image.astype(float), detector, streams
            )
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
    charge = pixel_effects.changed("charge", charge, detector, streams)
    charge = pixel_effects.after_effects(
        "charge_effects", detector.charge_effects, charge, detector, streams
    )
    if detector.blooming:
        return pixel_effects.bloom(charge, detector.full_well)
    return np.minimum(charge, detector.full_well)


def _signal(charge: Floats, law: Law, detector: Detector, streams: Streams) -> Floats:
    """Signal at the input of the converter, electron."""
    shape = charge.shape
    if detector.em_gain > 1:
        fraction = streams("multiplication").random(shape)
        charge = pixel_effects.multiply(charge, detector.em_gain, fraction)
    level = nonlinear_signal(charge, law.full_well, law.nonlinearity)
    if detector.reset_noise:
        level += detector.reset_noise * normals(shape, streams, "reset noise")
    if detector.settling:
        level = pixel_effects.settle(level, detector.settling)
    if detector.read_noise:
        level += read_noise(detector) * normals(shape, streams, "read noise")
    if detector.pattern:
        for offset in offsets(detector.pattern, shape, device_streams(detector), streams):
            level += offset
    return pixel_effects.changed("signal", level, detector, streams)


def _tracks(electrons: Floats, detector: Detector, streams: Streams) -> tuple[Ints, Floats]:
    assert detector.hits
    shape = (electrons.shape[0], electrons.shape[1])
    return tracks(detector.hits, shape, detector.pitch, detector.exposure, streams)
