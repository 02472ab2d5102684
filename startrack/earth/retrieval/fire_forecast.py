"""The smallest fire that is found, and the error of its power, by formula."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from startrack.core import Curve, Floats, Refused, printed
from startrack.earth import geometry
from startrack.earth.atmosphere import Air
from startrack.earth.imager import (
    Band,
    Channel,
    Survey,
    band_of,
    cover_at,
    exposure_of,
    image_blur,
    smear,
)
from startrack.earth.retrieval import fire, texture
from startrack.earth.retrieval.context import pixels_around, threshold_of
from startrack.earth.retrieval.hot_spots import HotSpots, channels_of, refuse_other_pixels
from startrack.earth.retrieval.patch import Radiation, radiation_over
from startrack.earth.terrain import geodetic
from startrack.optics import blur_transfer, pupil_transfer

WAVES, TURNS = 96, 12  # frequencies and directions, over which textures are integrated
FREQUENCIES, FINEST = 48, 4.0  # along each axis, to so many cycles a pixel, of a point's image
PHASES = 4  # places along half a side of the ground between two pixels
AREAS = 96  # between which the smallest is interpolated
DRAWS = 12  # nodes over the ground's contrast
SMALLEST = 1e-7  # of the ground between two pixels


class Side(NamedTuple):
    """A channel over the ground, for the formulas; radiance in watt / m^2 / sr / m.

    channel, band
    radiation      of the ground
    reflectance    1, mean of the ground
    temperature    kelvin
    side, across, along  metre: pixel on the ground; between columns; between lines
    smear          pixel
    blur           metre on the detector, rms along an axis
    electrons      of a radiance of 1
    exposure       second
    """

    channel: Channel
    band: Band
    radiation: Radiation
    reflectance: float
    temperature: float
    side: float
    across: float
    along: float
    smear: float
    blur: float
    electrons: float
    exposure: float

    @property
    def mean(self) -> float:
        """Radiance of the mean ground."""
        return float(self.radiation.of_ground(self.reflectance, np.array([self.temperature]))[0])

    @property
    def saturation(self) -> float:
        """Radiance of the largest number."""
        detector = self.channel.detector
        numbers = 2**detector.bits - 1 - detector.offset
        full = min(detector.full_well, numbers * detector.electrons_per_dn)
        return (full - detector.dark_rate * self.exposure) / self.electrons

    def variance(self, radiance: Floats) -> Floats:
        """Of a pixel's radiance by its noise."""
        detector = self.channel.detector
        light = self.electrons * radiance
        step = detector.electrons_per_dn
        variance = detector.excess_noise * (light + detector.dark_rate * self.exposure)
        variance = variance + detector.noise**2 + step**2 / 12 + (detector.prnu * light) ** 2
        return np.asarray(variance / self.electrons**2)

    def transfer(self, x: Floats, y: Floats) -> Floats:
        """Transfer function at frequencies in cycle / pixel: lens, blur, pixel, smear."""
        optics, detector = self.channel.optics, self.channel.detector
        size = np.hypot(x, y) / detector.pitch
        wavelength = float(self.band.weight @ self.band.wavelength)
        lens = pupil_transfer(size, wavelength, optics.working_f_number)
        blur = blur_transfer(size, self.blur)
        square = math.sqrt(detector.fill_factor)
        pixel = np.sinc(x * square) * np.sinc(y * square) * np.sinc(y * self.smear)
        return np.asarray(lens * blur * pixel)

    def ground_slopes(self) -> tuple[float, float]:
        """Change of radiance with the texture of reflectance, relative, and with temperature."""
        near = self.temperature + np.array([-0.5, 0.0, 0.5])
        light = self.radiation.emitted(near)
        grey = self.reflectance * (self.radiation.lit - light[1])
        return float(grey), float((1 - self.reflectance) * (light[2] - light[0]))


Curves = tuple[Curve, ...]


@lru_cache(maxsize=64)
def _band(
    curves: Curves, channel: "Same", air: Air | None, above: float, distance: float
) -> Band:
    return band_of(channel.channel, air, above, distance)


