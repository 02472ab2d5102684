"""Case -> plan of its statistical trials: detectable stars, their response, refused effects."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.catalog import open_sky
from startrack.core import Camera, Flags, Floats, Ints, Refused, kept
from startrack.design import Case, Fidelity
from startrack.detection import false_alarms, peak_border, star_profile
from startrack.detector import require_independent_pixels
from startrack.observation import (
    colour_range,
    detection_plan,
    electrons_of,
    field_psf_of,
    mean_colour,
    near_pairs,
    psf_of,
    sky_electrons,
)
from startrack.response import (
    COMPANION_RADIUS,
    COMPANION_RATIOS,
    HotPixels,
    ResponseGrid,
    SpotResponse,
    centroid_shift,
    companion_shift,
    dark_pattern,
    empty_frame,
    fluxes_between,
    focal_stretch,
    hot_windows,
    knowledge_of,
    response_of,
    response_of_zones,
    unique_places,
    with_uniform_dark,
    zones_of,
)
from startrack.trial.effects import require_least_squares, require_no_image, require_window

FAINTEST = 4.5  # sigma below the threshold, where a star passes 3 times in a million
LEAST = 0.5  # sigma of the faintest stars, lower limit for low thresholds; by hand
CROWDED = 0.1  # limit of the spots by hot pixels over the spots that are kept; chosen by hand
MARKED = 0.003  # limit of the fraction of pixels that a dark map marks as hot; by hand
STEPS, COLOURS = 16, 32  # nodes of the shifts by a lens table: along a side, over colour
TYPICAL = 5.0  # flux at which shifts by companions are measured, over the faintest flux


class SpotField(NamedTuple):
    """The stars that can be detected, in order of the last coordinate of their directions.

    direction   (n, 3) unit vectors, true
    believed    (n, 3) unit vectors in the tracker's catalogue
    known       (n,) whether the star is in the tracker's catalogue
    flux        (n,) logarithm of electrons
    number      (n,) index into the sky, which selects the star's random numbers
    systematic  (n,) pixel^2 per axis, systematic variance that the tracker assumes
    hot         (n,) pixel^2 per axis, `TrackerKnowledge.hot`
    colour      (n,) index of the star's colour among those of `Through`
    zone        (n,) first zone of the star's class of colour
    stretch     (n,) 1, relative excess of the tracker's focal length for the star's colour
    """

    direction: Floats
    believed: Floats
    known: Flags
    flux: Floats
    number: NDArray[np.uint64]
    systematic: Floats
    hot: Floats
    colour: Ints
    zone: Ints
    stretch: Floats


class Through(NamedTuple):
    """Effect of a lens table on stars of k colours over the frame; empty without one.

    table        (k, q, p, 3) shift in x and y, pixel; logarithm of the relative flux
    step_x, _y   pixel, distance between two nodes of the table
    wide, high   pixel, width and height of a zone
    across       number of zones in a row
    down         number of zones in a column
    slack        pixel^2 per axis, mean square of a unit's residual: the solver's gate grows with
                 the typical residual
    """

    table: Floats
    step_x: float
    step_y: float
    wide: float
    high: float
    across: int
    down: int
    slack: float = 0.0


class Companions(NamedTuple):
    """The neighbours of each of the n stars of a `SpotField`.

    start      (n + 1,) the neighbours of star i are those from start[i] to start[i + 1]
    direction  (k, 3) unit vectors of the neighbours
    flux       (k,) logarithm of electrons
    """

    start: Ints
    direction: Floats
    flux: Floats


class SpotView(NamedTuple):
    """A camera and the part of its frame that is searched, for the kernels.

    focal .. k3   as in Camera; centre_x, centre_y: principal point, pixel
    border        pixel, least distance of a star from the edge
    cosine        cosine of the angle from the boresight to the farthest corner
    """

    columns: int
    rows: int
    focal: float
    centre_x: float
    centre_y: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    border: int
    cosine: float


NO_LENS = Through(
    table=np.zeros((0, 1, 1, 3)),
    step_x=1.0,
    step_y=1.0,
    wide=1.0,
    high=1.0,
    across=1,
    down=1,
    slack=0.0,
)


class SpotPlan(NamedTuple):
    """Values that all trials of a case share.

    response    response of the detection to single stars
    pull        shifts by companions, from `companion_shift`
    field       the stars that can be detected
    companions  neighbours of these stars
    view        the true camera
    gate        sigma, gate of the solver
    false       expected number of false spots in a frame
    through     effect of a lens table
    hot         effect of hot pixels on the centroids of stars

    Accuracy  model: leaves out hot pixels near companions, and changes by noise in the order of
              brightness of two spots.
    """

    response: SpotResponse
    pull: Floats
    field: SpotField
    companions: Companions
    view: SpotView
    gate: float
    false: float
    through: Through
    hot: HotPixels


def refuse(case: Case) -> None:
    """Refuse effects that need an image.

    Raises  ValueError that names the effect.
    """
    require_no_image(case)
    _refuse_crowded(case)


def _refuse_crowded(case: Case) -> None:
    """Refuse designs with many hot pixels: they replace stars in the list of spots."""
    pattern = dark_pattern(case)
    if pattern is None:
        return
    empty = empty_frame(case, sky_electrons(case))
    assert empty is not None
    detection = case.tracker.detection
    if empty.spots > CROWDED * detection.max_spots:
        newer = "a newer dark map (dark_map_age)" if detection.dark_map else "a dark map"
        raise Refused(
            f"spots and covariance need fewer hot pixels: they make {empty.spots:.0f} spots in a "
            f"frame, of which the tracker keeps {detection.max_spots} "
            f"(tracker.detection.max_spots); choose the fidelity window or frame, or give the "
            f"tracker {newer}"
        )
    if pattern.marked > MARKED:
        raise Refused(
            f"spots and covariance need a dark map that marks at most {MARKED:.1%} of the pixels "
            f"as hot, got {pattern.marked:.2%}; choose the fidelity window or frame"
        )


class FluxLimits(NamedTuple):
    """The stars of a plan.

    faintest, brightest  electrons, range in which stars are measured
    found                (n,) indices of the stars in the sky, in the order of their last coordinate
    """

    faintest: float
    brightest: float
    found: Ints


def limits_of(case: Case) -> FluxLimits:
    """The stars that can be detected."""
    case = with_uniform_dark(case)
    instrument = case.instrument
    detector = instrument.detector
    stars, flux = open_sky(case.catalog).stars, electrons_of(case)
    background = sky_electrons(case) + detector.dark_rate * detector.exposure
    rounding = detector.electrons_per_dn / math.sqrt(12)
    shot = math.sqrt(detector.excess_noise * background)
    noise = math.hypot(shot, detector.noise, rounding)
    detection = detection_plan(case)
    noise *= float(np.linalg.norm(detection.kernel.whole.astype(float)))
    threshold = detection.threshold(detector.columns * detector.rows)
    shapes = [psf_of(instrument)]
    if instrument.optics.tabulated:
        images = field_psf_of(instrument)
        unique, _, _ = unique_places(case, zones_of(case).middles)
        shapes += [images.image(*place)[0] for place in unique]
    peak = max(float(star_profile(zone, detection.kernel)[0]) for zone in shapes)
    faintest = max(threshold - FAINTEST, LEAST) * noise / peak
    # At least one star, so that arrays are not empty.
    detectable = np.flatnonzero(flux >= min(faintest, flux.max()))
    detectable = detectable[np.argsort(stars.direction[detectable, 2])]
    return FluxLimits(faintest, float(flux[detectable].max(initial=faintest)), detectable)


@kept(8)
def plan_spots(case: Case) -> SpotPlan:
    """Measure the stars of a case; cached for the last 8 cases."""
    return plan_within(case, limits_of(case))


def plan_within(case: Case, limits: FluxLimits) -> SpotPlan:
    """`plan_spots` with given stars, so that the plans of several cases have the same shape."""
    even, settings = with_uniform_dark(case), case.tracker.detection
    instrument = even.instrument
    detector, camera = instrument.detector, instrument.camera
    stars, flux, sky = open_sky(case.catalog).stars, electrons_of(even), sky_electrons(even)
    faintest, brightest, detectable = limits
    believed, knowledge = open_sky(case.believed_catalog).stars, knowledge_of(case)
    there, is_known = believed.find(stars.identifier[detectable])
    empty = empty_frame(case, sky)
    grid = ResponseGrid(even, sky, search=empty and (empty.noise, empty.threshold_sigma))
    measure = response_of_zones if instrument.optics.tabulated else response_of
    false = false_alarms(detection_plan(even), detector.columns, detector.rows)
    response, pull = measure(grid, faintest, brightest), companion_shift(grid, TYPICAL * faintest)
    colour, zone, stretch = _colours(case, stars.colour[detectable], believed.colour[there])
    field = SpotField(
        direction=np.ascontiguousarray(stars.direction[detectable]),
        believed=np.ascontiguousarray(believed.direction[there]),
        known=is_known,
        flux=np.log(flux[detectable]),
        number=detectable.astype(np.uint64),
        systematic=knowledge.systematic[there],
        hot=knowledge.hot[there],
        colour=colour,
        zone=zone,
        stretch=stretch,
    )
    return SpotPlan(
        response=response,
        pull=pull,
        field=field,
        companions=_companions(case, flux, detectable),
        view=view_of(camera, peak_border(settings)),
        gate=case.tracker.attitude.gate,
        false=false + (empty.spots if empty else 0.0),
        through=through_of(case),
        hot=hot_windows(grid, case, fluxes_between(faintest, brightest))[0],
    )


def view_of(camera: Camera, border: int) -> SpotView:
    """A camera for the kernels."""
    x, y = camera.centre
    return SpotView(
        *(camera.columns, camera.rows, camera.focal_length_px, x, y),
        *(camera.k1, camera.k2, camera.p1, camera.p2, camera.k3),
        *(border, math.cos(camera.half_diagonal)),
    )


def through_of(case: Case) -> Through:
    """Effect of a lens table and of a unit's residual on stars over the frame."""
    camera, table, slack = case.instrument.camera, np.zeros((1, STEPS + 1, STEPS + 1, 3)), 0.0
    across = down = 1
    if case.instrument.optics.tabulated:
        zones, table = zones_of(case), _shifts(case)
        across, down = len(zones.x), len(zones.y)
    elif camera.residual is None:
        return NO_LENS
    step_x, step_y = camera.columns / STEPS, camera.rows / STEPS
    if camera.residual is not None:
        step = np.arange(STEPS + 1, dtype=float)
        place = np.stack(np.meshgrid(step * step_x - 0.5, step * step_y - 0.5), axis=-1)
        moved = camera.residual(place.reshape(-1, 2))
        table[..., :2] += moved.reshape(STEPS + 1, STEPS + 1, 2)
        slack = float((moved**2).mean())
    wide, high = camera.columns / across, camera.rows / down
    return Through(
        table=table,
        step_x=step_x,
        step_y=step_y,
        wide=wide,
        high=high,
        across=across,
        down=down,
        slack=slack,
    )


