"""An image from Survey and Channel: radiance at the sensor in five terms, and digital numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack import core
from startrack.core import Advance, Floats, Singles, deg, printed, um
from startrack.detector import Detector, dark, read_out, response
from startrack.earth import geometry
from startrack.earth.atmosphere import Terms
from startrack.earth.imager import lens
from startrack.earth.imager.adjacency import Environment, around_scene, leaving
from startrack.earth.imager.band import Band, band_of, mean_wavelength, terms_in_band
from startrack.earth.imager.cloud_radiance import Deck, decks_of, with_clouds
from startrack.earth.imager.land import Land, burning_fraction, reflection, temperature
from startrack.earth.imager.parameters import Channel, Survey, exposure_of, require_pace, smear
from startrack.earth.terrain import Ground, Pyramid, geodetic
from startrack.motion import Motion, realise_motion
from startrack.motion import blur as motion_blur
from startrack.optics import Optics

COARSE = 24  # largest number of lines or columns of the preview for `surroundings`; chosen by hand
FAINT = 1e-12  # fraction of a pixel below which a fire is neglected
BLACK = np.zeros(1)  # reflectance
SMILES = 3  # number of bands, between which the bands of a bent line are interpolated
MOST_LINES = 2**20  # largest number of lines of an image, so that no two channels share noise


@printed
class Picture(NamedTuple):
    """The image of a channel; `render` fills in the arrays, in memory or on disk.

    numbers    (lines, columns) digital number
    terms      (lines, columns) each, watt / m^2 / sr / um: mean spectral radiance in the band,
               weighted with the response of the channel, before the lens
    longitude, latitude  (lines, columns) degree, mean point of the ground of each pixel; NaN for
               the sky
    """

    numbers: NDArray[np.integer]
    terms: Terms
    longitude: Floats
    latitude: Floats

    @classmethod
    def blank(cls, lines: int, columns: int) -> Picture:
        """A picture in memory, filled with zeros."""
        shape = lines, columns
        return cls(
            np.zeros(shape, np.int32),
            Terms(*np.zeros((5, *shape), np.float32)),
            *np.zeros((2, *shape)),
        )


@printed
class Setting(NamedTuple):
    """Constant inputs of an image.

    period       second between lines, 0 for a matrix
    exposure     second, exposure of a pixel of the image
    smear        pixel along the track
    psf          PSF of its pixels, or the images of a lens table over its field
    band         channel, and air in its band
    surroundings  1, mean reflectance of the ground
    electrons    electron from a mean spectral radiance of 1 watt / m^2 / sr / m
    camera       directions of the image's pixels
    light        (1, columns) for a scanner, (rows, columns) for a matrix: electrons of each pixel
                 over `electrons`; None: uniform
    smile        bands along a line with smile, and the weight (columns,) of each band
    clouds       cloud layers in the band
    environment  reflectance around each pixel; None: `surroundings` everywhere
    terrain      terrain of the scene, with the tiles read so far; None: not opened yet
    """

    period: Annotated[float, core.Unit("s", "ms")]
    exposure: Annotated[float, core.Unit("s", "ms")]
    smear: Annotated[float, core.Unit("pixel")]
    psf: core.Psf | core.FieldPsf
    band: Band
    surroundings: float
    electrons: float
    camera: core.Camera
    light: Floats | None = None
    smile: tuple[tuple[Band, Floats], ...] = ()
    clouds: tuple[Deck, ...] = ()
    environment: Environment | None = None
    terrain: Pyramid | None = None


def prepare(survey: Survey, channel: Channel, folder: Path) -> Setting:
    """Compute the constant inputs of an image once.

        electrons = (pi / 4) (1 / f#^2) A_d ff t_int Int [lambda / (h c)] L tau QE dlambda

    Source: Krutz et al. (2011), eq. (4).

    Raises  ValueError as `band_of`, `focus` and the geometry; OSError for files that are missing.
    """
    scene = survey.scene(channel)
    flight = scene.carrier
    terrain = scene.terrain.open(folder)
    glimpse = _coarse_ground(scene, channel, folder, terrain)
    start = geometry.fly(flight, np.zeros(1)).position
    ground = np.concatenate([seen.height for seen in glimpse])
    above = float(geodetic(start)[2][0]) - (float(ground.mean()) if len(ground) else 0.0)
    band = band_of(channel, survey.air, max(above, 1.0), survey.distance_to_sun)
    period = scene.sensor.dating(flight).period
    exposure = exposure_of(channel, period)
    field = lens.field_lens(
        channel,
        scene.sensor,
        _with_jitter_blur(survey.motion, channel, period),
        band.wavelength,
        band.weight,
        *_keystone(survey, channel),
    )
    around, environment = survey.surroundings, None
    if around is None:
        around = _mean_reflectance(survey.land, glimpse, band)
        if band.table.spread is not None and len(ground):
            environment = _environment(survey, channel, folder, terrain, glimpse, band)
    electrons = channel.etendue() * exposure * band.electrons
    drift = smear(channel, period, geometry.ground_rate(flight))
    setting = Setting(
        period=period,
        exposure=exposure,
        smear=drift,
        psf=field.images,
        band=band,
        surroundings=around,
        electrons=electrons,
        camera=field.camera,
        light=field.light,
        clouds=decks_of(survey.clouds, band, folder),
        environment=environment,
        terrain=terrain,
    )
    return _with_smile(survey, channel, setting, max(above, 1.0))


def setting_below(survey: Survey, channel: Channel, height: float) -> tuple[Setting, float]:
    """Constant inputs of an image of level ground straight below, at the middle of the field.

    The surrounding ground is black in them.

    height   metre, height of the ground above the sea
    Returns  the setting, and metre from the ground to the camera
    Raises   ValueError in the cases of `band_of`, and if the channel's lens is a table over its
             field.
    """
    if channel.optics.tabulated:
        raise core.Refused(
            f"channel {channel.name}: lens_file, lens_family and psf_file must be left out for "
            "the study of a retrieval, whose images are at the lens axis"
        )
    carrier = survey.carrier
    above = geometry.flight_height(carrier) - height
    band = band_of(channel, survey.air, above, survey.distance_to_sun)
    rate = geometry.ground_rate(carrier)
    sensor = channel.sensor(survey.rays, rate)
    period = sensor.dating(carrier).period
    exposure = exposure_of(channel, period)
    optics = _with_jitter_blur(survey.motion, channel, period)
    field = lens.field_lens(channel, sensor, optics, band.wavelength, band.weight)
    electrons = channel.etendue() * exposure * band.electrons
    require_pace(channel, period, rate)
    drift = smear(channel, period, rate)
    setting = Setting(
        period=period,
        exposure=exposure,
        smear=drift,
        psf=field.images,
        band=band,
        surroundings=0.0,
        electrons=electrons,
        camera=field.camera,
    )
    return setting, above


def _keystone(survey: Survey, channel: Channel) -> tuple[float, float]:
    """Outward displacement of a channel's image at the end of its line, metre; half the line,
    metre."""
    detector_line = survey.whole(channel)
    half = detector_line.detector.columns / 2 * detector_line.detector.pitch
    spectrometer = survey.camera.spectrometer
    if spectrometer is None or not spectrometer.keystone:
        return 0.0, half
    means = [mean_wavelength(band) for band in survey.camera.channels]
    low, high = min(means), max(means)
    if low == high:
        raise ValueError(
            "spectrometer.keystone must be left out of a camera whose channels have one wavelength"
        )
    off = 2 * mean_wavelength(detector_line) - low - high
    return spectrometer.keystone * off / (high - low), half


def _with_smile(survey: Survey, channel: Channel, setting: Setting, above: float) -> Setting:
    """The setting with the bands along a line with smile."""
    spectrometer = survey.camera.spectrometer
    if spectrometer is None or not spectrometer.smile:
        return setting
    middle = (channel.columns - 1) / 2
    place = (np.arange(channel.columns) - middle) / (survey.whole(channel).columns / 2)
    shift = spectrometer.smile * place**2
    nodes = np.unique(np.linspace(shift.min(), shift.max(), SMILES))
    share = core.lagrange_weights(nodes, np.asarray(shift, float)).T
    shifted = (channel.shifted(node) for node in nodes.tolist())
    bands = [band_of(moved, survey.air, above, survey.distance_to_sun) for moved in shifted]
    answers = np.array([band.electrons for band in bands]) @ share / setting.band.electrons
    light = answers[None] if setting.light is None else setting.light * answers
    return setting._replace(light=light, smile=tuple(zip(bands, share, strict=True)))


def render(
    survey: Survey,
    channel: Channel,
    folder: Path,
    seed: int,
    picture: Picture,
    advance: Advance = lambda lines: None,
) -> Setting:
    """Fill in the picture of one channel, some lines at a time.

        DN = electrons (2^depth - 1) / full well, with the detector's noise, quantised and clipped

    Source: Krutz et al. (2011), eqs. (1) to (5).

    folder   folder of relative file names
    seed     seed of the noise and of the motion; a seed gives all channels the same motion
    advance  called with the number of newly rendered lines
    Raises    as `prepare`.
    Accuracy  model: without a lens table, the solid angle of a pixel and the PSF are taken on the
              axis. With a lens table, weights of rays change over the field by `field_blur`,
              accurate to 2e-3 of the light of each point; a pixel's illumination is taken at its
              centre; over the exposure of a scanner's line the image moves as on the axis. Bands of
              a bent line are interpolated between three bands. Motion displaces each line by the
              angle at its middle, and blurs all lines by the expected motion within an exposure,
              equal along both axes. Besides the picture, memory is needed for some lines.
    """
    setting = prepare(survey, channel, folder)
    turn = turn_of(survey, seed)
    strips = _strips(survey, channel, folder, setting, picture, advance, turn)
    names = [own.name for own in survey.camera.channels]
    first, offset = 0, names.index(channel.name) * MOST_LINES
    for light in _blurred(survey, channel, setting, strips):
        electrons = pixel_electrons(channel, setting, light, first)
        streams = core.Streams(seed, offset + first)
        numbers = read_out(electrons, as_matrix(channel, len(light)), streams)
        picture.numbers[first : first + len(light)] = numbers
        first += len(light)
    return setting


def _blurred(
    survey: Survey, channel: Channel, setting: Setting, strips: Iterator[Singles]
) -> Iterator[Singles]:
    """Resample strips of rays to strips of pixels."""
    across = channel.detector.columns / channel.columns
    along, drift = lines_apart(channel, setting), setting.smear
    if isinstance(setting.psf, core.Psf):
        weights = lens.blur_weights(setting.psf, survey.rays, across, along, drift)
        return lens.blur_strips(strips, weights)
    columns, rows = lens.image_pixels(channel, survey.scene(channel).sensor)
    blur = lens.field_blur(setting.psf, columns, rows, survey.rays, across, along, drift)
    return blur.blurred(strips)


def turn_of(survey: Survey, seed: int) -> geometry.Jitter | None:
    """Rotation of the camera over the time since the epoch, for all channels; None without
    motion."""
    if survey.motion == Motion():
        return None
    sensors = [survey.scene(channel).sensor for channel in survey.channels]
    longest = max((own.lines - 1) * own.dating(survey.carrier).period for own in sensors)
    exposures = [channel.detector.exposure for channel in survey.channels]
    return realise_motion(survey.motion, max(longest, *exposures), core.Streams(seed, 0)).at


def misregistration(survey: Survey, channel: Channel, seed: int) -> tuple[float, float]:
    """Displacement of a channel's lines relative to the first channel, by motion alone.

    Both channels see the same ground at different times; the camera turns in between.

    Returns   pixel of the channel, rms over its lines: along columns and along lines
    Accuracy  model: on the axis; the parallax of terrain is left out.
    """
    turn = turn_of(survey, seed)
    if turn is None:
        return 0.0, 0.0
    mine, first = (survey.scene(own).sensor for own in (channel, survey.channels[0]))
    time = mine.dating(survey.carrier).at(np.arange(float(mine.lines)))
    away = turn(time) - turn(time - mine.delay + first.delay)
    scale = channel.optics.image_distance / channel.detector.pitch
    down, right = scale * np.sqrt((away[:, :2] ** 2).mean(0))
    return float(right), float(down)


def image_blur(motion: Motion, channel: Channel, period: float) -> float:
    """Blur along an axis by a channel's lens and by the motion within a line, metre rms."""
    optics = channel.optics
    if motion == Motion():
        return optics.total_blur
    return math.hypot(optics.total_blur, _jitter_blur(motion, channel, period))


def _jitter_blur(motion: Motion, channel: Channel, period: float) -> float:
    once = channel.exposure_of_line(period)
    mean = math.sqrt(float((motion_blur(motion, once)[:2] ** 2).mean()))
    return mean * channel.optics.image_distance


def _with_jitter_blur(motion: Motion, channel: Channel, period: float) -> Optics:
    """A channel's lens with the blur by motion within an exposure of one line."""
    if motion == Motion():
        return channel.optics
    blur = math.hypot(channel.optics.blur, _jitter_blur(motion, channel, period))
    return replace(channel.optics, blur=blur)


def pixel_electrons(
    channel: Channel, setting: Setting, light: NDArray[np.floating], first: int = 0
) -> Floats:
    """Expected electrons of lines of an image.

    light    (lines, columns) watt / m^2 / sr / m
    first    number of the first line
    Returns  (lines, columns)
    """
    scan = channel.detector.scan
    device = as_matrix(channel, channel.stages if scan else channel.detector.rows)
    gain, current = response(device), np.asarray(dark(device), float)
    if scan:  # a column of the image averages its stages
        gain = None if gain is None else gain.mean(0)
        current = current.mean(0) if current.ndim else current
    here = slice(None) if scan else slice(first, first + len(light))
    electrons = setting.electrons * light.astype(np.float64)
    if setting.light is not None:
        electrons *= setting.light[here]
    if gain is not None:
        electrons *= gain if scan else gain[here]
    return electrons + (current[here] if current.ndim == 2 else current) * setting.exposure


def _strips(
    survey: Survey,
    channel: Channel,
    folder: Path,
    setting: Setting,
    picture: Picture,
    advance: Advance,
    turn: geometry.Jitter | None,
) -> Iterator[Singles]:
    """Radiance (lines, columns, rays) before the lens. Also fills in the picture's terms."""
    scene = survey.scene(channel)
    spread = channel.detector.pitch / channel.optics.image_distance / survey.rays
    for strip in geometry.observe_earth(scene, folder, turn, setting.camera, setting.terrain):
        lines, columns, rays = strip.shape
        here = slice(strip.first, strip.first + lines)
        terms = _along_smile(survey.land, strip, setting, spread)
        for term, part in zip(picture.terms, terms, strict=True):
            term[here] = part.reshape(strip.shape).mean(2) * um
        longitude, latitude = _place(strip)
        picture.longitude[here], picture.latitude[here] = longitude / deg, latitude / deg
        stages = rays // survey.rays**2
        total = terms.total.reshape(lines, columns, stages, survey.rays**2)
        yield total.mean(2)
        advance(lines)


def _along_smile(land: Land, strip: geometry.Strip, setting: Setting, spread: float) -> Terms:
    """The terms of all rays of a strip, each in the band of its column."""
    if not setting.smile:
        return radiance_terms(land, strip.ground, setting, spread)
    parts = []
    for band, share in setting.smile:
        terms = radiance_terms(land, strip.ground, setting._replace(band=band), spread)
        of_ray = np.broadcast_to(share[:, None].astype(np.float32), strip.shape).ravel()
        parts.append([of_ray * term for term in terms])
    return Terms(*(np.sum(shares, axis=0) for shares in zip(*parts, strict=True)))


def radiance_terms(land: Land, ground: Ground, setting: Setting, spread: float) -> Terms:
    """The terms of n rays, (n,) each, watt / m^2 / sr / m.

    spread  radian between rays
    """
    band = setting.band
    seen = reflection(land, ground, band.wavelength, band.weight)
    warm = temperature(land, ground)
    terms = terms_in_band(ground, band, seen.sky, around_of(setting, ground), warm, seen.direct)
    if band.heat is not None and land.hot_spots:
        terms = _burning(terms, land, ground, setting, spread)
    if not setting.clouds:
        return terms
    return with_clouds(terms, setting.clouds, ground, band, seen.sky, setting.surroundings)


def _burning(terms: Terms, land: Land, ground: Ground, setting: Setting, spread: float) -> Terms:
    """The terms with fires."""
    fractions = [burning_fraction(spot, ground, spread) for spot in land.hot_spots]
    emitted = terms.emitted.copy()
    for spot, fraction in zip(land.hot_spots, fractions, strict=True):
        burns = np.flatnonzero(fraction > FAINT)
        flame = np.full(len(burns), spot.temperature)
        black = terms_in_band(ground[burns], setting.band, BLACK, setting.surroundings, flame)
        emitted[burns] += fraction[burns] * (black.emitted - terms.emitted[burns])
    left = np.maximum(1 - sum(fractions), 0).astype(np.float32)  # burning parts reflect nothing
    return terms._replace(
        direct=terms.direct * left, indirect=terms.indirect * left, emitted=emitted
    )


def _place(strip: geometry.Strip) -> tuple[Floats, Floats]:
    """Longitude and latitude, (lines, columns) radian, of the mean point of ground in each
    pixel."""
    point = np.stack([strip.mean(along) for along in strip.ground.point.T], -1)
    return geodetic(point)[:2]


def _coarse_ground(
    scene: geometry.EarthScene, channel: Channel, folder: Path, terrain: Pyramid
) -> list[Ground]:
    """The ground of the image, sampled by a few rays."""
    coarse = replace(scene, sensor=_coarse(scene.sensor, scene.carrier), sky_rays=0)
    camera = lens.nominal(channel, coarse.sensor)
    strips = geometry.observe_earth(coarse, folder, None, camera, terrain)
    return [strip.ground[strip.ground.hit] for strip in strips]


def _mean_reflectance(land: Land, glimpse: list[Ground], band: Band) -> float:
    seen = [reflection(land, ground, band.wavelength, band.weight) for ground in glimpse]
    values = np.concatenate([part.albedo for part in seen])
    return float(values.mean()) if len(values) else 0.0


def _environment(
    survey: Survey,
    channel: Channel,
    folder: Path,
    terrain: Pyramid,
    glimpse: list[Ground],
    band: Band,
) -> Environment:
    def sent(ground: Ground) -> Floats:
        seen = reflection(survey.land, ground, band.wavelength, band.weight)
        return leaving(ground, band, seen.sky, seen.direct)

    distance = float(np.median(np.concatenate([ground.distance for ground in glimpse])))
    spacing = distance * channel.detector.pitch / channel.optics.image_distance / survey.rays
    mean = float(np.concatenate([sent(ground) for ground in glimpse]).mean())
    seen_ground = geometry.ground_finder(survey.scene(channel), folder, terrain)
    return around_scene(seen_ground, glimpse, spacing, mean, band, sent)


def around_of(setting: Setting, ground: Ground) -> Floats | float:
    """Reflectance around rays, 1: a scalar, or (2, n) for lines of sight and for skylight."""
    if setting.environment is None:
        return setting.surroundings
    return setting.environment.at(ground)


def _coarse(sensor: geometry.Sensor, flight: geometry.Carrier) -> geometry.Sensor:
    """A sensor of few pixels that sees the same ground."""
    across, lines = sensor.camera.columns, min(COARSE, sensor.lines)
    columns = min(COARSE, sensor.columns)
    period = sensor.dating(flight).period * sensor.lines / lines or None
    if sensor.detector == "matrix":  # its pixels stay square
        larger = max(1.0, max(across, sensor.lines) / COARSE)
        columns, lines = math.ceil(across / larger), math.ceil(sensor.lines / larger)
    return replace(
        sensor,
        detector="matrix" if sensor.detector == "matrix" else "line",
        lines=lines,
        columns=max(columns, 2),
        pixel_pitch=sensor.pixel_pitch * across / max(columns, 2),
        rays=1,
        period=period,
    )


def lines_apart(channel: Channel, setting: Setting) -> float:
    """Distance between lines of the image, pixel of the detector."""
    if not (setting.period and setting.smear):
        return 1.0
    return setting.smear / channel.exposure_of_line(setting.period) * setting.period


def as_matrix(channel: Channel, rows: int) -> Detector:
    """A matrix detector with the lines of an image as its rows."""
    return replace(channel.detector, scan=None, rows=rows, columns=channel.columns)
