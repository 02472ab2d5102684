"""Waves: height and direction of a sea from its glint; their errors by formula and by trials.

Each slope of the water mirrors another part of the sky. Where the camera sees the glint of the Sun,
waves longer than a pixel tilt the small waves on them, and brightness follows their slope towards
the Sun. Waves across that direction are invisible. An image does not distinguish a wave from the
opposite wave.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import (
    POSITIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Streams,
    Unit,
    parameter,
    printed,
)
from startrack.earth.imager import (
    Channel,
    Survey,
    Water,
    blur_strips,
    fresnel,
    sky_factor,
    terms_in_band,
)
from startrack.earth.retrieval import patch
from startrack.earth.retrieval.fire_forecast import Side, side_of
from startrack.earth.retrieval.glint import Glint, glint_over, scatter_of
from startrack.earth.retrieval.sea import Sea, draw_sea, elevation_power, slope_variance

HIGHEST = 0.49  # cycle / pixel, highest frequency of the fitted waves along each axis
RAYS = 2  # points of a pixel along each axis, for the statistics of slopes
LEAST_RAYS = 3  # likewise, for images of trials: two are too few for a sharp lens
SMALL = 1e-4  # step of derivatives of the spectrum
STEP = 1e-3  # step of derivatives of the image and the results
LENGTHS, DIRECTIONS = 8, 6  # lengths and directions of the seas where a fit begins
BLIND = 0.2  # cosine to the Sun's direction; waves below it are invisible
RINGS = 12  # rings of wave numbers
ROUNDS = 5  # rounds of a fit, each with the statistics of the last round
SCORINGS = 30  # most scoring steps of a round
CLOSE = 1e-4  # tolerance of scoring steps
COARSE = 0.6  # rms of waves and noise in steps of the converter; above, quantisation is noise
FOLLOWS = 0.75  # least fraction of the brightness variance that must follow the waves' slopes
WORST = 0.1  # relative height error, and radian; linear theory does not hold for larger errors


class Waves(Parameters):
    """Significant height and direction of waves in the glint of the Sun.

    Images show level water straight below. The air, the wind and the light of the water itself are
    assumed to be known.
    """

    channel: str = parameter("name of the channel whose image has the glint", default="B8")
    wind: float = parameter(
        "wind speed 12.5 m above the water; sets the roughness",
        unit=Unit("m / s"),
        limit=Range(0.5, 20),
        default=8.0,
    )
    significant_height: float = parameter(
        "significant height of the waves: four standard deviations of the elevation",
        unit=Unit("m"),
        limit=POSITIVE,
        default=1.4,
    )
    peak_wavelength: float = parameter(
        "of the waves", unit=Unit("m"), limit=Range(0.1, 2000), default=60.0
    )
    direction: float = parameter(
        "direction of the waves, from the direction of flight to the right",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi, math.pi),
        default=math.radians(20),
    )
    peakedness: float = parameter(
        "1: spectrum of Pierson and Moskowitz; 3.3: JONSWAP", limit=Range(1, 10), default=1.0
    )
    spreading: float = parameter(
        "power of the cosine of the angle from the direction", limit=Range(1, 60), default=2.0
    )
    sun_azimuth: float = parameter(
        "azimuth of the Sun, from the direction of flight to the right",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi, math.pi),
        default=math.radians(-30),
    )
    height: float = parameter(
        "height of the water above the ellipsoid", unit=Unit("m"), limit=Range(0, 9000), default=0.0
    )
    sun_zenith: float = parameter(
        "of the Sun", unit=Unit("rad", "deg"), limit=Range(0.02, 1.4), default=math.radians(20)
    )
    size: int = parameter(
        "pixel, a side of an image of a trial", limit=Range(32, 1024), default=128
    )

    @property
    def sea(self) -> Sea:
        """The state of the sea."""
        return Sea(
            self.significant_height,
            self.peak_wavelength,
            self.direction,
            self.peakedness,
            self.spreading,
        )


class Mirror(NamedTuple):
    """Radiance of a channel as a function of the slopes of waves.

        L = base + glint exp((|Z|^2 - |Z - z|^2) / s^2)

    base     watt / m^2 / sr / m, of air, sky and water
    glint    likewise, glint of water whose long waves are level
    towards  (2,) Z, the slope that mirrors the Sun into the camera, along lines and columns
    rough    s^2, mean square slope of the waves shorter than the drawn waves
    """

    base: float
    glint: float
    towards: Floats
    rough: float

    def gain(self, down: Floats, right: Floats) -> Floats:
        """Glint at the slopes z of long waves, over the glint of level long waves."""
        bright = 2 * (self.towards[0] * down + self.towards[1] * right)
        return np.asarray(np.exp((bright - down**2 - right**2) / self.rough))


def channel_of(survey: Survey, own: Waves) -> Channel:
    """The channel. Raises as `sunlit_channels`."""
    return patch.sunlit_channels(survey, (own.channel,), "retrieval.waves.channel")[0]


def _shortest(view: Side | patch.View) -> float:
    """Shortest resolved wave, one pixel, metre: longer waves tilt the shorter waves."""
    return max(view.along, view.across)


def mirror_of(survey: Survey, own: Waves, side: Side) -> Mirror:
    """The glint over a sea.

    Source: Cox and Munk (1954), J. Opt. Soc. Am. 44, 838; slopes of resolved and unresolved waves,
    Kudryavtsev et al. (2017), J. Geophys. Res. Oceans 122, 1369.

    Raises  Refused if the resolved waves are steeper than all waves of the wind.
    """
    water, band = Water(wind=own.wind), side.band
    if survey.rays < LEAST_RAYS:
        raise Refused(
            f"rays must be {LEAST_RAYS} or more for a retrieval of waves, got {survey.rays}"
        )
    shortest = _shortest(side)
    rough = water.slope_variance - slope_variance(own.sea, shortest)
    if rough < water.slope_variance / 3:
        raise Refused(
            f"retrieval.waves.significant_height must leave a third of the mean square slope, "
            f"{water.slope_variance:.3g}, to waves shorter than {shortest:.3g} m, got "
            f"{own.significant_height:g} m"
        )
    slope = math.tan(own.sun_zenith / 2)
    incident = math.cos(own.sun_zenith / 2)
    mirrored = float(fresnel(np.array([incident]), water.refraction)[0])
    density = math.exp(-(slope**2) / rough) / (math.pi * rough)
    factor = math.pi * mirrored * density / (4 * math.cos(own.sun_zenith) * incident**4)
    foam = water.foam
    mean = factor * math.exp(slope**2 / rough - slope**2 / water.slope_variance)
    mean *= rough / water.slope_variance
    below = side.reflectance
    sky = float(sky_factor(water, np.array([below]), (1.0, 0.0, 0.0), np.ones(1))[0])
    white = below + foam * 0.22
    ground = patch.level_ground(2, own.height, own.sun_zenith)
    around = min(white + mean, 1.0)
    terms = terms_in_band(ground, band, np.array([sky, 1.0]), around, None, np.array([white, 1.0]))
    direct = float(terms.direct[1])
    azimuth = own.sun_azimuth
    return Mirror(
        float(terms.total[0]),
        (1 - foam) * factor * direct,
        slope * np.array([math.cos(azimuth), math.sin(azimuth)]),
        rough,
    )


class WaveImage(NamedTuple):
    """An image and its truth.

    radiance   (size, size) measured
    height     metre, significant, of the waves in the image
    direction  radian, mean direction modulo pi
    """

    radiance: Floats
    height: float
    direction: float


@lru_cache(maxsize=8)
def _view(survey: Survey, own: Waves) -> tuple[patch.View, Mirror]:
    channel = channel_of(survey, own)
    view = patch.view_below(survey, channel, own.size, own.height, own.sun_zenith)
    return view, mirror_of(survey, own, side_of(survey, channel, own))


def observe_waves(survey: Survey, own: Waves, seed: int, number: int) -> WaveImage:
    """A periodic image of a random sea, from a seed and the image's number.

    Raises  ValueError as `channel_of`, `mirror_of` and `view_below`.
    """
    view, mirror = _view(survey, own)
    rays, size = survey.rays, own.size
    step = view.along / rays, view.across / rays
    stream = Streams(seed, number)("sea")
    level, down, right = draw_sea(own.sea, stream, size * rays, step, _shortest(view))
    light = mirror.base + mirror.glint * mirror.gain(down, right)
    lattice = light.astype(np.float32).reshape(size, rays, size, rays).transpose(0, 2, 1, 3)
    lattice = np.ascontiguousarray(lattice.reshape(size, size, rays**2))
    half = view.weights.shape[1] // 2
    around = np.pad(lattice, ((half, half), (half, half), (0, 0)), "wrap")
    seen = np.concatenate(list(blur_strips(iter([around]), view.weights)))
    near = seen[half : half + size, half : half + size].astype(np.float64)
    # Light beyond the table of a point's image has the mean radiance.
    seen = view.psf.energy * near + (1 - view.psf.energy) * float(lattice.mean())
    down, right = _plane(len(level), step)
    wave = np.abs(np.fft.fft2(level)) ** 2 / level.size**2
    model = elevation_power(own.sea, np.stack([down, right], -1), _shortest(view))
    model = model / (own.size**2 * view.along * view.across)
    height, direction = _moments(own.sea, wave, model, np.arctan2(right, down))
    return WaveImage(patch.numbers_of(view, seen, Streams(seed, number)), height, direction)


def _plane(size: int, step: tuple[float, float]) -> tuple[Floats, Floats]:
    """Frequencies (n, n) along lines and columns, cycle / metre."""
    down, right = (np.asarray(np.fft.fftfreq(size, width), np.float64) for width in step)
    grid = np.meshgrid(down, right, indexing="ij")
    return grid[0], grid[1]


def _moments(sea: Sea, wave: Floats, model: Floats, turn: Floats) -> tuple[float, float]:
    """Significant height (metre) and mean direction (radian, modulo pi) of waves.

    sea    the sea of the waves that are not among `wave`
    wave   metre^2, mean square of each
    model  metre^2, mean square of each in that sea
    turn   radian, direction of each
    """
    more, phase = wave - model, np.exp(2j * turn)
    total = sea.height**2 / 16
    double = total * _evenness(sea) * np.exp(2j * sea.direction) + (more * phase).sum()
    return 4 * math.sqrt(max(total + float(more.sum()), 0.0)), float(np.angle(double)) / 2


def _evenness(sea: Sea) -> float:
    """Mean cosine of twice the angle from the mean direction."""
    return sea.spreading / (sea.spreading + 2)


class _Modes(NamedTuple):
    """Waves that an image can show, (n,) each: one of each pair of opposite waves.

    down, right  cycle / metre, along lines and columns
    places       their places in the transform of an image
    seen         transfer function of lens, pixel and smear; zero where stripes hide waves
    fine         likewise, of all waves of a grid of several points a pixel
    area         square metre, area of an image
    """

    down: Floats
    right: Floats
    places: tuple[Ints, ...]
    seen: Floats
    fine: Floats
    area: float

    def power(self, sea: Sea) -> Floats:
        """Mean square elevation of each wave, metre^2."""
        frequency = np.stack([self.down, self.right], -1)
        return 2 * elevation_power(sea, frequency) / self.area

    def turn(self) -> Floats:
        """Direction of each wave from the lines' order to the right, radian."""
        return np.arctan2(self.right, self.down)