def _colours(case: Case, true: Floats, believed: Floats) -> tuple[Ints, Ints, Floats]:
    """`colour`, `zone` and `stretch` of a `SpotField`, for stars of colours BP - RP."""
    none = np.zeros(len(true), np.int64)
    if not case.instrument.optics.tabulated:
        return none, none, np.zeros(len(true))
    zones, colour = zones_of(case), mean_colour(case, true)
    nodes = _colour_nodes(case)
    nearest = np.rint((colour - nodes[0]) / (nodes[1] - nodes[0]))
    return (
        np.clip(nearest, 0, COLOURS - 1).astype(np.int64),
        zones.colour_class(colour) * len(zones.x) * len(zones.y),
        focal_stretch(case, mean_colour(case.as_designed, believed)),
    )


def _colour_nodes(case: Case) -> Floats:
    """Colours of `Through`: from the bluest to the reddest light of the computed images."""
    return np.linspace(*colour_range(case.instrument), COLOURS)


def _shifts(case: Case) -> Floats:
    """`Through.table` of a lens table: `centroid_shift` in small steps.

    Linear interpolation between the nodes has an error of 0.001 pixel for a shift of 0.1 pixel.
    """
    camera, shift = case.instrument.camera, centroid_shift(case)
    x = np.linspace(-0.5, camera.columns - 0.5, STEPS + 1)
    y = np.linspace(-0.5, camera.rows - 0.5, STEPS + 1)
    colour, down, across = np.meshgrid(_colour_nodes(case), y, x, indexing="ij")
    table = shift.at(across.ravel(), down.ravel(), colour.ravel())
    table[:, 2] = np.log(np.maximum(table[:, 2], 1e-6))
    return table.reshape(*colour.shape, 3)


