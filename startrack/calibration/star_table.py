"""Table of stars (CSV, FITS, VOTable) -> their directions, pixels and temperatures."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from startrack.catalog import HOURS, angle_texts, csv_table, fits_table, table_numbers, votable
from startrack.core import ZERO_CELSIUS, Floats, Refused, Unit, arcsec, deg, parse, printed, shown
from startrack.io import read_bytes, unpacked

KINDS = ("vectors", "radec", "yz", "xy")
# Names without unit, in lower case; the first name that a table has is used.
DIRECTIONS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("yz", ("y_angle", "z_angle")),
    ("yz", ("yag", "zag")),
    ("yz", ("yang", "zang")),
    ("xy", ("x_angle", "y_angle")),
    ("xy", ("angle_x", "angle_y")),
    ("xy", ("theta_x", "theta_y")),
    ("xy", ("field_x", "field_y")),
    ("xy", ("xi", "eta")),
    ("vectors", ("direction_x", "direction_y", "direction_z")),
    ("vectors", ("unit_x", "unit_y", "unit_z")),
    ("vectors", ("ux", "uy", "uz")),
    ("vectors", ("dx", "dy", "dz")),
    ("vectors", ("vx", "vy", "vz")),
    ("radec", ("ra", "dec")),
    ("radec", ("ra_icrs", "de_icrs")),
    ("radec", ("raj2000", "dej2000")),
    ("radec", ("right_ascension", "declination")),
    ("vectors", ("x", "y", "z")),
)
PIXELS = (
    ("column", "row"),
    ("col", "row"),
    ("pixel_x", "pixel_y"),
    ("x_pixel", "y_pixel"),
    ("xpix", "ypix"),
    ("px", "py"),
    ("x_centroid", "y_centroid"),
    ("xcentroid", "ycentroid"),
    ("x", "y"),
    ("u", "v"),
)
TEMPERATURES = ("camera_temperature", "temperature", "temp", "t_aca", "t_camera", "t_ccd", "t")
WEIGHTS = ("weight", "weights", "w")
SIGMAS = ("sigma", "error", "err", "uncertainty")
ARCSEC = ("yag", "zag")  # of Chandra, always in arcseconds
UNITS = {
    "arcsec": arcsec,
    "as": arcsec,
    "arcmin": 60 * arcsec,
    "mas": arcsec / 1000,
    "deg": deg,
    "degree": deg,
    "degrees": deg,
    "rad": 1.0,
    "radian": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    **dict.fromkeys((HOURS, "hr", "hour", "hours", "hourangle", "hms"), 15 * deg),
}
CELSIUS = ("c", "degc", "deg_c", "celsius")
KELVIN = ("k", "kelvin")
OTHER_UNITS = ("px", "pix", "pixel", "pixels", "unit")
SUFFIX = re.compile(
    rf"(?P<name>.+?)_(?P<unit>{'|'.join((*UNITS, *CELSIUS, *KELVIN, *OTHER_UNITS))})"
)
BINARY_TABLE = re.compile(rb"XTENSION= 'BINTABLE'")
HEADER = 80 * 36  # byte, of a block of a FITS file
LEAST_SPREAD = 0.05  # of the logarithms of scales between stars; a lens' distortion makes less
WARMEST_CELSIUS = 150.0  # a temperature without unit that is higher is in kelvin


class Names(NamedTuple):
    """Columns named by options; empty or None: found by their usual names.

    directions   two or three, each with its unit after a colon if its name has none
    kind         one of KINDS; None: by the names
    pixels       column and row
    """

    directions: tuple[str, ...] = ()
    kind: str | None = None
    pixels: tuple[str, ...] = ()
    temperature: str | None = None
    weight: str | None = None


@printed
@dataclass(frozen=True, eq=False)
class StarTable:
    """Stars of one camera at one attitude.

    direction    (n, 3) unit vectors, in the axes of the table
    pixel        (n, 2) column and row, as the table counts them
    temperature  (n,) kelvin; None: not given
    sigma        (n,) 1, of each place relative to the others
    kind         one of KINDS, the original form of the directions
    left_out     rows without a finite number in each column
    columns      names of the columns, by their use
    unused       other columns with usual names for one of these uses
    """

    direction: Floats
    pixel: Annotated[Floats, Unit("pixel")]
    temperature: Annotated[Floats | None, Unit("K")]
    sigma: Floats
    kind: str
    left_out: int = 0
    columns: Mapping[str, str] = field(default_factory=dict)
    unused: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.pixel)

    def part(self, chosen: Any) -> StarTable:
        """Some of the stars, by index or mask."""
        kelvin = None if self.temperature is None else self.temperature[chosen]
        return StarTable(
            self.direction[chosen], self.pixel[chosen], kelvin, self.sigma[chosen], self.kind
        )


def is_star_table(path: Path) -> bool:
    """Whether a file is a table, by its name or as a FITS file that begins with an empty image."""
    name = path.name.lower().removesuffix(".gz")
    if name.endswith((".csv", ".ecsv", ".vot", ".votable", ".xml")):
        return True
    if not name.endswith((".fits", ".fit", ".fts")) or not path.is_file():
        return False
    data = unpacked(path, read_bytes(path, "a table or an image"), 2)
    return data[:HEADER].find(b"NAXIS   =                    0") > 0 and bool(
        BINARY_TABLE.search(data[HEADER : 20 * HEADER])
    )


def read_star_table(path: Path, names: Names | None = None) -> StarTable:
    """Read a table of stars.

    Raises  FileNotFoundError without the file; ValueError for a file that is not a complete
            table, lacks a column, or has an unknown unit.
    """
    names = names or Names()
    columns = _columns(path)
    bare = {_bare(name)[0]: name for name in reversed(columns)}
    used: dict[str, str] = {}
    kind, chosen = _directions(path, names, bare)
    angles = [_angle(path, columns, name, kind, n == 0) for n, name in enumerate(chosen)]
    direction = _vectors(kind, angles)
    pixels = _pixels(path, names.pixels, bare, set(map(_alone, chosen)))
    pixel = np.column_stack([columns[_alone(name)].value for name in pixels])
    ra = columns[_alone(chosen[0])]
    if kind == "radec" and not ra.sexagesimal and not _unit(ra, chosen[0]):
        _refuse_other_units(path, chosen, angles, pixel)
    kelvin = _optional(names.temperature, bare, TEMPERATURES, path, "temperature")
    weight = _optional(names.weight, bare, (*WEIGHTS, *SIGMAS), path, "weight")
    for use, name in (
        *((f"direction {n + 1}", _alone(angle)) for n, angle in enumerate(chosen)),
        *zip(("column", "row"), map(_alone, pixels), strict=True),
        ("temperature", kelvin),
        ("weight", weight),
    ):
        if name:
            used[use] = _alone(name)
    temperature = None if kelvin is None else _kelvin(columns[_alone(kelvin)], kelvin)
    sigma = np.ones(len(pixel)) if weight is None else _sigma(path, columns, weight)
    given = [direction, pixel, sigma, *([] if temperature is None else [temperature])]
    good = np.isfinite(np.column_stack(given)).all(axis=1)
    if good.sum() < 4:
        raise Refused(f"{path} must have at least 4 stars with all values, got {good.sum()}")
    table = StarTable(direction, pixel, temperature, sigma, kind).part(good)
    unused = _unused(bare, names, set(used.values()))
    return replace(table, left_out=int((~good).sum()), columns=used, unused=unused)


def _unused(bare: Mapping[str, str], names: Names, used: set[str]) -> tuple[str, ...]:
    """Columns that would have had a use which no option gives, had others not come first."""
    groups = list[tuple[str, ...]]()
    if not names.directions:
        groups += [pair for kind, pair in DIRECTIONS if names.kind in (None, kind)]
    if not names.pixels:
        groups += PIXELS
    if names.temperature is None:
        groups += [(name,) for name in TEMPERATURES]
    if names.weight is None:
        groups += [(name,) for name in (*WEIGHTS, *SIGMAS)]
    others = [[bare[name] for name in group] for group in groups if set(group) <= set(bare)]
    return tuple(dict.fromkeys(name for one in others if used.isdisjoint(one) for name in one))


class _Column(NamedTuple):
    """Numbers of a column; whether they were degrees (or hours), minutes and seconds."""

    value: Floats
    unit: str
    sexagesimal: bool = False


def _columns(path: Path) -> dict[str, _Column]:
    """All columns of numbers, by their names in lower case."""
    name = path.name.lower().removesuffix(".gz")
    if name.endswith((".fits", ".fit", ".fts")):
        header, columns = fits_table(path)
        unit = {
            str(header[f"TTYPE{n}"]).lower(): str(header.get(f"TUNIT{n}", ""))
            for n in range(1, int(header["TFIELDS"]) + 1)
        }
        return {
            column: _Column(values.astype(float), unit.get(column, ""))
            for column, values in columns.items()
            if values.dtype.kind in "iuf" and values.ndim == 1
        }
    if name.endswith((".vot", ".votable", ".xml")):
        table = votable(path)
    else:  # one star with a number that was cut is an outlier
        table = csv_table(path, ended=False)
    from astropy.units import hourangle

    columns = {}
    for name in table.colnames:
        unit, kind = table[name].unit, table[name].dtype.kind
        said = HOURS if unit == hourangle else str(unit or "")  # VOTable calls it "15 deg"
        if kind in "iuf":
            columns[name] = _Column(table_numbers(path, table, name), said)
        elif kind in "US" and (angles := angle_texts(path, name, map(str, table[name]))):
            columns[name] = _Column(angles[0], angles[1] or said, sexagesimal=True)
    return columns


def _bare(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit."""
    suffix = SUFFIX.fullmatch(name)
    return (suffix["name"], suffix["unit"]) if suffix else (name, "")