def _modes(own: Waves, side: Side) -> _Modes:
    steps = side.along, side.across
    down, right = _plane(own.size, steps)
    inside = (np.abs(down * steps[0]) <= HIGHEST) & (np.abs(right * steps[1]) <= HIGHEST)
    places = np.nonzero(inside & ((down > 0) | ((down == 0) & (right > 0))))
    down, right = down[places], right[places]
    fine = _plane(own.size * RAYS, (steps[0] / RAYS, steps[1] / RAYS))
    seen, every = (
        side.transfer(across * side.side, along * side.side)
        for along, across in ((down, right), fine)
    )
    # Differences between columns are equal in all lines.
    seen = np.where(down > 0, seen, 0.0)
    return _Modes(down, right, places, seen, every, own.size**2 * math.prod(steps))


class _Transfer(NamedTuple):
    """Transfer from the waves of a sea to an image, (n,) each.

    gain    1 / metre^2, mean square of the brightness over that of the elevation
    rest    1, mean square of the other brightness, noise included
    glint   statistics of the brightness
    rms     watt / m^2 / sr / m, rms brightness by waves: one number
    mean    likewise, mean of the glint
    noise   variance of a pixel, likewise squared
    """

    gain: Floats
    rest: Floats
    glint: Glint
    rms: float
    mean: float
    noise: float


