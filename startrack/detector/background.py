"""Sky and detector -> what each pixel expects where no star is."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from startrack.core import Floats
from startrack.detector.effects import diffuse
from startrack.detector.law import law_of
from startrack.detector.maps import dark, response
from startrack.detector.parameters import Detector
from startrack.detector.tables import Tables, tables_for

WINGS = 0.6  # standard deviations; most pixels that a star reaches are no brighter


@lru_cache(maxsize=4)
def background(detector: Detector, sky: float) -> Floats:
    """Expected electrons (rows, columns) of an even sky and of the dark current; read-only.

        ground = response sky, spread by crosstalk, + dark current times exposure

    sky  electron in a pixel of mean response
    """
    electrons = caught(np.full((detector.rows, detector.columns), float(sky)), detector)
    electrons += dark(detector) * detector.exposure
    electrons.flags.writeable = False
    return electrons


def caught(electrons: Floats, detector: Detector) -> Floats:
    """What pixels catch of light that is spread over the frame: by their response, and crosstalk.

    electrons  (rows, columns), in pixels of mean response; overwritten
    """
    gain = response(detector)
    if gain is not None:
        electrons *= gain
    return diffuse(electrons, detector.crosstalk) if detector.crosstalk else electrons


@lru_cache(maxsize=4)
def background_tables(detector: Detector, sky: float) -> Tables:
    """The tables of the law of a frame's numbers; of its ground alone, so that they stay.

    Arguments as `ground` takes them.
    """
    return tables_for(background(detector, sky) * (1 - detector.lag), law_of(detector), WINGS)
