"""Extinction of the aerosol over height, from visibility."""

import numpy as np

from startrack.core import Floats

KOSCHMIEDER = 3.912  # ln 50: a contrast of 2 %
AIR_AT_GROUND = 1.16e-5  # 1 / m, Rayleigh extinction at 550 nm and sea level
# Extinction at 550 nm over height, 1 / km: columns for a visibility of 50, 23, 10, 5 and 2 km
# in the lowest three, then spring and summer, then a background stratosphere.
# Source: Shettle and Fenn (1979), table 4; as LOWTRAN 7 has them, AFGL-TR-88-0177.
VISIBILITIES: Floats = np.array([50.0, 23, 10, 5, 2]) * 1e3
LOW: Floats = np.array(
    [
        [6.62e-2, 1.58e-1, 3.79e-1, 7.70e-1, 1.94],
        [4.15e-2, 9.91e-2, 3.79e-1, 7.70e-1, 1.94],
        [2.60e-2, 6.21e-2, 6.21e-2, 6.21e-2, 6.21e-2],
    ]
)
MIDDLE_HAZY = (3.46e-2, 1.85e-2)  # at 3 and 4 km for 23 km and less
MIDDLE_CLEAR = (1.46e-2, 1.02e-2)  # for 50 km
HIGH = (
    *(9.31e-3, 7.71e-3, 6.23e-3, 3.37e-3, 1.82e-3, 1.14e-3, 7.99e-4, 6.41e-4, 5.17e-4),
    *(4.42e-4, 3.95e-4, 3.82e-4, 4.25e-4, 5.20e-4, 5.81e-4, 5.89e-4, 5.02e-4, 4.20e-4),
    *(3.00e-4, 1.98e-4, 1.31e-4, 3.32e-5, 1.64e-5, 7.99e-6, 4.01e-6, 2.10e-6, 1.60e-7),
    9.31e-10,
)
SPARSE = 25e3  # metre, above which the steps are 5 km and more
HEIGHT: Floats = np.array([*range(26), 30, 35, 40, 45, 50, 70, 100], np.float64) * 1e3


def profile(visibility: float, height: Floats) -> Floats:
    """Extinction of the aerosol at 550 nm.

    visibility  metre
    height      (n,) metre above the sea
    Returns     (n,) 1 / metre
    Accuracy    model: Shettle and Fenn's profiles, linear in 1 / visibility between them, as
                extinction is, and linear over height; exponential where their steps are wide.
    """
    inverse = 1 / np.array([visibility])
    low = [np.interp(inverse, 1 / VISIBILITIES, row)[0] for row in LOW]
    if visibility > VISIBILITIES[0]:
        ground = KOSCHMIEDER / visibility - AIR_AT_GROUND
        low = list(LOW[:, 0] * ground / (KOSCHMIEDER / VISIBILITIES[0] - AIR_AT_GROUND))
    clear = np.interp(inverse, 1 / VISIBILITIES[1::-1][::-1], (0.0, 1.0))[0]
    middle = np.array(MIDDLE_CLEAR) * (1 - clear) + np.array(MIDDLE_HAZY) * clear
    table = np.array([*low, *middle, *HIGH])
    straight = np.interp(height, HEIGHT, table, right=0.0)
    bent = np.exp(np.interp(height, HEIGHT, np.log(table)))
    return np.where((height > SPARSE) & (height <= HEIGHT[-1]), bent, straight) / 1e3
