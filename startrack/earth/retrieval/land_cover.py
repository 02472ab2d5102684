"""LandCover: reflectance, an index and classes of land; their errors by formula and by trials.

The land is a mosaic of square fields, each of one of the scene's covers. Lens, pixel, smear and air
mix light of neighbouring fields into a pixel. The retrieval does not correct for that mixing.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from scipy import special
from scipy.stats import qmc

from startrack.core import (
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Singles,
    Streams,
    Unit,
    parameter,
    printed,
)
from startrack.earth.atmosphere import SPREADS
from startrack.earth.imager import Band, Channel, Survey, blur_strips, terms_in_band
from startrack.earth.retrieval import patch, texture
from startrack.earth.retrieval.fire_forecast import FINEST, Side, side_of
from startrack.earth.retrieval.hot_spots import refuse_other_grounds

FAR = 3.0  # widths of a Gaussian of the air; fields around an image are drawn to this distance
BROAD = 8.0  # fields; a wider Gaussian averages over all covers
STEP = 0.05  # step of the surroundings' reflectance for derivatives
NEAREST = 3.0  # pixel; half of the points of a forecast lie within this distance of a border
WIDEST = 12.0  # pixel; a border has no effect beyond this distance
TAIL = 3  # widths of the table of a point's image; light outside the table is spread over them
LEAST = 2.0  # pixel, smallest field for which a forecast is within 12 % of trials
POINTS = 2**13  # points of a forecast, over places, covers, texture, noise and surroundings
# numbers of frequencies (of an edge's image and of the texture) and of directions
NODES, TURNS = 96, 12


class LandCover(Parameters):
    """Reflectance, an index of two channels and the class of each pixel.

    Images show level ground straight below: a mosaic of square fields. Each cover of the scene's
    land is equally frequent; heights of covers are ignored.
    """

    channels: tuple[str, ...] = parameter(
        "names of the channels whose reflectance is measured", default=("B2", "B3", "B4", "B8")
    )
    red: str = parameter(
        "channel of the index (infrared - red) / (infrared + red); one of `channels`", default="B4"
    )
    infrared: str = parameter("likewise", default="B8")
    field: float = parameter(
        "side of a field", unit=Unit("m"), limit=Range(0.01, 1e5), default=200.0
    )
    height: float = parameter(
        "height of the ground above the ellipsoid",
        unit=Unit("m"),
        limit=Range(0, 9000),
        default=0.0,
    )
    sun_zenith: float = parameter(
        "of the Sun", unit=Unit("rad", "deg"), limit=Range(0, math.radians(85)), default=0.7
    )
    size: int = parameter(
        "pixel, a side of an image of a trial", limit=Range(16, 1024), default=128
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.channels)) < max(len(self.channels), 2):
            raise Refused(f"channels must be two or more different names, got {self.channels}")
        for name in ("red", "infrared"):
            if getattr(self, name) not in self.channels:
                raise Refused(f"{name} must be one of channels, got {getattr(self, name)!r}")
        if self.red == self.infrared:
            raise Refused(f"red and infrared must be different channels, got {self.red!r} twice")

    @property
    def pair(self) -> tuple[int, int]:
        """Indices of `red` and `infrared` in `channels`."""
        return self.channels.index(self.red), self.channels.index(self.infrared)


class AirOverLand(NamedTuple):
    """Radiance over level ground, linear in the reflectance around, watt / m^2 / sr / m.

        L = path + rho lit + (black + rho white) . (around - mean)

    black, white  (2,) derivative with the reflectance around: for the line of sight, for skylight
    spread        (2, g) weights of Gaussians of `SPREADS`; zero without air
    """

    path: float
    lit: float
    black: Floats
    white: Floats
    spread: Floats


def channels_of(survey: Survey, own: LandCover) -> list[Channel]:
    """The channels of a retrieval. Raises as `sunlit_channels`."""
    return patch.sunlit_channels(survey, own.channels, "retrieval.land_cover.channels")


def _mean_ground(survey: Survey, band: Band) -> Survey:
    """A survey whose surroundings have the mean reflectance of its covers in a band."""
    return replace(survey, surroundings=float(_covers(survey, band).mean()))


def _covers(survey: Survey, band: Band) -> Floats:
    """(k,) 1, reflectance of each cover in a band."""
    return np.array(
        [cover.reflectance(band.wavelength) @ band.weight for cover in survey.land.covers]
    )


def _air(band: Band, radiation: patch.Radiation, own: LandCover, mean: float) -> AirOverLand:
    """The radiance over level ground in a band."""
    step = STEP if mean < 0.5 else -STEP
    around = mean + step * np.array(
        [[0.0, 1.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]]
    )
    warm = None if band.heat is None else np.full(6, 288.0)
    ground = patch.level_ground(6, own.height, own.sun_zenith)
    terms = terms_in_band(ground, band, np.repeat([0.0, 1.0], 3), around, warm)
    light = (terms.total - terms.emitted).astype(np.float64).reshape(2, 3)
    change = (light[:, 1:] - light[:, :1]) / step
    table, spread = band.table, np.zeros((2, len(SPREADS)))
    if table.spread is not None:
        level = table.spread[:, :, 0]
        for kind in range(2):
            spread[kind] = [np.interp(own.height, table.height, part) for part in level[kind].T]
    return AirOverLand(radiation.path, radiation.lit, change[0], change[1] - change[0], spread)


class LandView(NamedTuple):
    """Inputs that are the same for all images of a channel.

    view     constant inputs of the channel
    air      over the ground
    covers   (k,) 1, reflectance of each cover
    """

    view: patch.View
    air: AirOverLand
    covers: Floats


@lru_cache(maxsize=8)
def land_views(survey: Survey, own: LandCover) -> tuple[LandView, ...]:
    """Each channel over the ground.

    Raises  ValueError as `channels_of` and `view_below`, and where the channels' pixels differ.
    """
    made = []
    for channel in channels_of(survey, own):
        first = patch.view_below(survey, channel, own.size, own.height, own.sun_zenith)
        mean = _mean_ground(survey, first.setting.band)
        view = patch.view_below(mean, channel, own.size, own.height, own.sun_zenith)
        band = view.setting.band
        covers = _covers(survey, band)
        air = _air(band, view.radiation, own, float(covers.mean()))
        made.append(LandView(view, air, covers))
    for other in made[1:]:
        refuse_other_grounds(made[0].view, other.view)
    return tuple(made)


class LandImage(NamedTuple):
    """An image and its truth.

    truth      (b, n) 1, mean reflectance of the ground of each pixel
    measured   (b, n) 1, from the digital numbers
    cover      (n,) index of the cover at the centre of each pixel
    """

    truth: Floats
    measured: Floats
    cover: Ints


def observe_land(survey: Survey, own: LandCover, seed: int, number: int) -> LandImage:
    """An image of random fields, from a seed and the image's number."""
    views, streams = land_views(survey, own), Streams(seed, number)
    first, rays, size = views[0].view, survey.rays, own.size
    widths = [width for width in SPREADS.tolist() if width < BROAD * own.field]
    sides = size * first.along, size * first.across
    far = FAR * max(widths, default=0.0)
    cover, borders = _random_fields(survey, own, streams, sides, far)
    step = first.along / rays, first.across / rays
    grey = _texture(survey, streams, size * rays, step)
    fine = [_within(edge, size * rays, width) for edge, width in zip(borders, step, strict=True)]
    middles = [(np.arange(size) + 0.5) * width for width in (first.along, first.across)]
    row, column = (
        np.searchsorted(edge, middle) - 1 for edge, middle in zip(borders, middles, strict=True)
    )
    kernels = [
        [
            np.diff(special.ndtr((edge - middle[:, None]) / width), axis=1)
            for edge, middle in zip(borders, middles, strict=True)
        ]
        for width in widths
    ]
    truths, measured = [], []
    for index, (view, air, covers) in enumerate(views):
        field = covers[cover]
        ground = (fine[0] @ field @ fine[1].T).astype(np.float32)
        if grey is not None:
            ground = np.minimum(ground * grey, 1.0)
        lattice = ground.reshape(size, rays, size, rays).transpose(0, 2, 1, 3)
        lattice = np.ascontiguousarray(lattice.reshape(size, size, rays**2))
        truths.append(lattice.mean(-1, dtype=np.float64).ravel())
        seen = _blurred(lattice, view)
        light = air.path + air.lit * seen.astype(np.float64)
        around = np.zeros((2, size, size))
        for weight, (down, right) in zip(air.spread.T, kernels, strict=False):
            around += weight[:, None, None] * (down @ (field - covers.mean()) @ right.T)
        for kind in range(2):
            light += (air.black[kind] + air.white[kind] * seen) * around[kind]
        noise = Streams(seed, len(views) * number + index)
        radiance = patch.numbers_of(view, np.maximum(light, 0.0), noise)
        measured.append((radiance.ravel() - air.path) / air.lit)
    return LandImage(np.array(truths), np.array(measured), cover[np.ix_(row, column)].ravel())


