"""Points on the detector -> irradiance of a star, by code that is not part of startrack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from startrack.core import POINTS, Floats, call_code, returned
from startrack.optics.parameters import Optics

GROUP = "psfs"


@dataclass(frozen=True, eq=False)
class PsfInput:
    """Where the irradiance of a star is asked for.

    x, y        (m, m) metre on the detector, along columns and rows, from the star's place
    wavelength  (k,) metre, of the detected light
    weight      (k,) 1, of its photons; the sum is 1
    optics      of the design: focal length, f-number, defocus, ...
    """

    x: Floats
    y: Floats
    wavelength: Floats
    weight: Floats
    optics: Optics


class PsfModel(Protocol):
    """A PSF of one's own, which a design names in `instrument.optics.psf`.

    Returns  (m, m) irradiance on any scale, before the blur of the design, diffusion and pixels
    """

    def __call__(self, given: PsfInput, /) -> ArrayLike:
        """Compute the irradiance at all points."""


def irradiance_by_code(
    optics: Optics, wavelength: Floats, weight: Floats, spacing: float, count: int
) -> Floats:
    """The irradiance (count, count) of a function that a design names, whose integral is one.

    Raises  ValueError where the function raises an error, or returns what it must not.
    """
    name, line = optics.psf, (np.arange(count, dtype=float) - count // 2) * spacing
    x, y = np.meshgrid(line, line)
    found = call_code(GROUP, name, PsfInput(x, y, wavelength, weight, optics))
    plane = returned(GROUP, name, found, (count, count))
    if (plane < 0).any() or not plane.any():
        raise ValueError(f"{POINTS[GROUP]} {name} must return irradiances that are not negative")
    return np.asarray(plane / (plane.sum() * spacing**2))