def _alone(name: str) -> str:
    """The name of a column as an option gives it, without its unit."""
    return name.partition(":")[0].strip().lower()


def _directions(path: Path, names: Names, bare: Mapping[str, str]) -> tuple[str, tuple[str, ...]]:
    if names.directions:
        plain = tuple(_bare(_alone(name))[0] for name in names.directions)
        kind_of = {pair: kind for kind, pair in DIRECTIONS}
        kind = names.kind or kind_of.get(plain) or ("vectors" if len(plain) == 3 else None)
        if kind is None:
            raise Refused(
                f"the kind of directions must be given for columns {', '.join(names.directions)}: "
                f"one of {', '.join(KINDS)}"
            )
        if len(plain) != (3 if kind == "vectors" else 2):
            raise Refused(
                f"directions must be 3 columns for vectors and 2 for angles, got {len(plain)}"
            )
        return kind, _named(path, names.directions, bare, "directions")
    for kind, pair in DIRECTIONS:
        if set(pair) <= set(bare) and names.kind in (None, kind):
            return kind, tuple(bare[name] for name in pair)
    raise Refused(
        f"{path} must have columns of directions, such as ra_deg and dec_deg, y_angle_arcsec and "
        f"z_angle_arcsec, or ux, uy and uz, got {_list(bare)}"
    )


