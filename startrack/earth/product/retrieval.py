"""Calibration frames; raw numbers -> radiance -> reflectance or temperature of the ground."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from startrack.core import Advance, Floats, Streams, printed, um, whole
from startrack.detector import read_out
from startrack.earth import imager
from startrack.earth.terrain import Ground

FRACTIONS = 0.1, 0.3, 0.6, 0.9  # signals of the flat frames over the largest signal; chosen by hand
TOO_MUCH = 3.0  # times the largest signal; saturates every pixel that responds to light
SIGMA = 4.0
TRANSFER = 2  # index of the flat for photon transfer
# defaults: number of averaged lines of a scanner, of averaged frames of a matrix
LINES, FRAMES = 256, 16
IN_TURN = 2**16  # largest number of exposures of one level in memory
ROUNDS = 6  # iterations of the surroundings' mean reflectance; each change is a tenth of the last
MIXED = 5  # iterations of each pixel's surroundings; in haze each change is a third of the last
FIRST = 0.2  # initial mean reflectance
THINNED = 2**14  # largest number of pixels for the mean reflectance


@printed
class RadiometricCalibration(NamedTuple):
    """Mean frames of one channel; lines of a scanner are averaged into one.

    dark       (r, columns) digital number, r = 1 for a scanner
    flat       (k, r, columns) digital number, in uniform light
    radiance   (k,) watt / m^2 / sr / um of the flats, rising
    gain       (r, columns) digital number for 1 watt / m^2 / sr / um, at the middle flat
    electrons  electron / digital number, measured by photon transfer
    saturation  (r, columns) least digital number that counts as saturated: four sigma below the
                mean of saturated exposures
    exposures  in each mean
    """

    dark: Floats
    flat: Floats
    radiance: Floats
    gain: Floats
    electrons: float
    saturation: Floats
    exposures: int


def calibrate(
    survey: imager.Survey,
    channel: imager.Channel,
    setting: imager.Setting,
    seed: int,
    count: int | None = None,
    advance: Advance = lambda frames: None,
) -> RadiometricCalibration:
    """Simulate dark frames, and flat frames of known radiance, with the detector's own noise.

    setting  setting of the channel's images
    seed     of the noise, which differs from the noise of an image with the same seed
    count    exposures in each mean; None: 256 lines or 16 frames
    advance  called after each level, with 1
    Accuracy model: the calibration lamp is uniform and known exactly. numerical: the noise of each
             pixel's mean is 1 / sqrt(count) of the noise of an exposure.
    """
    scanner = bool(channel.detector.scan)
    count = (LINES if scanner else FRAMES) if count is None else count
    whole(2, IN_TURN, frames=count)
    detector = channel.detector
    largest = 2**detector.bits - 1
    full = (largest - detector.offset) * detector.full_well / largest / detector.gain
    full = min(full, detector.full_well)
    light = np.array([0.0, *FRACTIONS, TOO_MUCH]) * full / setting.electrons
    names = [own.name for own in survey.camera.channels]
    first = (len(names) + names.index(channel.name)) * imager.MOST_LINES
    mean, variance = [], []
    for level, radiance_of_level in enumerate(light):
        turn = first + level * IN_TURN
        expose = _lines if scanner else _frames
        average, spread = expose(channel, setting, radiance_of_level, count, seed, turn)
        mean.append(average)
        variance.append(spread)
        advance(1)
    signal = mean[1 + TRANSFER] - mean[0]
    noise = float((variance[1 + TRANSFER] - variance[0]).mean())
    radiance = light[1:-1] * um
    saturation = np.round(mean[-1] - SIGMA * np.sqrt(variance[-1]))
    return RadiometricCalibration(
        dark=mean[0],
        flat=np.stack(mean[1:-1]),
        radiance=radiance,
        gain=signal / radiance[TRANSFER],
        electrons=float(signal.mean()) / noise if noise > 0 else 0.0,
        saturation=saturation,
        exposures=count,
    )


def _lines(
    channel: imager.Channel, setting: imager.Setting, light: float, count: int, seed: int, turn: int
) -> tuple[Floats, Floats]:
    """Mean and variance (1, columns) of lines in uniform light, watt / m^2 / sr / m."""
    even = np.full((count, channel.columns), light)
    electrons = imager.pixel_electrons(channel, setting, even)
    numbers = read_out(electrons, imager.as_matrix(channel, count), Streams(seed, turn))
    numbers = numbers.astype(float)
    return numbers.mean(0, keepdims=True), numbers.var(0, ddof=1, keepdims=True)


def _frames(
    channel: imager.Channel, setting: imager.Setting, light: float, count: int, seed: int, turn: int
) -> tuple[Floats, Floats]:
    """Mean and variance (rows, columns) of frames, likewise."""
    rows = channel.detector.rows
    electrons = imager.pixel_electrons(channel, setting, np.full((rows, channel.columns), light))
    start, total, squares = np.zeros((3, rows, channel.columns))
    for n in range(count):
        numbers = read_out(electrons, imager.as_matrix(channel, rows), Streams(seed, turn + n))
        values = numbers.astype(float)
        if n == 0:
            start = values  # differences from it: squares lose no digits
        total += values - start
        squares += (values - start) ** 2
    return start + total / count, (squares - total**2 / count) / (count - 1)


def to_radiance(numbers: NDArray[np.integer], calibration: RadiometricCalibration) -> Floats:
    """Radiance of raw numbers, watt / m^2 / sr / um.

    Interpolates linearly between the dark frame and the flats of each pixel, and extrapolates
    beyond the last flat. This corrects dark signal, gain and non-linearity together.

    numbers  (lines, columns)
    Returns  (lines, columns); a saturated pixel has the radiance of its number
    Raises   ValueError if the frames have another size, or a pixel does not respond to light.
    """
    lines, columns = numbers.shape
    rows, wide = calibration.dark.shape
    if columns != wide or rows not in (1, lines):
        raise ValueError(
            f"the calibration frames must have the {columns} columns of the image and one line or "
            f"its {lines}, got {wide} x {rows}"
        )
    out = np.zeros(numbers.shape)
    below, dark, last = 0.0, calibration.dark, len(calibration.flat) - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        for n, (flat, light) in enumerate(zip(calibration.flat, calibration.radiance, strict=True)):
            part = (numbers - dark) / (flat - dark)
            part = np.clip(part, 0 if n else -np.inf, np.inf if n == last else 1)
            out += part * (light - below)
            below, dark = light, flat
    out[~np.isfinite(out)] = np.nan  # a dead pixel
    return out


def is_thermal(band: imager.Band) -> bool:
    """Whether thermal radiance exceeds sunlight; the product is then a temperature."""
    return float(band.weight @ band.wavelength) > imager.INFRARED


def retrieve(radiance: Floats, ground: Ground, setting: imager.Setting) -> dict[str, Floats]:
    """The products of n pixels by name; NaN for the sky.

    radiance  (n,) watt / m^2 / sr / um
    ground    ground at the centres of the pixels
    setting   setting whose `surroundings` is the mean reflectance of the surrounding ground
    Returns   (n,) each: reflectance at the top of the atmosphere, and reflectance of the Lambertian
              surface with this radiance through the air; or temperature in kelvin of the blackbody
              with this radiance without air
    """
    if is_thermal(setting.band):
        return {"brightness temperature": brightness_temperature(radiance, setting.band)}
    apparent = np.full(len(radiance), math.nan)
    hit = ground.hit
    zenith = ground[hit].sun_zenith
    apparent[hit] = apparent_reflectance(radiance[hit], zenith, setting.band)
    surface = surface_reflectance(radiance, ground, setting)
    return {"reflectance": apparent, "surface reflectance": surface}


def apparent_reflectance(radiance: Floats, sun_zenith: Floats, band: imager.Band) -> Floats:
    """Reflectance (n,) at the top of the atmosphere.

        pi L / (E_sun cos(sun))

    E_sun is the Sun's mean irradiance in the band at its distance. Source: ESA, Sentinel-2 MSI
    technical guide, for all products of level 1 (Thuillier, Wang and Chance).
    """
    cosine = np.cos(sun_zenith)
    with np.errstate(divide="ignore", invalid="ignore"):
        apparent = math.pi * radiance / um / (band.irradiance * cosine)
    return np.where(cosine > 0, apparent, math.nan)


def surface_reflectance(radiance: Floats, ground: Ground, setting: imager.Setting) -> Floats:
    """Reflectance (n,) of Lambertian ground on its slope, in light of Sun and sky.

        rho = (L - L_sc) / (L_dir + L_ind of white ground)

    Source: Krutz et al. (2011), eqs. (1) and (2), solved for the reflectance.

    Accuracy  model: the air of the scene and Lambertian ground are assumed, even where the
              reflectance depends on directions. The result is uncertain for slopes in shadow.
    """
    scattered, white = _air(ground, setting)
    out = np.full(len(radiance), math.nan)
    lit = ground.hit & (white > 0)
    out[lit] = (radiance[lit] / um - scattered[lit]) / white[lit]
    return out


def mean_reflectance(
    radiance: list[Floats], grounds: list[Ground], setting: imager.Setting
) -> float:
    """Mean reflectance of the surface, which illuminates the air from below.

        rho' = mean of rho(rho'), solved by iteration over a sample of the pixels

    radiance, grounds  one entry for each part of an image
    Returns            NaN for thermal radiance
    """
    if is_thermal(setting.band):
        return math.nan
    step = max(1, sum(len(values) for values in grounds) // THINNED)
    parts = zip(radiance, grounds, strict=True)
    some = [(values[::step], ground[::step]) for values, ground in parts]
    around = FIRST
    for _ in range(ROUNDS):
        here = setting._replace(surroundings=around)
        reflectance = np.concatenate([surface_reflectance(*part, here) for part in some])
        reflectance = reflectance[np.isfinite(reflectance)]
        around = float(np.clip(reflectance.mean(), 0, 1)) if len(reflectance) else 0.0
    return around


def environment_of(
    reflectance: Floats, ground: Ground, pixel: float, setting: imager.Setting, more: float = 0.0
) -> imager.Environment | None:
    """Surroundings of each pixel, from the reflectance of all pixels; the mean beyond the image.

    reflectance  (n,) of the surface
    pixel        metre, size of a pixel on the ground
    more         1, reflectance of the ground beyond the image minus the image's mean
    Returns      None where air does not scatter, or no pixel has a value
    """
    finite = np.flatnonzero(np.isfinite(reflectance))
    if setting.band.table.spread is None or not len(finite):
        return None
    here = ground[finite]
    sent = imager.leaving(here, setting.band, np.clip(reflectance[finite], 0, 1))
    plane = imager.Plane(float(here.longitude[0]), float(np.median(here.latitude)))
    nearest = KDTree(np.stack(plane.at(here.longitude, here.latitude), 1))

    def values(longitude: Floats, latitude: Floats) -> Floats:
        place = np.stack(plane.at(longitude, latitude), 1)
        _, at = nearest.query(place, distance_upper_bound=2 * pixel)
        return np.where(at < len(sent), sent[np.minimum(at, len(sent) - 1)], math.nan)

    return imager.surrounded([here], pixel / 2, float(sent.mean()) + more, setting.band, values)


def settled(
    radiance: Floats, ground: Ground, pixel: float, setting: imager.Setting, more: float = 0.0
) -> imager.Setting:
    """The setting with the surroundings of each pixel, by iteration over the whole image.

    radiance, ground, pixel, more  as for `surface_reflectance` and `environment_of`
    """
    for _ in range(MIXED):
        surface = surface_reflectance(radiance, ground, setting)
        around = environment_of(surface, ground, pixel, setting, more)
        setting = setting._replace(environment=around)
    return setting


def _air(ground: Ground, setting: imager.Setting) -> tuple[Floats, Floats]:
    """Radiance (n,) of the air, and of white ground, watt / m^2 / sr / m."""
    around = imager.around_of(setting, ground)
    terms = imager.terms_in_band(ground, setting.band, np.ones(1), around)
    direct, indirect, scattered = (term.astype(np.float64) for term in terms[:3])
    return scattered, direct + indirect


def brightness_temperature(radiance: Floats, band: imager.Band) -> Floats:
    """Temperature (n,), kelvin, of a blackbody with this radiance in the band.

    Raises    ValueError if the band has no thermal radiance.
    Accuracy  numerical: 1 mK. NaN below 50 K and above 3,000 K.
    """
    if band.heat is None:
        raise ValueError(
            "band must lie above 1.5 um for a brightness temperature, got a band below"
        )
    temperature = 1 / np.linspace(1 / 50.0, 1 / 3000.0, 4000)
    table = np.log(band.heat(temperature)[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1 / np.interp(np.log(radiance / um), table, 1 / temperature, math.nan, math.nan)
