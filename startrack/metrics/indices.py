"""The error indices of ECSS-E-ST-60-10C from a sequence of errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, Refused, positive


@dataclass(frozen=True, eq=False)
class Indices:
    """The error indices of one sequence.

    Pointing errors are called APE, MPE, RPE and PDE; knowledge errors, such as those of a star
    tracker, AKE, MKE, RKE and KDE.

    absolute  (m, ...) error
    mean      (k, ...) its mean over each window
    relative  (j, ...) error minus the mean of its window, for the times in whole windows
    drift     (k - lag, ...) mean of a window minus that of the window `lag` before
    """

    absolute: Floats
    mean: Floats
    relative: Floats
    drift: Floats


def indices(error: Floats, step: float, window: float, lag: int = 1) -> Indices:
    """Compute the error indices of a sequence over consecutive windows.

        APE(t) = e(t),  MPE = mean e over a window,  RPE(t) = e(t) - MPE,  PDE = MPE_2 - MPE_1

    Source: ECSS-E-ST-60-10C (2008), 3.2.

    error    (m, ...) error at equal steps of time, usually (m, 3) radian
    step     second
    window   second, rounded to a whole number of steps
    lag      number of windows between the two of a drift
    Returns  Indices; errors after the last whole window are in `absolute` alone
    Raises   ValueError where the step or the lag is not positive, or a window holds less than one
             step or more than the sequence.
    """
    positive(step=step, window=window)
    each = round(window / step)
    count = len(error) // each if each else 0
    if count < 1:
        raise Refused(
            f"window must last from one step ({step} s) to the sequence ({len(error) * step} s), "
            f"got {window} s"
        )
    if lag < 1:
        raise Refused(f"lag must be at least one window, got {lag}")
    windows = error[: count * each].reshape(count, each, *error.shape[1:])
    mean = windows.mean(axis=1)
    relative = (windows - mean[:, None]).reshape(count * each, *error.shape[1:])
    return Indices(error, mean, relative, mean[lag:] - mean[:-lag])


def reproducibility(first: Floats, second: Floats) -> Floats:
    """Difference between the mean errors of two observation periods: PRE, of knowledge KRE.

    Source: ECSS-E-ST-60-10C (2008), 3.2.

    first, second  (m, ...) and (n, ...) errors
    Returns        (...) mean of the second minus mean of the first
    """
    return np.asarray(second.mean(axis=0) - first.mean(axis=0))
