"""The smallest detectable fire, and the error of its power, by formula."""

import math
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from scipy import special

from startrack.core import Floats, Refused, printed
from startrack.earth import geometry
from startrack.earth.atmosphere import Air
from startrack.earth.imager import (
    Band,
    Channel,
    Cover,
    Land,
    Survey,
    band_of,
    cover_at,
    exposure_of,
    image_blur,
    require_pace,
    smear,
)
from startrack.earth.retrieval import fire, texture
from startrack.earth.retrieval.context import pixels_around, threshold_of
from startrack.earth.retrieval.hot_spots import (
    HotSpots,
    channels_of,
    pixels_of_fire,
    refuse_other_pixels,
)
from startrack.earth.retrieval.patch import Radiation, radiation_over
from startrack.optics import blur_transfer, pupil_transfer

WAVES, TURNS = 96, 12  # frequencies and directions for the integrals over textures
FINEST = 4.0  # cycle / pixel, highest frequency of a point's image
LEAST_NODES = 48  # nodes over the frequencies of a point's image, along each axis
PHASES = 3  # positions along half of the pixel pitch on the ground
COARSE, FINE = 20, 10  # areas of the first and of the second interpolation of the smallest area
WARMEST = 5.0  # standard deviations; a channel must not saturate this far above the mean ground
WIDTHS = 3  # widths of the surroundings: extent of the sum over the covariance of textures
DIM = 0.1  # fraction of the brightest pixel's light; a dimmer pixel finds no fire; chosen by hand
DRAWS = 6  # nodes over the ground's contrast
SMALLEST = 1e-7  # smallest area, relative to the ground area of a pixel


class Side(NamedTuple):
    """A channel over the ground, for the formulas; radiance in watt / m^2 / sr / m.

    channel, band
    radiation      of the ground
    reflectance    1, mean of the ground
    temperature    kelvin
    side, across, along  metre on the ground: side of a pixel; between columns; between lines
    smear          pixel
    blur           metre on the detector, rms along an axis
    electrons      electron from a radiance of 1
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
        """Radiance of the largest digital number."""
        detector = self.channel.detector
        numbers = 2**detector.bits - 1 - detector.offset
        full = min(detector.full_well, numbers * detector.electrons_per_dn)
        return (full - detector.dark_rate * self.exposure) / self.electrons

    @property
    def stripes(self) -> float:
        """Variance between the columns of a scanner by PRNU, of the mean ground's radiance."""
        detector = self.channel.detector
        return (detector.prnu * self.mean) ** 2 if detector.scan else 0.0

    def variance(self, radiance: Floats) -> Floats:
        """Variance of a pixel's radiance by its temporal noise; `stripes` are separate."""
        detector = self.channel.detector
        light = self.electrons * radiance
        step = detector.electrons_per_dn
        variance = detector.excess_noise * (light + detector.dark_rate * self.exposure)
        variance = variance + detector.noise**2 + step**2 / 12 + (detector.prnu * light) ** 2
        return np.maximum(variance / self.electrons**2 - self.stripes, 0.0)

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
        """Derivatives of radiance with the relative texture of reflectance and with temperature."""
        near = self.temperature + np.array([-0.5, 0.0, 0.5])
        light = self.radiation.emitted(near)
        grey = self.reflectance * (self.radiation.lit - light[1])
        return float(grey), float((1 - self.reflectance) * (light[2] - light[0]))

    def ground_bends(self) -> tuple[float, float]:
        """Half the second derivative with temperature, and the mixed second derivative with
        temperature and texture."""
        light = self.radiation.emitted(self.temperature + np.array([-1.0, 0.0, 1.0]))
        bend = (1 - self.reflectance) * (light[0] - 2 * light[1] + light[2]) / 2
        return float(bend), float(-self.reflectance * (light[2] - light[0]) / 2)


