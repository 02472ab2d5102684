"""Case -> error of a single star's centroid over its magnitude, in time and in all."""

import numpy as np

from startrack.budget.analytic import HOT, response
from startrack.core import Floats
from startrack.design import Case
from startrack.trial import METHOD, READ, SHOT, SingleStars, boxed, boxed_stars

STEP = 10  # rows of the table of the formula, between two magnitudes


def single_stars(case: Case, seed: int = 0) -> SingleStars:
    """Of a tracker with boxes by stars that are drawn in them, else by the formula of the budget.

    The formula's errors are means over zones of the frame and colours; its usual error is that
    without hot pixels. What moves all stars of a frame alike, and neighbours, are left out.

    seed      of the drawn stars
    Accuracy  as of `boxed_stars` and `analytic`.
    """
    if boxed(case):
        return boxed_stars(case, seed)
    found = response(case)
    table, rows = found.table, slice(None, None, STEP)
    by_cause = {
        name: np.trace(table.causes[:, k, rows], axis1=2, axis2=3).mean(axis=0) / 2
        for k, name in enumerate(found.random)
    }

    def rms(*without: str, only: tuple[str, ...] = tuple(by_cause)) -> Floats:
        parts = [by_cause[name] for name in only if name not in without]
        return np.asarray(np.sqrt(np.sum(parts, axis=0)))

    measured = table.fraction[:, rows].mean(axis=0)
    magnitude: Floats = table.start + table.step * STEP * np.arange(len(measured), dtype=float)
    stated = np.sqrt(np.trace(table.stated[:, rows], axis1=2, axis2=3).mean(axis=0) / 2)
    return SingleStars(
        magnitude, measured, stated, rms(only=(SHOT, READ)), rms(only=(METHOD,)), rms(), rms(HOT)
    )
