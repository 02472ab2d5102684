"""Optics with a lens table -> mass, volume and price of the lens, from its glass."""

from __future__ import annotations

import math
from typing import NamedTuple

from startrack.optics import (
    Optics,
    Surfaces,
    element_count,
    family_surfaces,
    lens_path,
    open_lens,
    open_surfaces,
)

BARREL = 3.7  # kilogram of a whole lens for one of its glass
WALL = 1.96  # outer diameter over that of the largest clear aperture
HOUSING = 1.26  # length of the housing, to the detector, over that of the rays
PRICE, PRICED, STEEP = 270.0, 0.24, 1.6  # dollar of 2010, of a lens of so many kilogram; exponent


class LensCost(NamedTuple):
    """What a lens needs.

    elements  pieces of glass and mirrors; a family's law need not give whole numbers
    mass      kilogram, with its barrel
    volume    cubic metre, of the cylinder that it needs, to the detector
    price     dollar of 2010, of lenses made in series for cameras
    """

    elements: float
    mass: float
    volume: float
    price: float


def lens_cost(optics: Optics) -> LensCost | None:
    """The cost of a lens of a family or of a lens table; None where its surfaces are not known.

        mass   = 3.7 glass * elements / elements of the published lens
        volume = pi / 4 (1.96 largest clear diameter)^2 * 1.26 length to the detector
        price  = 270 (mass / 0.24 kg)^1.6

    The glass is that of the prescription in the design's size; a family's has the clear apertures
    that its beams need at the design's f-number. The three factors of mass and volume are medians
    over nine camera lenses, and the price is a fit to five of them: docs/lens-costs.md has them.

    Accuracy  model: measured over predicted, mass is 0.5 to 1.8, by barrels of plastic or brass;
              volume 0.5 to 1.4; price 0.5 to 3.1, of series. A lens for space costs some hundred
              times as much, so that only ratios mean something. All nine are double Gauss lenses.
    """
    if optics.lens_family:
        surfaces = family_surfaces(
            optics.lens_family, optics.focal_length, optics.f_number, optics.family_field
        )
        elements = element_count(optics.lens_family, optics.f_number, optics.family_field)
        return cost_of(surfaces, elements)
    found = open_surfaces(lens_path(optics.lens_file)) if optics.lens_file else None
    if found is None:
        return None
    table = open_lens(optics.lens_file)
    # Stopped down, it is as large as before.
    surfaces = found.scaled(optics.focal_length / table.focal_length)
    return cost_of(surfaces, len(found.elements))


def cost_of(surfaces: Surfaces, elements: float) -> LensCost:
    """The cost of a lens of some surfaces and of so many elements, which need not be theirs."""
    more = elements / max(len(surfaces.elements), 1)
    mass = BARREL * surfaces.glass_mass() * more
    width = WALL * 2 * float(surfaces.radius.max())
    volume = math.pi / 4 * width**2 * HOUSING * surfaces.length()
    return LensCost(elements, mass, volume, PRICE * (mass / PRICED) ** STEEP)