def _noise(side: Side, radiance: float) -> float:
    """Variance of a pixel's radiance by noise; differences between columns do not count as
    noise."""
    detector = side.channel.detector
    every = float(side.variance(np.array(radiance)))
    return every + side.stripes - (detector.prnu * radiance) ** 2 if detector.scan else every


def _transfer(own: Waves, side: Side, mirror: Mirror, modes: _Modes, sea: Sea) -> _Transfer:
    """The waves of a sea in the images of a channel."""
    steps = side.along / RAYS, side.across / RAYS
    glint = glint_over(mirror.rough, mirror.towards, sea, own.size * RAYS, steps, _shortest(side))
    # Waves too short for the grid of pixels appear as longer waves (aliasing).
    every = glint.spectrum * modes.fine**2
    folded = every.reshape(RAYS, own.size, RAYS, own.size).sum((0, 2))
    mean = mirror.glint * glint.mean
    noise = _noise(side, mirror.base + mean)
    wave = 2 * math.pi * (glint.gain[0] * modes.down + glint.gain[1] * modes.right) * modes.seen
    linear = wave**2 * modes.power(sea)
    rest = np.maximum(2 * folded[modes.places] - linear, 0.0)
    # Differences between columns, or pixels, change the contrast of waves.
    detector = side.channel.detector
    around = folded.mean(1, keepdims=True) if detector.scan else folded.mean(keepdims=True)
    uneven = detector.prnu**2 * np.broadcast_to(around, folded.shape)[modes.places]
    camera = 2 * (noise / mean**2 / own.size**2 + uneven)
    scatter = max(float(folded.sum()), 0.0)
    rms = math.sqrt(scatter) * mean
    return _Transfer(wave**2, rest + camera, glint, rms, mean, noise)


