"""Case and colours -> magnitudes by which stars are fainter here than sunlike ones."""

from __future__ import annotations

import numpy as np

from startrack.case import Case
from startrack.detector import electron_rate
from startrack.scene import illuminate
from startrack.values import Floats, Stars
from startrack.view import throughput

COLOURS = np.linspace(-0.6, 4.0, 24)  # BP - RP


def dimming(case: Case, known: Floats) -> Floats:
    """Magnitude by which stars of these colours (n,) are fainter here than sunlike ones of their G.

    known  BP - RP, NaN where it is not known
    """
    count = len(COLOURS) + 1
    colour = np.append(COLOURS, np.nan)
    stars = Stars(np.zeros(count, np.int64), np.zeros((count, 3)), np.zeros(count), colour)
    light = illuminate(case.scene, stars)
    rate, _ = electron_rate(light, case.instrument.detector, throughput(case.instrument))
    fainter = -2.5 * np.log10(rate[:-1] / rate[-1])
    return np.where(np.isnan(known), 0.0, np.interp(known, COLOURS, fainter))
