"""Irradiance of the Sun over wavelength."""

from functools import lru_cache

import numpy as np
import scipy

from startrack.core import Floats
from startrack.io import checked_arrays, shipped

FORMAT = 1  # of the file
# parts between two wavelengths of the table, for the integral of the linear interpolation
PARTS = 4


def sun_spectrum(wavelength: Floats) -> Floats:
    """Irradiance of the Sun at one astronomical unit, the mean of each cell of a grid.

    Source: Thuillier et al. (2003), Solar Physics 214, 1, the source of the published irradiances
    of Sentinel-2's bands; beyond 2400 nm Gueymard (2018), Solar Energy 169, 434.

    wavelength  (f,) metre, rising, between 200 nm and 50 micrometre; a cell reaches half-way to its
                neighbours
    Returns     (f,) watt / m^2 / m
    Raises      ValueError if a wavelength lies outside.
    Accuracy    model: measurement uncertainty of some 3 %. TSIS-1 (Coddington et al. 2021) is 1.2,
                2.7 and 1.4 % above in bands at 490, 560 and 665 nm, within 1 % from 700 to 870 nm,
                and 3.6 and 4.8 % below at 1610 and 2200 nm; the step at 2400 nm is 4 %. Beyond 5
                micrometre ASTM E490 is up to 9 % above. The Sun varies by 0.1 %. numerical: exact
                integrals of the table's straight lines.
    """
    nodes, total = _integral()
    if wavelength[0] < nodes[0] or wavelength[-1] > nodes[-1]:
        raise ValueError(
            f"wavelength must lie in [{nodes[0]:g}, {nodes[-1]:g}] metre, got {wavelength[0]:g} to "
            f"{wavelength[-1]:g}"
        )
    edges = edges_of(wavelength)
    return np.asarray(np.diff(np.interp(edges, nodes, total)) / np.diff(edges))


def edges_of(wavelength: Floats) -> Floats:
    """Borders (f + 1,) of the cells of a grid (f,): the points half-way between nodes, and the
    grid's ends."""
    middle = (wavelength[1:] + wavelength[:-1]) / 2
    return np.concatenate([wavelength[:1], middle, wavelength[-1:]])


@lru_cache(maxsize=1)
def _integral() -> tuple[Floats, Floats]:
    """Fine wavelengths, and the integral of irradiance up to each, watt / m^2."""
    path = shipped("atmosphere/sun.fits")
    nodes, values = checked_arrays(path, "SUN", FORMAT, "a spectrum", ("WAVELENGTH", "VALUE"))
    parts_of_each = np.linspace(nodes[:-1], nodes[1:], PARTS, endpoint=False).T.ravel()
    fine = np.append(parts_of_each, nodes[-1])
    return fine, scipy.integrate.cumulative_trapezoid(
        np.interp(fine, nodes, values), fine, initial=0
    )
