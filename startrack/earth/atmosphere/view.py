"""Ground -> Terms: what an Earth image's rays see, through the air."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import Floats
from startrack.earth.atmosphere.bands import BandTable
from startrack.earth.atmosphere.look_up import FineTable, Reach, Reals, Sight, refine
from startrack.earth.atmosphere.radiance import Heat, Terms, radiance
from startrack.earth.terrain import Ground, up

TINY = 1e-12  # product of sines, below which no azimuth is told


def sight_of(ground: Ground) -> Sight:
    """How the Sun and the camera stand over each of the m points of ground that are seen."""
    seen = ground.hit
    zenith = up(ground.longitude[seen], ground.latitude[seen])
    camera, sun = -ground.direction[seen], ground.sun
    high, low = np.einsum("ij,ij->i", camera, zenith), zenith @ sun
    # Both without their share along the zenith: how high and how level each stands.
    level, shone = camera - high[:, None] * zenith, sun - low[:, None] * zenith
    apart, about = (np.sqrt(np.einsum("ij,ij->i", one, one)) for one in (level, shone))
    turned = np.einsum("ij,ij->i", level, shone) / np.maximum(apart * about, TINY)
    return Sight(
        ground.height[seen],
        np.arctan2(apart, high),
        np.arctan2(about, low),
        np.arccos(np.clip(turned, -1, 1)),
        np.cos(ground.sun_incidence[seen]),
        (~ground.shadow[seen]).astype(np.float64),
        ground.sky_view[seen],
    )


def at_sensor(
    ground: Ground,
    table: BandTable,
    reflectance: Reals,
    surroundings: Reals,
    heat: Heat | None = None,
    temperature: Floats | None = None,
) -> Terms:
    """Radiance of n rays; those that miss the ground see black sky.

    reflectance  (n, b) or (b,) 1, of the ground; where a ray misses it does not matter
    temperature  (n,) kelvin, likewise
    Returns      Terms of (n, b); finite and never negative
    Raises       those of `radiance`; ValueError where ground lies outside the table's heights, or a
                 ray grazes it beyond the table's zenith angles.
    Accuracy     model: where the Sun stands lower than the table goes, the air's light is that of
                 the lowest Sun, less in proportion to the cosine, and none under the horizon.
    """
    bands = table.backscatter.shape[1]
    out = Terms(*np.zeros((5, len(ground), bands), np.float32))
    if not ground.hit.any():
        return out
    sight = sight_of(ground)
    lowest = float(table.sun[-1])
    weak = np.where(
        sight.sun > lowest, np.maximum(np.cos(sight.sun), 0) / math.cos(lowest), 1.0
    ).astype(np.float32)
    sight = sight._replace(sun=np.minimum(sight.sun, lowest), lit=sight.lit * (weak > 0))
    here = np.broadcast_to(reflectance, (len(ground), bands))[ground.hit]
    warm = None if temperature is None else temperature[ground.hit]
    found = radiance(_near(table, sight), sight, here, surroundings, heat, warm)
    for name, whole, part in zip(Terms._fields, out, found, strict=True):
        lit_by_air = name in ("indirect", "scattered")
        whole[ground.hit] = part * weak[:, None] if lit_by_air else part
    return out


def _near(table: BandTable, sight: Sight) -> FineTable:
    """The table around what is seen."""
    return refine(
        table,
        Reach._make((float(values.min()), float(values.max())) for values in sight[:4]),
    )