class _Fit(NamedTuple):
    """A model of the waves of an image.

    sea     the state
    wave    (n,) metre^2, mean square of each wave
    image   (n,) mean square of each wave in the image
    slopes  (3, n) metre^2, derivatives of `wave` with ln(height), ln(wavelength) and direction
    covariance  (3, 3) of the three
    """

    sea: Sea
    wave: Floats
    image: Floats
    slopes: Floats
    covariance: Floats


def _fit(modes: _Modes, transfer: _Transfer, sea: Sea) -> _Fit:
    wave = modes.power(sea)
    image = transfer.gain * wave + transfer.rest
    slopes = np.stack(
        [
            (modes.power(_moved(sea, unit * SMALL)) - modes.power(_moved(sea, -unit * SMALL)))
            / (2 * SMALL)
            for unit in np.eye(3)
        ]
    )
    relative = transfer.gain * slopes / image
    covariance = np.asarray(np.linalg.inv(relative @ relative.T), np.float64)
    return _Fit(sea, wave, image, slopes, covariance)


def _moved(sea: Sea, change: Floats) -> Sea:
    """The sea with changed ln(height), ln(wavelength) and direction."""
    return sea._replace(
        height=sea.height * math.exp(change[0]),
        wavelength=sea.wavelength * math.exp(change[1]),
        direction=sea.direction + change[2],
    )


@printed
class WaveEstimate(NamedTuple):
    """Results of the retrieval from an image.

    height      metre, significant
    direction   radian, from the direction of flight to the right; its sense is not known
    wavelength  metre, at the peak of the spectrum
    """

    height: float
    direction: float
    wavelength: float


def retrieve_waves(survey: Survey, own: Waves, radiance: Floats) -> WaveEstimate:
    """Height and direction of the waves of an image.

        b = (L - base) / mean - 1,   |b_k|^2 = (g . k)^2 T^2 |z_k|^2 + rest

    The spectrum S of maximum likelihood is the prior of waves that are hardly visible. The
    posterior mean square of each wave is the square of its Wiener estimate plus its remaining
    variance:

        |z_k|^2 = W^2 |b_k|^2 / gain + (1 - W) S,   W = gain S / (gain S + rest)

    Source: transfer of glint, Kudryavtsev et al. (2017); likelihood of a spectrum, Whittle (1953),
    Arkiv foer Matematik 2, 423.
    """
    mirror, side, modes = _plan(survey, own)
    light = radiance - mirror.base
    bright = light / light.mean() - 1
    square = 2 * np.abs(np.fft.fft2(bright)[modes.places]) ** 2 / own.size**4
    sea = _start(own, mirror, modes, square)
    for _ in range(ROUNDS):
        transfer = _transfer(own, side, mirror, modes, sea)
        fit = _best(modes, transfer, sea, square)
        sea = fit.sea
    height, direction = _estimated(modes, transfer, sea, square)
    return WaveEstimate(height, direction, sea.wavelength)


def _estimated(modes: _Modes, transfer: _Transfer, sea: Sea, square: Floats) -> tuple[float, float]:
    """Significant height and direction of the waves of an image, given the sea."""
    model = modes.power(sea)
    image = transfer.gain * model + transfer.rest
    kept = transfer.gain * model / image
    wave = kept * square * (model / image) + (1 - kept) * model
    return _moments(sea, wave, model, modes.turn())


