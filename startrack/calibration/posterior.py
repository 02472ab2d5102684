"""Identified spots of one camera -> samples of its camera model (emcee)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude import UNKNOWNS, Calibration, calibrate, camera_vector, matched_pixels
from startrack.calibration.psf_width import width_likelihood
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Floats,
    Parameters,
    Refused,
    parameter,
    printed,
)
from startrack.optimise import Chains, Ensembles, Ledger, draw, median_and_interval

LOGARITHMS = ("floor", "psf_sigma")  # sampled as their logarithms
ROUNDS = 2  # of Gauss-Newton on the attitudes; chosen by hand: they start at solved attitudes
# Standard deviation over that of the prior, from which a column is unconstrained. Chosen by hand: a
# smaller one reports weakly constrained columns too.
UNCONSTRAINED = 0.9
# Chosen by hand: split R-hat needs starts wider than the posterior; still wider starts need a
# longer burn-in.
START_SPREAD = 3.0  # standard errors of the least squares
FLOOR_SPREAD = 0.2  # of the logarithm of the floor


class Prior(Parameters):
    """Prior of a camera: normal about its values; 0 fixes a value.

    The logarithms of floor and width have uniform priors.
    """

    focal_length: float = parameter("relative", limit=POSITIVE, default=0.05)
    principal: float = parameter("pixel, along each axis", limit=NON_NEGATIVE, default=20.0)
    k1: float = parameter(limit=NON_NEGATIVE, default=0.1)
    floor_low: float = parameter(
        "pixel, of the systematic error of centroids; both bounds equal fix it",
        limit=POSITIVE,
        default=1e-3,
    )
    floor_high: float = parameter("pixel, likewise", limit=FINITE, default=0.3)
    width_low: float = parameter("pixel, of the sigma of the PSF", limit=POSITIVE, default=0.2)
    width_high: float = parameter("pixel, likewise", limit=FINITE, default=4.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.floor_high >= self.floor_low and self.width_high > self.width_low):
            raise Refused("floor_high and width_high must not lie below their lows")


@printed
@dataclass(frozen=True, eq=False)
class CameraPosterior:
    """Samples of a camera.

    names          of the columns: fields of Camera, "floor" and "psf_sigma" in pixel
    chains         of these columns; "floor" and "psf_sigma" as natural logarithms
    correlation    (d, d) between the columns
    unconstrained  columns that the frames hardly constrain: at least 0.9 as wide as their prior
    """

    names: tuple[str, ...]
    chains: Chains
    correlation: Floats
    unconstrained: tuple[str, ...]

    @property
    def samples(self) -> Floats:
        """(n, d) samples; "floor" and "psf_sigma" in pixel."""
        logarithm, values = [name in LOGARITHMS for name in self.names], self.chains.flat
        return np.where(logarithm, np.exp(np.where(logarithm, values, 0)), values)

    def interval(self, name: str, fraction: float = 0.95) -> tuple[float, float, float]:
        """Median and the ends of the middle fraction of one column."""
        return median_and_interval(self.samples[:, self.names.index(name)], fraction)


def sample_camera(
    spots: Sequence[core.Spots],
    matches: Sequence[core.Matches],
    camera: core.Camera,
    prior: Prior,
    seed: int,
    settings: Ensembles | None = None,
    ledger: Ledger | None = None,
    images: Sequence[core.Frame] | None = None,
) -> CameraPosterior:
    """Sample focal length, principal point, k1 and centroid floor, marginalised over attitudes.

    With images, the width of the PSF is sampled too, from the pixels of the stars.

        ln L = -1/2 sum_frames (r^T W r + ln |W^-1| + ln |A^T W A|),   r the residuals at the best
        attitude of each frame, W^-1 = covariance + floor^2, A = d pixel / d attitude

    which is Laplace's approximation of the integral over each attitude with a uniform prior. It is
    exact where pixel positions are linear over the uncertainty of the attitude.

    spots    of each frame
    matches  of each frame; those with fewer than 4 stars are left out
    camera   centre of the prior
    images   of the frames, in the same order; None for no width
    Raises    ValueError if no frame has 4 matched stars.
    Accuracy  model: normal errors of centroids, no false match; a narrow frame constrains the
              principal point only through the curvature of the tangent plane, see
              `unconstrained`.
    """
    chosen = [pair for pair in zip(spots, matches, strict=True) if len(pair[1]) >= 4]
    if not chosen:
        raise Refused("matches must hold a frame of 4 stars or more, got none")
    width = None
    if images is not None:
        width = width_likelihood(images, spots, prior.width_low, prior.width_high)
    law = _PosteriorLaw([_frame(*pair) for pair in chosen], camera, prior, width)
    middle, spread = _least_squares(law, *zip(*chosen, strict=True))

    def start(rng: np.random.Generator, n: int) -> Floats:
        around = middle + START_SPREAD * spread * rng.standard_normal((n, len(middle)))
        return np.clip(around, law.low, law.high)

    chains = draw(law, start, seed, settings, ledger)
    wide = chains.flat.std(axis=0) > UNCONSTRAINED * law.before
    unconstrained = tuple(np.array(law.names)[wide].tolist())
    return CameraPosterior(
        law.names, chains, np.atleast_2d(np.corrcoef(chains.flat.T)), unconstrained
    )


class _PosteriorLaw:
    """The logarithm of the posterior, with the prior in the same columns."""

    def __init__(
        self,
        frames: list[tuple[Floats, Floats, Floats]],
        camera: core.Camera,
        prior: Prior,
        width: Callable[[Floats], Floats] | None,
    ) -> None:
        sigma = np.array(
            [
                prior.focal_length * camera.focal_length_px,
                prior.principal,
                prior.principal,
                prior.k1,
            ]
        )
        self.free = np.flatnonzero(sigma > 0)
        self.middle = camera_vector(camera)
        even = {"floor": (prior.floor_low, prior.floor_high)}
        if width:
            even["psf_sigma"] = (prior.width_low, prior.width_high)
        self.even = {name: np.log(pair) for name, pair in even.items() if pair[0] < pair[1]}
        self.names = (*(UNKNOWNS[i] for i in self.free), *self.even)
        bounds = np.reshape([*self.even.values()], (-1, 2)).T
        open_end = np.full(len(self.free), np.inf)
        self.low = np.concatenate([-open_end, bounds[0]])
        self.high = np.concatenate([open_end, bounds[1]])
        self.sigma = sigma[self.free]
        self.before = np.concatenate([self.sigma, np.ptp(bounds, axis=0) / math.sqrt(12)])
        self.fixed_floor = prior.floor_low
        self.likely_floor = math.sqrt(prior.floor_low * prior.floor_high)
        self.frames, self.camera, self.width = frames, camera, width

    def __call__(self, points: Floats) -> Floats:
        """Log-probability (w,) at points (w, d)."""
        count = len(self.free)
        values = np.tile(self.middle, (len(points), 1))
        values[:, self.free] = points[:, :count]
        inside = ((points >= self.low) & (points <= self.high)).all(axis=1) & (values[:, 0] > 0)
        values[:, 0] = np.maximum(values[:, 0], 1.0)
        clipped = np.clip(points, self.low, self.high)[:, count:].T
        log = dict(zip(self.even, clipped, strict=True))
        floor = np.exp(log["floor"]) if "floor" in log else np.full(len(points), self.fixed_floor)
        off = (points[:, :count] - self.middle[self.free]) / self.sigma
        score = -0.5 * (off**2).sum(axis=1)
        for pixel, covariance, seen in self.frames:
            score += _log_likelihood(pixel, covariance, seen, self.camera, values, floor)
        if self.width:
            score += self.width(log["psf_sigma"])
        return np.where(inside & np.isfinite(score), score, -np.inf)


def _frame(spots: core.Spots, matches: core.Matches) -> tuple[Floats, Floats, Floats]:
    """Pixels (n, 2), their covariance, and star directions by the first attitude (n, 3)."""
    assert matches.icrs_to_camera is not None
    return *matched_pixels(spots, matches), matches.icrs_to_camera.apply(matches.direction)


def _least_squares(
    law: _PosteriorLaw, spots: Sequence[core.Spots], matches: Sequence[core.Matches]
) -> tuple[Floats, Floats]:
    """Least-squares estimate and its standard errors, in the columns of the posterior."""
    tight = dict(zip(UNKNOWNS, np.zeros(len(UNKNOWNS)), strict=True))
    tight |= dict(zip(law.names, law.sigma, strict=False))
    relative = tight["focal_length_px"] / law.camera.focal_length_px
    prior = Calibration(relative, tight["principal_x"], tight["k1"], floor=law.likely_floor)
    fitted = calibrate(spots, matches, law.camera, prior)
    middle = list(camera_vector(fitted.camera)[law.free])
    spread = list(np.sqrt(fitted.covariance.diagonal()[law.free]))
    if "floor" in law.even:
        middle.append(math.log(fitted.residual_rms + 1e-9))
        spread.append(FLOOR_SPREAD)
    if law.width:
        low, high = law.even["psf_sigma"]
        grid = np.linspace(low, high, 4001)
        fraction = np.exp(law.width(grid) - law.width(grid).max())
        middle.append(float(np.average(grid, weights=fraction)))
        variance = float(np.average((grid - middle[-1]) ** 2, weights=fraction))
        spread.append(math.sqrt(variance) + 1e-6)
    return np.array(middle), np.array(spread)


def project(direction: Floats, values: Floats, camera: core.Camera) -> Floats:
    """Pixels of directions for many cameras at once; as Camera.project for each.

    direction  (w, n, 3) in camera axes
    values     (w, 8) of UNKNOWNS
    Returns    (w, n, 2) pixel
    """
    f, cx, cy, k1, k2, p1, p2, k3 = (column[:, None] for column in values.T)
    x, y = direction[..., 0] / direction[..., 2], direction[..., 1] / direction[..., 2]
    u, v = core.distort.py_func(x, y, k1, k2, p1, p2, k3)
    middle_x, middle_y = (camera.columns - 1) / 2, (camera.rows - 1) / 2
    return np.stack([f * u + cx + middle_x, f * v + cy + middle_y], axis=-1)


def _log_likelihood(
    pixel: Floats,
    covariance: Floats,
    seen: Floats,
    camera: core.Camera,
    values: Floats,
    floor: Floats,
) -> Floats:
    """Log-likelihood (w,) of one frame for w cameras, marginalised over its attitude."""
    square = floor[:, None] ** 2
    # Cholesky's root of each star's covariance, whose inverse whitens its residuals.
    first = np.sqrt(covariance[:, 0, 0] + square)
    across = covariance[:, 0, 1] / first
    second = np.sqrt(covariance[:, 1, 1] + square - across**2)
    turn = np.zeros((len(values), 3))
    for _ in range(ROUNDS):
        residual, slope = _linear(pixel, seen, camera, values, turn)
        white = np.concatenate([slope, residual[..., None]], axis=-1)
        white[..., 0, :] /= first[..., None]
        white[..., 1, :] -= across[..., None] * white[..., 0, :]
        white[..., 1, :] /= second[..., None]
        white = white.reshape(len(values), -1, 4)
        products = white.swapaxes(1, 2) @ white
        normal, right = products[:, :3, :3], products[:, :3, 3]
        step = np.linalg.solve(normal, right[..., None])[..., 0]
        turn = turn + step
    left = products[:, 3, 3] - (right * step).sum(axis=1)  # r^T W r after the last, linear step
    width = 2 * np.log(first * second).sum(axis=1) + np.linalg.slogdet(normal)[1]
    return -0.5 * (left + width)


def _linear(
    pixel: Floats, seen: Floats, camera: core.Camera, values: Floats, turn: Floats
) -> tuple[Floats, Floats]:
    """Residuals (w, n, 2) after small rotations, and their derivatives (w, n, 2, 3)."""
    direction = seen @ Rotation.from_rotvec(turn).as_matrix().swapaxes(1, 2)
    residual = pixel - project(direction, values, camera)
    x, y = direction[..., 0] / direction[..., 2], direction[..., 1] / direction[..., 2]
    f = values[:, 0, None]
    slope = np.empty((*x.shape, 2, 3))
    # Without distortion: Gauss-Newton needs the derivatives to about 1 %.
    slope[..., 0, :] = np.stack([-f * x * y, f * (1 + x * x), -f * y], axis=-1)
    slope[..., 1, :] = np.stack([-f * (1 + y * y), f * x * y, f * x], axis=-1)
    return residual, slope
