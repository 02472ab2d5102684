"""Waves: height and direction of a sea from its glint; their errors by formula and by trials.

Each slope of the water mirrors another part of the sky. Where the camera sees the glint of the Sun,
waves that are longer than a pixel tilt the small ones on them, and brightness follows their slope
towards the Sun. Waves that run across that direction are not seen, and an image does not tell a
wave from one that runs the opposite way.
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

HIGHEST = 0.49  # cycle / pixel along each axis, of the waves that are fitted
RAYS = 2  # points of a pixel along each axis, of the statistics of slopes
LEAST_RAYS = 3  # likewise, of the images of trials: two are too few for a sharp lens
SMALL = 1e-4  # step of derivatives of the spectrum
STEP = 1e-3  # likewise, of the image and the results
LENGTHS, DIRECTIONS = 8, 6  # of the seas in which a fit begins
BLIND = 0.2  # cosine to the Sun's direction, below which waves are not seen
RINGS = 12  # of wave numbers
ROUNDS = 5  # of a fit, each with the statistics of the last
SCORINGS = 30  # of a round, at most
CLOSE = 1e-4  # of its steps
COARSE = 0.6  # steps of the converter, of waves and noise together, from which on steps are noise
FOLLOWS = 0.75  # of the variance of brightness by waves, that must follow their slopes
WORST = 0.1  # of the height, and radian: larger errors are not those of a linear theory


class Waves(Parameters):
    """Significant height and direction of waves in the glint of the Sun.

    Images are those of level water straight below; the air, the wind and the light of the water
    itself are taken as known.
    """

    channel: str = parameter("name of the one whose image has the glint", default="B8")
    wind: float = parameter(
        "12.5 m above the water, which makes it rough",
        unit=Unit("m / s"),
        limit=Range(0.5, 20),
        default=8.0,
    )
    significant_height: float = parameter(
        "of the waves: four standard deviations of the elevation",
        unit=Unit("m"),
        limit=POSITIVE,
        default=1.4,
    )
    peak_wavelength: float = parameter(
        "of the waves", unit=Unit("m"), limit=Range(0.1, 2000), default=60.0
    )
    direction: float = parameter(
        "of the waves, from the direction of flight to the right",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi, math.pi),
        default=math.radians(20),
    )
    peakedness: float = parameter(
        "1: spectrum of Pierson and Moskowitz; 3.3: JONSWAP", limit=Range(1, 10), default=1.0
    )
    spreading: float = parameter(
        "power of the cosine of the angle from that direction", limit=Range(1, 60), default=2.0
    )
    sun_azimuth: float = parameter(
        "of the Sun, from the direction of flight to the right",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi, math.pi),
        default=math.radians(-30),
    )
    height: float = parameter(
        "of the water above the ellipsoid", unit=Unit("m"), limit=Range(0, 9000), default=0.0
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
    """What waves do to the light of a channel.

        L = base + glint exp((|Z|^2 - |Z - z|^2) / s^2)

    base     watt / m^2 / sr / m, of air, sky and water
    glint    likewise, of water whose long waves are level
    towards  (2,) Z, the slope that mirrors the Sun into the camera, along lines and columns
    rough    s^2, mean square slope of the waves shorter than those that are drawn
    """

    base: float
    glint: float
    towards: Floats
    rough: float

    def gain(self, down: Floats, right: Floats) -> Floats:
        """Glint over that of level long waves, at their slopes z."""
        bright = 2 * (self.towards[0] * down + self.towards[1] * right)
        return np.asarray(np.exp((bright - down**2 - right**2) / self.rough))


def channel_of(survey: Survey, own: Waves) -> Channel:
    """The channel. Raises as `sunlit_channels`."""
    return patch.sunlit_channels(survey, (own.channel,), "retrieval.waves.channel")[0]


def _shortest(view: Side | patch.View) -> float:
    """Metre, a pixel: longer waves tilt those that are shorter."""
    return max(view.along, view.across)


def mirror_of(survey: Survey, own: Waves, side: Side) -> Mirror:
    """The glint over a sea.

    Source: Cox and Munk (1954), J. Opt. Soc. Am. 44, 838; slopes of waves that are seen and of
    those that are not, Kudryavtsev et al. (2017), J. Geophys. Res. Oceans 122, 1369.

    Raises  Refused where waves of the lengths that are seen are steeper than the wind makes all.
    """
    water, band = Water(wind=own.wind), side.band
    if survey.rays < LEAST_RAYS:
        raise Refused(f"rays must be {LEAST_RAYS} or more where waves are seen, got {survey.rays}")
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
    direction  radian, their mean, opposite ones alike
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
    """An image of a random sea, from a seed and its number. It is periodic.

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
    # Light beyond the table of a point's image is that of the mean.
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
    """Significant height (metre) and mean direction (radian) of waves; opposite ones are alike.

    sea    that waves which are not among them have
    wave   metre^2, mean square of each
    model  metre^2, likewise in that sea
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
    """Waves that an image may show, (n,) each: one of each pair of opposite ones.

    down, right  cycle / metre, along lines and columns
    places       of them in the transform of an image
    seen         transfer function of lens, pixel and smear; zero where stripes hide waves
    fine         likewise, of all waves of a grid of several points a pixel
    area         square metre of an image
    """

    down: Floats
    right: Floats
    places: tuple[Ints, ...]
    seen: Floats
    fine: Floats
    area: float

    def power(self, sea: Sea) -> Floats:
        """Mean square elevation of each, metre^2."""
        frequency = np.stack([self.down, self.right], -1)
        return 2 * elevation_power(sea, frequency) / self.area

    def turn(self) -> Floats:
        """Radian, direction of each from the lines' order to the right."""
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
    # Differences between columns are alike in all lines.
    seen = np.where(down > 0, seen, 0.0)
    return _Modes(down, right, places, seen, every, own.size**2 * math.prod(steps))