def _cost(image: Floats, square: Floats) -> float:
    """Minus the log-likelihood of squares with the means `image`."""
    return float((np.log(image) + square / image).sum())


def _start(own: Waves, mirror: Mirror, modes: _Modes, square: Floats) -> Sea:
    """The best of a few seas; invisible waves give the brightness that does not follow waves."""
    slopes = (mirror.towards[0] * modes.down + mirror.towards[1] * modes.right) / mirror.rough
    gain = (4 * math.pi * slopes * modes.seen) ** 2
    size = np.hypot(modes.down, modes.right)
    across = np.abs(slopes) < BLIND * size * np.hypot(*mirror.towards) / mirror.rough
    ring = np.minimum((size / size.max() * RINGS).astype(int), RINGS - 1)
    blind = across & (modes.seen > 0)
    count = np.maximum(np.bincount(ring[blind], minlength=RINGS), 1)
    rest = (np.bincount(ring[blind], square[blind], RINGS) / count)[ring]
    rest = np.where(rest > 0, rest, float(square.mean()))
    best, least = own.sea, math.inf
    for wavelength in np.geomspace(2 / size.max(), math.sqrt(modes.area) / 3, LENGTHS):
        for direction in np.arange(DIRECTIONS) * math.pi / DIRECTIONS:
            sea = own.sea._replace(height=1.0, wavelength=wavelength, direction=direction)
            image = gain * modes.power(sea)
            more = square - rest
            # Strong waves give their sum, weak waves the slope of the likelihood.
            for level in (
                float(more.sum() / image.sum()),
                float((more * image / rest**2).sum() / ((image / rest) ** 2).sum()),
            ):
                strength = max(level, 1e-12)
                if (value := _cost(strength * image + rest, square)) < least:
                    best, least = sea._replace(height=math.sqrt(strength)), value
    return best


def _best(modes: _Modes, transfer: _Transfer, sea: Sea, square: Floats) -> _Fit:
    """The sea of maximum likelihood for (n,) squares of an image, from a nearby sea."""
    fit = _fit(modes, transfer, sea)
    least = _cost(fit.image, square)
    for _ in range(SCORINGS):
        relative = transfer.gain * fit.slopes / fit.image
        step = fit.covariance @ (relative @ (square / fit.image - 1))
        step = np.clip(step, -0.5, 0.5)
        while np.abs(step).max() > CLOSE:
            new = _fit(modes, transfer, _moved(fit.sea, step))
            if (value := _cost(new.image, square)) < least:
                break
            step = step / 2
        else:
            break
        least, fit = value, new
    return fit


@lru_cache(maxsize=8)
def _plan(survey: Survey, own: Waves) -> tuple[Mirror, Side, _Modes]:
    """Known inputs of retrieval and forecast: the glint, the channel, and the waves of an image."""
    side = side_of(survey, channel_of(survey, own), own)
    mirror = mirror_of(survey, own, side)
    return mirror, side, _modes(own, side)


@printed
class WaveForecast(NamedTuple):
    """Errors by formula.

    height_error     metre, rms
    direction_error  radian, rms
    gain             1, derivative of ln(glint) with slope towards the Sun
    """

    height_error: float
    direction_error: float
    gain: float


