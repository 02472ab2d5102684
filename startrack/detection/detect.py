"""A Frame enters; Spots leave, brightest first: of the whole frame, or near given places."""

import math

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Frame, Ints, Psf, Refused, Spots, kernel, positive
from startrack.detection.connect import Peaks
from startrack.detection.find import find
from startrack.detection.gravity import FLUX, FLUX_SIGMA, XX, XY, YY, Sample, X, Y
from startrack.detection.parameters import Detection
from startrack.detection.pixels import Pixels
from startrack.detection.plan import DetectionPlan, calibrated, planned

SAME = 1.0  # pixel; peaks whose centroids are closer than that are one star


def centroid(frame: Frame, pixels: Pixels, candidates: Peaks, plan: DetectionPlan) -> Spots:
    """Measure every candidate, and drop those that diverge or lead to the same star.

    Returns  Spots, brightest first
    Raises   those of the files of the four centroids.
    """
    table = measured(sample(frame, pixels, candidates, plan.settings), plan)
    order = np.argsort(-table[:, FLUX], kind="stable")  # NaN goes last
    return Spots(*_kept(table, order, candidates.area, plan.settings.max_spots))


def places(
    frame: Frame, pixels: Pixels, candidates: Peaks, plan: DetectionPlan
) -> tuple[Floats, Floats]:
    """Centroids of every candidate, which must be different stars, in their order.

    Returns  (n, 2) pixel, (n, 2, 2) pixel^2 as stated; NaN where it diverges
    """
    table = measured(sample(frame, pixels, candidates, plan.settings), plan)
    table[np.isnan(table[:, FLUX])] = np.nan
    return table[:, [X, Y]], table[:, [XX, XY, XY, YY]].reshape(-1, 2, 2)


def sample(frame: Frame, pixels: Pixels, candidates: Peaks, settings: Detection) -> Sample:
    """Gather it from the frame, its pixels and the settings."""
    saturation = math.inf if settings.saturation is None else settings.saturation
    # Kernels are compiled anew for arrays of another layout.
    x, y = (np.ascontiguousarray(place) for place in (candidates.x, candidates.y))
    return Sample(
        pixels.value,
        pixels.marks,
        x,
        y,
        settings.window // 2,
        pixels.step / math.sqrt(12),
        frame.noise_gain,
        frame.offset - pixels.pivot,
        frame.read_noise / frame.electrons_per_dn,
        saturation - pixels.pivot,
    )


def measured(stars: Sample, plan: DetectionPlan, stated: bool = True) -> Floats:
    """One row per candidate, as `gravity` describes it.

    stated  whether the covariance and sigma of the flux are needed; else they may be missing
    """
    settings, method = plan.settings, plan.method
    measure = method.measure if stated or not method.place else method.place
    return measure(stars, plan.star, settings.kernel_sigma, settings.compensation)


@kernel
def _kept(table, order, area, most):  # type: ignore[no-untyped-def]
    """The columns of Spots, of the rows that `_apart` keeps."""
    chosen = order[_apart(table, order, most)]
    x, y, flux, snr = np.empty((4, len(chosen)))
    covariance = np.empty((len(chosen), 2, 2))
    for k in range(len(chosen)):
        row = table[chosen[k]]
        x[k], y[k], flux[k], snr[k] = row[X], row[Y], row[FLUX], row[FLUX] / row[FLUX_SIGMA]
        covariance[k, 0, 0], covariance[k, 1, 1] = row[XX], row[YY]
        covariance[k, 0, 1] = covariance[k, 1, 0] = row[XY]
    return x, y, flux, covariance, snr, area[chosen]


@kernel
def _apart(table: Floats, order: Ints, most: int) -> Ints:
    """Positions in `order` to keep: measured spots, one for each star, at most `most`."""
    kept = np.empty(min(len(order), most), np.int64)
    count = 0
    for k in range(len(order)):
        x, y, flux = table[order[k], X], table[order[k], Y], table[order[k], FLUX]
        if count == len(kept) or np.isnan(flux):
            break
        new = True
        for other in kept[:count]:
            dx, dy = table[order[other], X] - x, table[order[other], Y] - y
            if dx * dx + dy * dy < SAME * SAME:
                new = False
                break
        if new:
            kept[count] = k
            count += 1
    return kept[:count]