class Same:
    """A channel, equal to others of the same fill factor: for what depends on its curves."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[float, bool]:
        return self.channel.detector.fill_factor, self.channel.response is None


def side_of(survey: Survey, channel: Channel, spots: HotSpots) -> Side:
    """A channel over the ground of a retrieval.

    Raises  ValueError where its lens has a table, or aberrations that its blur does not hold.
    """
    optics = channel.optics
    if optics.tabulated or not optics.plain:
        raise Refused(
            f"channel {channel.name}: a forecast knows a lens by its f-number and blur alone; "
            "lens_file, lens_family, psf_file, pupil, defocus and aberrations must be left out"
        )
    carrier = survey.carrier
    height = float(geodetic(geometry.fly(carrier, np.zeros(1)).position)[2][0])
    above = height - spots.height
    own = Same(channel)
    band = _band(channel.curves, own, survey.air, above, survey.sun_distance)
    rate = geometry.ground_rate(carrier)
    period = channel.sensor(survey.rays, rate).dating(carrier).period
    exposure = exposure_of(channel, period)
    cover = cover_at(survey.land, spots.height)
    reflectance = float(cover.reflectance(band.wavelength) @ band.weight)
    around = reflectance if survey.surroundings is None else survey.surroundings
    side = above * channel.detector.pitch / optics.image_distance
    drift = smear(channel, period, rate)
    once = channel.exposure_of_line(period)
    along = drift / once * period if period and drift else 1.0
    return Side(
        channel,
        band,
        radiation_over(band, around, spots.height, spots.sun_zenith),
        reflectance,
        cover.temperature - survey.land.lapse * spots.height,
        side,
        side * channel.detector.columns / channel.columns,
        side * along,
        drift,
        math.hypot(image_blur(survey.motion, channel, period), channel.detector.diffusion),
        channel.etendue() * exposure * band.electrons,
        exposure,
    )


@printed
class FireForecast(NamedTuple):
    """What the formulas expect.

    areas        square metre, smallest of each temperature
    power_error  1, rms of the relative error of the radiative power
    power_bias   1, its mean
    contrast     watt / m^2 / sr / m, rms of the excess without fire: noise and ground
    noise        the same without the ground's share
    """

    areas: tuple[float, ...]
    power_error: float
    power_bias: float
    contrast: float
    noise: float


def forecast_fires(survey: Survey, spots: HotSpots) -> FireForecast:
    """The smallest areas of fires, and the error of the radiative power.

        P(found) = mean over places [1 - mean over c prod over pixels Phi((q s - A k - c) / n)]

    A k is the excess of a fire of the area A in a pixel, lens, pixel and smear included; n the noise
    of that pixel, of its photons too; s the scatter of the surroundings, of which q is the quantile
    of the false-alarm rate; c the ground's own contrast at the fire. s and c follow from the power
    spectrum of the textures by the transfer functions of both channels and of the surroundings.

    Raises    ValueError as `side_of`, and where both channels have other pixels.
    Accuracy  model: contrast linear in textures; noise independent between pixels, the ground's
              contrast the same in those around a fire. Beside trials: tests/earth/retrieval.
    """
    mid, thermal = (side_of(survey, channel, spots) for channel in channels_of(survey, spots))
    refuse_other_pixels(mid, thermal)
    ground = _ground(survey, spots, mid, thermal)
    quiet = [float(side.variance(np.array(side.mean))) for side in (mid, thermal)]
    count = pixels_around(spots.window, spots.guard)
    of_t, both = ground.around[1, 1] + quiet[1], ground.around[0, 1]
    slope = both / of_t
    scatter = math.sqrt(ground.around[0, 0] + quiet[0] - slope * both)
    weights = np.array([1.0, -slope])
    own = float(weights @ ground.here @ weights)
    steady = (quiet[0] + slope**2 * quiet[1]) / count
    limit = threshold_of(spots.false_alarms, spots.window, spots.guard) * scatter
    shares = [_point_shares(side, spots) for side in (mid, thermal)]
    areas = []
    for temperature in spots.temperatures:
        flames = [_flame(side, temperature) for side in (mid, thermal)]
        excess = [flame * share / side.side**2 for flame, share, side in zip(
            flames, shares, (mid, thermal), strict=True)]
        areas.append(
            _smallest(excess, (mid, thermal), slope, limit, own + steady, spots.found)
        )
    error, bias = _power(spots, mid, ground, quiet[0])
    noise = math.sqrt(quiet[0] + slope**2 * quiet[1])
    return FireForecast(tuple(areas), error, bias, math.sqrt(noise**2 + own), noise)


def _flame(side: Side, temperature: float) -> float:
    """Radiance of a fire above that of the ground that it takes the place of."""
    light = side.radiation.emitted(np.array([temperature]))[0]
    return float(side.radiation.path + light - side.mean)


def _smallest(
    excess: list[Floats],
    sides: tuple[Side, Side],
    slope: float,
    limit: float,
    ground: float,
    wanted: float,
) -> float:
    """Square metre of the smallest fire that is found with a probability; inf where none is.

    excess  of each channel, (places, pixels) watt / m^2 / sr / m per m^2
    ground  variance that the pixels around a fire have in common
    """
    mid, thermal = sides
    most = mid.across * mid.along
    area = np.geomspace(SMALLEST * most, most, AREAS)[:, None, None]
    light = [
        np.minimum(side.mean + area * part, side.saturation)
        for side, part in zip(sides, excess, strict=True)
    ]
    signal = (light[0] - mid.mean) - slope * (light[1] - thermal.mean)
    full = light[0] >= mid.saturation
    noise = np.sqrt(mid.variance(light[0]) + slope**2 * thermal.variance(light[1]))
    node, weight = special.roots_hermitenorm(DRAWS)
    weight = weight / weight.sum()
    common = node * math.sqrt(ground)
    argument = (limit - signal[..., None] - common) / np.where(full, 1e-9, noise)[..., None]
    missed = (special.ndtr(argument).prod(-2) @ weight).mean(-1)
    found = np.maximum.accumulate(1 - missed)
    if found[-1] < wanted:
        return math.inf
    above = int(np.argmax(found >= wanted))
    if above == 0:
        return 0.0
    ends = special.ndtri(np.clip(found[above - 1 : above + 1], 1e-12, 1 - 1e-12))
    place = (special.ndtri(wanted) - ends[0]) / (ends[1] - ends[0])
    low, high = area[above - 1, 0, 0], area[above, 0, 0]
    return float(low * (high / low) ** place)


def _point_shares(side: Side, spots: HotSpots) -> Floats:
    """Fraction of a point's light in the pixels around it: (places, pixels)."""
    x, y = _offsets(side, spots)
    nodes, weights = _frequencies()
    transfer = side.transfer(nodes[None, :], nodes[:, None]) * weights[None, :] * weights[:, None]
    # The transfer function is even in both: twice the cosine over each half.
    right = 2 * np.cos(2 * np.pi * x[..., None] * nodes)
    down = 2 * np.cos(2 * np.pi * y[..., None] * nodes)
    shares = np.einsum("pyv,vu,qxu->pqyx", down, transfer, right, optimize=True)
    return np.asarray(shares.reshape(PHASES**2, -1))