def _random_fields(
    survey: Survey, own: LandCover, streams: Streams, sides: tuple[float, float], far: float
) -> tuple[Ints, list[Floats]]:
    """Random rectangular fields over an image and its surroundings.

    sides    metre, of the image along and across
    far      metre, width of the surroundings
    Returns  cover of each field (n, m); borders (n + 1,) and (m + 1,) of the fields along each
             axis, metre from the image's first corner
    """
    counts = [math.ceil((side + 2 * far) / own.field) + 2 for side in sides]
    first = math.ceil(far / own.field)
    random = streams("fields")
    cover = random.integers(0, len(survey.land.covers), counts)
    borders = [
        np.asarray(own.field * (np.arange(count + 1) - first - random.random()), np.float64)
        for count in counts
    ]
    return cover, borders


def _texture(
    survey: Survey, streams: Streams, count: int, step: tuple[float, float]
) -> Floats | None:
    """Relative reflectance (count, count) of the land's texture; None without a texture."""
    land = survey.land
    if not land.texture:
        return None
    drawn = texture.draw(streams("reflectance"), count, count, step, land.texture_cell)
    return np.maximum(1 + land.texture * drawn, 0.0)


def _blurred(lattice: Singles, view: patch.View) -> Singles:
    """Reflectance (size, size) in the image, from the reflectance at the rays of pixels (size,
    size, n).

    Light beyond the table of a point's image is spread evenly over `TAIL` times its width.
    """
    near = np.concatenate(list(blur_strips(iter([lattice]), view.weights)))
    wide = TAIL * view.weights.shape[1]
    far = cv2.blur(lattice.mean(-1), (wide, wide), borderType=cv2.BORDER_REFLECT)
    return np.asarray(view.psf.energy * near + (1 - view.psf.energy) * far, np.float32)


