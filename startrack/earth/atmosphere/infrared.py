"""BandTable from InfraredTable and bands: thermal radiance and transmittance of the air.

Beyond 3 micrometre the air emits and absorbs more than it scatters. The table holds lines of sight
down to the sea; the part above higher ground follows from their ratio. Light that particles scatter
comes from an AirTable, through the gases of the infrared table.
"""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from startrack.core import Flags, Floats, deg, positive, um
from startrack.earth.atmosphere.radiance import planck
from startrack.earth.atmosphere.spectra import sun_spectrum
from startrack.earth.atmosphere.table import TINY, AirTable, BandTable, require_response
from startrack.io import open_checked

FORMAT = 1  # of the file
WARM = 300.0  # kelvin
DIFFUSE = 53.13 * deg  # zenith angle whose path is 5/3 of the vertical path: Elsasser's diffusivity
HEIGHT: Floats = np.array([0.0, 1e3, 2e3, 4e3, 8e3, 9e3])
ANGLES: Floats = np.arange(0.0, 81.0, 10.0) * deg
SUNLIT = 5 * um  # scattered sunlight is neglected above: it is below 1e-4 of the air's heat


@dataclass(frozen=True, eq=False)
class InfraredTable:
    """Transmittance and thermal radiance of the air between the sea and a sensor.

    spectrum  (f,) metre
    altitude  (a,) metre of the sensor above the sea; the last is above the air
    sensor    (v,) radian, zenith angle of the sensor
    through   (a, v, f) 1, transmittance
    rise      (a, v, f) watt / m^2 / sr / m, thermal radiance of the air towards the sensor
    fall      (f,) watt / m^2 / sr / m, mean thermal radiance of the sky at sea level: its
              irradiance over pi
    particles  table of the same aerosol, which scatters sunlight; None: no scattering
    """

    spectrum: Floats
    altitude: Floats
    sensor: Floats
    through: Floats
    rise: Floats
    fall: Floats
    particles: AirTable | None = None

    def within(self, used: Flags) -> "InfraredTable":
        """The table at the given wavelengths (f,)."""
        rest = (self.through[..., used], self.rise[..., used], self.fall[used])
        return InfraredTable(
            self.spectrum[used], self.altitude, self.sensor, *rest, particles=self.particles
        )


def vacuum() -> InfraredTable:
    """A table without air, from 0.3 to 40 micrometre, for planets without an atmosphere."""
    spectrum = np.geomspace(0.3, 40, 4001) * um
    altitude, sensor = np.array([1.0, 1e3]), np.array([0.0, 89.0]) * deg
    clear = np.ones((2, 2, len(spectrum)))
    return InfraredTable(spectrum, altitude, sensor, clear, 0 * clear, 0 * spectrum)