def _offsets(side: Side, spots: HotSpots) -> tuple[Floats, Floats]:
    """Pixel of the detector from a fire to columns and lines: (places along an axis, pixels)."""
    across, along = side.across / side.side, side.along / side.side
    near = math.ceil(side.side / min(side.across, side.along) - 1e-6)
    inside = (np.arange(PHASES) + 0.5) / (2 * PHASES)  # of one half; the other is its mirror
    step = np.arange(-near, near + 1) - inside[:, None]
    return step * across, step * along


@lru_cache(maxsize=1)
def _frequencies() -> tuple[Floats, Floats]:
    """Nodes and weights from 0 to FINEST cycles a pixel."""
    node, weight = np.polynomial.legendre.leggauss(FREQUENCIES)
    return (node + 1) * FINEST / 2, weight * FINEST / 2


class _Ground(NamedTuple):
    """Covariances (2, 2) of both channels by the ground's textures.

    around  within the surroundings, of deviations from their mean
    here    of a pixel's deviations from the mean of its surroundings
    summed  of the mid infrared alone, of the sum over a fire's pixels of these deviations
    """

    around: Floats
    here: Floats
    summed: float


def _ground(survey: Survey, spots: HotSpots, mid: Side, thermal: Side) -> _Ground:
    land, sides = survey.land, (mid, thermal)
    slopes = [side.ground_slopes() for side in sides]
    rms = land.texture, land.temperature_texture
    if not any(rms):
        return _Ground(np.zeros((2, 2)), np.zeros((2, 2)), 0.0)
    size = np.geomspace(0.5 / texture.TEXELS, math.sqrt(0.5), WAVES + 1) / land.texture_cell
    middle, width = np.sqrt(size[1:] * size[:-1]), np.diff(size)
    turn = (np.arange(TURNS) + 0.5) * math.pi / 2 / TURNS
    x, y = (np.outer(middle, part(turn)) for part in (np.cos, np.sin))
    density = texture.power(np.stack([x, y], -1), land.texture_cell)
    density = density * (2 * math.pi * middle * width)[:, None] / TURNS

    def square(half: int) -> Floats:
        """Mean over a square of pixels."""
        return _dirichlet(x * mid.across, 2 * half + 1) * _dirichlet(y * mid.along, 2 * half + 1)

    outer, inner = 2 * spots.window + 1, 2 * spots.guard + 1
    count = pixels_around(spots.window, spots.guard)
    around = (square(spots.window) * outer**2 - square(spots.guard) * inner**2) / count
    transfers = [side.transfer(x * side.side, y * side.side) for side in sides]
    result = np.zeros((2, 2, 2))
    for n, factor in enumerate((1 - around**2, (1 - around) ** 2)):
        for i in range(2):
            for j in range(2):
                shared = float((density * transfers[i] * transfers[j] * factor).sum())
                for kind, spread in enumerate(rms):
                    result[n, i, j] += slopes[i][kind] * slopes[j][kind] * spread**2 * shared
    over = (square(spots.guard) - around) * inner**2
    shared = float((density * (transfers[0] * over) ** 2).sum())
    summed = sum((slopes[0][kind] * spread) ** 2 for kind, spread in enumerate(rms)) * shared
    return _Ground(result[0], result[1], summed)


