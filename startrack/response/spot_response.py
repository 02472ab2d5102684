"""Case -> detection and centroid of a star, over its flux and position in the pixel."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Flags, Floats, Psf, Streams
from startrack.design import Case
from startrack.detection import NEAR, SpotExpectation, expect, margin, reach
from startrack.detector import star_grid
from startrack.observation import detection_plan, field_psf_of, line_of_sight
from startrack.response.dark_pattern import NO_HOT, SAMPLES, HotPixels, near_stars
from startrack.response.star_response import PHASES, phases, with_expected_jitter, within_frame
from startrack.response.zones import centroid_shift, unique_places, zones_of

FLUX_STEP = 0.2 * math.log(10)  # step in the logarithm of flux: half a magnitude
# Pixel, distance within which a companion shifts a star: a window and its ring. Chosen by hand.
COMPANION_RADIUS = 7
KEPT = 0.5  # probability of acceptance below which a star near hot pixels counts as lost
COMPANION_RATIOS = np.arange(-4, 4) * 0.8  # logarithm of a companion's flux over the star's


class SpotResponse(NamedTuple):
    """Detection and centroid of a star, over its flux and position in the pixel.

    There are z zones of the frame and of colour; without a lens table there is one.

    first              logarithm of the least flux in electron; the others follow in equal steps
    bias               (z, l, p, p, 2) pixel x and y, by row and column of the position
    covariance_root    (z, l, p, p, 3) pixel electron, triangular root xx, yx, yy of the covariance,
                       times flux
    light              (z, l, p, p, 2) measured flux (digital number) over electrons; relative noise
                       of the measured flux
    threshold_margin   (z, l, p, p) sigma, excess of a star over the threshold
    pass_probability   (z, l, p, p) 1, probability that a detected star is not rejected as a hot
                       pixel
    star_at_threshold  (5,) flux in digital number, its sigma, covariance xx, xy, yy
    """

    first: float
    bias: Floats
    covariance_root: Floats
    light: Floats
    threshold_margin: Floats
    pass_probability: Floats
    star_at_threshold: Floats


@dataclass(frozen=True)
class ResponseGrid:
    """Stars of a case on a grid of cells, which the detection measures.

    sky     electron in a pixel
    psf     PSF of the stars; None: the PSF of the instrument
    search  as for `detection.expect`
    """

    case: Case
    sky: float
    psf: Psf | None = None
    search: tuple[float, float] | None = None

    @property
    def side(self) -> int:
        """Pixel, of a cell."""
        longest = math.ceil(np.abs(_smear(self.case)[:, 1:]).max())
        side = 2 * (margin(detection_plan(self.case)) + longest + 2) + 1
        return within_frame(side, self.case.instrument.detector)

    @property
    def reach(self) -> int:
        """Pixel, from the middle of a cell to the farthest pixel that is read."""
        beside = 1 if self.case.instrument.detector.crosstalk else 0
        return reach(detection_plan(self.case)) + NEAR + beside

    def expect(
        self,
        place: Floats,
        flux: Floats,
        companions: tuple[Floats, Floats] | None = None,
        dark: Floats | None = None,
    ) -> tuple[SpotExpectation, Floats]:
        """Expected measurement of stars (n), and their places; arguments as `star_grid`."""
        detector = self.case.instrument.detector
        plan = detection_plan(self.case)
        psf, smear = with_expected_jitter(self.case.instrument, self.psf), _smear(self.case)
        frame, at = star_grid(
            place, flux, self.side, smear, psf, detector, self.sky, companions, dark, self.reach
        )
        empty = self.sky + detector.dark_rate * detector.exposure
        level = detector.offset + empty / detector.electrons_per_dn
        area = detector.columns * detector.rows
        return expect(frame, at, level, area, plan, self.search), at


def response_of(grid: ResponseGrid, faintest: float, brightest: float) -> SpotResponse:
    """The response of the detection to stars of all fluxes and positions in the pixel."""
    flux = fluxes_between(faintest, brightest)
    count, light = len(flux), np.repeat(flux, PHASES**2)
    seen, place = grid.expect(phases(), flux)
    shape = (count, PHASES, PHASES)
    bias = np.column_stack([seen.x, seen.y]) - place
    variance_x, variance_y = seen.covariance[:, 0, 0], seen.covariance[:, 1, 1]
    good = np.isfinite(bias).all(axis=1) & (variance_x > 0) & (variance_y > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        xx = np.sqrt(variance_x)
        yx = seen.covariance[:, 0, 1] / xx
        root = np.stack([xx, yx, np.sqrt(np.maximum(variance_y - yx**2, 0))], axis=-1)
        gain = np.column_stack([seen.flux / light, seen.sigma / seen.flux])
    root *= light[:, None]
    return SpotResponse(
        first=math.log(faintest),
        bias=np.where(good[:, None], bias, 0.0).reshape(1, *shape, 2),
        covariance_root=np.where(good[:, None], root, 0.0).reshape(1, *shape, 3),
        light=np.where(good[:, None], gain, 0.0).reshape(1, *shape, 2),
        threshold_margin=np.where(good, seen.above / seen.spread, -np.inf).reshape(1, *shape),
        pass_probability=np.where(good, seen.kept, 0.0).reshape(1, *shape),
        star_at_threshold=_at_threshold(seen, good.reshape(count, -1)),
    )


def response_of_zones(grid: ResponseGrid, faintest: float, brightest: float) -> SpotResponse:
    """`response_of` in each zone of a lens table.

    The bias leaves out the difference between `centroid_shift` and the shift of the image, because
    this difference varies from star to star. False spots have the same flux as with the mean image.
    """
    case = grid.case
    images, shift = field_psf_of(case.instrument), centroid_shift(case)
    mean = response_of(grid, faintest, brightest)
    middles = zones_of(case).middles
    unique, which, mirror = unique_places(case, middles)
    measured = []
    for place in unique:
        psf, _ = images.image(*place)
        measured.append(response_of(replace(grid, psf=psf), faintest, brightest))
    zones = []
    for (x, y, colour), u, turn in zip(middles, which, mirror, strict=True):
        zone = _mirrored(measured[u], turn)
        at = np.array([x]), np.array([y]), np.array([colour])
        left_out = shift.at(*at)[0, :2] - images.at(*at)[0, :2]
        zones.append(zone._replace(bias=zone.bias - left_out))
    tables = zip(*(zone[1:6] for zone in zones), strict=True)
    joined = map(np.concatenate, tables)
    return SpotResponse._make([mean.first, *joined, mean.star_at_threshold])


def _mirrored(response: SpotResponse, mirror: Floats) -> SpotResponse:
    """The response at the mirror image (2, 2) of a measured place."""
    swapped, signs = mirror[0, 0] == 0, mirror.sum(axis=1)

    def turned(table: Floats) -> Floats:
        table = table.swapaxes(2, 3) if swapped else table
        for axis, sign in ((3, signs[0]), (2, signs[1])):
            table = np.flip(table, axis) if sign < 0 else table
        return table

    bias, root, light, above, kept = (turned(quantity) for quantity in response[1:6])
    xx, yx, yy = np.moveaxis(root, -1, 0)
    covariance = np.stack(
        [np.stack([xx**2, xx * yx], -1), np.stack([xx * yx, yx**2 + yy**2], -1)], -1
    )
    covariance = mirror @ covariance @ mirror.T
    xx = np.sqrt(covariance[..., 0, 0])
    yx = covariance[..., 0, 1] / np.where(xx > 0, xx, 1.0)
    yy = np.sqrt(np.maximum(covariance[..., 1, 1] - yx**2, 0))
    bias, root = bias @ mirror.T, np.stack([xx, yx, yy], axis=-1)
    return SpotResponse(
        first=response.first,
        bias=bias,
        covariance_root=root,
        light=light,
        threshold_margin=above,
        pass_probability=kept,
        star_at_threshold=response.star_at_threshold,
    )


def _at_threshold(seen: SpotExpectation, good: Flags) -> Floats:
    """`SpotResponse.star_at_threshold`: interpolated over flux, median over all positions."""
    xx, xy, yy = (seen.covariance[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    values = np.stack([seen.above, seen.flux, seen.sigma, xx, xy, yy]).reshape(6, *good.shape)
    above, *rest = np.median(values[:, good.all(axis=1)], axis=2)
    # A saturated star may exceed the threshold by less than a fainter star does.
    above = np.maximum.accumulate(above)
    return np.array([np.interp(0.0, above, figure) if len(above) else np.nan for figure in rest])


def hot_windows(
    grid: ResponseGrid, true: Case, flux: Floats, samples: int = SAMPLES
) -> tuple[HotPixels, Floats]:
    """Effect of hot pixels on the centroids of stars of some fluxes, and on their detection.

    grid     grid of the case `with_uniform_dark`
    true     the case with its hot pixels
    flux     (l,) electron
    samples  number of windows with hot pixels
    Returns  the shifts; (l, k) sigma, increase of the star's excess over the threshold
    """
    chance, dark = near_stars(true, grid.side, samples)
    if not chance:
        return NO_HOT, np.zeros((2, 1))
    samples, few = len(dark), min(len(dark), SAMPLES)  # few: own places of stars
    phase = Streams(0, 0)("places of stars near hot pixels").random((few, 2)) - 0.5

    def expected(behind: Floats | None, count: int) -> tuple[Floats, Floats, Floats]:
        """Displacement (l, k, 2), excess over the threshold and probability to be kept (l, k)."""
        shape = len(flux), count
        seen, place = grid.expect(phase, flux, dark=behind)
        moved = np.column_stack([seen.x, seen.y]) - place
        return moved.reshape(*shape, 2), seen.above.reshape(shape), seen.kept.reshape(shape)

    of_place = np.arange(samples) % few
    alone, above_alone, _ = (part[:, of_place] for part in expected(None, few))
    seen, above, kept = expected(dark, samples)
    shift = seen - alone
    shift[~(kept > KEPT)] = np.nan
    shift[~((above_alone > 0) & np.isfinite(alone[..., 0]))] = 0.0  # is lost in any case
    return HotPixels(chance, shift), above - above_alone


def fluxes_between(faintest: float, brightest: float) -> Floats:
    """Electron, of the stars of a `SpotResponse`."""
    count = math.ceil(math.log(brightest / faintest) / FLUX_STEP) + 2
    return np.asarray(faintest * np.exp(FLUX_STEP * np.arange(count)))


def companion_shift(grid: ResponseGrid, flux: float) -> Floats:
    """Shift of a centroid by a companion, pixel: (r, d, d, 2) over its flux ratio and position.

    NaN if only the companion is detected.
    """
    offset = np.arange(-COMPANION_RADIUS, COMPANION_RADIUS + 1.0)
    y, x = np.meshgrid(offset, offset, indexing="ij")
    count, ratios, side = x.size, len(COMPANION_RATIOS), len(offset)
    middle, to_companion = np.zeros((count, 2)), np.column_stack([x.ravel(), y.ravel()])
    companion = flux * np.exp(COMPANION_RATIOS)
    seen, place = grid.expect(middle, np.full(ratios, flux), (to_companion, companion))
    alone, _ = grid.expect(middle, np.array([flux]))
    centroid = np.column_stack([seen.x, seen.y])
    shift = centroid - np.tile(np.column_stack([alone.x, alone.y]), (ratios, 1))
    shift[:, 1] -= np.repeat(np.arange(ratios), count) * (place[count, 1] - place[0, 1])
    from_star = centroid - place
    from_companion = from_star - np.tile(to_companion, (ratios, 1))
    lost = np.hypot(*from_star.T) > np.hypot(*from_companion.T)
    shift[lost & (np.repeat(companion, count) >= flux)] = np.nan
    return shift.reshape(ratios, side, side, 2)


def _smear(case: Case) -> Floats:
    """Weight, x and y (pixel) of the path of a star in the middle of the field, (m, 3).

    Only the slew counts. Jitter moves the star differently in each trial, and is included as blur.
    """
    camera = case.instrument.camera.ideal
    slew = replace(case.instrument, motion=case.instrument.motion.steady)
    path = line_of_sight(slew, Streams(0, 0))
    place = camera.project(Rotation.from_rotvec(path.rotation).apply([0.0, 0.0, 1.0]))
    return np.column_stack([path.weight, place - camera.centre])