class _Transfer(NamedTuple):
    """How an image shows the waves of a sea, (n,) each.

    gain    1 / metre^2, mean square of the brightness over that of the elevation
    rest    1, mean square of the brightness that does not follow the elevation, noise included
    glint   statistics of the brightness
    rms     watt / m^2 / sr / m, of the brightness by waves: one number
    mean    likewise, of the glint
    noise   variance of a pixel, likewise squared
    """

    gain: Floats
    rest: Floats
    glint: Glint
    rms: float
    mean: float
    noise: float


def _noise(side: Side, radiance: float) -> float:
    """Variance of a pixel's radiance; differences between columns are no noise of waves."""
    detector = side.channel.detector
    every = float(side.variance(np.array(radiance)))
    return every + side.stripes - (detector.prnu * radiance) ** 2 if detector.scan else every


def _transfer(own: Waves, side: Side, mirror: Mirror, modes: _Modes, sea: Sea) -> _Transfer:
    """The waves of a sea in the images of a channel."""
    steps = side.along / RAYS, side.across / RAYS
    glint = glint_over(
        mirror.rough, *mirror.towards.tolist(), sea, own.size * RAYS, steps, _shortest(side)
    )
    # What a pixel's grid is too coarse for is seen as longer waves.
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
    image   (n,) mean square of each in the image
    slopes  (3, n) metre^2, derivatives of `wave` with ln(height), ln(wavelength) and direction
    covariance  (3, 3) of these three
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
    """A sea of another ln(height), ln(wavelength) and direction."""
    return sea._replace(
        height=sea.height * math.exp(change[0]),
        wavelength=sea.wavelength * math.exp(change[1]),
        direction=sea.direction + change[2],
    )


@printed
class WaveEstimate(NamedTuple):
    """What is retrieved of an image.

    height      metre, significant
    direction   radian, from the direction of flight to the right; an image does not tell it from
                the opposite direction
    wavelength  metre, of the peak
    """

    height: float
    direction: float
    wavelength: float


def retrieve_waves(survey: Survey, own: Waves, radiance: Floats) -> WaveEstimate:
    """Height and direction of the waves of an image.

        b = (L - base) / mean - 1,   |b_k|^2 = (g . k)^2 T^2 |z_k|^2 + rest

    The spectrum S of maximum likelihood is the prior of waves that the image hardly shows. The
    posterior mean square of each wave is that of a Wiener filter plus its remaining variance:

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
    """Minus the logarithm of the likelihood of squares whose means are an image's."""
    return float((np.log(image) + square / image).sum())


def _start(own: Waves, mirror: Mirror, modes: _Modes, square: Floats) -> Sea:
    """The best of a few seas; brightness that does not follow the waves is that of blind ones."""
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
            # Of strong waves by their sum, of weak ones by the slope of the likelihood.
            for level in (
                float(more.sum() / image.sum()),
                float((more * image / rest**2).sum() / ((image / rest) ** 2).sum()),
            ):
                strength = max(level, 1e-12)
                if (value := _cost(strength * image + rest, square)) < least:
                    best, least = sea._replace(height=math.sqrt(strength)), value
    return best