def _within(borders: Floats, count: int, width: float) -> Floats:
    """Fraction (count, n) of each cell of a row that lies in each of n fields."""
    cells = np.arange(count + 1) * width
    inside = np.clip(cells[:, None], borders[:-1], borders[1:])
    return np.asarray(np.diff(inside, axis=0) / width, np.float64)


def index_of(own: LandCover, reflectance: Floats) -> Floats:
    """(infrared - red) / (infrared + red) of reflectances (b, ...), within [-1, 1]."""
    red, infrared = (np.maximum(reflectance[place], 0.0) for place in own.pair)
    total = red + infrared
    return np.asarray(np.where(total > 0, (infrared - red) / np.where(total > 0, total, 1), 0.0))


class Belief(NamedTuple):
    """Each cover as the classification assumes it: inverse covariance, and its log determinant."""

    means: Floats
    inverse: Floats
    determinant: Floats


@lru_cache(maxsize=8)
def _belief(survey: Survey, own: LandCover) -> Belief:
    """Normal distribution of each cover's reflectance, by texture and noise of the camera."""
    sides = _sides(survey, own)
    means = np.stack([side.covers for side in sides], 1)
    inner = _texture_seen(survey, sides[0].side) * survey.land.texture**2
    covariance = np.stack(
        [inner * np.outer(mean, mean) + np.diag(_noise(sides, mean[None])[0]) for mean in means]
    )
    inverse = np.asarray(np.linalg.inv(covariance), float)
    return Belief(means, inverse, np.linalg.slogdet(covariance)[1])