def _companions(case: Case, flux: Floats, detectable: Ints) -> Companions:
    """The neighbours of each detectable star, without much fainter ones."""
    stars, row = open_sky(case.catalog).stars, np.full(len(flux), -1)
    row[detectable] = np.arange(len(detectable))
    radius = (COMPANION_RADIUS + 1) / case.instrument.camera.focal_length_px
    faintest = float(stars.magnitude_g[detectable].max())
    star, other = near_pairs(case.catalog, radius, faintest)
    kept = (row[star] >= 0) & (flux[other] > flux[star] * math.exp(COMPANION_RATIOS[0]))
    star, other = star[kept], other[kept]
    order = np.argsort(row[star], kind="stable")
    other, count = other[order], np.bincount(row[star], minlength=len(detectable))
    start = np.concatenate([[0], np.cumsum(count)])
    return Companions(start, stars.direction[other].reshape(-1, 3), np.log(flux[other]))


def require_fidelity(case: Case, fidelity: Fidelity) -> None:
    """Refuse a fidelity that cannot run every trial of a case.

    Raises  Refused with the effect that the fidelity cannot compute.
    """
    if fidelity is Fidelity.WINDOW:
        require_independent_pixels(case.instrument.detector)
        require_window(case)
    elif fidelity is not Fidelity.FRAME:
        refuse(case)
        if fidelity is Fidelity.COVARIANCE:
            require_least_squares(case)