class LevelGround(Protocol):
    """Level ground: height in metre, zenith angle of the Sun in radian."""

    @property
    def height(self) -> float: ...  # noqa: D102
    @property
    def sun_zenith(self) -> float: ...  # noqa: D102


class _Curves:
    """Curves that depend on the band alone; channels with the same band share them."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        optics, detector = channel.optics, channel.detector
        self._key = (
            channel.curves,
            optics.transmission,
            detector.quantum_efficiency,
            detector.fill_factor,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Curves) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def band_in(channel: Channel, air: Air | None, above: float, distance: float) -> Band:
    """Like `band_of`; cached by the values on which a band depends."""
    return _band(_Curves(channel), air, above, distance)


@lru_cache(maxsize=64)
def _band(curves: _Curves, air: Air | None, above: float, distance: float) -> Band:
    return band_of(curves.channel, air, above, distance)


_Lit = tuple[Band, Radiation, float]


@lru_cache(maxsize=64)
def _lit(
    curves: _Curves,
    air: Air | None,
    above: float,
    distance: float,
    cover: Cover,
    around: float | None,
    height: float,
    sun: float,
) -> _Lit:
    """Band, radiation of the ground and its mean reflectance; cached during a search."""
    band = _band(curves, air, above, distance)
    reflectance = float(cover.reflectance(band.wavelength) @ band.weight)
    around = reflectance if around is None else around
    return band, radiation_over(band, around, height, sun), reflectance


def side_of(survey: Survey, channel: Channel, spots: LevelGround) -> Side:
    """A channel over the ground of a retrieval.

    Raises  ValueError if the lens has a table, or aberrations that its blur does not contain.
    """
    optics = channel.optics
    if optics.tabulated or not optics.plain:
        raise Refused(
            f"channel {channel.name}: a forecast uses only the f-number and the blur of a lens; "
            "lens_file, lens_family, psf_file, pupil, defocus and aberrations must be left out"
        )
    carrier = survey.carrier
    above = geometry.flight_height(carrier) - spots.height
    cover = cover_at(survey.land, spots.height)
    band, radiation, reflectance = _lit(
        _Curves(channel),
        survey.air,
        above,
        survey.distance_to_sun,
        cover,
        survey.surroundings,
        spots.height,
        spots.sun_zenith,
    )
    rate = geometry.ground_rate(carrier)
    period = channel.sensor(survey.rays, rate).dating(carrier).period
    exposure = exposure_of(channel, period)
    side = above * channel.detector.pitch / optics.image_distance
    require_pace(channel, period, rate)
    drift = smear(channel, period, rate)
    once = channel.exposure_of_line(period)
    along = drift / once * period if period and drift else 1.0
    return Side(
        channel=channel,
        band=band,
        radiation=radiation,
        reflectance=reflectance,
        temperature=cover.temperature - survey.land.lapse * spots.height,
        side=side,
        across=side * channel.detector.columns / channel.columns,
        along=side * along,
        smear=drift,
        blur=math.hypot(image_blur(survey.motion, channel, period), channel.detector.diffusion),
        electrons=channel.etendue() * exposure * band.electrons,
        exposure=exposure,
    )


@printed
class FireForecast(NamedTuple):
    """Errors of retrieved fires that the formulas expect.

    areas        square metre, smallest of each temperature
    power_error  1, rms of the relative error of the radiative power
    power_bias   1, mean of the relative error of the radiative power
    contrast     watt / m^2 / sr / m, rms of the excess without fire: noise and ground
    noise        the same, by noise alone
    """

    areas: tuple[float, ...]
    power_error: float
    power_bias: float
    contrast: float
    noise: float


def forecast_fires(survey: Survey, spots: HotSpots) -> FireForecast:
    """The smallest areas of fires, and the error of the radiative power.

        P(found) = mean over places [1 - mean over c prod over pixels Phi((q s - A k - c) / n)]

    A k is the excess of a fire of the area A in a pixel, lens, pixel and smear included. n is the
    noise of that pixel, its photon noise included. s is the scatter of the surroundings, and q the
    quantile of the false-alarm rate. c is the sum of the ground's own contrast at the fire, the
    contrast of its column, and the deviation of q s from its mean. s and c follow from the power
    spectrum of the textures by the transfer functions of both channels and of the surroundings; the
    scatter of s^2 from the covariance of the textures over all pairs of pixels.

    Raises    ValueError as `side_of`, and where both channels have other pixels.
    Accuracy  model: contrast linear in textures, and only the variance of their squares known;
              noise independent between pixels; the same contrast of the ground in all pixels around
              a fire. No fire is found where ground of five standard deviations above the mean
              saturates. Within 15 % of trials over eleven designs
              (experiments/retrieval_formulas.py); 17 % too small over ground of 10 K rms whose
              reflectance varies little.
    """
    mid, thermal = (side_of(survey, channel, spots) for channel in channels_of(survey, spots))
    refuse_other_pixels(mid, thermal)
    ground = _ground(survey, spots, mid, thermal)
    quiet = [float(side.variance(np.array(side.mean))) for side in (mid, thermal)]
    count, wide = pixels_around(spots.window, spots.guard), 2 * spots.window + 1
    steady = [noise + side.stripes for noise, side in zip(quiet, (mid, thermal), strict=True)]
    slope = ground.around[0, 1] / (ground.around[1, 1] + steady[1])
    weights = np.array([1.0, -slope])
    noise = quiet[0] + slope**2 * quiet[1]
    stripes = mid.stripes + slope**2 * thermal.stripes
    bent = ground.bent(weights)
    square = float(weights @ ground.around @ weights + bent[0]) + noise + stripes
    quantile = threshold_of(spots.false_alarms, spots.window, spots.guard)
    limit = quantile * math.sqrt(square)
    # Variance of the mean square of the surroundings, by the ground, the pixels and the columns.
    loose = 2 * (ground.uneven(weights) + noise**2 / count + stripes**2 / wide)
    # On warmer ground all contrasts are larger, and the contrasts by bends vary more.
    loose += ground.warming(weights, survey.land.temperature_texture)
    loose += 8 * bent[0] ** 2 * ground.warm_uneven()
    common = float(weights @ ground.here @ weights + bent[1])
    common += stripes * (1 + 1 / wide) + noise / count
    common += quantile**2 * loose / (4 * square)
    if any(
        side.mean + WARMEST * math.sqrt(variance + own) >= side.saturation
        for side, variance, own in zip((mid, thermal), np.diag(ground.around), steady, strict=True)
    ):  # the warmest ground saturates, as a fire does
        return FireForecast((math.inf,) * len(spots.temperatures), math.inf, 0.0, math.inf, 0.0)
    near = pixels_of_fire(mid)
    shares = [_point_shares(side, near) for side in (mid, thermal)]
    bright = shares[0].max(0) > DIM * shares[0].max()  # dimmer pixels find no further fires
    shares = [share[:, bright] for share in shares]
    areas = []
    for temperature in spots.temperatures:
        flames = [_flame(side, temperature) for side in (mid, thermal)]
        excess = [
            flame * share / side.side**2
            for flame, share, side in zip(flames, shares, (mid, thermal), strict=True)
        ]
        areas.append(_smallest(excess, (mid, thermal), slope, limit, common, spots.found))
    error, bias = _power(spots, mid, ground, quiet[0])
    full = noise + stripes
    here = float(weights @ ground.here @ weights + bent[1])
    return FireForecast(tuple(areas), error, bias, math.sqrt(full + here), math.sqrt(full))


def _flame(side: Side, temperature: float) -> float:
    """Radiance of a fire minus the radiance of the ground that it replaces."""
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
    """Area of the smallest fire that is found with a given probability, square metre; inf where no
    fire is found.

    excess  of each channel, (places, pixels) watt / m^2 / sr / m per m^2
    ground  common variance of the pixels around a fire
    """
    mid, thermal = sides
    most = mid.across * mid.along
    node, weight = special.roots_hermitenorm(DRAWS)
    weight, common = weight / weight.sum(), node * math.sqrt(ground)

    def found(areas: Floats) -> Floats:
        area = areas[:, None, None]
        light = [
            np.minimum(side.mean + area * part, side.saturation)
            for side, part in zip(sides, excess, strict=True)
        ]
        signal = (light[0] - mid.mean) - slope * (light[1] - thermal.mean)
        noise = np.sqrt(mid.variance(light[0]) + slope**2 * thermal.variance(light[1]))
        noise = np.where(light[0] >= mid.saturation, 1e-9 * limit, noise)
        argument = (limit - signal[..., None] - common) / noise[..., None]
        missed = (special.ndtr(argument).prod(-2) @ weight).mean(-1)
        return np.asarray(np.maximum.accumulate(1 - missed))

    area = np.geomspace(SMALLEST * most, most, COARSE)
    for count in (FINE, 0):
        chance = found(area)
        if chance[-1] < wanted:
            return math.inf
        above = int(np.argmax(chance >= wanted))
        if above == 0:
            return 0.0
        if count:
            area = np.geomspace(area[above - 1], area[above], count)
    ends = special.ndtri(np.clip(chance[above - 1 : above + 1], 1e-12, 1 - 1e-12))
    place = (special.ndtri(wanted) - ends[0]) / (ends[1] - ends[0])
    return float(area[above - 1] * (area[above] / area[above - 1]) ** place)


def _point_shares(side: Side, near: int) -> Floats:
    """Fraction of a point's light in the pixels around it: (places, pixels).

    near  pixel, half a side of the square of pixels
    """
    across, along = side.across / side.side, side.along / side.side
    # one half; the other half is its mirror image
    inside = (np.arange(PHASES) + 0.5) / (2 * PHASES)
    step = np.arange(-near, near + 1) - inside[:, None]
    waves = FINEST * near * max(across, along)
    nodes, weights = _frequencies(max(LEAST_NODES, math.ceil(3 * waves) + LEAST_NODES // 2))
    transfer = side.transfer(nodes[None, :], nodes[:, None]) * np.outer(weights, weights)
    # The transfer function is even along both axes: twice the cosine over each half.
    right = 2 * np.cos(2 * np.pi * across * step[..., None] * nodes)
    down = 2 * np.cos(2 * np.pi * along * step[..., None] * nodes)
    rows = down.reshape(-1, len(nodes)) @ transfer @ right.reshape(-1, len(nodes)).T
    width = 2 * near + 1
    shares = rows.reshape(PHASES, width, PHASES, width).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(shares).reshape(PHASES**2, -1)


@lru_cache(maxsize=8)
def _frequencies(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights from 0 to FINEST cycle / pixel."""
    node, weight = np.polynomial.legendre.leggauss(count)
    return (node + 1) * FINEST / 2, weight * FINEST / 2


