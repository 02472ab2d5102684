"""What each pixel of a device does on its own: maps that belong to the device, not to a trial."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from startrack.detector.parameters import Detector
from startrack.streams import Streams


def response(detector: Detector) -> NDArray[np.float64] | None:
    """Photo response of each pixel over the mean, None where all are alike.

    Normal with rms `prnu`, clipped at zero. Source: EMVA 1288 release 4.0, section 2.3.
    """
    if detector.prnu == 0:
        return None
    return _response(detector.rows, detector.columns, detector.prnu, detector.device_seed)


@lru_cache(maxsize=4)
def _response(rows: int, columns: int, prnu: float, device_seed: int) -> NDArray[np.float64]:
    draw = Streams(device_seed, 0)("photo response").standard_normal((rows, columns))
    gain = np.maximum(1 + prnu * draw, 0.0)
    gain.flags.writeable = False
    return gain