def infrared_bands(
    table: InfraredTable, response: Floats, altitude: float, distance: float = 1.0
) -> BandTable:
    """Weight the spectrum with the response of each band.

        direct = E_sun cos(sun) / pi t(sun) t(sensor)

    A line of sight from higher ground is the upper part of a line of sight from the sea:
    t = t(0 to sensor) / t(0 to ground), rise = rise(0 to sensor) - t rise(0 to ground).

    response  (b, f), as for `in_bands`, over table.spectrum
    altitude  metre, of the sensor above the ground
    distance  astronomical unit, of the Sun
    Returns   BandTable with thermal radiance of the air; for bands below 5 micrometre it includes
              the sunlight that the table's particles scatter
    Raises    ValueError as `in_bands`.
    Accuracy  model: a transmittance is the mean over the light of 300 K; for a fire of 1000 K in
              3.4 to 4.2 micrometre it is 4 % low. Sunlight of 3.4 to 4.2 micrometre is 9 % less
              than MODTRAN 5.2.1's, because the product of two mean transmittances ignores that
              gases absorb the same lines on both paths. Its scattered part, 1 to 3 % of the
              reflected part, is known to a factor of two. The ratio for higher ground is exact for
              grey air; saturated lines reduce the transmittance above 2 km by up to 0.05.
    """
    positive(altitude=altitude, distance=distance)
    require_response(response, table.spectrum)
    weights = response * np.gradient(table.spectrum)
    used = np.any(weights, axis=0)  # the rest of the spectrum would cost time
    sunlight = sun_spectrum(table.spectrum)[used] / distance**2
    weights, table = weights[:, used], table.within(used)
    angles = ANGLES[: np.searchsorted(ANGLES, table.sensor[-1] + 1e-9)]
    shape = len(HEIGHT), len(angles), len(angles), len(response)
    direct, warm = np.empty(shape), planck(table.spectrum, WARM)
    seen = np.empty((2, len(HEIGHT), len(angles), len(table.spectrum)))
    through, rise, fall = np.empty((3, len(HEIGHT), len(angles), len(response)))
    top = float(table.altitude[-1])
    for h, ground in enumerate(HEIGHT):
        down = _above(table, ground, top, angles)[0]
        up, emitted = _above(table, ground, ground + altitude, angles)
        seen[:, h] = up, down
        sky = table.fall * _fraction_above(table, ground)
        for v in range(len(angles)):
            through[h, v] = weights @ (warm * up[v]) / (weights @ warm)
            rise[h, v], fall[h, v] = weights @ emitted[v], weights @ (sky * up[v])
            direct[h, v] = (np.cos(angles) / math.pi * (weights @ (sunlight * up[v] * down).T)).T
    light = _dark(shape)
    if table.particles is not None and table.spectrum[0] < SUNLIT:
        shone = weights * sunlight * (table.spectrum < SUNLIT)
        light = _scattered(table.particles, shone, table.spectrum, seen, altitude)
    return BandTable(
        height=HEIGHT,
        sensor=angles,
        sun=angles,
        azimuth=light.azimuth,
        path=light.path,
        direct=direct,
        sky=light.sky,
        around=light.around,
        backscatter=light.backscatter,
        through=through,
        rise=rise,
        fall=fall,
    )


class _Scattered(NamedTuple):
    """Scattered sunlight, in the form of BandTable."""

    azimuth: Floats
    path: Floats
    sky: Floats
    around: Floats
    backscatter: Floats


def _dark(shape: tuple[int, ...]) -> _Scattered:
    dark = np.zeros(shape)
    behind = np.zeros((shape[0], shape[-1]))
    return _Scattered(np.array([0.0, math.pi]), np.stack([dark, dark], 3), dark, dark, behind)


def _scattered(
    air: AirTable, sunlight: Floats, spectrum: Floats, seen: Floats, altitude: float
) -> _Scattered:
    """Sunlight that particles scatter, through the gases of the infrared table.

        gases = t / t_particles,   path = E P gases(Sun) gases(sensor)
        sky = E K / pi gases(Sun) t(sensor)
        around = E (cos(sun) t_particles(Sun) + K) / pi A gases(Sun) gases(sensor)

    P, K and A are the light of the air, the skylight and the diffuse transmittance of the table.

    sunlight  (b, f) the response times the Sun's irradiance
    seen      (2, h, v, f) transmittance to the sensor, and to the Sun
    """
    angles = ANGLES[: seen.shape[2]]
    # The last two nodes of the table; beyond them, the last node.
    nodes = np.log(air.wavelength[-2:])
    part = np.clip((np.log(spectrum) - nodes[0]) / (nodes[1] - nodes[0]), 0, 1)
    shares = np.array([1 - part, part])

    def at_heights(values: Floats) -> Floats:
        """Values (2, h, ...) on the heights of the bands; constant above the table's heights."""
        return CubicSpline(air.height, values, 1)(np.minimum(HEIGHT, air.height[-1]))

    logarithm = np.log(np.clip(altitude, *air.altitude[[0, -1]]))
    thin = min(altitude / float(air.altitude[0]), 1.0)
    spline = CubicSpline(np.log(air.altitude), np.eye(len(air.altitude)))(logarithm)

    def to_sensor(values: Floats) -> Floats:
        """(k, h, a, v, ...) -> (2, h, v, ...)."""
        mine = at_heights(np.tensordot(values[-2:], spline, (2, 0)))
        return CubicSpline(air.sensor, mine, 2)(angles)

    def to_sun(values: Floats) -> Floats:
        """(k, h, s) -> (2, h, s)."""
        return CubicSpline(air.sun, at_heights(values[-2:]), 2)(angles)

    straight, beam = to_sensor(air.seen) ** thin, to_sun(air.beam)
    path = np.maximum(CubicSpline(air.sun, to_sensor(air.path), 3)(angles), 0) * thin
    around, sky = (np.maximum(v, 0) for v in (to_sensor(air.around) * thin, to_sun(air.skylight)))
    gases = [
        np.minimum(through / np.einsum("khv,kf->hvf", straight_part, shares), 1.0)
        for through, straight_part in zip(seen, (straight, beam), strict=True)
    ]
    both = np.einsum("bf,hvf,hsf,kf->khvsb", sunlight, *gases, shares, optimize=True)
    reflected = np.einsum(
        "bf,hvf,hsf,kf->khvsb", sunlight, seen[0], gases[1], shares, optimize=True
    )
    lit = np.cos(angles) * beam + sky
    mirrored = at_heights(air.backscatter[-2:])
    of_band = np.einsum("bf,kf->kb", sunlight, shares) / np.maximum(sunlight.sum(1), TINY)
    return _Scattered(
        air.azimuth,
        np.einsum("khvsb,khvsp->hvspb", both, path),
        np.einsum("khvsb,khs->hvsb", reflected, sky) / math.pi,
        np.einsum("khvsb,khv,khs->hvsb", both, around, lit) / math.pi,
        np.maximum(np.einsum("kb,kh->hb", of_band, mirrored), 0.0),
    )


