"""Spots of an unknown camera -> matches and field of view, then the distortion of its lens."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    FieldPolynomial,
    Floats,
    Matches,
    Refused,
    Spots,
    Stars,
    deg,
    within,
)
from startrack.identification.identify import identify, refined
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.identification.seen import usable

# Radian across the columns. A larger range takes more tries; the pinhole of a field of 2.5 radian
# has its corners 77 degrees off the axis.
NARROWEST, WIDEST = 1.5 * deg, 90 * deg
# Relative, of the focal length in each try. Chosen by hand: a larger one needs fewer tries, but the
# search for triangles becomes slower and less certain, more so off the axis of a wide field.
TOLERANCE, TOLERANCE_WIDE, WIDE = 0.1, 0.05, 30 * deg
FISHEYE = 45 * deg  # wider fields are tried with a fisheye's image, too
USUAL = 12 * deg  # field that is tried first
WIDEST_PINHOLE = 2.5  # radian


def fields(
    narrowest: float = NARROWEST, widest: float = WIDEST, first: float = USUAL
) -> list[float]:
    """Fields of view to try, radian, whose tolerances leave no gap.

    The tolerances are those of the focal length, by which the tangent of half a field goes.

    narrowest, widest  radian
    first              radian; the nearest to it come first
    Raises             ValueError where these lie outside [0.001, 2.5] or are not in order.
    """
    within(1e-3, WIDEST_PINHOLE, narrowest=narrowest, widest=widest)
    if narrowest > widest:
        raise Refused(f"narrowest must not be above widest, got {narrowest} and {widest}")
    steps = [narrowest]
    reach = math.tan(narrowest / 2) * (1 + tolerance(narrowest))
    while reach < math.tan(widest / 2):
        here = 2 * math.atan(reach / (1 - TOLERANCE))
        if here >= WIDE:
            here = 2 * math.atan(reach / (1 - TOLERANCE_WIDE))
        steps.append(min(here, widest))
        reach = math.tan(steps[-1] / 2) * (1 + tolerance(steps[-1]))
    return sorted(steps, key=lambda field: abs(math.log(field / first)))


def tolerance(field: float) -> float:
    """Relative, of the focal length in the try of a field (radian)."""
    return TOLERANCE if field < WIDE else TOLERANCE_WIDE


def cameras(
    columns: int, rows: int, first: float | None = None, fisheyes: bool = True
) -> list[tuple[Camera, float]]:
    """Cameras to try and the tolerance of each: pinholes of all fields, then wide fisheyes.

    first  radian, field that is tried first; None: 12 degrees
    """
    tried = fields(first=first or USUAL)
    pinholes = [(Camera.from_field_of_view(columns, rows, field), field) for field in tried]
    wide = [(fisheye(columns, rows, field), field) for field in tried if field >= FISHEYE]
    return [(camera, tolerance(field)) for camera, field in pinholes + (wide if fisheyes else [])]


def cameras_of(
    columns: int, rows: int, field: float, tolerance: float
) -> list[tuple[Camera, float]]:
    """The cameras of a field of view (radian) alone: a pinhole and, if it is wide, a fisheye."""
    made = [Camera.from_field_of_view(columns, rows, field)] if field <= WIDEST_PINHOLE else []
    made += [fisheye(columns, rows, field)] if FISHEYE <= field <= WIDEST else []
    return [(camera, tolerance) for camera in made]


def fisheye(columns: int, rows: int, fov_x: float) -> Camera:
    """A camera whose images lie from its axis as the angle, not as its tangent (equidistant).

    fov_x     radian, edge to edge
    Accuracy  model: OpenCV's radial distortion up to the corners, within 0.03, 0.15, 1.2 and 8 of
              1024 pixels for 50, 60, 75 and 90 degrees.
    """
    focal = columns / fov_x
    corner = min(math.hypot(columns, rows) / 2 / focal, 1.2)
    angle = np.linspace(corner / 100, corner, 100)
    x = np.tan(angle)
    terms = np.linalg.lstsq(np.column_stack([x**3, x**5, x**7]), angle - x, rcond=None)[0]
    k1, k2, k3 = terms.tolist()
    return Camera(columns, rows, focal, k1=k1, k2=k2, k3=k3)


def identify_blind(
    spots: Spots,
    columns: int,
    rows: int,
    stars: Stars,
    index_of: Callable[[Camera], PatternIndex],
    settings: Identification,
    tries: Sequence[tuple[Camera, float]] | None = None,
) -> Matches:
    """Try one camera after the other until one is solved: fields from 1.5 to 90 degrees.

    `settings.max_false_probability` is divided by the number of tries, so that it bounds all
    together.

    columns, rows  pixel
    index_of       the index of the stars for a camera, best `PatternIndexes`: thirty are needed
    settings       its focal tolerance is replaced by that of each try
    tries          cameras with their tolerances; None: `cameras`
    Returns        as `identify`; where none is solved, that which chance explains the least
    """
    tries = cameras(columns, rows) if tries is None else tries
    chance = settings.max_false_probability / len(tries)
    best: Matches | None = None
    for camera, focal in tries:
        one_try = replace(settings, focal_tolerance=focal, max_false_probability=chance)
        matches = identify(spots, camera, stars, index_of(camera), one_try)
        if matches.icrs_to_camera is not None:
            return matches
        if best is None or matches.false_probability < best.false_probability:
            best = matches
    assert best is not None
    return best


# What may be estimated with the attitude, with the standard deviation of its prior: relative focal
# length, principal point over the width of the image, radial distortion, and what makes the grid of
# pixels neither square nor rectangular: resampling, a rolling shutter.
PRIORS = {
    "focal": 0.2, "k1": 0.5, "x": 0.03, "y": 0.03, "k2": 0.5, "oblong": 0.05, "shear": 0.05,
}  # fmt: skip
NAMES = tuple(PRIORS)
# The same where the stars show none: what is left out counts in the covariance with these.
UNSEEN = PRIORS | {"k2": 0.2, "oblong": 0.002, "shear": 0.002}
STAGES = (("focal",), ("focal", "k1"), ("focal", "k1", "x", "y"), ("focal", "k1", "x", "y", "k2"))
GRID = ("oblong", "shear")  # the last stage, with those before that were kept
# Match radius of the rounds of a stage: a lens that is not known yet is off by more than a spot.
RADII = (4.0, 2.0, 1.0)
# Chosen by hand.
SIGNIFICANT = 10.0  # of Fisher's F: a stage is kept above; a smaller one fits noise
LEAST_FREE = 8  # coordinates beyond the unknowns, below which a stage is not tried
FLOOR = 0.05  # pixel, of a centroid: no lens is known better
# Pixel, of the axis through the centre of the image: what this model leaves of a lens. That of the
# 25 photographs of `fit_lens` is tilted, which the model does not know.
AXIS = 0.1
OUTLIER = 2.0  # sigma, beyond which a residual counts less (soft L1)
STEP = 1e-5  # of priors and radian, for derivatives
ROUNDS = 8  # of matching and fitting in a stage, unless the matches stay the same before


class LensFit(NamedTuple):
    """An image with the distortion of its lens.

    matches            with the camera that was found and its attitude
    icrs_to_image      the attitude of the axis through the centre of the image, turned from that of
                       the camera, whose axis goes through the principal point, by the shortest way
    covariance         (3, 3) radian^2, of the small rotation about these axes; the unknowns of the
                       camera are counted, those that the stars do not show by their priors
    residual_rms       pixel, root mean square over both axes of all matches
    """

    matches: Matches
    icrs_to_image: Rotation
    covariance: Floats
    residual_rms: float


def fit_lens(
    spots: Spots, matches: Matches, stars: Stars, index: PatternIndex, settings: Identification
) -> LensFit:
    """Estimate what the matches show of the lens, and match more stars with it, in turns.

    Radial distortion, principal point, a second radial term, and a grid of pixels that is oblong
    and sheared are added one after the other, each if it is significant with those before. One
    image determines a principal point where its field is wide (20 pixels, at 50 degrees and 40
    stars, to 1 pixel).

    spots, matches  as of `identify`, solved
    stars, index    as of `identify`
    settings        its `match_radius` holds for the fitted lens
    Raises          ValueError where the matches are not solved.
    Accuracy        model: OpenCV's radial distortion of second order about the principal point.
                    The boresights of 25 photographs of 50 degrees lie within 0.2 arcmin in the
                    median, and 2 at most, of those with a camera fitted to all of them.
    """
    if matches.icrs_to_camera is None:
        raise Refused(f"matches must be solved, got {matches.status}: {matches.reason}")
    best = _Fit(spots, matches, STAGES[0])
    for stage in (*STAGES[1:], GRID):
        free = best.free + GRID if stage is GRID else stage
        if 2 * len(best.matches) - 3 - len(free) < LEAST_FREE:
            continue
        better = _rematched(spots, best, free, stars, index, settings)
        if better.significant(best.free):
            best = better
    return best.lens()


def _rematched(
    spots: Spots,
    start: _Fit,
    free: tuple[str, ...],
    stars: Stars,
    index: PatternIndex,
    settings: Identification,
) -> _Fit:
    """The fit with more unknowns, after the matches have stayed the same."""
    fit = _Fit(spots, start.matches, free)
    log_p = math.log(max(start.matches.false_probability, 1e-300))
    for turn in range(ROUNDS):
        wider = RADII[min(turn, len(RADII) - 1)]
        held = replace(settings, focal_tolerance=0.0, match_radius=settings.match_radius * wider)
        assert fit.matches.icrs_to_camera is not None
        again = refined(
            spots, usable(spots), fit.matches.camera, stars, index, held,
            fit.matches.icrs_to_camera.as_matrix(), 1.0, log_p,
        )  # fmt: skip
        if again.icrs_to_camera is None or len(again) < LEAST_FREE // 2 + len(free):
            break
        same = np.array_equal(again.star, fit.matches.star)
        fit = _Fit(spots, again, free)
        if same and wider == RADII[-1]:
            break
    return fit


class _Fit:
    """Robust least squares of attitude and camera for given matches.

    free   names of what is estimated of the camera; the rest stays at its start
    """

    def __init__(self, spots: Spots, matches: Matches, free: tuple[str, ...]) -> None:
        from scipy.optimize import least_squares  # which a tracker's trial does without

        assert matches.icrs_to_camera is not None
        self.free, self.start, self.camera = free, matches.icrs_to_camera, matches.camera
        self.direction = matches.direction
        self.place = np.column_stack([spots.x, spots.y])[matches.spot]
        covariance = spots.covariance[matches.spot]
        noise = (covariance[:, 0, 0] + covariance[:, 1, 1]) / 2
        self.noise = np.where(np.isfinite(noise), noise, 1.0) + FLOOR**2
        self.excess = 0.0
        self.unknown = np.zeros(3 + len(free))
        for _ in range(2):  # the second time with the weights of the residuals of the first
            self.found: Any = least_squares(self._weighted, self.unknown, x_scale="jac")
            self.unknown = self.found.x
            self.excess = self._excess()
        camera, rotation = self._at(self.free, self.unknown)
        self.matches = replace(matches, camera=camera, icrs_to_camera=rotation)

    def _at(self, free: tuple[str, ...], unknown: Floats) -> tuple[Camera, Rotation]:
        camera, step = self.camera, dict(zip(free, unknown[3:].tolist(), strict=True))
        width = camera.columns
        if any(step.get(name) for name in GRID):
            oblong, shear = self._grid()
            oblong, shear = oblong + step.get("oblong", 0.0), shear + step.get("shear", 0.0)
            grid = FieldPolynomial((0.0, oblong / 2, shear), (0.0, 0.0, -oblong / 2))
            camera = replace(camera, polynomial=grid)
        camera = replace(
            camera,
            focal_length_px=camera.focal_length_px * math.exp(step.get("focal", 0.0)),
            principal_x=camera.principal_x + step.get("x", 0.0) * width,
            principal_y=camera.principal_y + step.get("y", 0.0) * width,
            k1=camera.k1 + step.get("k1", 0.0),
            k2=camera.k2 + step.get("k2", 0.0),
        )
        return camera, Rotation.from_rotvec(unknown[:3]) * self.start

    def _grid(self) -> tuple[float, float]:
        """By how much the pixels of the camera to start from are oblong and sheared."""
        polynomial = self.camera.polynomial
        return (2 * polynomial.x[1], polynomial.x[2]) if polynomial else (0.0, 0.0)

    def _residual(self, free: tuple[str, ...], unknown: Floats) -> Floats:
        """Pixel (n, 2), spots minus stars; of a star behind the camera far outside."""
        camera, rotation = self._at(free, unknown)
        pixel = camera.project(rotation.apply(self.direction))
        return np.nan_to_num(self.place - pixel, nan=1e6, posinf=1e6, neginf=-1e6)

    def _weighted(self, unknown: Floats) -> Floats:
        """Residuals in sigma, large ones as their soft L1, and those of the priors."""
        rows = self._residual(self.free, unknown)
        rows /= np.sqrt(self.noise + self.excess)[:, None]
        robust = np.sqrt(2 * OUTLIER**2 * (np.sqrt(1 + (rows / OUTLIER) ** 2) - 1))
        rows = np.copysign(robust, rows)
        steps = zip(self.free, unknown[3:].tolist(), strict=True)
        prior = [(self._offset(name) + step) / PRIORS[name] for name, step in steps]
        return np.concatenate([rows.ravel(), prior])

    def _offset(self, name: str) -> float:
        """Of the camera to start from, from the mean of the prior."""
        camera, (oblong, shear) = self.camera, self._grid()
        start = {
            "focal": 0.0,
            "x": camera.principal_x / camera.columns,
            "y": camera.principal_y / camera.columns,
            "k1": camera.k1,
            "k2": camera.k2,
            "oblong": oblong,
            "shear": shear,
        }
        return start[name]

    def _excess(self) -> float:
        """Variance of the residuals per axis beyond the noise; see `agree`."""
        square = (self._residual(self.free, self.unknown) ** 2).sum(axis=1)
        left = max(2 * len(square) - len(self.unknown), 1) / (2 * len(square))
        typical = float(np.median(square)) / (2 * math.log(2) * left)
        return max(typical - float(np.median(self.noise)), 0.0)

    def significant(self, before: tuple[str, ...]) -> bool:
        """Whether the unknowns that were not free before are significantly different from zero."""
        added = [3 + self.free.index(name) for name in self.free if name not in before]
        jacobian = self.found.jac
        covariance = np.linalg.pinv(jacobian.T @ jacobian)
        offset = np.array([self._offset(self.free[k - 3]) + self.unknown[k] for k in added])
        chi_square = float(offset @ np.linalg.solve(covariance[np.ix_(added, added)], offset))
        return chi_square / len(added) > SIGNIFICANT * self._chi_square()

    def _chi_square(self) -> float:
        """Per degree of freedom; at least 1."""
        freedom = 2 * len(self.place) - len(self.unknown)
        return max(1.0, 2 * float(self.found.cost) / freedom) if freedom > 0 else 1.0

    def lens(self) -> LensFit:
        """The result, its covariance from the derivatives of all that may be unknown."""
        unknown = np.zeros(3 + len(NAMES))
        unknown[:3] = self.unknown[:3]
        for name, value in zip(self.free, self.unknown[3:], strict=True):
            unknown[3 + NAMES.index(name)] = value
        prior = [(PRIORS if name in self.free else UNSEEN)[name] for name in NAMES]
        steps = np.concatenate([np.full(3, STEP), STEP * np.asarray(prior)])
        centre, residual = _to_image(*self._at(NAMES, unknown)), self._residual(NAMES, unknown)
        slopes, rows = np.empty((residual.size, len(unknown))), np.empty((3, len(unknown)))
        for k, step in enumerate(steps):
            moved = unknown + step * np.eye(len(unknown))[k]
            slopes[:, k] = (self._residual(NAMES, moved) - residual).ravel() / step
            turned = _to_image(*self._at(NAMES, moved)) * centre.inv()
            rows[:, k] = turned.as_rotvec() / step
        sigma = np.repeat(np.sqrt(self.noise + self.excess), 2)
        weight = 1 / np.sqrt(1 + (residual.ravel() / sigma / OUTLIER) ** 2) / sigma**2
        information = slopes.T @ (slopes * weight[:, None])
        information[np.diag_indices(len(unknown))] += [0.0] * 3 + [p**-2 for p in prior]
        covariance = np.linalg.pinv(information) * self._chi_square() * self._few()
        rms = float(np.sqrt(np.mean(residual**2)))
        axis_covariance = rows @ covariance @ rows.T
        axis_covariance[[0, 1], [0, 1]] += (AXIS / self.camera.focal_length_px) ** 2
        return LensFit(self.matches, centre, axis_covariance, rms)

    def _few(self) -> float:
        """Variance of Student's distribution: few residuals do not tell their own scatter."""
        freedom = 2 * len(self.place) - len(self.unknown)
        return freedom / (freedom - 2) if freedom > 2 else 3.0


def _to_image(camera: Camera, icrs_to_camera: Rotation) -> Rotation:
    """The attitude of the axis through the centre of the image."""
    middle = np.array([[(camera.columns - 1) / 2, (camera.rows - 1) / 2]])
    x, y, z = camera.unproject(middle)[0]
    apart = math.hypot(x, y)
    turn = np.array([-y, x, 0.0]) * (math.atan2(apart, z) / apart if apart else 0.0)
    return Rotation.from_rotvec(turn).inv() * icrs_to_camera