def classify_land(survey: Survey, own: LandCover, reflectance: Floats) -> Ints:
    """The cover (n,) of maximum likelihood, from reflectances (b, n).

    Source: Richards (2013), Remote Sensing Digital Image Analysis, 8.2.
    """
    belief = _belief(survey, own)
    score = [
        np.einsum("bn,bc,cn->n", off, inverse, off) + determinant
        for mean, inverse, determinant in zip(*belief, strict=True)
        for off in [reflectance - mean[:, None]]
    ]
    return np.asarray(np.argmin(score, 0))


class LandSide(NamedTuple):
    """A channel for the formulas, the air over the ground, and the covers' reflectances (k,)."""

    side: Side
    air: AirOverLand
    covers: Floats


@lru_cache(maxsize=8)
def _sides(survey: Survey, own: LandCover) -> tuple[LandSide, ...]:
    made = []
    for channel in channels_of(survey, own):
        band = side_of(survey, channel, own).band
        side = side_of(_mean_ground(survey, band), channel, own)
        covers = _covers(survey, side.band)
        air = _air(side.band, side.radiation, own, float(covers.mean()))
        made.append(LandSide(side, air, covers))
    for other in made[1:]:
        refuse_other_grounds(made[0].side, other.side)
    return tuple(made)


def _noise(sides: tuple[LandSide, ...], reflectance: Floats) -> Floats:
    """Variance (n, b) of reflectances (n, b) by the camera's noise."""
    columns = []
    for (side, air, _), rho in zip(sides, reflectance.T, strict=True):
        columns.append((side.variance(air.path + air.lit * rho) + side.stripes) / air.lit**2)
    return np.stack(columns, 1)


@printed
class LandForecast(NamedTuple):
    """Errors that the formulas predict.

    reflectance_error  1, rms over channels and pixels
    index_error        1, rms
    wrong              1, fraction of misclassified pixels
    """

    reflectance_error: float
    index_error: float
    wrong: float


def forecast_land(survey: Survey, own: LandCover) -> LandForecast:
    """Errors of reflectance, of the index and of classes.

        rho' = sum_i c_i rho_i (1 + t g') + (black + rho' white) . a / lit + n
        c_i = products of C(x) or 1 - C(x) along both axes
        C(x) = 1/2 + Int H sin(2 pi f x) / (pi f)

    The sum is over the pixel's own field and the three fields beyond its nearest corner. H is the
    transfer function of lens, pixel and smear; g' is the texture through H; a is the light of the
    surroundings by the Gaussians of the air; n is the noise of the digital numbers. A fixed Sobol
    sequence integrates over the place of a pixel in its field, covers, textures, noise and
    surroundings.

    Raises    ValueError as `channels_of` and `side_of`; where a field is smaller than two pixels.
    Accuracy  model: a field's border is an edge along each axis; fields beyond the nearest corner
              contribute their variance alone. numerical: 2 %. Within 12 % of trials over the
              designs of experiments/retrieval_formulas.py.
    """
    sides = _sides(survey, own)
    largest = max(sides[0].side.across, sides[0].side.along)
    if own.field < LEAST * largest:
        raise Refused(
            f"retrieval.land_cover.field must be {LEAST:g} pixels or more for a forecast, "
            f"{LEAST * largest:.4g} m, got {own.field:g} m; trials accept smaller fields"
        )
    bands, kinds = len(sides), len(survey.land.covers)
    draws = _sobol(6 + 2 + kinds + bands)
    where, normal = draws[:, :6], special.ndtri(draws[:, 6:])
    first = sides[0].side
    place, weight = _places(own.field, (first.along, first.across), where)
    cover = np.minimum((where[:, 2:6] * kinds).astype(int), kinds - 1)
    seen_texture, true_texture = _brightness(survey, first, normal[:, :2])
    around = _surroundings(own.field, place) if survey.air else None
    truth, measured = np.empty((2, bands, len(draws)))
    for band, (side, air, covers) in enumerate(sides):
        rho = covers[cover]
        truth[band] = true_texture * _mixed(rho, _squares(side, place))
        seen = seen_texture * _mixed(rho, _edges(side, place))
        light = air.path + air.lit * seen
        if around is not None:
            off = covers - covers.mean()
            far = normal[:, 2 : 2 + kinds] @ off / math.sqrt(kinds)
            for kind, spread in enumerate(air.spread):
                other = around.reflectance(spread, off[cover], far, weight)
                light += (air.black[kind] + air.white[kind] * seen) * other
        light = _converted(side, light, normal[:, 2 + kinds + band])
        measured[band] = (light - air.path) / air.lit
    square = ((measured - truth) ** 2).mean(0)
    index = (index_of(own, measured) - index_of(own, truth)) ** 2
    wrong = classify_land(survey, own, measured) != cover[:, 0]
    return LandForecast(
        math.sqrt(weight @ square), math.sqrt(weight @ index), float(weight @ wrong)
    )