class _Ground(NamedTuple):
    """Covariances (2, 2) of both channels by the ground's textures.

    around  within the surroundings, of deviations from their mean
    here    of a pixel's deviations from the mean of its surroundings
    summed  of the sum of these deviations over a fire's pixels, in the mid infrared alone
    waves   of the unevenness; None: even ground
    bends   (2, 2) second derivatives of both channels, as `ground_bends`
    spreads (2, 2) variances of both textures around and here, of the mid infrared's pixels
    slopes  of the mid infrared with both textures
    kinds   (2, 2, 2) `around` by each texture
    """

    around: Floats
    here: Floats
    summed: float
    waves: "_Waves | None" = None
    bends: Floats = np.zeros((2, 2))
    spreads: Floats = np.zeros((2, 2))
    slopes: tuple[float, float] = (0.0, 1.0)
    kinds: Floats = np.zeros((2, 2, 2))

    def bent(self, weights: Floats) -> Floats:
        """Variance (2,), around and here, of the part of the contrast that is not linear in the
        textures."""
        square, product = weights @ self.bends
        grey, warm = self.spreads.T
        return np.asarray(2 * square**2 * warm**2 + product**2 * warm * grey)

    def warming(self, weights: Floats, rms: float) -> float:
        """Variance of the mean square, caused by temperature waves longer than the surroundings."""
        if not self.spreads[0, 1]:
            return 0.0
        grey, warm = (float(weights @ part @ weights) for part in self.kinds)
        bend, product = self.bends[0]
        grown = 2 * bend / self.slopes[1]  # of contrasts of temperature, per kelvin
        change = 2 * grown * (warm + float(self.bent(weights)[0]))
        change += 2 * product / self.slopes[0] * grey if self.slopes[0] else 0.0
        return change**2 * max(rms**2 - self.spreads[0, 1], 0.0)

    def warm_uneven(self) -> float:
        """Half the relative variance of the mean square of the temperature's texture."""
        if self.waves is None or not self.spreads[0, 1]:
            return 0.0
        half = self.waves.half_variance(self.waves.amplitude[1, 0] ** 2)
        return half / float((self.waves.amplitude[1, 0] ** 2).mean()) ** 2

    def uneven(self, weights: Floats) -> float:
        """Half the variance of the mean square of a combination of both textures, in the
        surroundings."""
        return 0.0 if self.waves is None else self.waves.uneven(weights)