def detect(frame: Frame, settings: Detection | DetectionPlan, psf: Psf | None = None) -> Spots:
    """Find the stars of an image.

    The image is filtered for stars, compared with its local background and noise, and cut
    into connected components; peaks that look like stars are measured in small windows.

    frame     image of any real type; what is not finite is a dead pixel
    settings  thresholds and windows; or a plan made of settings and PSF by `plan_detection`, which
              saves time for many frames
    psf       of the design at rest, where the settings use it; None: a Gaussian of their
              kernel_sigma
    Returns   Spots, brightest first; none where there is none
    Raises    TypeError or ValueError where the image is not a two-dimensional array of real numbers
              with at least one finite value. Those of `centroid` for the accuracy.
    """
    plan = planned(settings, psf)
    image = calibrated(frame, plan)
    return centroid(frame, image, find(image, plan), plan)


MEDIAN_STRIDE = 7  # no divisor of a usual side, so that all columns count
LEAST_SIDE = 25  # pixel; fewer pixels would not tell their noise


def detect_near(
    frame: Frame, place: Floats, reach: float, settings: Detection | DetectionPlan
) -> Spots:
    """Find the stars near places where a tracker expects some.

    The windows are laid under one another as one narrow image, each less its own median, and
    that is searched as a frame is, each window on its own tile. The spots are measured on the
    frame itself, so that a star is the same wherever it was looked for.

    place     (m, 2) pixel (x, y); places outside the frame find nothing
    reach     pixel, by which a star may lie off its place along either axis
    settings  as `detect` takes them; the mesh is the window's side
    Returns   Spots, brightest first; one star for two places near it
    Raises    those of `detect`; ValueError where `place` is not (m, 2) or reach not positive.
    """
    positive(reach=reach)
    place = np.asarray(place, float)
    if place.ndim != 2 or place.shape[1] != 2:
        raise Refused(f"place must have the shape (m, 2), got {place.shape}")
    plan = planned(settings)
    image = calibrated(frame, plan)
    return centroid(frame, image, _near(image, place, reach, plan), plan)


def _near(image: Pixels, place: Floats, half_side: float, plan: DetectionPlan) -> Peaks:
    settings = plan.settings
    rows, columns = image.value.shape
    inside = (place > -0.5).all(axis=1) & (place < [columns - 0.5, rows - 0.5]).all(axis=1)
    centre = np.rint(place[inside]).astype(np.int64)
    # Room for the kernel, for the ring about a star at the edge of the reach, and for the noise.
    half = math.ceil(half_side) + max(plan.kernel.half, settings.window // 2 + 4)
    half = min(max(half, LEAST_SIDE // 2), (min(rows, columns) - 1) // 2)
    side = 2 * half + 1
    # A window at the border is moved inwards to be whole.
    corner = np.clip(centre - half, 0, [columns - side, rows - side])
    if not len(corner):
        nothing = np.empty(0, np.int64)
        return Peaks(nothing, nothing, nothing)
    dead = None if image.dead is None else _stacked(image.dead, corner, side)
    values = _stacked(image.value, corner, side).reshape(len(corner), -1)
    # So that windows far apart in the frame fit together; some of the pixels tell it.
    values = values - np.median(values[:, ::MEDIAN_STRIDE], axis=1)[:, None]
    stack = Pixels(values.reshape(-1, side), image.pivot, image.step, dead)
    candidates = find(stack, plan, mesh=side)
    window = candidates.y // side
    x, y = candidates.x + corner[window, 0], candidates.y - window * side + corner[window, 1]
    off = np.maximum(abs(x - place[inside][window, 0]), abs(y - place[inside][window, 1]))
    border = settings.window // 2 + settings.edge
    good = (off <= half_side + 1) & (np.minimum(x, columns - 1 - x) >= border)
    good &= np.minimum(y, rows - 1 - y) >= border
    return Peaks(x[good], y[good], candidates.area[good])


def _stacked(image: NDArray, corner: Ints, side: int) -> NDArray:
    """Windows under one another, (m side, side), by their first columns and rows, (m, 2)."""
    step = np.arange(side)
    row, column = corner[:, 1, None] + step, corner[:, 0, None] + step
    return image[row[:, :, None], column[:, None, :]].reshape(-1, side)
