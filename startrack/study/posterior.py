"""Identified spots of one camera enter; samples of what that camera may be leave (emcee)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.checks import positive
from startrack.study.ensemble import Chains, Ensembles, draw
from startrack.study.ledger import Ledger
from startrack.values import Matches, Spots

Floats = NDArray[np.float64]

CAMERA = ("focal_length_px", "principal_x", "principal_y", "k1", "k2", "p1", "p2", "k3")
ROUNDS = 3  # of Gauss-Newton on the attitudes
SPREAD = 0.1  # of the prior, from which the walkers start around the camera


@dataclass(frozen=True)
class Prior:
    """What is known of a camera before: a normal law about its values; 0 keeps one as it is.

    focal_length     1, relative
    principal        pixel, along each axis
    k1               1
    floor_low, high  pixel, between which the centroids' own error beside their noise lies, its
                     logarithm even; equal ones keep it
    """

    focal_length: float = 0.05
    principal: float = 20.0
    k1: float = 0.1
    floor_low: float = 1e-3
    floor_high: float = 0.3

    def __post_init__(self) -> None:
        positive(focal_length=self.focal_length, floor_low=self.floor_low)
        if not (self.principal >= 0 and self.k1 >= 0 and self.floor_high >= self.floor_low):
            raise ValueError(
                "principal and k1 must not be negative and floor_high not below floor_low"
            )


@dataclass(frozen=True, eq=False)
class CameraPosterior:
    """Samples of a camera.

    names        of the columns: fields of Camera, and "floor" in pixel
    chains       of the camera; "floor" as its natural logarithm
    correlation  (d, d) between the columns
    open         columns that the frames hardly tell: as wide as nine tenths of their prior
    """

    names: tuple[str, ...]
    chains: Chains
    correlation: Floats
    open: tuple[str, ...]

    def interval(self, name: str, share: float = 0.95) -> tuple[float, float, float]:
        """Median and the ends of the middle share of one column."""
        column = self.chains.flat[:, self.names.index(name)]
        low, middle, high = np.quantile(column, [(1 - share) / 2, 0.5, (1 + share) / 2])
        return float(middle), float(low), float(high)


def sample_camera(
    spots: Sequence[Spots],
    matches: Sequence[Matches],
    camera: Camera,
    prior: Prior,
    seed: int,
    settings: Ensembles | None = None,
    ledger: Ledger | None = None,
) -> CameraPosterior:
    """Sample focal length, principal point, k1 and centroid floor, attitudes integrated out.

        ln L = -1/2 sum_frames (r^T W r + ln |W^-1| + ln |A^T W A|),   r the residuals at the best
        attitude of each frame, W^-1 = covariance + floor^2, A = d pixel / d attitude

    which is Laplace's integral over each attitude with an even prior, exact as far as the pixels
    are linear over the attitude's own uncertainty.

    spots    of each frame
    matches  of each frame; those with fewer than 4 stars are left out
    camera   where the prior has its middle
    Errors   ValueError where no frame has 4 matched stars.
             model: normal errors of centroids, no bad match; a narrow frame tells the principal
             point only through the tangent plane's bend: see `open`.
    """
    frames = [
        (np.column_stack([one.x, one.y])[match.spot], one.covariance[match.spot], match)
        for one, match in zip(spots, matches, strict=True)
        if len(match) >= 4
    ]
    if not frames:
        raise ValueError("matches must hold a frame of 4 stars or more, got none")
    sigma = np.array([prior.focal_length * camera.focal_length_px, prior.principal,
                      prior.principal, prior.k1])  # fmt: skip
    free = np.flatnonzero(sigma > 0)
    names = [CAMERA[i] for i in free]
    middle = np.array([getattr(camera, name) for name in CAMERA])
    fixed_floor = prior.floor_high == prior.floor_low
    low, high = np.log([prior.floor_low, prior.floor_high])

    def log_probability(places: Floats) -> Floats:
        values = np.tile(middle, (len(places), 1))
        values[:, free] = places[:, : len(free)]
        log_floor = np.full(len(places), low) if fixed_floor else places[:, -1]
        inside = (log_floor >= low) & (log_floor <= high) & (values[:, 0] > 0)
        score = -0.5 * (((places[:, : len(free)] - middle[free]) / sigma[free]) ** 2).sum(axis=1)
        floor = np.exp(np.clip(log_floor, low, high))
        values[:, 0] = np.maximum(values[:, 0], 1.0)
        for pixel, covariance, match in frames:
            assert match.icrs_to_camera is not None
            seen = match.icrs_to_camera.apply(match.direction)
            score += _log_likelihood(pixel, covariance, seen, camera, values, floor)
        return np.where(inside & np.isfinite(score), score, -np.inf)

    def start(rng: np.random.Generator, n: int) -> Floats:
        around = middle[free] + SPREAD * sigma[free] * rng.standard_normal((n, len(free)))
        if fixed_floor:
            return around
        return np.column_stack([around, rng.uniform(low, high, n)])

    chains = draw(log_probability, start, seed, settings, ledger)
    prior_width = dict(zip(names, sigma[free], strict=True))
    if not fixed_floor:
        names.append("floor")
    width = chains.flat.std(axis=0)
    hardly = tuple(
        name
        for name, one in zip(names, width, strict=True)
        if one > 0.9 * prior_width.get(name, np.inf)
    )
    return CameraPosterior(tuple(names), chains, np.atleast_2d(np.corrcoef(chains.flat.T)), hardly)


def project(direction: Floats, values: Floats, camera: Camera) -> Floats:
    """Where directions fall for many cameras at once; the same as Camera.project for each.

    direction  (w, n, 3) in camera axes
    values     (w, 8) of CAMERA
    Returns    (w, n, 2) pixel
    """
    f, cx, cy, k1, k2, p1, p2, k3 = (column[:, None] for column in values.T)
    x, y = direction[..., 0] / direction[..., 2], direction[..., 1] / direction[..., 2]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    middle_x, middle_y = (camera.columns - 1) / 2, (camera.rows - 1) / 2
    return np.stack([f * u + cx + middle_x, f * v + cy + middle_y], axis=-1)


def _log_likelihood(
    pixel: Floats, covariance: Floats, seen: Floats, camera: Camera, values: Floats, floor: Floats
) -> Floats:
    """(w,) of one frame for many cameras, its attitude integrated out."""
    inside = covariance + floor[:, None, None, None] ** 2 * np.eye(2)
    weight = np.linalg.inv(inside)
    turn = np.zeros((len(values), 3))
    for _ in range(ROUNDS):
        _, residual, slope = _linear(pixel, seen, camera, values, turn)
        left = np.einsum("wnik,wnij->wnkj", slope, weight)
        normal = np.einsum("wnkj,wnjl->wkl", left, slope)
        right = np.einsum("wnkj,wnj->wk", left, residual)
        turn = turn + np.linalg.solve(normal, right[..., None])[..., 0]
    _, residual, _ = _linear(pixel, seen, camera, values, turn)
    square = np.einsum("wni,wnij,wnj->w", residual, weight, residual)
    width = np.linalg.slogdet(inside)[1].sum(axis=1) + np.linalg.slogdet(normal)[1]
    return -0.5 * (square + width)


def _linear(
    pixel: Floats, seen: Floats, camera: Camera, values: Floats, turn: Floats
) -> tuple[Floats, Floats, Floats]:
    """Directions after small turns, residuals (w, n, 2), and their slopes by turns (w, n, 2, 3)."""
    direction = np.einsum("wij,nj->wni", Rotation.from_rotvec(turn).as_matrix(), seen)
    residual = pixel - project(direction, values, camera)
    x, y = direction[..., 0] / direction[..., 2], direction[..., 1] / direction[..., 2]
    f = values[:, 0, None]
    slope = np.empty((*x.shape, 2, 3))
    # Distortion hardly changes the slopes, and Gauss-Newton needs them to a part in a hundred.
    slope[..., 0, :] = np.stack([-f * x * y, f * (1 + x * x), -f * y], axis=-1)
    slope[..., 1, :] = np.stack([-f * (1 + y * y), f * x * y, f * x], axis=-1)
    return direction, residual, slope