class _Waves(NamedTuple):
    """Textures on a grid of waves: square roots of the spectra within the surroundings.

    amplitude  (kinds, 2, n, n) for each texture and both channels
    width      pixel, a side of the surroundings
    """

    amplitude: Floats
    width: int

    def uneven(self, weights: Floats) -> float:
        """Half the variance of the mean square, from the covariance R of pairs of pixels.

        var <z^2> = 2 / N^2 * sum over pairs of pixels of R^2
        """
        return self.half_variance((np.tensordot(weights, self.amplitude, (0, 1)) ** 2).sum(0))

    def half_variance(self, spectrum: Floats) -> float:
        """Half the variance of the mean square of a spectrum (n, n)."""
        covariance = np.fft.ifft2(spectrum).real
        away = np.abs(np.fft.fftfreq(len(spectrum), 1 / len(spectrum)))
        pairs = np.maximum(self.width - away, 0)
        return float(pairs @ covariance**2 @ pairs) / self.width**4


def _ground(survey: Survey, spots: HotSpots, mid: Side, thermal: Side) -> _Ground:
    land, sides = survey.land, (mid, thermal)
    slopes = [side.ground_slopes() for side in sides]
    rms = land.texture, land.temperature_texture
    if not any(rms):
        return _Ground(np.zeros((2, 2)), np.zeros((2, 2)), 0.0)
    size = np.geomspace(0.5 / texture.TEXELS, math.sqrt(0.5), WAVES + 1) / land.texture_cell
    middle, width = np.sqrt(size[1:] * size[:-1]), np.diff(size)
    turn = (np.arange(TURNS) + 0.5) * math.pi / 2 / TURNS
    x, y = np.outer(middle, np.cos(turn)), np.outer(middle, np.sin(turn))
    density = texture.power(np.stack([x, y], -1), land.texture_cell)
    part = (2 * math.pi * middle * width)[:, None] / TURNS

    def square(half: int) -> Floats:
        """Mean over a square of pixels."""
        return _dirichlet(x * mid.across, 2 * half + 1) * _dirichlet(y * mid.along, 2 * half + 1)

    outer, inner = 2 * spots.window + 1, 2 * spots.guard + 1
    count = pixels_around(spots.window, spots.guard)
    around = (square(spots.window) * outer**2 - square(spots.guard) * inner**2) / count
    transfers = [side.transfer(x * side.side, y * side.side) for side in sides]
    result, spreads, kinds = np.zeros((2, 2, 2)), np.zeros((2, 2)), np.zeros((2, 2, 2))
    for n, factor in enumerate((1 - around**2, (1 - around) ** 2)):
        spreads[n] = np.square(rms) * float((part * density * transfers[0] ** 2 * factor).sum())
        for i in range(2):
            for j in range(2):
                shared = float((part * density * transfers[i] * transfers[j] * factor).sum())
                for kind, spread in enumerate(rms):
                    own = slopes[i][kind] * slopes[j][kind] * spread**2 * shared
                    result[n, i, j] += own
                    if n == 0:
                        kinds[kind, i, j] = own
    over = (square(spots.guard) - around) * inner**2
    shared = float((part * density * (transfers[0] * over) ** 2).sum())
    summed = sum((slopes[0][kind] * spread) ** 2 for kind, spread in enumerate(rms)) * shared
    waves = _waves(spots, sides, slopes, rms, land)
    bends = np.array([side.ground_bends() for side in sides])
    return _Ground(
        around=result[0],
        here=result[1],
        summed=summed,
        waves=waves,
        bends=bends,
        spreads=spreads,
        slopes=slopes[0],
        kinds=kinds,
    )


