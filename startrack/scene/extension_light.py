"""Directions in the field -> diffuse light, by code that is not part of startrack."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from startrack.core import POINTS, DiffuseLight, Floats, call_code, returned
from startrack.scene.parameters import Scene

GROUP = "lights"
LEAST = 1e-6  # of the largest, of the terms (a spectrum times a map) that a light is made of


@dataclass(frozen=True, eq=False)
class LightInput:
    """Where light is asked for.

    direction   (m, 3) unit vectors, ICRS axes, of points evenly spaced over the frame, row by row
    wavelength  (k,) metre, middle of each spectral bin
    width       metre, of each bin
    scene       date, orbit and background of the design
    generator   random numbers of this trial for this light alone
    """

    direction: Floats
    wavelength: Floats
    width: float
    scene: Scene
    generator: np.random.Generator


class DiffuseSource(Protocol):
    """A diffuse light of one's own, which a design lists in `scene.lights`.

    Returns  (m, k) photon / s / m^2 / sr at the entrance pupil, in each direction and spectral bin
    """

    def __call__(self, given: LightInput, /) -> ArrayLike:
        """Compute the light; it is linear between the points."""


def light_by_code(name: str, given: LightInput) -> Iterator[DiffuseLight]:
    """The light of a function that a design names, as sums of a spectrum times a map.

    Raises    ValueError where the function raises an error, or returns what it must not.
    Accuracy  numerical: 1e-6 of the largest term, by singular values.
    """
    shape = len(given.direction), len(given.wavelength)
    light = returned(GROUP, name, call_code(GROUP, name, given), shape)
    if (light < 0).any():
        raise ValueError(f"{POINTS[GROUP]} {name} must return no negative light, got {light.min()}")
    side = round(len(light) ** 0.5)
    places, sizes, spectra = np.linalg.svd(light, full_matrices=False)
    for place, size, spectrum in zip(places.T, sizes, spectra, strict=True):
        if size > LEAST * sizes[0]:
            yield DiffuseLight(spectrum * size, place.reshape(side, side))
