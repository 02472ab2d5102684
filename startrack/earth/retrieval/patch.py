"""A channel's image of level ground straight below, with fires: radiance and digital numbers.

`render` does the same for any terrain and the whole field. Here all pixels share one line of sight
and one transmittance, and textures replace maps. An image takes milliseconds.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Ints, Psf, Refused, Singles, Streams, printed
from startrack.detector import Detector, read_out
from startrack.earth.atmosphere import ThermalRadiance
from startrack.earth.geometry import inside_pixel
from startrack.earth.imager import (
    INFRARED,
    Band,
    Channel,
    Land,
    Setting,
    Survey,
    as_matrix,
    blur_strips,
    cover_at,
    lines_apart,
    mean_wavelength,
    pixel_electrons,
    point_images,
    setting_below,
    smeared,
    terms_in_band,
)
from startrack.earth.terrain import Ground, cartesian

FIRES = 37  # points of a fire as large as the ground between two pixels
MOST_CHANNELS = 2**10  # channels of a camera, so that no two devices share a detector
SMALL = 0.2  # of that ground's side; a smaller fire is a point


@printed
class Radiation(NamedTuple):
    """The radiance at the sensor over level ground, watt / m^2 / sr / m in the band.

        L = path + rho lit + (1 - rho) through B(T)

    path, lit   radiance of the air; radiance of white ground at the sensor
    through     1, transmittance from ground to sensor
    heat        B in the band; None where thermal radiance is negligible
    """

    path: float
    lit: float
    through: float
    heat: ThermalRadiance | None

    def emitted(self, temperature: Floats) -> Floats:
        """Radiance (n,) of a blackbody on the ground at (n,) kelvin."""
        if self.heat is None:
            return np.zeros(len(temperature))
        return self.through * self.heat(temperature)[:, 0]

    def of_ground(self, reflectance: Floats | float, temperature: Floats) -> Floats:
        """Radiance (n,) of ground of given reflectance and temperature."""
        return self.path + reflectance * self.lit + (1 - reflectance) * self.emitted(temperature)


@printed
class View(NamedTuple):
    """Constant inputs of the images of a channel.

    channel       with as many columns and lines as the image
    setting       setting of its images
    radiation     radiance over the ground
    reflectance, temperature  1, kelvin: means of the ground
    side          metre, side of a pixel projected on the ground
    across, along  metre between columns and between lines
    psf           images of points, smear included
    weights       weights of the rays of a pixel, as `blur_weights`
    device        the detector with the image's lines as its rows
    """

    channel: Channel
    setting: Setting
    radiation: Radiation
    reflectance: float
    temperature: float
    side: float
    across: float
    along: float
    psf: Psf
    weights: Floats
    device: Detector

    @property
    def mean(self) -> float:
        """Radiance of the mean ground."""
        return float(self.radiation.of_ground(self.reflectance, np.array([self.temperature]))[0])


def radiation_over(band: Band, surroundings: float, height: float, sun_zenith: float) -> Radiation:
    """The radiance over level ground, from the radiances over black and over white ground.

    surroundings  1, reflectance of the surrounding ground
    height        metre above the sea
    sun_zenith    radian; beyond pi / 2 it is night
    """
    ground = level_ground(2, height, sun_zenith)
    heat = band.heat
    warm = None if heat is None else np.full(2, 300.0)
    terms = terms_in_band(ground, band, np.array([0.0, 1.0]), surroundings, warm)
    black = terms.total[0] - terms.emitted[0]
    through = 1.0 if heat is None or warm is None else terms.emitted[0] / heat(warm)[0, 0]
    return Radiation(float(black), float(terms.total[1] - black), float(through), heat)


def level_ground(count: int, height: float, sun_zenith: float) -> Ground:
    """`count` copies of a point of level ground, seen from above."""
    zero, one = np.zeros(count), np.ones(count)
    vertical, sun = np.tile([1.0, 0.0, 0.0], (count, 1)), np.array([math.cos(sun_zenith), 0.0, 0.0])
    sun[1] = math.sin(sun_zenith)
    return Ground(
        hit=np.ones(count, bool),
        distance=one,
        point=cartesian(zero, zero, height * one),
        longitude=zero,
        latitude=zero,
        height=height * one,
        normal=vertical,
        incidence=zero,
        sun_incidence=sun_zenith * one,
        shadow=np.full(count, sun_zenith >= math.pi / 2),
        sky_view=one,
        tangent_height=np.full(count, math.nan),
        level=np.zeros(count, np.int8),
        sun=sun,
        direction=-vertical,
    )


def sunlit_channels(survey: Survey, names: Sequence[str], key: str) -> list[Channel]:
    """The channels with the given names.

    key     key of the scene with the names, for messages
    Raises  Refused if the camera has no channel of a name, or a channel is infrared.
    """
    known = {channel.name: channel for channel in survey.camera.channels}
    for name in names:
        if name not in known:
            raise Refused(
                f"{key} must be a channel of the camera, {', '.join(known)}, got {name!r}"
            )
        if mean_wavelength(known[name]) > INFRARED:
            raise Refused(
                f"channel {name} must have a band of reflected sunlight, shorter than 3 um"
            )
    return [known[name] for name in names]


def view_below(survey: Survey, channel: Channel, size: int, height: float, sun: float) -> View:
    """Constant inputs of the images of one channel of size x size pixels.

    height, sun  metre above the sea; zenith angle of the Sun, radian
    Raises  ValueError as `setting_below`.
    """
    own = channel.cropped(size, size)
    names = [other.name for other in survey.camera.channels]
    # Each channel has a different detector, even where a file gives all of them one seed.
    seed = own.detector.device_seed * MOST_CHANNELS + names.index(own.name)
    own = replace(own, detector=replace(own.detector, device_seed=seed))
    cover = cover_at(survey.land, height)
    setting, above = setting_below(survey, own, height)
    band = setting.band
    reflectance = float(cover.reflectance(band.wavelength) @ band.weight)
    around = reflectance if survey.surroundings is None else survey.surroundings
    setting = setting._replace(surroundings=around)
    side = above * own.detector.pitch / own.optics.image_distance
    across, along = own.detector.columns / own.columns, lines_apart(own, setting)
    offsets = inside_pixel(survey.rays)
    assert isinstance(setting.psf, Psf)
    psf = smeared(setting.psf, setting.smear)
    images = point_images(psf, offsets, across, along)[:, ::-1, ::-1]
    weights = images / images.sum((-2, -1), keepdims=True) / len(offsets)
    return View(
        channel=own,
        setting=setting,
        radiation=radiation_over(band, around, height, sun),
        reflectance=reflectance,
        temperature=cover.temperature - survey.land.lapse * height,
        side=side,
        across=side * across,
        along=side * along,
        psf=psf,
        weights=weights,
        device=as_matrix(own, size),
    )


def ground_radiance(
    view: View, land: Land, grey: Singles | None, warm: Singles | None, size: int, rays: int
) -> Singles:
    """Radiance of each pixel of an image, blurred by lens and pixel.

    grey, warm  (size rays, size rays) textures of reflectance and of temperature, of rms one; None
                where the land has none
    Returns     (size, size) watt / m^2 / sr / m
    """
    reflectance, temperature = np.array([view.reflectance]), np.array([view.temperature])
    if grey is not None:
        reflectance = np.clip(view.reflectance * (1 + land.texture * grey.ravel()), 0.0, 1.0)
    if warm is not None:
        temperature = np.clip(view.temperature + land.temperature_texture * warm.ravel(), 50, 3000)
    full = view.radiation.of_ground(reflectance, temperature).astype(np.float32)
    if len(full) == 1:
        return np.full((size, size), full[0])
    pixels = full.reshape(size, rays, size, rays).transpose(0, 2, 1, 3)
    lattices = np.ascontiguousarray(pixels.reshape(size, size, rays**2))
    return np.concatenate(list(blur_strips(iter([lattices]), view.weights)))


def fire_images(view: View, place: Floats, area: float) -> Floats:
    """Images of fires: the light of each pixel over the light of a pixel full of fire, per m^2.

    place    (n, 2) pixel, from the centre of the images
    area     square metre of each; a fire larger than a point widens the images
    Returns  (n, k, k) 1 / m^2, k odd
    """
    across, along = view.across / view.side, view.along / view.side
    radius = math.sqrt(area / math.pi)
    points = np.zeros((1, 2))
    if 2 * radius > SMALL * min(view.across, view.along):
        turn = np.arange(FIRES)
        spread = radius * np.sqrt((turn + 0.5) / FIRES)
        angle = turn * math.pi * (3 - math.sqrt(5))
        points = np.stack(
            [spread * np.cos(angle) / view.across, spread * np.sin(angle) / view.along], 1
        )
    every = (place[:, None] + points).reshape(-1, 2)
    images = point_images(view.psf, every, across, along)
    shape = len(place), len(points), *images.shape[1:]
    return images.reshape(shape).mean(1) / view.side**2


def add_images(scene: Floats, pixel: Ints, images: Floats) -> None:
    """Add images (n, k, k) to a scene, centred on pixels (n, 2), columns first."""
    half = images.shape[1] // 2
    padded = np.pad(scene, half)
    for (x, y), image in zip(pixel, images, strict=True):
        padded[y : y + 2 * half + 1, x : x + 2 * half + 1] += image
    scene[:] = padded[half : half + len(scene), half : half + scene.shape[1]]


def numbers_of(view: View, radiance: Floats, streams: Streams) -> Floats:
    """Measured radiance of each pixel from its digital number, watt / m^2 / sr / m.

    The design's gain is used; differences between pixels (PRNU) stay in the image.

    Returns  (size, size); a saturated pixel has the radiance of the largest number
    """
    electrons = pixel_electrons(view.channel, view.setting, radiance)
    detector = view.channel.detector
    numbers = read_out(electrons, view.device, streams)
    dark = detector.dark_rate * view.setting.exposure
    charge = (numbers - float(detector.offset)) * detector.electrons_per_dn - dark
    return np.asarray(charge / view.setting.electrons, np.float64)
