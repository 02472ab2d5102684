"""Build the infrared table of the air that is shipped from runs of MODTRAN 5.2.1, and its checksum.

    python catalogs/atmosphere/build_infrared.py

needs pybsm, which ships the runs: mid-latitude summer, rural aerosol 23 km, Sun at 50 degrees,
ground of 299 K that reflects 15 %.
"""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import numpy as np
from air_files import save_infrared
from build_tables import sign

from startrack.core import Floats
from startrack.core.units import deg, um
from startrack.earth.atmosphere import planck
from startrack.earth.atmosphere.infrared import DIFFUSE, InfraredTable
from startrack.earth.atmosphere.spectra import sun_spectrum
from startrack.io.saving import whole

HERE = Path(__file__).parent
EARTH = 6371e3  # metre
ALTITUDE: Floats = np.array([500.0, 1e3, 2e3, 4e3, 8e3, 12e3, 24500.0])
SENSOR: Floats = np.array([0.0, 25, 40, 50, 60, 65, 70]) * deg
FROM, TO = 2.9 * um, 14.0 * um
REFLECTANCE, AUGUST_23 = 0.15, 1.0104
SUN = 50 * deg
SOLAR = 5 * um  # below, the ground's light is mostly the Sun's, and the sky's heat is lost in it
AIR = 285.0  # kelvin, of the air that is seen there
MEAN = 2  # rows of 10 nm to one of the table


def main() -> None:
    every: Floats = 0.3 * um + 0.01 * um * np.arange(1371, dtype=np.float64)
    kept = (every >= FROM) & (every <= TO)
    spectrum: Floats = every[kept]
    through, rise = np.empty((2, len(ALTITUDE), len(SENSOR), len(spectrum)))
    for a, altitude in enumerate(ALTITUDE):
        for v, angle in enumerate(SENSOR):
            rows = along(altitude, angle)[:, kept]
            through[a, v], rise[a, v] = rows[0], rows[1]
    nadir = along(ALTITUDE[-1], 0.0)[:, kept]
    down = np.exp(interpolated(SENSOR, np.log(np.maximum(through[-1], 1e-12)), SUN))
    sun = sun_spectrum(spectrum) / AUGUST_23**2 * math.cos(SUN) / math.pi * down
    measured = np.maximum(nadir[4], 0) / REFLECTANCE / np.maximum(nadir[0], 1e-3) - sun
    emissivity = 1 - np.exp(interpolated(SENSOR, np.log(np.maximum(through[-1], 1e-12)), DIFFUSE))
    warm = emissivity * planck(spectrum, AIR)
    seen = (spectrum > SOLAR) & (nadir[0] > 0.02)  # where the ground is dark the sky is opaque
    fall = np.clip(np.where(seen, measured, warm), 0, planck(spectrum, 299.0))
    table = InfraredTable(mean(spectrum), ALTITUDE, SENSOR, mean(through), mean(rise), mean(fall))
    with whole(HERE / "infrared.fits") as draft:
        save_infrared(draft, table)
    sign()


def along(altitude: float, angle: float) -> Floats:
    """(5, 1371) columns of the run whose sensor stands in a zenith angle, between two of them."""
    utils = importlib.import_module("pybsm.utils")
    # On the round Earth the sensor is farther away along the ground than by the tangent.
    turn = angle - math.asin(EARTH * math.sin(angle) / (EARTH + altitude))
    wanted = EARTH * turn
    ranges = np.array([0.0, 100, 500, *np.arange(1e3, 20.1e3, 1e3), *np.arange(22e3, 80.1e3, 2e3)])
    after = min(int(np.searchsorted(ranges, wanted)), len(ranges) - 1)
    ends = [
        utils.load_database_atmosphere_no_interp(
            altitude=altitude, ground_range=int(ranges[n]), ihaze=1
        ).T[1:]
        for n in (max(after - 1, 0), after)
    ]
    start = ranges[max(after - 1, 0)]
    fraction = (wanted - start) / (ranges[after] - start) if after else 0.0
    out = (1 - fraction) * ends[0] + fraction * ends[1]
    out[0] = np.exp(
        (1 - fraction) * np.log(np.maximum(ends[0][0], 1e-12))
        + fraction * np.log(np.maximum(ends[1][0], 1e-12))
    )
    return out


def interpolated(angles: Floats, values: Floats, at: float) -> Floats:
    """Rows (v, f) at one angle, straight over the secant."""
    secant = 1 / np.cos(angles)
    place = float(np.interp(1 / math.cos(at), secant, np.arange(len(secant))))
    low = min(int(place), len(secant) - 2)
    return (1 - (place - low)) * values[low] + (place - low) * values[low + 1]


def mean(values: Floats) -> Floats:
    """Means of MEAN neighbours along the last axis."""
    count = values.shape[-1] // MEAN
    return values[..., : count * MEAN].reshape(*values.shape[:-1], count, MEAN).mean(-1)


if __name__ == "__main__":
    main()