def forecast_waves(survey: Survey, own: Waves) -> WaveForecast:
    """Errors of significant height and of direction.

        e = sum_k t_k |b_k|^2 - sum_k a_k |z_k|^2,   t = a W^2 / gain + g (r e)^-1 r / E
        Var e = sum (S d<sum t |b|^2> / dS - a S)^2 + sum (t E)^2 (1 - W^2) + pairs
        r = d(gain S) / E,   e = dE / E,   E = gain S + N,   W = gain S / E

    Waves z have the powers S; b is their image. a, per change of the result, is 1 for height; for
    direction it is the sine of twice the angle from the mean direction. d is a derivative with
    height, wavelength and direction of the fitted sea, g the derivative of the result. Higher waves
    increase the brightness N that does not follow them and reduce the brightness that does, so b
    contains more information on z than E implies. `scatter_of` computes this information, and the
    variance by pairs of waves that depend on a third wave. The rest of N, with the camera's noise,
    is assumed to be independent of the waves.

    Source    Kay (1993), Fundamentals of Statistical Signal Processing, 3.9 and 11.
    Raises    ValueError as `channel_of`, `mirror_of` and `side_of`; where waves are hardly visible,
              brightness depends on more than their slopes, or the converter's steps are too coarse.
    Accuracy  model: linear waves, normal slopes; the wind and the light of air and water are known.
    """
    mirror, side, modes = _plan(survey, own)
    sea = own.sea
    transfer = _transfer(own, side, mirror, modes, sea)
    _refuse_coarse_steps(side, transfer)
    fit = _fit(modes, transfer, sea)
    _refuse_if_unlike_waves(transfer, fit)
    growth, response = _sensitivity(own, side, mirror, modes, fit)
    relative = transfer.gain * fit.slopes / fit.image
    towards = np.linalg.inv(relative @ growth.T)
    kept = transfer.gain * fit.wave / fit.image

    def squared(weight: Floats, response: Floats) -> float:
        """Variance of a sum of weighted squares of waves with this response to the sea."""
        waves = weight * fit.wave
        image = kept * waves + response @ towards @ relative
        half = np.zeros((own.size, own.size))
        half[modes.places] = image / fit.image * modes.seen**2
        opposite = np.roll(half[::-1, ::-1], 1, (0, 1))
        steps = side.along, side.across
        found = scatter_of(
            transfer.glint, mirror.towards, sea, half + opposite, steps, _shortest(side)
        )
        rest = image**2 @ (1 - kept**2) + found.pairs
        return float(((found.follows[modes.places] - waves) ** 2).sum() + rest)

    total = sea.height**2 / 16
    turned = np.sin(2 * (modes.turn() - sea.direction)) / (2 * total * _evenness(sea))
    detector = side.channel.detector
    pixels = own.size if detector.scan else own.size**2
    # Brightness is divided by the mean of the glint, which contains differences of pixels.
    level = detector.prnu * (mirror.base + transfer.mean) / transfer.mean / math.sqrt(pixels)
    linear = np.full(len(turned), 2 / math.sqrt(total))
    height = squared(linear, response[:, 0]) + (sea.height * level) ** 2
    direction = squared(turned, response[:, 1])
    if height > (WORST * sea.height) ** 2 or direction > WORST**2:
        raise Refused(
            f"waves must be visible enough for a forecast: errors within {WORST:.0%} of the "
            f"height and {WORST:g} rad, got {math.sqrt(height) / sea.height:.0%} and "
            f"{math.sqrt(direction):.2g} rad: increase light or wave height, or reduce noise"
        )
    return WaveForecast(
        math.sqrt(height), math.sqrt(direction), 2 * float(np.hypot(*mirror.towards)) / mirror.rough
    )


def _refuse_coarse_steps(side: Side, transfer: _Transfer) -> None:
    """Refuse a converter whose steps are large compared with the brightness before it."""
    step = side.channel.detector.electrons_per_dn / side.electrons
    before = math.sqrt(transfer.rms**2 + max(transfer.noise - step**2 / 12, 0.0))
    if before < COARSE * step:
        raise Refused(
            f"bits of channel {side.channel.name} must make steps of {before / COARSE:.3g} "
            f"W / (m2 sr m) or finer for a forecast of waves, got {step:.3g}"
        )


def _refuse_if_unlike_waves(transfer: _Transfer, fit: _Fit) -> None:
    """Refuse an image in which little of the brightness follows the slopes of waves."""
    follows = float((transfer.gain * fit.wave).sum()) * (transfer.mean / transfer.rms) ** 2
    if follows < FOLLOWS:
        raise Refused(
            f"brightness must follow the slopes of waves for a forecast, {FOLLOWS:.0%} of its "
            f"variance, got {follows:.0%}: use a lower Sun or waves along it"
        )


def _sensitivity(
    own: Waves, side: Side, mirror: Mirror, modes: _Modes, fit: _Fit
) -> tuple[Floats, Floats]:
    """Derivatives with the sea that the retrieval assumes: ln(height), ln(wavelength), direction.

    Returns  of the image (3, n), relative; of the height and the direction (3, 2) that are
             estimated from it
    """
    sea, growth, results = own.sea, [], []
    for unit in np.eye(3):
        other = _moved(sea, unit * STEP)
        changed = _transfer(own, side, mirror, modes, other)
        image = changed.gain * modes.power(other) + changed.rest
        growth.append((image / fit.image - 1) / STEP)
        results.append(_estimated(modes, changed, other, fit.image))
    return np.array(growth), (np.array(results) - (sea.height, sea.direction)) / STEP
