"""Errors of single stars -> the tables that `propagate` reads them from."""

from __future__ import annotations

import numpy as np

from startrack.budget.fields import Response
from startrack.case import Case
from startrack.single import Errors
from startrack.single.chart import detected
from startrack.values import Floats

FINE = 0.05  # magnitude between two entries


def response(case: Case, star: Errors) -> Response:
    """The same as a table of small steps."""
    grid = np.arange(star.magnitude[0], star.magnitude[-1] + FINE / 2, FINE)
    return Response(
        float(grid[0]),
        FINE,
        detected(case, grid) * np.interp(grid, star.magnitude, star.kept),
        _fine(star.magnitude, star.stated, grid),
        np.stack([_fine(star.magnitude, one, grid) for one in star.random.values()]),
    )


def _fine(magnitude: Floats, table: Floats, grid: Floats) -> Floats:
    """Covariances between magnitudes, straight lines in the logarithm; (k, 2, 2) pixel^2."""
    xx, yy = (np.maximum(table[:, a, a], 1e-16) for a in (0, 1))
    correlation = np.interp(grid, magnitude, np.clip(table[:, 0, 1] / np.sqrt(xx * yy), -1, 1))
    x, y = (np.exp(np.interp(grid, magnitude, np.log(each) / 2)) for each in (xx, yy))
    cross = correlation * x * y
    return np.stack([x * x, cross, cross, y * y], axis=-1).reshape(-1, 2, 2)
