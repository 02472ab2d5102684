"""At-sensor radiance in five terms, from the viewing geometry of pixels or from Ground."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from startrack.core import BOLTZMANN, LIGHT_SPEED, PLANCK, Floats, Refused, Singles, deg
from startrack.earth.atmosphere.look_up import FineTable, Reach, Reals, SlantPath, look_up, refine
from startrack.earth.atmosphere.table import BandTable
from startrack.earth.terrain import Ground, up

COLDEST, HOTTEST = 50.0, 3000.0  # kelvin, range of the spline
NODES = 600


def planck(wavelength: Floats, temperature: Floats | float) -> Floats:
    """Spectral radiance of a blackbody.

        B = 2 h c^2 / wavelength^5 / (exp(h c / (wavelength k T)) - 1)

    wavelength, temperature  metre, kelvin; shapes broadcast; temperature above 0
    Returns                  watt / m^2 / sr / m
    """
    with np.errstate(over="ignore"):
        exponent = PLANCK * LIGHT_SPEED / (BOLTZMANN * wavelength * temperature)
        return 2 * PLANCK * LIGHT_SPEED**2 / wavelength**5 / np.expm1(exponent)


@dataclass(frozen=True, eq=False)
class ThermalRadiance:
    """Radiance of a blackbody in each band, as a spline of its logarithm over 1 / T."""

    spline: CubicSpline

    def __call__(self, temperature: Floats) -> Floats:
        """Radiance (n, b) at (n,) kelvin.

        Raises    ValueError if a temperature is not a number from 50 to 3000 K.
        Accuracy  numerical: 1e-6.
        """
        temperature = np.asarray(temperature, np.float64)
        good = (temperature >= COLDEST) & (temperature <= HOTTEST)
        if not good.all():
            raise ValueError(
                f"temperature must lie in [{COLDEST:g}, {HOTTEST:g}] K, got {temperature[~good][0]}"
            )
        return np.exp(self.spline(-1 / temperature))


def heat_of(spectrum: Floats, response: Floats) -> ThermalRadiance:
    """Radiance of a blackbody in each band, over temperature.

    spectrum  (f,) metre
    response  (b, f), as for `in_bands`
    """
    inverse = np.linspace(-1 / COLDEST, -1 / HOTTEST, NODES)
    weights = response * np.gradient(spectrum)
    used = weights.any(0)  # the rest of the spectrum would cost time
    bands = planck(spectrum[used], -1 / inverse[:, None]) @ weights[:, used].T
    return ThermalRadiance(CubicSpline(inverse, np.log(np.maximum(bands, 1e-300))))


PIXELS = 2**15  # pixels at a time, so that intermediate arrays stay in the cache


class Terms(NamedTuple):
    """The five terms of the radiance at the sensor, (n, b) each, watt / m^2 / sr in each band.

    Source: Krutz et al. (2011), eq. (1).

    direct     sunlight that the ground reflects
    indirect   light of sky, air and surrounding slopes, reflected by the ground
    scattered  light that the air scatters, from the Sun and from the surrounding ground
    emitted    thermal radiance of the ground
    thermal    thermal radiance of the air, direct or reflected
    """

    direct: Singles
    indirect: Singles
    scattered: Singles
    emitted: Singles
    thermal: Singles

    @property
    def total(self) -> Singles:
        """Sum of the terms, (n, b) watt / m^2 / sr."""
        return self.direct + self.indirect + self.scattered + self.emitted + self.thermal


def radiance(
    table: FineTable,
    sight: SlantPath,
    reflectance: Reals,
    surroundings: Reals,
    heat: ThermalRadiance | None = None,
    temperature: Floats | None = None,
    air_temperature: float = 275.0,
    direct: Reals | None = None,
) -> Terms:
    """Radiance of n pixels of ground.

        L_em = (1 - rho) B(T) t
        L_th = rise + rho fall

    t is the transmittance between ground and sensor. Where the table has no thermal radiance of the
    air, the air is assumed to be isothermal: rise = (1 - t) B(T_air), fall = rise t.

    Source: Krutz et al. (2011), eqs. (1) to (3).

    reflectance      (n, b) or (b,) 1
    surroundings     (b,) or (2, n, b) 1, reflectance of the surrounding ground, as for `look_up`
    heat             of the bands; None where thermal radiance is negligible
    temperature      (n,) kelvin, of the ground; needed with `heat`
    air_temperature  kelvin, of isothermal air, where the table has no thermal radiance
    direct           (n, b) 1, reflectance factor for sunlight; None: `reflectance`
    Raises           ValueError as `look_up` and `ThermalRadiance`; TypeError if `heat` is given
                     without `temperature`.
    Accuracy         model: isothermal air over black ground of the same temperature gives Planck's
                     law exactly. Isothermal air errs by some per cent of L_th in the windows and
                     more in the bands of gases.
    """
    count, bands = len(sight.height), table.backscatter.shape[1]
    out = Terms(*np.zeros((5, count, bands), np.float32))
    reflectance = np.broadcast_to(reflectance, (count, bands))
    beam = reflectance if direct is None else direct
    for first in range(0, count, PIXELS):
        some = slice(first, first + PIXELS)
        part = SlantPath(*(values[some] for values in sight))
        around = surroundings if np.ndim(surroundings) < 3 else surroundings[:, some]
        lit = look_up(table, part, reflectance[some], around, beam[some])
        for term, values in zip(out, lit, strict=False):
            term[some] = values
    if heat is not None:
        if temperature is None:
            raise TypeError("temperature must be given with heat, got None")
        through = table.heat(table.through, sight)
        if table.rise is None or table.fall is None:
            rise = heat(np.array([air_temperature])) * (1 - through)
            fall = rise * through
        else:
            rise, fall = table.heat(table.rise, sight), table.heat(table.fall, sight)
        out.emitted[:] = (1 - reflectance) * heat(temperature) * through
        out.thermal[:] = rise + reflectance * fall
    return out


LOW_SUN = 69.9 * deg  # a table up to this zenith angle also holds for a lower Sun
TINY = 1e-12  # product of sines; the azimuth is undefined below it


def sight_of(ground: Ground) -> SlantPath:
    """Viewing geometry and illumination of each of the m visible points of ground."""
    seen = ground.hit
    zenith = up(ground.longitude[seen], ground.latitude[seen])
    camera, sun = -ground.direction[seen], ground.sun
    high, low = np.einsum("ij,ij->i", camera, zenith), zenith @ sun
    # Both directions without their components along the zenith.
    level, shone = camera - high[:, None] * zenith, sun - low[:, None] * zenith
    apart, about = (np.sqrt(np.einsum("ij,ij->i", vector, vector)) for vector in (level, shone))
    turned = np.einsum("ij,ij->i", level, shone) / np.maximum(apart * about, TINY)
    lit = (~ground.shadow[seen]).astype(np.float64)
    return SlantPath(
        height=ground.height[seen],
        sensor=np.arctan2(apart, high),
        sun=np.arctan2(about, low),
        azimuth=np.arccos(np.clip(turned, -1, 1)),
        incidence=np.cos(ground.sun_incidence[seen]),
        lit=lit,
        sky_view=ground.sky_view[seen],
    )


def at_sensor(
    ground: Ground,
    table: BandTable,
    reflectance: Reals,
    surroundings: Reals,
    heat: ThermalRadiance | None = None,
    temperature: Floats | None = None,
    direct: Reals | None = None,
) -> Terms:
    """Radiance of n rays; rays that miss the ground see a black sky.

    reflectance  (n, b) or (b,) 1, of the ground; without effect where a ray misses
    surroundings  (b,) or (2, n, b) 1, as for `look_up`
    temperature  (n,) kelvin of the ground, likewise
    direct       (n, b) 1, reflectance factor for sunlight, likewise; None: `reflectance`
    Returns      Terms of (n, b); finite and never negative
    Raises       as `radiance`; ValueError if ground lies outside the table's heights, or a ray
                 meets it beyond the table's zenith angles.
    Accuracy     model: for a Sun below the table's range, the light of the lowest Sun is reduced in
                 proportion to the cosine; it is 0 below the horizon.
    """
    bands = table.backscatter.shape[1]
    out = Terms(*np.zeros((5, len(ground), bands), np.float32))
    if not ground.hit.any():
        return out
    sight = sight_of(ground)
    lowest = float(table.sun[-1])
    between = (sight.sun > lowest) & (sight.sun < math.pi / 2)
    if lowest < LOW_SUN and between.any():
        raise Refused(
            f"sun must lie in the table's {table.sun[0] / deg:.4g} to {lowest / deg:.4g} degree, "
            f"got {sight.sun[between][0] / deg:.4g} degree"
        )
    weak = np.where(
        sight.sun > lowest, np.maximum(np.cos(sight.sun), 0) / math.cos(lowest), 1.0
    ).astype(np.float32)
    sight = sight._replace(sun=np.minimum(sight.sun, lowest), lit=sight.lit * (weak > 0))
    here = np.broadcast_to(reflectance, (len(ground), bands))[ground.hit]
    if np.ndim(surroundings) == 3:
        surroundings = surroundings[:, ground.hit]
    warm = None if temperature is None else temperature[ground.hit]
    beam = None if direct is None else direct[ground.hit]
    reach = Reach._make((float(values.min()), float(values.max())) for values in sight[:4])
    fine = refine(table, reach)
    seen_terms = radiance(fine, sight, here, surroundings, heat, warm, direct=beam)
    for name, all_rays, part in zip(Terms._fields, out, seen_terms, strict=True):
        lit_by_air = name in ("indirect", "scattered")
        all_rays[ground.hit] = part * weak[:, None] if lit_by_air else part
    return out