def _places(field: float, pixel: tuple[float, float], where: Floats) -> tuple[Floats, Floats]:
    """Places of a pixel in its field, half of them near a border, and their weights.

    field    metre, side of the field
    pixel    metre, sides of a pixel
    where    (n, 2 or more) in [0, 1), one column for each axis
    Returns  (2, n) metre, distance from the nearer border along each axis; (n,) weights, sum 1
    """
    weight = np.ones(len(where))
    place = np.empty((2, len(where)))
    for axis, step in enumerate(pixel):
        half = field / step / 2
        near = min(NEAREST, half / 2)
        u = where[:, axis]
        place[axis] = step * np.where(u < 0.5, 2 * u * near, near + (2 * u - 1) * (half - near))
        weight *= np.where(u < 0.5, 2 * near / half, 2 * (half - near) / half)
    weight /= weight.sum()
    return place, weight


def _converted(side: Side, light: Floats, normal: Floats) -> Floats:
    """Radiance (n,) from the digital numbers of light (n,), with noise of normal deviates (n,)."""
    detector = side.channel.detector
    step = detector.electrons_per_dn / side.electrons
    dark = detector.dark_rate * side.exposure / side.electrons
    variance = side.variance(light) + side.stripes - step**2 / 12
    noisy = light + np.sqrt(np.maximum(variance, 0.0)) * normal
    numbers = np.maximum(np.rint((noisy + dark) / step), -float(detector.offset))
    return np.minimum(step * numbers - dark, side.saturation)


def _sobol(dimensions: int) -> Floats:
    """Points (n, d) of a Sobol sequence, within (0, 1)."""
    points = qmc.Sobol(dimensions, rng=Streams(1, 0)("nodes of land")).random(POINTS)
    return np.asarray(np.clip(points, 1e-9, 1 - 1e-9), np.float64)


def _mixed(rho: Floats, shares: Floats) -> Floats:
    """Reflectance (n,) of four fields (n, 4), by the own fraction along both axes (2, n)."""
    down, right = shares
    parts = down * right, down * (1 - right), (1 - down) * right, (1 - down) * (1 - right)
    return np.asarray(sum(part * rho[:, n] for n, part in enumerate(parts)), np.float64)


def _edges(side: Side, place: Floats) -> Floats:
    """Fraction of a pixel's light from its own side of an edge at (2, n) metre."""
    frequency, grid, waves = _edge_waves()
    nothing = np.zeros(NODES)
    transfers = side.transfer(nothing, frequency), side.transfer(frequency, nothing)
    return np.array(
        [
            np.interp(metre / side.side, grid, 0.5 + waves @ transfer, right=1.0)
            for metre, transfer in zip(place, transfers, strict=True)
        ]
    )


def _edge_waves() -> tuple[Floats, Floats, Floats]:
    """Frequencies (f,) in cycle / pixel, places (p,) in pixel, and weights (p, f) of a transfer."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    frequency, weight = (node + 1) * FINEST / 2, weight * FINEST / 2
    grid = np.linspace(0, WIDEST, 4 * NODES)
    waves = np.sin(2 * math.pi * np.outer(grid, frequency)) / (math.pi * frequency) * weight
    return frequency, grid, waves


def _squares(side: Side, place: Floats) -> Floats:
    """Fraction of a pixel's ground on its own side of an edge at (2, n) metre."""
    return np.array(
        [
            np.clip(0.5 + metre / step, 0, 1)
            for metre, step in zip(place, (side.along, side.across), strict=True)
        ]
    )


