"""Columns in the units that catalogues print enter; a checked Catalog leaves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from startrack.catalog.catalog import Catalog
from startrack.units import arcsec, deg
from startrack.values import Floats, Ints

MAS = arcsec / 1000


def assemble(
    path: Path,
    epoch: float,
    identifier: Ints,
    ra_deg: Floats,
    dec_deg: Floats,
    pm_ra_mas: Floats,
    pm_dec_mas: Floats,
    parallax_mas: Floats,
    magnitude_g: Floats,
    colour: Floats,
    line: Sequence[int] | None = None,
) -> Catalog:
    """A Catalog from columns (n,) as a file has them.

    path                   the file, for messages
    epoch                  Julian year of the positions
    identifier             as in Catalog
    ra_deg, dec_deg        degree
    pm_ra_mas, pm_dec_mas  mas / yr, with cos(declination); NaN where unknown
    parallax_mas           mas, NaN where unknown
    magnitude_g, colour    magnitude
    line                   the number in the file of each star's line, to name a bad one
    Returns                the catalogue; an unknown proper motion and parallax become zero
    Errors                 ValueError without stars, and where a position is none.
    """
    if len(identifier) == 0:
        raise ValueError(f"{path} must hold stars, got none")
    # NaN fails every comparison, so this catches what is not finite too.
    good = (ra_deg >= 0) & (ra_deg <= 360) & (np.abs(dec_deg) <= 90)
    if not good.all():
        i = int(np.argmin(good))
        where = f"line {line[i]}" if line is not None else f"row {i + 1}"
        raise ValueError(
            f"{path}, {where}: the position must lie in [0, 360] x [-90, 90] deg, "
            f"got {ra_deg[i]}, {dec_deg[i]}"
        )
    known = np.isfinite(pm_ra_mas) & np.isfinite(pm_dec_mas)
    return Catalog(
        identifier=np.asarray(identifier, np.int64),
        right_ascension=np.asarray(ra_deg, float) * deg,
        declination=np.asarray(dec_deg, float) * deg,
        epoch=epoch,
        pm_ra=np.where(known, pm_ra_mas, 0.0) * MAS,
        pm_dec=np.where(known, pm_dec_mas, 0.0) * MAS,
        proper_motion_known=known,
        parallax=np.where(np.isfinite(parallax_mas), parallax_mas, 0.0) * MAS,
        magnitude_g=np.asarray(magnitude_g, float),
        colour=np.asarray(colour, float),
    )