def _best(modes: _Modes, transfer: _Transfer, sea: Sea, square: Floats) -> _Fit:
    """The sea of the largest likelihood of (n,) squares of an image, from one that is near."""
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
    """What retrieval and forecast know: the glint, the channel, and waves of an image."""
    side = side_of(survey, channel_of(survey, own), own)
    mirror = mirror_of(survey, own, side)
    return mirror, side, _modes(own, side)


@printed
class WaveForecast(NamedTuple):
    """What the formulas expect.

    height_error     metre, rms
    direction_error  radian, rms
    gain             1, change of ln(glint) with slope towards the Sun
    """

    height_error: float
    direction_error: float
    gain: float


def forecast_waves(survey: Survey, own: Waves) -> WaveForecast:
    """Errors of significant height and of direction.

        e = sum_k t_k |b_k|^2 - sum_k a_k |z_k|^2,   t = a W^2 / gain + g (r e)^-1 r / E
        Var e = sum (S d<sum t |b|^2> / dS - a S)^2 + sum (t E)^2 (1 - W^2) + pairs
        r = d(gain S) / E,   e = dE / E,   E = gain S + N,   W = gain S / E

    of waves z of the powers S whose image has b, with a = 1 for height and the sine of twice the
    angle from the mean direction for that, per change of the result; d is a derivative with height,
    wavelength and direction of the sea that the fit finds, g that of the result. Higher waves have
    more of the brightness N that does not follow them, and less of that which does: so b knows more
    of z than E says. `scatter_of` has how much, and what pairs of waves that are seen with a third
    add where they are not independent of it. All else of N, camera's noise included, is taken as
    independent of the waves.

    Source    Kay (1993), Fundamentals of Statistical Signal Processing, 3.9 and 11.
    Raises    ValueError as `channel_of`, `mirror_of` and `side_of`; where waves are hardly seen,
              brightness follows more than their slopes, or steps of the converter are too coarse.
    Accuracy  model: waves linear, slopes normal, the wind and the light of air and water known.
    """
    mirror, side, modes = _plan(survey, own)
    sea = own.sea
    transfer = _transfer(own, side, mirror, modes, sea)
    step = side.channel.detector.electrons_per_dn / side.electrons
    before = math.sqrt(transfer.rms**2 + max(transfer.noise - step**2 / 12, 0.0))
    if before < COARSE * step:
        raise Refused(
            f"bits of channel {side.channel.name} must make steps of {before / COARSE:.3g} "
            f"W / (m2 sr m) or finer for a forecast of waves, got {step:.3g}"
        )
    fit = _fit(modes, transfer, sea)
    follows = float((transfer.gain * fit.wave).sum()) * (transfer.mean / transfer.rms) ** 2
    if follows < FOLLOWS:
        raise Refused(
            f"brightness must follow the slopes of waves for a forecast, {FOLLOWS:.0%} of its "
            f"variance, got {follows:.0%}: a lower Sun, or fewer waves across its direction"
        )
    # By how much image and results change with the sea that the retrieval takes them for.
    growth, results = [], []
    for unit in np.eye(3):
        other = _moved(sea, unit * STEP)
        changed = _transfer(own, side, mirror, modes, other)
        image = changed.gain * modes.power(other) + changed.rest
        growth.append((image / fit.image - 1) / STEP)
        results.append(_estimated(modes, changed, other, fit.image))
    relative = transfer.gain * fit.slopes / fit.image
    towards = np.linalg.inv(relative @ np.array(growth).T)
    response = (np.array(results) - (sea.height, sea.direction)) / STEP
    kept = transfer.gain * fit.wave / fit.image

    def squared(weight: Floats, response: Floats) -> float:
        """Variance of a sum of weighted squares of waves that responds so to the sea."""
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
    # The mean of the glint, by which brightness is divided, has differences of pixels.
    level = detector.prnu * (mirror.base + transfer.mean) / transfer.mean / math.sqrt(pixels)
    linear = np.full(len(turned), 2 / math.sqrt(total))
    height = squared(linear, response[:, 0]) + (sea.height * level) ** 2
    direction = squared(turned, response[:, 1])
    if height > (WORST * sea.height) ** 2 or direction > WORST**2:
        raise Refused(
            f"waves must be seen well enough for a forecast, errors within {WORST:.0%} of the "
            f"height and {WORST:g} rad, got {math.sqrt(height) / sea.height:.0%} and "
            f"{math.sqrt(direction):.2g} rad: more light, less noise, or higher waves"
        )
    return WaveForecast(
        math.sqrt(height), math.sqrt(direction), 2 * float(np.hypot(*mirror.towards)) / mirror.rough
    )