class _Surroundings(NamedTuple):
    """Fractions of the light of Gaussians: from four fields (g, 4, n), and, for two Gaussians,
    from the field in which both lie (g, g)."""

    shares: Floats
    same: Floats

    def reflectance(self, spread: Floats, off: Floats, far: Floats, weight: Floats) -> Floats:
        """Deviation (n,) of the reflectance around from its mean.

        spread  (g,) weights of the Gaussians
        off     (n, 4) deviation of the reflectance of the own and three other fields from the mean
        far     (n,) random deviation with the variance of the covers, for the fields beyond
        weight  (n,) weight of the points
        """
        shares = np.tensordot(spread, self.shares, 1)
        rest = float(spread @ self.same @ spread) - float((shares**2).sum(0) @ weight)
        return np.asarray((shares.T * off).sum(1) + math.sqrt(max(rest, 0.0)) * far, np.float64)


def _surroundings(field: float, place: Floats) -> _Surroundings:
    """Surroundings of points at (2, n) metre from the borders of their own field."""
    widths = SPREADS[:, None, None]
    edge = special.ndtr(place / widths)
    inner = edge - special.ndtr((place - field) / widths)
    outer = special.ndtr((place + field) / widths) - edge
    products = [
        down * right for down in (inner[:, 0], outer[:, 0]) for right in (inner[:, 1], outer[:, 1])
    ]
    ratio = field / np.hypot(SPREADS[:, None], SPREADS)
    tail = math.sqrt(2 / math.pi) / ratio * np.expm1(-(ratio**2) / 2)
    return _Surroundings(np.stack(products, 1), (special.erf(ratio / math.sqrt(2)) + tail) ** 2)


def _texture_seen(survey: Survey, side: Side) -> float:
    """Variance in the image of a texture of variance one."""
    return float(_texture_covariance(survey, side)[0, 0])


def _brightness(survey: Survey, side: Side, normal: Floats) -> Floats:
    """(2, n) mean of max(1 + texture, 0), in the image and over pixels, at normal deviates (n, 2).

        E max(m + s z, 0) = m Phi(m / s) + s phi(m / s)

    m is the mean of a pixel; s is the rms of the texture that lens and pixel do not resolve.
    """
    rms, covariance = survey.land.texture, _texture_covariance(survey, side)
    mean = 1 + rms * (normal @ _texture_root(survey, side).T).T
    rest = rms * np.sqrt(np.maximum(1 - np.diag(covariance), 1e-12))[:, None]
    ratio = mean / np.maximum(rest, 1e-12)
    density = np.exp(-(ratio**2) / 2) / math.sqrt(2 * math.pi)
    return np.asarray(mean * special.ndtr(ratio) + rest * density, np.float64)


def _texture_root(survey: Survey, side: Side) -> Floats:
    """(2, 2) root of the covariance of the texture in the image and of its mean over pixels."""
    covariance = _texture_covariance(survey, side)
    seen = math.sqrt(covariance[0, 0])
    part = covariance[0, 1] / seen if seen else 0.0
    rest = math.sqrt(max(covariance[1, 1] - part**2, 0.0))
    return np.array([[seen, 0.0], [part, rest]])


def _texture_covariance(survey: Survey, side: Side) -> Floats:
    """(2, 2) covariance of the texture in the image and of its mean over a pixel.

    The variance is 1 before lens, pixel and smear.
    """
    cell = survey.land.texture_cell
    size = np.geomspace(0.5 / texture.TEXELS, math.sqrt(0.5), NODES + 1) / cell
    middle, width = np.sqrt(size[1:] * size[:-1]), np.diff(size)
    turn = (np.arange(TURNS) + 0.5) * math.pi / 2 / TURNS
    x, y = np.outer(middle, np.cos(turn)), np.outer(middle, np.sin(turn))
    density = texture.power(np.stack([x, y], -1), cell)
    part = density * (2 * math.pi * middle * width)[:, None] / TURNS
    seen = side.transfer(x * side.side, y * side.side)
    true = np.sinc(x * side.across) * np.sinc(y * side.along)
    lost = [float((part * (1 - product)).sum()) for product in (seen**2, seen * true, true**2)]
    image, both, ground = np.maximum(1 - np.array(lost), 0.0)
    return np.array([[image, both], [both, ground]])