def _list(bare: Mapping[str, str]) -> str:
    return shown(", ".join(bare.values())) if bare else "no columns of numbers"


def _named(path: Path, given: Sequence[str], bare: Mapping[str, str], what: str) -> tuple[str, ...]:
    there = set(bare.values())
    for name in given:
        if _alone(name) not in there:
            raise Refused(
                f"{path} must have the column {shown(_alone(name))} of {what}, got {_list(bare)}"
            )
    return tuple(given)


def _pixels(
    path: Path, given: tuple[str, ...], bare: Mapping[str, str], taken: set[str]
) -> tuple[str, ...]:
    if given:
        if len(given) != 2:
            raise Refused(f"pixels must be 2 columns, column and row, got {len(given)}")
        return _named(path, given, bare, "pixels")
    for pair in PIXELS:
        if set(pair) <= set(bare) and not taken & {bare[name] for name in pair}:
            return tuple(bare[name] for name in pair)
    raise Refused(
        f"{path} must have columns of pixels, such as column_px and row_px, or x and y, got "
        f"{_list(bare)}"
    )


def _optional(
    given: str | None, bare: Mapping[str, str], usual: Sequence[str], path: Path, what: str
) -> str | None:
    if given == "":
        return None
    if given is not None:
        return _named(path, (given,), bare, what)[0]
    return next((bare[name] for name in usual if name in bare), None)


def _unit(column: _Column, name: str) -> str:
    """Unit by the option, the table or the name; empty if none gives it."""
    return (name.partition(":")[2].strip() or column.unit or _bare(_alone(name))[1]).strip()


