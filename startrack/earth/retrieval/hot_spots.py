"""HotSpots: fires in the mid and the thermal infrared; a trial of their detection and power."""

import math
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from startrack.core import (
    POSITIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Singles,
    Streams,
    Unit,
    parameter,
)
from startrack.earth.imager import Channel, Survey
from startrack.earth.retrieval import fire, patch, texture
from startrack.earth.retrieval.context import Contrast, contrast_of, threshold_of

ALIKE = 1e-6  # largest relative difference between the ground pixels of two channels
ROOM = 2  # pixel between the surroundings of a fire and the image's edge
ROUNDS = 7  # rounds of the search for the smallest area
CLOSE = 0.01  # relative tolerance of the smallest area
WIDEST = 16.0  # largest factor by which a round changes an area


class HotSpots(Parameters):
    """Detection of fires against their surroundings, and their radiative power.

    Images show level ground straight below, with the cover, the temperature and the textures of the
    scene's land at the height of the ground.
    """

    mid: str = parameter("name of the channel in the mid infrared", default="mir")
    thermal: str = parameter("name of the channel in the thermal infrared", default="tir")
    false_alarms: float = parameter(
        "false-alarm rate: fraction of pixels without fire that are found to be hot",
        limit=Range(1e-12, 0.1),
        default=1e-6,
    )
    window: int = parameter(
        "pixel, half a side of the square of surroundings", limit=Range(3, 50), default=10
    )
    guard: int = parameter(
        "pixel, half a side of the square in the middle, which is not part of the surroundings; "
        "the light of a fire is summed over it",
        limit=Range(1, 20),
        default=3,
    )
    height: float = parameter(
        "height of the ground above the ellipsoid",
        unit=Unit("m"),
        limit=Range(0, 9000),
        default=0.0,
    )
    sun_zenith: float = parameter(
        "zenith angle of the Sun; beyond 90 deg it is night",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
        default=math.radians(40),
    )
    temperatures: tuple[float, ...] = parameter(
        "temperatures of fires; the smallest detectable area is computed for each",
        unit=Unit("K"),
        default=(800.0, 1000.0),
    )
    found: float = parameter(
        "1, probability of detection that defines the smallest detectable area",
        limit=Range(0.5, 0.99),
        default=0.95,
    )
    area: float = parameter(
        "of the fire whose radiative power is measured",
        unit=Unit("m2"),
        limit=POSITIVE,
        default=1000.0,
    )
    temperature: float = parameter(
        "of the fire whose radiative power is measured",
        unit=Unit("K"),
        limit=Range(400, 1900),
        default=1000.0,
    )
    size: int = parameter(
        "pixel, a side of an image of a trial", limit=Range(16, 1024), default=128
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.guard >= self.window:
            raise Refused(f"guard must be below window, {self.window}, got {self.guard}")
        if not self.temperatures or not all(400 <= kelvin <= 1900 for kelvin in self.temperatures):
            raise Refused(f"temperatures must lie in [400, 1900] K, got {self.temperatures}")
        if self.size < 2 * (self.window + ROOM) + 1:
            raise Refused(
                f"size must be at least {2 * (self.window + ROOM) + 1}, so that an image holds the "
                f"surroundings of a fire, got {self.size}"
            )

    @property
    def a_side(self) -> int:
        """Number of fires along each side of an image; no fire is in the surroundings of
        another."""
        room = self.size - 2 * (self.window + ROOM)
        return 1 + (room - 1) // (2 * (self.window + ROOM))

    @property
    def per_image(self) -> int:
        """Fires of an image; each is a trial."""
        return self.a_side**2


class Views(NamedTuple):
    """Constant inputs of the images of both channels."""

    mid: patch.View
    thermal: patch.View


def channels_of(survey: Survey, spots: HotSpots) -> tuple[Channel, Channel]:
    """The channels in the mid and in the thermal infrared.

    Raises  ValueError if the camera has no channel of that name.
    """
    names = {channel.name: channel for channel in survey.camera.channels}
    for key in ("mid", "thermal"):
        if getattr(spots, key) not in names:
            raise Refused(
                f"retrieval.hot_spots.{key} must be a channel of the camera, "
                f"{', '.join(names)}, got {getattr(spots, key)!r}"
            )
    return names[spots.mid], names[spots.thermal]


@lru_cache(maxsize=8)
def views_of(survey: Survey, spots: HotSpots) -> Views:
    """Both channels over the ground.

    Raises  ValueError as `channels_of`, `refuse_other_pixels` and `view_below`.
    """
    mid, thermal = (
        patch.view_below(survey, channel, spots.size, spots.height, spots.sun_zenith)
        for channel in channels_of(survey, spots)
    )
    refuse_other_pixels(mid, thermal)
    return Views(mid, thermal)


class Sampled(Protocol):
    """A channel over the ground."""

    @property
    def channel(self) -> Channel: ...  # noqa: D102
    @property
    def radiation(self) -> patch.Radiation: ...  # noqa: D102
    @property
    def across(self) -> float: ...  # noqa: D102
    @property
    def along(self) -> float: ...  # noqa: D102
    @property
    def side(self) -> float: ...  # noqa: D102


def pixels_of_fire(view: Sampled) -> int:
    """Pixel; a hot pixel within this distance of a fire counts as that fire."""
    return math.ceil(view.side / min(view.across, view.along) - 1e-6)


def refuse_other_pixels(mid: Sampled, thermal: Sampled) -> None:
    """Both channels must be infrared and see the ground in the same pixels."""
    refuse_other_grounds(mid, thermal)
    for view in (mid, thermal):
        if view.radiation.heat is None:
            raise Refused(f"channel {view.channel.name} must be infrared to detect hot spots")


def refuse_other_grounds(mid: Sampled, thermal: Sampled) -> None:
    """Both channels must see the ground in the same pixels."""
    pairs = ("across", mid.across, thermal.across), ("along", mid.along, thermal.along)
    for name, first, second in pairs:
        if abs(first / second - 1) > ALIKE:
            raise Refused(
                f"channels {mid.channel.name} and {thermal.channel.name} must sample the ground "
                f"alike, got {first:.6g} and {second:.6g} m {name}"
            )


class Image(NamedTuple):
    """Both channels of an image without fires, and the places of the fires.

    scene     radiance (size, size) of each channel, watt / m^2 / sr / m
    streams   random streams of the noise of each channel
    pixel     (n, 2) of the fires, columns first
    inside    (n, 2) pixel, offset of each fire from the centre of its pixel
    """

    scene: tuple[Singles, Singles]
    streams: tuple[Streams, Streams]
    pixel: Ints
    inside: Floats


def image_of(survey: Survey, spots: HotSpots, views: Views, seed: int, number: int) -> Image:
    """The ground and the places of the fires of an image, from a seed and its number."""
    streams = Streams(seed, number)
    mid = views.mid
    size, rays, land = spots.size, survey.rays, survey.land
    step = mid.along / rays, mid.across / rays
    textures = [
        texture.draw(streams(cause), size * rays, size * rays, step, land.texture_cell)
        if rms
        else None
        for cause, rms in (("reflectance", land.texture), ("temperature", land.temperature_texture))
    ]
    scene = tuple(
        patch.ground_radiance(view, land, textures[0], textures[1], size, rays) for view in views
    )
    pixel, inside = _places(spots, streams("fires"))
    noise = Streams(seed, 2 * number), Streams(seed, 2 * number + 1)
    return Image((scene[0], scene[1]), noise, pixel, inside)


def _places(spots: HotSpots, stream: np.random.Generator) -> tuple[Ints, Floats]:
    """Pixels (n, 2) of fires, columns first, and offsets (n, 2) within the pixels.

    The places are a lattice with a random shift, so that columns vary between images.
    """
    apart = 2 * (spots.window + ROOM)
    spare = spots.size - apart - apart * (spots.a_side - 1)
    first = spots.window + ROOM + stream.integers(0, max(spare, 1), 2)
    at = apart * np.arange(spots.a_side)
    pixel = np.stack(np.meshgrid(first[0] + at, first[1] + at), -1).reshape(-1, 2)
    return pixel, stream.random((len(pixel), 2)) - 0.5


class Burning(NamedTuple):
    """Images of fires of 1 m^2 and one temperature in both channels, and the places of the
    fires."""

    mid: Floats
    thermal: Floats


def burning(views: Views, image: Image, temperature: float, area: float) -> Burning:
    """The excess radiance (n, k, k) of fires per m^2 of fire, over that of the replaced ground."""
    images = []
    for view, scene in zip(views, image.scene, strict=True):
        flame = view.radiation.path + view.radiation.emitted(np.array([temperature]))[0]
        ground = scene[image.pixel[:, 1], image.pixel[:, 0]].astype(np.float64)
        shape = patch.fire_images(view, image.inside, area)
        images.append(shape * (flame - ground)[:, None, None])
    return Burning(*images)


def observed(views: Views, image: Image, spots: HotSpots, fires: Burning, area: Floats) -> Contrast:
    """The contrast of an image's pixels, with fires of (n,) square metre."""
    radiance = []
    for view, scene, streams, shape in zip(views, image.scene, image.streams, fires, strict=True):
        lit = scene.astype(np.float64)
        if area.any():
            patch.add_images(lit, image.pixel, shape * area[:, None, None])
        radiance.append(patch.numbers_of(view, lit, streams))
    return contrast_of(radiance[0], radiance[1], spots.window, spots.guard)


def highest_near(score: Singles, image: Image, views: Views) -> Floats:
    """The highest score (n,) of the pixels that count as each fire of an image."""
    near = pixels_of_fire(views.mid)
    return np.array(
        [score[y - near : y + near + 1, x - near : x + near + 1].max() for x, y in image.pixel],
        np.float64,
    )


def smallest_areas(
    views: Views, image: Image, spots: HotSpots, temperature: float, guess: float
) -> Floats:
    """The smallest area (n,) with which each fire of an image is found, square metre.

    The noise of an image is the same for fires of any area: one random number a pixel.

    guess    square metre, start of the search
    Returns  inf where a fire as large as the ground between two pixels is not found
    Accuracy numerical: 1 %.
    """
    limit = threshold_of(spots.false_alarms, spots.window, spots.guard)
    fires = burning(views, image, temperature, guess)
    count, most = len(image.pixel), views.mid.across * views.mid.along

    def score(area: Floats) -> Floats:
        return highest_near(observed(views, image, spots, fires, area).score, image, views)

    low, below = np.zeros(count), score(np.zeros(count))
    area = np.full(count, min(guess, most))
    high, above = np.full(count, math.inf), np.full(count, math.nan)
    for _ in range(ROUNDS):
        value = score(area)
        hit = value > limit
        high, above = np.where(hit, area, high), np.where(hit, value, above)
        low, below = np.where(hit, low, area), np.where(hit, below, value)
        if ((high - low) <= CLOSE * high).all():
            break
        with np.errstate(invalid="ignore", divide="ignore"):
            straight = low + (high - low) * (limit - below) / (above - below)
            # The point is moved a little towards the farther end, so that both ends close in.
            nudge = np.where(straight - low < high - straight, 1 + CLOSE / 2, 1 - CLOSE / 2)
            least, last = low + 0.02 * (high - low), high - 0.02 * (high - low)
            inner = np.clip(straight * nudge, least, last)
        rising = np.clip(
            area * limit / np.maximum(value, limit / WIDEST), 1.5 * area, WIDEST * area
        )
        area = np.where(np.isfinite(high), inner, np.minimum(rising, most))
    found = np.where(np.isfinite(high), 0.5 * (high + np.where(low > 0, low, high)), math.inf)
    # Where noise alone exceeds the threshold, any fire is found.
    return np.where((low == 0) & (below > limit), 0.0, found)


class MeasuredFires(NamedTuple):
    """Retrieved power, temperature and area of fires, (n,) each: watt, kelvin, square metre."""

    power: Floats
    temperature: Floats
    area: Floats


def observed_fires(views: Views, image: Image, spots: HotSpots) -> Contrast:
    """An image with fires of the study's area and temperature."""
    fires = burning(views, image, spots.temperature, spots.area)
    return observed(views, image, spots, fires, np.full(len(image.pixel), spots.area))


def measure(views: Views, image: Image, spots: HotSpots) -> MeasuredFires:
    """Retrieved radiative power, temperature and area of fires of the study's area and
    temperature."""
    return measured_power(views, image, spots, observed_fires(views, image, spots))


def measured_power(views: Views, image: Image, spots: HotSpots, seen: Contrast) -> MeasuredFires:
    """Retrieved radiative power, temperature and area of the fires of an image.

    seen  as `observed_fires`
    """
    half = spots.guard
    sums = []
    layers = (seen.mid, seen.mid_around), (seen.thermal, seen.thermal_around)
    for (radiance, around), view in zip(layers, views, strict=True):
        # The surroundings of the fire's centre are used; those of its edge contain light of the
        # fire.
        excess = [
            (radiance[y - half : y + half + 1, x - half : x + half + 1] - around[y, x]).sum()
            for x, y in image.pixel
        ]
        sums.append(np.array(excess) * view.across * view.along / view.radiation.through)
    mid, thermal = (view.radiation.heat for view in views)
    assert mid is not None
    assert thermal is not None
    ground = tuple((view.mean - view.radiation.path) / view.radiation.through for view in views)
    kelvin, area = fire.temperature_and_area(
        sums[0], sums[1], (mid, thermal), (ground[0], ground[1])
    )
    return MeasuredFires(fire.power_of(sums[0], mid), kelvin, area)


def false_alarms(views: Views, image: Image, spots: HotSpots) -> tuple[int, int]:
    """Number of false alarms in an image without fires, and number of tested pixels."""
    nothing = burning(views, image, spots.temperature, spots.area)
    seen = observed(views, image, spots, nothing, np.zeros(len(image.pixel)))
    inner = seen.score[spots.window : -spots.window, spots.window : -spots.window]
    limit = threshold_of(spots.false_alarms, spots.window, spots.guard)
    return int((inner > limit).sum()), inner.size