def load_infrared(path: Path) -> InfraredTable:
    """Read a table.

    Raises  FileNotFoundError; ValueError if the file is not an infrared table, or damaged.
    """
    with open_checked(path, "INFRARED", FORMAT, "an infrared table of the air") as parts:
        return InfraredTable(*(parts[name].data.astype(np.float64) for name in ARRAYS))


def _above(table: InfraredTable, ground: float, sensor: float, angle: Floats) -> tuple[Floats, ...]:
    """Transmittance and thermal radiance (v, f) of the air between two heights above the sea."""
    from_sea = _from_sea(table, sensor, angle)
    if ground <= 0:
        return from_sea
    below = _from_sea(table, ground, angle)
    through = np.minimum(from_sea[0] / np.maximum(below[0], 1e-6), 1.0)
    return through, np.maximum(from_sea[1] - through * below[1], 0.0)


def _from_sea(table: InfraredTable, height: float, angle: Floats) -> tuple[Floats, ...]:
    """Transmittance and thermal radiance from the sea, linear in the logarithm of height and in the
    secant."""
    at = np.interp(np.log(max(height, 1.0)), np.log(table.altitude), np.arange(len(table.altitude)))
    low = min(int(at), len(table.altitude) - 2)
    fraction = at - low
    secant = 1 / np.cos(table.sensor)
    position = np.interp(1 / np.cos(angle), secant, np.arange(len(secant)))
    left = np.minimum(position.astype(int), len(secant) - 2)
    right = (position - left)[:, None]
    between = []
    for values in (np.log(np.maximum(table.through, 1e-12)), table.rise):
        layer = (1 - fraction) * values[low] + fraction * values[low + 1]
        between.append(layer[left] * (1 - right) + layer[left + 1] * right)
    thin = min(height / table.altitude[0], 1.0)  # proportional below the lowest sensor
    return np.exp(thin * between[0]), thin * between[1]


def _fraction_above(table: InfraredTable, ground: float) -> Floats:
    """Thermal radiance (f,) of the sky at a height, relative to sea level, by its emissivity."""
    angle, top = np.array([DIFFUSE]), float(table.altitude[-1])
    emissivity = 1 - _above(table, 0.0, top, angle)[0][0]
    return (1 - _above(table, ground, top, angle)[0][0]) / np.maximum(emissivity, 1e-12)


ARRAYS = tuple(field.name for field in fields(InfraredTable) if field.name != "particles")