def _angle(path: Path, columns: Mapping[str, _Column], name: str, kind: str, first: bool) -> Floats:
    """A column of angles in radian, or a component of a vector as it is.

    first  whether it is the first of two angles; a right ascension is the first, and only it may be
           in hours
    """
    column = columns[_alone(name)]
    if kind == "vectors":
        return column.value
    unit, hours = _unit(column, name), first and kind == "radec"
    if column.sexagesimal and not unit:
        unit = HOURS if hours else "deg"
    if not hours and UNITS.get(unit.lower()) == UNITS[HOURS]:
        raise Refused(
            f"{path}: the column {_alone(name)} must be in degree, or another unit of angles, got "
            f"{unit}; only right ascensions are in hours"
        )
    if not unit and _alone(name) in ARCSEC:
        unit = "arcsec"
    if not unit and kind == "radec":
        unit = "deg"
    if not unit:
        raise Refused(
            f"{path}: the column {_alone(name)} must have a unit, in its name "
            f"({_alone(name)}_arcsec) or by the option ({_alone(name)}:arcsec)"
        )
    if unit.lower() in UNITS:
        return column.value * UNITS[unit.lower()]
    try:
        return column.value * parse(f"1 {unit}", "rad")
    except ValueError as error:
        raise Refused(f"{path}: the column {_alone(name)} {error}") from None


def _refuse_other_units(
    path: Path, chosen: Sequence[str], angles: Sequence[Floats], pixel: Floats
) -> None:
    """Refuse places without a unit that fit the pixels as hours or radian, and not as degrees.

    The angle between two stars is nearly proportional to their distance in the image.
    """
    ra, dec = angles
    seen, name = ra[np.isfinite(ra)], _alone(chosen[0])
    if len(seen) < 4 or seen.min() < 0 or seen.max() > 24 * deg:
        return
    distance = np.linalg.norm(np.diff(pixel, axis=0), axis=1)

    def spread(*places: Floats) -> float:
        chord = np.linalg.norm(np.diff(_vectors("radec", places), axis=0), axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):  # of equal or missing places
            ratio = np.log(chord / distance)
        return float(np.std(ratio[np.isfinite(ratio)]))

    as_degrees, unit = spread(ra, dec), ""
    if as_degrees > LEAST_SPREAD and spread(15 * ra, dec) < as_degrees / 2:
        unit = "hours"
    elif seen.max() <= 2 * math.pi * deg and spread(ra / deg, dec / deg) < as_degrees / 2:
        unit = "radian"
    if unit:
        raise Refused(
            f"{path}: the column {name} must have a unit, in its name ({name}_deg, {name}_hours, "
            f"{name}_rad) or by the option ({name}:h): its values, up to {seen.max() / deg:.4g}, "
            f"fit the pixels as {unit} and not as degrees"
        )


def _vectors(kind: str, values: Sequence[Floats]) -> Floats:
    """Unit vectors (n, 3) of angles in radian, or of vectors of any length."""
    if kind == "vectors":
        vector = np.column_stack(values)
    elif kind == "radec":
        ra, dec = values
        vector = np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    else:
        first, second = np.tan(values[0]), np.tan(values[1])
        ones = np.ones(len(first))
        order = (ones, first, second) if kind == "yz" else (first, second, ones)
        vector = np.column_stack(order)
    with np.errstate(invalid="ignore", divide="ignore"):
        return vector / np.linalg.norm(vector, axis=1, keepdims=True)


def angles_of(kind: str, direction: Floats) -> Floats:
    """The two angles (n, 2) of unit vectors (n, 3), radian, of the kind in the table.

    For a table of vectors they are right ascension and declination.
    """
    x, y, z = direction.T
    if kind == "yz":
        return np.column_stack([np.arctan2(y, x), np.arctan2(z, x)])
    if kind == "xy":
        return np.column_stack([np.arctan2(x, z), np.arctan2(y, z)])
    return np.column_stack([np.arctan2(y, x), np.arcsin(np.clip(z, -1, 1))])


def _kelvin(column: _Column, name: str) -> Floats:
    unit = _unit(column, name).lower()
    value = column.value
    if unit in KELVIN:
        return value
    if unit in CELSIUS or not np.nanmedian(value) > WARMEST_CELSIUS:
        return value + ZERO_CELSIUS
    return value


def _sigma(path: Path, columns: Mapping[str, _Column], name: str) -> Floats:
    """Relative sigma (n,) of a column of weights, which are inverse variances, or of sigma."""
    value = columns[_alone(name)].value
    if not (value[np.isfinite(value)] > 0).all():
        raise Refused(f"{path}: {_alone(name)} must be positive, got {np.nanmin(value):g}")
    sigma = value if _bare(_alone(name))[0] in SIGMAS else 1 / np.sqrt(value)
    return np.asarray(sigma / np.nanmedian(sigma))
