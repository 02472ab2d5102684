"""Expected electrons -> digital numbers: in one step for independent pixels, or by each effect."""

from startrack.core import Floats, Streams
from startrack.detector.digitise import digitise, digitise_hit, shot
from startrack.detector.effects import PixelStage, after, hits_in, need_whole_frame
from startrack.detector.law import Image, Tables, blank, converted, law_of
from startrack.detector.parameters import Detector


def read_out(
    electrons: Floats, detector: Detector, streams: Streams, tables: Tables | None = None
) -> Image:
    """The digital image of expected electrons.

    The numbers of independent pixels are drawn in one step. If an effect needs the whole frame
    after the electrons are drawn, the effects are applied one after the other to charge, signal and
    numbers.

    electrons  (rows, columns) expectation of photo- and dark electrons
    tables     as `digitise` takes them
    Returns    (rows, columns) digital numbers, in 16 bits or, if these are too few, 32
    Accuracy   as `digitise` and the effects
    """
    law = law_of(detector)
    if any(effect.stage is not PixelStage.EXPECTED for effect in need_whole_frame(detector)):
        return _by_effects(electrons, detector, streams)
    image = digitise(electrons, law, streams, tables)
    if detector.hits:
        hits = hits_in(detector, electrons.shape, streams)
        digitise_hit(image, electrons, *hits, law, streams)
    return image


def _by_effects(electrons: Floats, detector: Detector, streams: Streams) -> Image:
    law = law_of(detector)
    charge = after(PixelStage.CHARGE, shot(electrons, streams), detector, streams)
    signal = after(PixelStage.SIGNAL, charge, detector, streams)
    image = blank(electrons.shape, law)
    image[...] = after(PixelStage.IMAGE, converted(signal, law), detector, streams)
    return image