def _dirichlet(cycles: Floats, count: int) -> Floats:
    """Transfer function of the mean of so many samples, at cycles per sample."""
    below = count * np.sin(np.pi * cycles)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.abs(below) < 1e-9, 1.0, np.sin(np.pi * cycles * count) / below)


def _power(spots: HotSpots, mid: Side, ground: _Ground, quiet: float) -> tuple[float, float]:
    """Rms and mean of the relative error of the radiative power."""
    heat = mid.radiation.heat
    assert heat
    sample = mid.across * mid.along
    true = fire.radiated_power(spots.temperature, spots.area)
    per_radiance = float(fire.power_of(np.array([sample / mid.radiation.through]), heat)[0]) / true
    # The fire's pixels, with its light in each over places inside a pixel.
    wide = mid._replace(across=mid.across, along=mid.along)
    shares = _shares_of_box(wide, spots)
    excess = _flame(mid, spots.temperature) * spots.area * shares / mid.side**2
    light = np.minimum(mid.mean + excess, mid.saturation)
    means = per_radiance * (light - mid.mean).sum(-1) - 1
    photons = (mid.variance(light) * (light < mid.saturation)).sum(-1).mean()
    pixels, count = shares.shape[1], pixels_around(spots.window, spots.guard)
    variance = photons + pixels**2 * quiet / count + ground.summed
    bias = float(means.mean())
    return math.sqrt(float((means**2).mean()) + per_radiance**2 * variance), bias


def _shares_of_box(side: Side, spots: HotSpots) -> Floats:
    """Fraction of a point's light in the pixels over which a fire is summed."""
    across, along = side.across / side.side, side.along / side.side
    inside = (np.arange(PHASES) + 0.5) / (2 * PHASES)
    step = np.arange(-spots.guard, spots.guard + 1) - inside[:, None]
    nodes, weights = _frequencies()
    transfer = side.transfer(nodes[None, :], nodes[:, None]) * weights[None, :] * weights[:, None]
    right = 2 * np.cos(2 * np.pi * (step * across)[..., None] * nodes)
    down = 2 * np.cos(2 * np.pi * (step * along)[..., None] * nodes)
    shares = np.einsum("pyv,vu,qxu->pqyx", down, transfer, right, optimize=True)
    return np.asarray(shares.reshape(PHASES**2, -1))
