"""RadianceTable: a user's table of the air, over wavelength and geometry, and its file."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from startrack.core import Floats, Refused, deg, parse, positive, printed, um
from startrack.earth.atmosphere.table import AirTable, BandTable, load_table, require_response
from startrack.io import content, csv_table, first_line, read_bytes, require_fits

WHAT = "a table of the air"
RADIANCE = "W / (m2 sr m)"


class GeometryAxis(NamedTuple):
    """A column of the geometry.

    unit     SI unit of its values
    whole    range of validity of a table without this column
    around   half range of validity of a table with a single value
    highest  largest allowed value
    """

    unit: str
    whole: tuple[float, float]
    around: float
    highest: float


WIDE = 89 * deg
SPACE = 100e3  # metre; a table does not depend on an altitude above it
AXES = {
    "height": GeometryAxis("m", (-500.0, 9e3), 100.0, 9e3),
    "altitude": GeometryAxis("m", (1.0, SPACE), 100.0, 1e12),
    "sensor_zenith": GeometryAxis("rad", (0.0, WIDE), 1 * deg, WIDE),
    "sun_zenith": GeometryAxis("rad", (0.0, WIDE), 1 * deg, WIDE),
    "azimuth": GeometryAxis("rad", (0.0, math.pi), 5 * deg, math.pi),
}
# Unit of each column of values; columns of the second row are transmittances and albedos.
LIGHT = ("path", "direct", "sky", "around")
RATIOS = ("backscatter", "through")
HEAT = ("rise", "fall")
UNITS = dict.fromkeys((*LIGHT, *HEAT), RADIANCE) | dict.fromkeys(RATIOS, "")
FEWEST = 3  # least number of wavelengths of a table
BLOCK, BUILT = 2880, b"TABLE   ="  # byte of a FITS header; its keyword in a built table
HEADING = re.compile(r"(\w+)\s*(?:\[([^\]]*)\])?")


@printed
@dataclass(frozen=True, eq=False)
class RadianceTable:
    """Spectral radiance at a sensor, from a program of radiative transfer.

    The Sun is at one astronomical unit. Each array of values is (h, a, v, s, p, f).

    spectrum   (f,) metre, rising
    height     (h,) metre of the ground above the sea
    altitude   (a,) metre of the sensor above the ground, at most 100 km, which is above the air
    sensor     (v,) radian, zenith angle of the sensor
    sun        (s,) radian, zenith angle of the Sun
    azimuth    (p,) radian, between both; 0 for the same side
    path       watt / m^2 / sr / m, sunlight that the air scatters over black ground
    direct     likewise, from white level ground in the direct beam alone
    sky        likewise, in the diffuse light alone
    around     likewise, light of surrounding white ground that the air scatters into the line of
               sight
    backscatter  1, spherical albedo of the air
    through    1, direct transmittance from ground to sensor
    rise       watt / m^2 / sr / m, thermal radiance of the air towards the sensor
    fall       likewise, thermal radiance of the sky that white ground reflects to the sensor; both
               None if not given
    """

    spectrum: Floats
    height: Floats
    altitude: Floats
    sensor: Floats
    sun: Floats
    azimuth: Floats
    path: Floats
    direct: Floats
    sky: Floats
    around: Floats
    backscatter: Floats
    through: Floats
    rise: Floats | None = None
    fall: Floats | None = None


def load_user_table(path: Path) -> AirTable | RadianceTable:
    """A table named by a scene: from any program, or in the format of the shipped tables.

    Raises  ValueError as `load_radiance_table` and `load_table`.
    """
    head = read_bytes(path, WHAT)[:BLOCK]
    if head.startswith(b"SIMPLE") and BUILT in head:
        return load_table(path)
    return load_radiance_table(path)


def load_radiance_table(path: Path) -> RadianceTable:
    """Read a CSV file with units in brackets, an ECSV file or a FITS table with units.

    A row is one wavelength in one geometry; every geometry must have every wavelength. If a column
    of the geometry is left out, nothing depends on it.

    Raises  FileNotFoundError; ValueError if a column is missing or unknown, has another unit or has
            values out of range, or if rows are missing. The message names the file and the column,
            or the geometry of the missing rows.
    """
    columns = _columns(path)
    _refuse_unknown(path, columns)
    values = {
        name: _in_si(path, name, *given, "m" if name == "wavelength" else _unit(name))
        for name, given in columns.items()
    }
    _check_ranges(path, values)
    if "altitude" in values:
        values["altitude"] = np.minimum(values["altitude"], SPACE)
    names = [name for name in AXES if name in values]
    nodes = [np.unique(values[name]) for name in names]
    spectrum = np.unique(values["wavelength"])
    shape = (*(len(axis) for axis in nodes), len(spectrum))
    places = [
        np.searchsorted(axis, values[name])
        for name, axis in zip([*names, "wavelength"], [*nodes, spectrum], strict=True)
    ]
    cells = np.ravel_multi_index(tuple(places), shape)
    _require_all(path, cells, names, nodes, spectrum)
    axes, widths = list[Floats](), list[int]()
    for name, about in AXES.items():
        own = nodes[names.index(name)] if name in names else np.array(about.whole)
        if len(own) == 1:
            own = own[0] + about.around * np.array([-1.0, 1.0])
        axes.append(own)
        widths.append(len(own))
    arrays = {}
    for name in UNITS:
        if name not in values:
            continue
        array = np.empty(len(cells))
        array[cells] = values[name]
        array = array.reshape(
            [len(nodes[names.index(axis)]) if axis in names else 1 for axis in AXES]
            + [len(spectrum)]
        )
        arrays[name] = np.ascontiguousarray(np.broadcast_to(array, (*widths, len(spectrum))))
    return RadianceTable(spectrum, *axes, **arrays)


def radiance_bands(
    table: RadianceTable, response: Floats, altitude: float, distance: float = 1.0
) -> BandTable:
    """Weight the spectrum with the response of each band.

    response  (b, f), as for `in_bands`, over table.spectrum
    altitude  metre, of the sensor above the ground
    distance  astronomical unit, of the Sun
    Raises    ValueError if the altitude of the sensor is outside the table.
    Accuracy  numerical: sums over the table's wavelengths, linear over the altitude.
    """
    positive(altitude=altitude, distance=distance)
    require_response(response, table.spectrum)
    low, high = table.altitude[[0, -1]]
    altitude = min(altitude, SPACE)
    if not low <= altitude <= high:
        raise Refused(
            f"altitude of the sensor above the ground must lie in the table's {low:g} to {high:g} "
            f"m, got {altitude:g} m"
        )
    at = np.interp(altitude, table.altitude, np.arange(len(table.altitude)))
    below = min(int(at), len(table.altitude) - 2)
    weights = response * np.gradient(table.spectrum)
    sums = weights.sum(1)

    def banded(name: str) -> Floats:
        """Array (h, v, s, p, b) of a term in bands."""
        values = getattr(table, name)
        here = values[:, below] * (1 - (at - below)) + values[:, below + 1] * (at - below)
        return np.asarray(here @ weights.T)

    path, direct, sky, around = (banded(name) / distance**2 for name in LIGHT)
    mirrored, through = (banded(name)[:, :, 0, 0] / sums for name in RATIOS)
    rise, fall = (None if table.rise is None else banded(name)[:, :, 0, 0] for name in HEAT)
    return BandTable(
        height=table.height,
        sensor=table.sensor,
        sun=table.sun,
        azimuth=table.azimuth,
        path=path,
        direct=direct[:, :, :, 0],
        sky=sky[:, :, :, 0],
        around=around[:, :, :, 0],
        backscatter=mirrored[:, 0],
        through=through,
        rise=rise,
        fall=fall,
    )


def _unit(name: str) -> str:
    return AXES[name].unit if name in AXES else UNITS[name]


def _columns(path: Path) -> dict[str, tuple[Any, str]]:
    """Values and unit of each column, by its name in lower case."""
    if path.suffix.lower() in (".fits", ".fit"):
        return _fits_columns(path)
    table = csv_table(path, what=WHAT)
    if any(table[name].unit is not None for name in table.colnames):
        return {name: (table[name], str(table[name].unit or "")) for name in table.colnames}
    text = content(path, WHAT).splitlines()
    head = next(line for line in text if line.strip() and line[0] != "#")
    written = {name.lower(): unit for name, unit in HEADING.findall(head)}
    columns = {}
    for name in table.colnames:
        bare = name.partition("[")[0].strip().strip('"')
        columns[bare] = table[name], written.get(bare, "").strip()
    return columns


def _fits_columns(path: Path) -> dict[str, tuple[Any, str]]:
    from astropy.io import fits

    data = read_bytes(path, WHAT)
    require_fits(path, data)
    try:
        with warnings.catch_warnings(action="error"), fits.open(BytesIO(data)) as parts:
            rows, about = parts[1].data, parts[1].columns
            return {one.name.lower(): (np.array(rows[one.name]), one.unit or "") for one in about}
    except MemoryError:
        raise
    except Exception as error:  # each parser raises different errors
        raise Refused(
            f"{path} must have a table in its first extension, got: {first_line(error)}"
        ) from None


def _refuse_unknown(path: Path, columns: dict[str, Any]) -> None:
    known = ["wavelength", *AXES, *UNITS]
    needed = ["wavelength", *LIGHT, *RATIOS]
    if ("rise" in columns) != ("fall" in columns):
        needed += HEAT
    for name in columns:
        if name not in known:
            raise Refused(f"{path}: a column must be one of {', '.join(known)}, got {name!r}")
    if missing := [name for name in needed if name not in columns]:
        raise Refused(f"{path} must have the columns {', '.join(needed)}, has no {missing[0]}")


def _in_si(path: Path, name: str, values: Any, given: str, unit: str) -> Floats:
    try:
        numbers = np.ma.filled(np.ma.asarray(values, float), math.nan).astype(float)
    except (TypeError, ValueError):
        raise Refused(f"{path}, column {name}: values must be numbers") from None
    if not np.isfinite(numbers).all():
        row = int(np.argmin(np.isfinite(numbers))) + 1
        raise Refused(
            f"{path}, column {name}: values must be finite, but row {row} has one that is not"
        )
    if not unit:
        if given not in ("", "1"):
            raise Refused(f"{path}, column {name}: must have no unit, got {given!r}")
        return numbers
    try:
        return numbers * parse(f"1 {given}", unit)
    except Refused:
        raise Refused(
            f"{path}, column {name}: must have a unit that converts to {unit}, got {given!r}"
        ) from None


def _check_ranges(path: Path, values: dict[str, Floats]) -> None:
    limits = {"wavelength": (0.2 * um, 50 * um)}
    limits |= {name: (about.whole[0], about.highest) for name, about in AXES.items()}
    limits |= dict.fromkeys(UNITS, (0.0, math.inf)) | dict.fromkeys(RATIOS, (0.0, 1.0))
    for name, own in values.items():
        low, high = limits[name]
        slack = 1e-9 * max(abs(low), 1e-9)
        outside = (own < low - slack) | (own > high * (1 + 1e-9))
        if outside.any():
            unit = "m" if name == "wavelength" else _unit(name)
            raise Refused(
                f"{path}, column {name}: values must lie in [{low:g}, {high:g}] {unit}, that of "
                f"row {int(np.argmax(outside)) + 1} is {own[outside][0]:g}"
            )


def _require_all(
    path: Path, cells: Any, names: list[str], nodes: list[Floats], spectrum: Floats
) -> None:
    """Refuse a table in which a geometry is missing or repeated."""
    shape = (*(len(axis) for axis in nodes), len(spectrum))
    if len(spectrum) < FEWEST:
        raise Refused(f"{path} must have {FEWEST} wavelengths or more, got {len(spectrum)}")
    count = np.bincount(cells, minlength=math.prod(shape))
    wrong = np.flatnonzero(count != 1)
    if len(wrong):
        *where, last = np.unravel_index(wrong[0], shape)
        place = [
            f"{name} {axis[n] / deg if AXES[name].unit == 'rad' else axis[n]:g} "
            f"{'deg' if AXES[name].unit == 'rad' else 'm'}"
            for name, axis, n in zip(names, nodes, where, strict=True)
        ]
        shown = ", ".join([f"wavelength {spectrum[last] / um:g} um", *place])
        raise Refused(
            f"{path} must have each wavelength once in each geometry, has {shown} "
            f"{count[wrong[0]]} times"
        )