def _waves(
    spots: HotSpots,
    sides: tuple[Side, Side],
    slopes: list[tuple[float, float]],
    rms: tuple[float, float],
    land: Land,
) -> _Waves:
    mid, width = sides[0], 2 * spots.window + 1
    count = WIDTHS * width
    right: Floats = np.asarray(np.fft.fftfreq(count, mid.across), np.float64)
    down: Floats = np.asarray(np.fft.fftfreq(count, mid.along), np.float64)
    x, y = np.broadcast_to(right, (count, count)), np.broadcast_to(down[:, None], (count, count))
    mean = _dirichlet(right * mid.across, width) * _dirichlet(down * mid.along, width)[:, None]
    # This factor makes the inverse transform, a sum over waves, unitary.
    density = texture.power(np.stack([x, y], -1), land.texture_cell) / (mid.across * mid.along)
    within = np.sqrt(density * (1 - mean**2))
    transfers = [side.transfer(x * side.side, y * side.side) * within for side in sides]
    amplitude = [
        [slopes[i][kind] * spread * transfers[i] for i in range(2)]
        for kind, spread in enumerate(rms)
    ]
    return _Waves(np.array(amplitude), width)


def _dirichlet(cycles: Floats, count: int) -> Floats:
    """Transfer function of the mean of N samples; frequency in cycle / sample."""
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
    shares = _point_shares(mid, spots.guard)
    excess = _flame(mid, spots.temperature) * spots.area * shares / mid.side**2
    light = np.minimum(mid.mean + excess, mid.saturation)
    # The estimate attributes the fire's light in the surroundings to the ground.
    beside = _point_shares(mid, spots.window).sum(-1) - shares.sum(-1)
    share = shares.shape[1] / pixels_around(spots.window, spots.guard)
    lost = share * _flame(mid, spots.temperature) * spots.area * beside / mid.side**2
    means = per_radiance * ((light - mid.mean).sum(-1) - lost) - 1
    photons = (mid.variance(light) * (light < mid.saturation)).sum(-1).mean()
    pixels, count = shares.shape[1], pixels_around(spots.window, spots.guard)
    # The columns of a fire differ from those around by PRNU.
    tall = 2 * spots.guard + 1
    stripes = mid.stripes * tall**3 * (1 + tall / (2 * spots.window + 1))
    variance = photons + pixels**2 * quiet / count + stripes + ground.summed
    bias = float(means.mean())
    return math.sqrt(float((means**2).mean()) + per_radiance**2 * variance), bias
