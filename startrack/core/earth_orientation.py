"""Files of Earth orientation that are installed with astropy -> what astropy turns axes by."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core.dates import installed_tables

# First and last column of a line of `finals2000A.all`, counted from 1, as its ReadMe has them.
MJD = 8, 15
BULLETIN_A = ((19, 27), (38, 46), (59, 68), (98, 106), (117, 125))  # x, y, UT1 - UTC, dX, dY
UT1_OF_B = 155, 165
SERIES = (4, 5, 6, 7, 8, 9)  # MJD, x, y, UT1 - UTC, dX, dY among the numbers of `eopc04`
UNITS = ("d", "arcsec", "arcsec", "s", "marcsec", "marcsec")
NAMES = ("MJD", "PM_x", "PM_y", "UT1_UTC", "dX_2000A", "dY_2000A")


@contextmanager
def earth_axes() -> Iterator[None]:
    """As `installed_tables`, for what is converted to UT1 or to the Earth's axes.

    Astropy would find the same numbers, but take a second of each process to read them.
    """
    from astropy.utils import iers

    with installed_tables(), iers.earth_orientation_table.set(earth_orientation()):
        yield


@cache
def earth_orientation() -> Any:
    """The installed Earth orientation by day: all that `IERS_Auto.open()` computes with.

    Bulletin A and its predictions; where there is a Bulletin B, the series EOP C04 instead.
    """
    from astropy import units
    from astropy.utils import iers

    lines = np.array(Path(iers.IERS_A_FILE).read_bytes().splitlines())
    letters = lines.view("S1").reshape(len(lines), -1)
    table = np.stack([_numbers(letters, *one) for one in (MJD, *BULLETIN_A)])
    final = table[0, np.isfinite(_numbers(letters, *UT1_OF_B))]
    table = table[:, np.isfinite(table[1:4]).all(axis=0)]  # the last lines hold but their day
    series = np.loadtxt(iers.IERS_B_FILE, usecols=SERIES).T
    series = series[:, (series[0] >= final[0]) & (series[0] <= final[-1])]
    series[-2:] *= units.arcsec.to(units.marcsec)
    table[:, : series.shape[1]] = series
    columns = (units.Quantity(one, unit) for one, unit in zip(table, UNITS, strict=True))
    return iers.IERS(list(columns), names=NAMES)


def _numbers(letters: NDArray[np.bytes_], first: int, last: int) -> NDArray[np.float64]:
    """Those in some columns of all lines; NaN where these are empty."""
    found = np.ascontiguousarray(letters[:, first - 1 : last]).view(f"S{last - first + 1}")[:, 0]
    found = np.char.strip(found)
    return np.where(found == b"", b"nan", found).astype(float)
