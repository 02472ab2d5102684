"""AirTable: radiation over wavelength and geometry, and its file; BandTable: the same in bands."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from startrack import core
from startrack.core import (
    FILE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    positive,
    printed,
)
from startrack.io import open_checked

KOSCHMIEDER = 3.912  # ln 50: a contrast of 2 %
AIR_AT_GROUND = 1.16e-5  # 1 / m, Rayleigh extinction at 550 nm and sea level
# Extinction at 550 nm over height, 1 / km: columns for a visibility of 50, 23, 10, 5 and 2 km
# in the lowest three, then spring and summer, then a background stratosphere.
# Source: Shettle and Fenn (1979), table 4; as LOWTRAN 7 has them, AFGL-TR-88-0177.
VISIBILITIES: Floats = np.array([50.0, 23, 10, 5, 2]) * 1e3
LOW: Floats = np.array([
    [6.62e-2, 1.58e-1, 3.79e-1, 7.70e-1, 1.94],
    [4.15e-2, 9.91e-2, 3.79e-1, 7.70e-1, 1.94],
    [2.60e-2, 6.21e-2, 6.21e-2, 6.21e-2, 6.21e-2],
])  # fmt: skip
MIDDLE_HAZY = (3.46e-2, 1.85e-2)  # at 3 and 4 km for 23 km and less
MIDDLE_CLEAR = (1.46e-2, 1.02e-2)  # for 50 km
HIGH = (
    *(9.31e-3, 7.71e-3, 6.23e-3, 3.37e-3, 1.82e-3, 1.14e-3, 7.99e-4, 6.41e-4, 5.17e-4),
    *(4.42e-4, 3.95e-4, 3.82e-4, 4.25e-4, 5.20e-4, 5.81e-4, 5.89e-4, 5.02e-4, 4.20e-4),
    *(3.00e-4, 1.98e-4, 1.31e-4, 3.32e-5, 1.64e-5, 7.99e-6, 4.01e-6, 2.10e-6, 1.60e-7),
    9.31e-10,
)
SPARSE = 25e3  # metre; steps are 5 km and more above
HEIGHT: Floats = np.array([*range(26), 30, 35, 40, 45, 50, 70, 100], np.float64) * 1e3


def profile(visibility: float, height: Floats) -> Floats:
    """Extinction of the aerosol at 550 nm.

    visibility  metre
    height      (n,) metre above the sea
    Returns     (n,) 1 / metre
    Accuracy    model: Shettle and Fenn's profiles; linear in 1 / visibility and over height,
                exponential over height where their steps are wide.
    """
    inverse = 1 / np.array([visibility])
    low = [np.interp(inverse, 1 / VISIBILITIES, row)[0] for row in LOW]
    if visibility > VISIBILITIES[0]:
        ground = KOSCHMIEDER / visibility - AIR_AT_GROUND
        low = list(LOW[:, 0] * ground / (KOSCHMIEDER / VISIBILITIES[0] - AIR_AT_GROUND))
    clear = np.interp(inverse, 1 / VISIBILITIES[1::-1][::-1], (0.0, 1.0))[0]
    middle = np.array(MIDDLE_CLEAR) * (1 - clear) + np.array(MIDDLE_HAZY) * clear
    table = np.array([*low, *middle, *HIGH])
    straight = np.interp(height, HEIGHT, table, right=0.0)
    bent = np.exp(np.interp(height, HEIGHT, np.log(table)))
    return np.where((height > SPARSE) & (height <= HEIGHT[-1]), bent, straight) / 1e3


AEROSOLS = ("none", "rural", "urban", "maritime")
# Columns of water, kg / m^2, and ozone, metre at standard conditions: integrals of the profiles of
# AFGL's model atmospheres, Anderson et al. (1986), AFGL-TR-86-0110, exponential in each layer.
SUMMER = "midlatitude summer"
CLIMATES = {
    "tropical": (41.2, 2.82e-3),
    SUMMER: (29.2, 3.32e-3),
    "midlatitude winter": (8.52, 3.78e-3),
    "subarctic summer": (20.8, 3.48e-3),
    "subarctic winter": (4.16, 3.76e-3),
    "us standard": (14.2, 3.44e-3),
}
FORMAT = 2  # format of the file; format 1 had no spread
# Scale heights, metre, for the fraction of a gas below a height. Water: 2 km, as Bird and Riordan;
# mixed gases: as the air; ozone: evenly between two heights, chosen by hand.
WATER_SCALE, AIR_SCALE = 2e3, 8e3
OZONE_FROM, OZONE_TO = 12e3, 35e3
TINY = 1e-300
SPREADS: Floats = 20.0 * np.sqrt(10.0) ** np.arange(7.0)  # metre, rms widths of the Gaussians
# fraction of the water that light scattered by the air crosses (as 6S)
WATER_ABOVE_SCATTERING = 0.5


class Air(Parameters):
    """One state of the atmosphere; the defaults are a clear day in mid-latitude summer."""

    aerosol: str = parameter(
        'type of Shettle and Fenn (1979) below 100 km, or "none" for molecules alone; bands beyond '
        "3 um have rural aerosol with a visibility of 23 km, whatever is given here",
        limit=Range(choices=AEROSOLS),
        default="rural",
    )
    visibility: float = parameter(
        "meteorological range at the ground, where contrast falls to 2 %",
        unit=Unit("m", "km"),
        limit=Range(2e3, 150e3),
        default=23e3,
    )
    water: float | None = parameter(
        "column of water vapour above the sea, in place of the climate's",
        unit=Unit("kg / m2"),
        limit=Range(0.5, 80),
        default=None,
    )
    ozone: float | None = parameter(
        "column of pure ozone at standard conditions, in place of the climate's; 1e-5 m "
        "is a Dobson unit",
        unit=Unit("m", "mm"),
        limit=Range(1e-4, 1e-2),
        default=None,
    )
    climate: str = parameter(
        "model atmosphere of AFGL (Anderson et al. 1986), which gives the columns of water and "
        "ozone; bands beyond 3 um always use midlatitude summer",
        limit=Range(choices=tuple(CLIMATES)),
        default=SUMMER,
    )
    table: str = parameter(
        "path, relative to the scene file, of a user's table (FITS, ECSV or CSV) from MODTRAN, "
        "6S, libRadtran or another program (see docs/own-air.md); the other keys must then be "
        "left out",
        limit=FILE,
        default="",
    )
    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.table and replace(self, table="") != Air():
            raise Refused("the other keys must be left out if table is given")

    @property
    def columns(self) -> tuple[float, float]:
        """Columns of water, kilogram / square metre, and ozone, metre at standard conditions."""
        water, ozone = CLIMATES[self.climate]
        return (
            water if self.water is None else self.water,
            ozone if self.ozone is None else self.ozone,
        )


@printed
@dataclass(frozen=True, eq=False)
class AirTable:
    """Radiation in plane layers over a Lambert surface; absorption by gases is kept apart.

    air          state of the atmosphere
    wavelength   (k,) metre, nodes of scattering
    height       (h,) metre of the ground above the sea
    altitude     (a,) metre of the sensor above the ground; the last is above the air
    sensor       (v,) radian, zenith angle of the sensor
    sun          (s,) radian, zenith angle of the Sun
    azimuth      (p,) radian, between Sun and sensor as the ground sees them; 0 for the same side
    path         (k, h, a, v, s, p) 1 / sr, radiance of the air over a black ground, over the
                 Sun's irradiance
    beam         (k, h, s) 1, direct transmittance of sunlight to the ground
    skylight     (k, h, s) 1, irradiance of the sky over a black ground, over the Sun's
    seen         (k, h, a, v) 1, direct transmittance from ground to sensor
    around       (k, h, a, v) 1, diffuse transmittance of light from the surrounding ground
    backscatter  (k, h) 1, spherical albedo of the air from below
    spread       (k, h, a, g) 1, weights of Gaussians of SPREADS over the ground that make up
                 `around`, for a vertical line of sight
    returned     (k, h, g) 1, likewise for `backscatter`
    spectrum     (f,) metre
    irradiance   (f,) watt / m^2 / m, irradiance of the Sun at one astronomical unit
    mass         (m,) 1, air masses
    gas          (3, f, m) 1, transmittance of water, mixed gases and ozone of the whole column
    """

    air: Air
    wavelength: Floats
    height: Floats
    altitude: Floats
    sensor: Floats
    sun: Floats
    azimuth: Floats
    path: Floats
    beam: Floats
    skylight: Floats
    seen: Floats
    around: Floats
    backscatter: Floats
    spread: Floats
    returned: Floats
    spectrum: Floats
    irradiance: Floats
    mass: Floats
    gas: Floats


ARRAYS = tuple(field.name for field in fields(AirTable) if field.name != "air")


def load_table(path: Path) -> AirTable:
    """Read a table.

    Raises  FileNotFoundError; ValueError if the file is not a table of the air, has another
            format, or is damaged (wrong checksums).
    """
    with open_checked(path, "TABLE", FORMAT, "a table of the air") as parts:
        head = parts[0].header
        air, columns = Air(head["AEROSOL"], head["VISIBIL"]), (head["WATER"], head["OZONE"])
        if columns != air.columns:
            air = replace(air, water=columns[0], ozone=columns[1])
        arrays = {name: parts[name].data.astype(np.float64) for name in ARRAYS}
    return AirTable(air, **arrays)


def mixed(air: Air, tables: Sequence[AirTable]) -> AirTable:
    """The table for another visibility, from tables that differ in visibility alone, clearest
    first.

    Logarithms of direct transmittances, and of the fraction of light from each Gaussian, are
    interpolated to match the aerosol's optical depths below and above 2 km. Logarithms of total
    transmittances, and scattered light, follow parabolas over 1 - exp(-d / 2); d is the aerosol's
    depth.

    Accuracy  model: differences from the solver, for visibilities of 8 to 120 km. Seen from space:
              light of the air 2 % straight down with the Sun up to 60 degree from the zenith, 8 %
              on slant paths; transmittances to the sensor 0.5 %, from Sun and sky 2 %. Seen from 5
              km: light of the air 6 % in haze, 40 % at a visibility of 120 km. Two tables are
              interpolated linearly, from 23 to 150 km.
    """
    height = np.arange(50.0, 100e3, 100.0)  # centres of layers of 100 m
    depth = 100 * np.array(
        [
            profile(own.visibility, height) * (own.aerosol != "none")
            for own in (*(table.air for table in tables), air)
        ]
    )
    low, high = depth[:, height < LAYER].sum(1), depth[:, height >= LAYER].sum(1)
    sums = [low, high] if len(tables) > 2 else [low + high]  # two tables cannot match both
    known = np.array([*sums, np.ones(len(low))])
    layered = np.linalg.solve(known[:, :-1], known[:, -1])
    bend = -np.expm1(-(low + high) / 2)
    bent = core.lagrange_weights(bend[:-1], bend[-1:])[0]
    forms, made = [_form(table) for table in tables], dict[str, Floats]()
    for name in ARRAYS:
        weights = layered if name in ("seen", "beam", "spread") else bent
        mean = np.tensordot(weights, [form[name] for form in forms], 1)
        made[name] = np.exp(mean) if name in LOGARITHMS else mean
    seen, total = (made[name][..., :1] for name in ("seen", "around"))
    made["spread"] = np.diff(made["spread"] * total, prepend=seen) / (total - seen)
    made["around"] -= made["seen"]
    made["skylight"] = (made["skylight"] - made["beam"]) * np.cos(tables[0].sun)
    made["returned"] /= made["backscatter"][..., None]
    made = {name: np.maximum(values, 0) for name, values in made.items()}
    for name in ("spread", "returned"):  # for sensors within the air, where layers differ more
        made[name] /= np.maximum(made[name].sum(-1, keepdims=True), 1)
    return AirTable(air, **made)


LAYER = 2e3  # metre; the visibility sets the aerosol below
LOGARITHMS = "seen", "beam", "around", "skylight", "spread"


def _form(table: AirTable) -> dict[str, Floats]:
    """The arrays of a table in the form for interpolation."""
    total, straight = table.seen + table.around, table.seen[..., :1]
    within = straight + table.around[..., :1] * np.cumsum(table.spread, -1)
    form = {name: getattr(table, name) for name in ARRAYS} | {
        "around": total,
        "skylight": table.beam + table.skylight / np.cos(table.sun),
        "spread": within / total[..., :1],
        "returned": table.returned * table.backscatter[..., None],
    }
    return form | {name: np.log(np.maximum(form[name], TINY)) for name in LOGARITHMS}


@printed
@dataclass(frozen=True, eq=False)
class BandTable:
    """Terms of the radiance in bands, over geometry, for one altitude of the sensor.

    height, sensor, sun, azimuth  as in AirTable
    path         (h, v, s, p, b) watt / m^2 / sr, air alone
    direct       (h, v, s, b) watt / m^2 / sr, white horizontal ground in the direct beam alone
    sky          (h, v, s, b) watt / m^2 / sr, white horizontal ground in the diffuse light alone
    around       (h, v, s, b) watt / m^2 / sr, surrounding white ground, in both
    backscatter  (h, b) 1, spherical albedo
    through      (h, v, b) 1, direct transmittance from ground to sensor, lines of gases
                 included
    rise         (h, v, b) watt / m^2 / sr, thermal radiance of the air towards the sensor
    fall         (h, v, b) watt / m^2 / sr, thermal radiance of the sky that white ground reflects
                 to the sensor; both None where `radiance` assumes isothermal air
    spread       (2, h, b, g) 1, weights of Gaussians over the ground, for `around` and for
                 `backscatter`; None without scattering
    """

    height: Floats
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
    spread: Floats | None = None


def in_bands(
    table: AirTable, response: Floats, altitude: float, distance: float = 1.0
) -> BandTable:
    """Weight the spectrum with the response of each band.

    Transmittances are multiplied before the average over a band, so that spectral lines and slopes
    within it are kept.

    response  (b, f) 1 / metre or 1 over table.spectrum: the band's radiance is the integral of
              response times spectral radiance
    altitude  metre, of the sensor above the ground
    distance  astronomical unit, of the Sun
    Returns   BandTable; unit: watt / m^2 / sr times the unit of `response` times metre
    Raises    ValueError if no response lies inside the table's spectrum, or the sensor on the
              ground.
    Accuracy  model: below the table's lowest altitude the air below the sensor is reduced in
              proportion. At 500 m, with a lowest altitude of 2 km, its light is 10 to 20 % low,
              because haze is densest near the ground. numerical: a cubic spline over the logarithm
              of wavelength and altitude.
    """
    positive(altitude=altitude, distance=distance)
    flat = response * np.gradient(table.spectrum)
    weights = flat * table.irradiance / distance**2
    require_response(weights, table.spectrum)
    used = np.flatnonzero(weights.any(0))
    weights, flat, at = weights[:, used], flat[:, used], np.log(table.spectrum[used])
    position = np.log(np.clip(altitude, *table.altitude[[0, -1]]))
    thin = min(altitude / float(table.altitude[0]), 1.0)

    across = _spline(np.log(table.wavelength), at)  # (f, k)
    here = _spline(np.log(table.altitude), np.array([position]))[0]  # (a,)

    def fine(values: Floats) -> Floats:
        """(k, ...) -> (..., f)."""
        return np.tensordot(values, across, (0, 1))

    gas = np.log(np.maximum(table.gas[:, used], 1e-12))
    seen, around, spectral_path = (
        np.tensordot(values, here, (2, 0)) for values in (table.seen, table.around, table.path)
    )
    seen, around, spectral_path = fine(seen) ** thin, fine(around) * thin, spectral_path * thin
    beam, skylight, mirrored = fine(table.beam), fine(table.skylight), fine(table.backscatter)
    cosine = np.cos(table.sun)
    shape = len(table.height), len(table.sensor), len(table.sun)
    direct, sky, spread = np.empty((3, *shape, len(weights)))
    path = np.empty((*shape, len(table.azimuth), len(weights)))
    for h, v, s in np.ndindex(shape):
        through, halfway = _gases(table, gas, h, v, s, altitude)
        lit = weights * through / math.pi
        direct[h, v, s] = lit @ (cosine[s] * beam[h, s] * seen[h, v])
        sky[h, v, s] = lit @ (skylight[h, s] * seen[h, v])
        spread[h, v, s] = lit @ ((cosine[s] * beam[h, s] + skylight[h, s]) * around[h, v])
        path[h, v, s] = (((weights * halfway) @ across) @ spectral_path[:, h, v, s]).T
    transmittance = np.empty((*shape[:2], len(weights)))
    for h, v in np.ndindex(shape[:2]):
        masses = _masses(table, h, v, altitude)
        transmittance[h, v] = flat @ (seen[h, v] * _transmitted(table, gas, masses)) / flat.sum(-1)
    spreads = _spread(table, weights, across, here, (around[:, 0], mirrored))
    return BandTable(
        height=table.height,
        sensor=table.sensor,
        sun=table.sun,
        azimuth=table.azimuth,
        path=path,
        direct=direct,
        sky=sky,
        around=spread,
        backscatter=mirrored @ weights.T / weights.sum(-1),
        through=transmittance,
        spread=spreads,
    )


def _spread(
    table: AirTable, weights: Floats, across: Floats, here: Floats, light: tuple[Floats, Floats]
) -> Floats:
    """Weights (2, h, b, g) of Gaussians, averaged over the light (h, f) of each kind."""
    kinds = np.einsum("khag,a->khg", table.spread, here), table.returned
    out = []
    for gaussians, own in zip(kinds, light, strict=True):
        band = (weights[None] * own[:, None]) @ across  # (h, b, k)
        band /= np.maximum(band.sum(-1, keepdims=True), TINY)
        out.append(np.clip(np.einsum("hbk,khg->hbg", band, gaussians), 0, 1))
    return np.array(out)


def require_response(weights: Floats, spectrum: Floats) -> None:
    """Refuse bands (b, f) without response in a spectrum (f,) in metre."""
    if not (weights.any(-1).all() and np.isfinite(weights).all()):
        low, high = spectrum[[0, -1]]
        raise ValueError(
            f"every band must have a response between {low * 1e9:.0f} and {high * 1e9:.0f} nm"
        )


def _spline(nodes: Floats, at: Floats) -> Floats:
    """Matrix (f, k) from values at k nodes to values of their cubic spline; constant for one
    node."""
    if len(nodes) == 1:
        return np.ones((len(at), 1))
    return CubicSpline(nodes, np.eye(len(nodes)))(at)


def _gases(
    table: AirTable, gas: Floats, h: int, v: int, s: int, altitude: float
) -> tuple[Floats, Floats]:
    """Transmittance of all gases for light from the ground, and for light of the air."""
    air_mass = 1 / math.cos(table.sun[s])
    down = np.array([_below(table.height[h], 1e6, gas) for gas in range(3)]) * air_mass
    masses = _masses(table, h, v, altitude) + down
    through = _transmitted(table, gas, masses)
    masses[0] *= WATER_ABOVE_SCATTERING
    return through, _transmitted(table, gas, masses)


def _masses(table: AirTable, h: int, v: int, altitude: float) -> Floats:
    """Air masses (3,) of the gases between ground and sensor."""
    ground = table.height[h]
    return np.array([_below(ground, ground + altitude, gas) for gas in range(3)]) / math.cos(
        table.sensor[v]
    )


def _below(low: float, high: float, gas: int) -> float:
    """Fraction of a gas, in the order of GASES, between two heights above the sea."""
    if gas < 2:
        scale = (WATER_SCALE, AIR_SCALE)[gas]
        return math.exp(-low / scale) - math.exp(-high / scale)
    edges = np.clip((np.array([low, high]) - OZONE_FROM) / (OZONE_TO - OZONE_FROM), 0, 1)
    return float(edges[1] - edges[0])


def _transmitted(table: AirTable, gas: Floats, masses: Floats) -> Floats:
    """Transmittance of all gases, from logarithms (3, f, m); the depth of strong lines is
    proportional to the root of the mass.
    """
    root, total = np.sqrt(table.mass), np.zeros(gas.shape[1])
    for values, at in zip(gas, masses, strict=True):
        i = int(np.clip(np.searchsorted(table.mass, at) - 1, 0, len(root) - 2))
        fraction = (math.sqrt(min(at, table.mass[-1])) - root[i]) / (root[i + 1] - root[i])
        total += (1 - fraction) * values[:, i] + fraction * values[:, i + 1]
    return np.exp(total)
