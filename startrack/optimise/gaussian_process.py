"""Points of the unit cube and values -> a Gaussian process through them, and its predictions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.linalg.lapack import dpotrs
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from startrack.core import Flags, Floats

# Normal prior of the logarithms of the lengths: functions with one or two bends along each axis.
TYPICAL_LENGTH, LENGTH_SPREAD = 1.0, 1.5
LENGTHS = 0.05, 50.0  # between which a length lies
NOISES = 1e-9, 1e-2  # between which the noise lies, of the variance of the process
FIRST_NOISE = 1e-5
ROOT5 = math.sqrt(5)


@dataclass(frozen=True, eq=False)
class Emulator:
    """A Gaussian process of a constant mean, which expects a smooth function between its points.

        k(x, x') = s^2 (1 + sqrt(5) r + 5 r^2 / 3) exp(-sqrt(5) r),
        r^2 = sum_i ((x_i - x'_i) / length_i)^2

    Source: Rasmussen and Williams (2006), Gaussian Processes for Machine Learning, eq. 4.17 with
    nu = 5/2, and eq. 2.23 and 2.24 for mean and variance.

    points    (n, d) in the unit cube
    length    (d,) 1
    noise     1, variance of the function's jumps between near points, over s^2
    doubt     (n,) additional variance of each value over s^2: the process need not fit it exactly
    mean      mean of the process
    size      s, its standard deviation
    factor    (n, n) Cholesky factor of the covariance over s^2, by columns as LAPACK takes it
    weight    (n,) of the points in a mean
    """

    points: Floats
    length: Floats
    noise: float
    doubt: Floats
    mean: float
    size: float
    factor: Floats
    weight: Floats

    def expected(self, points: Floats) -> Floats:
        """The mean (m,) at points (m, d)."""
        return np.asarray(self.mean + self._near(points) @ self.weight)

    def expected_and_sigma(self, points: Floats) -> tuple[Floats, Floats]:
        """Mean and standard deviation (m,) at points (m, d)."""
        near = self._near(points)
        inner = scipy.linalg.solve_triangular(self.factor, near.T, lower=True, check_finite=False)
        variance = np.maximum(1 - (inner**2).sum(axis=0), 0.0)
        return self.mean + near @ self.weight, self.size * np.sqrt(variance)

    def bound(self, point: Floats, sigmas: float) -> tuple[float, Floats]:
        """Mean plus some standard deviations at a point (d,), and the gradient of that."""
        apart = (point - self.points) / self.length
        r = np.sqrt((apart**2).sum(axis=1))
        near, slope = matern(r), -5 / 3 * (1 + ROOT5 * r) * np.exp(-ROOT5 * r)
        slopes = slope[:, None] * apart / self.length
        value, gradient = self.mean + float(near @ self.weight), slopes.T @ self.weight
        if not sigmas:
            return value, gradient
        inner, _ = dpotrs(self.factor, near, lower=True)
        sigma = math.sqrt(max(1 - float(near @ inner), 1e-12))
        gradient = gradient - sigmas * self.size / sigma * (slopes.T @ inner)
        return value + sigmas * self.size * sigma, gradient

    def with_point(self, point: Floats) -> Emulator:
        """The process if its own mean were the value at one more point (d,)."""
        values = np.append(self._values, self.expected(point[None]))
        doubt = np.append(self.doubt, 0.0)
        return _of(np.vstack([self.points, point]), values, self.length, self.noise, doubt)

    def of_some(self, kept: Flags) -> Emulator:
        """The process through some of its points (n,), of the same lengths and noise."""
        doubt = self.doubt[kept]
        return _of(self.points[kept], self._values[kept], self.length, self.noise, doubt)

    @property
    def _values(self) -> Floats:
        return np.asarray(self.mean + self.factor @ (self.factor.T @ self.weight))

    def _near(self, points: Floats) -> Floats:
        return matern(cdist(np.atleast_2d(points) / self.length, self.points / self.length))


def emulator(
    points: Floats, values: Floats, like: Emulator | None = None, doubt: Floats | None = None
) -> Emulator:
    """The process of the most probable lengths and noise, by their likelihood and a wide prior.

    points  (n, d) in the unit cube
    values  (n,)
    like    a process of fewer points, from whose lengths the search also begins
    doubt   (n,) variance of each value over that of the process, besides the noise; None: zeros
    Accuracy  numerical: the likelihood has several maxima; the best from two starts is taken.
    """
    count = points.shape[1]
    plain = np.append(np.zeros(count), math.log(FIRST_NOISE))
    starts = [plain]
    if like is not None:
        starts.append(np.log(np.append(like.length, like.noise)))
    bounds = [tuple(map(math.log, LENGTHS))] * count + [tuple(map(math.log, NOISES))]
    doubt = np.zeros(len(values)) if doubt is None else doubt
    unit = (values - values.mean()) / (values.std() or 1.0)
    square = (points[:, None] - points[None]) ** 2
    ends = [
        minimize(
            _misfit,
            np.clip(start, *np.transpose(bounds)),
            (square, unit, doubt),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": 60},
        )
        for start in starts
    ]
    best = np.exp(min(ends, key=lambda end: float(end.fun)).x)
    return _of(points, values, best[:-1], float(best[-1]), doubt)


def _of(points: Floats, values: Floats, length: Floats, noise: float, doubt: Floats) -> Emulator:
    scaled = points / length
    covariance = matern(cdist(scaled, scaled)) + np.diag(noise + doubt)
    factor = np.asfortranarray(np.linalg.cholesky(covariance), np.float64)
    sides = np.column_stack([values, np.ones_like(values)])
    inverse = scipy.linalg.cho_solve((factor, True), sides)
    mean = float(inverse[:, 0].sum() / inverse[:, 1].sum())
    weight = inverse[:, 0] - mean * inverse[:, 1]
    size = math.sqrt(max(float((values - mean) @ weight) / len(values), 0.0))
    return Emulator(
        points=points,
        length=length,
        noise=noise,
        doubt=doubt,
        mean=mean,
        size=size,
        factor=factor,
        weight=weight,
    )


def matern(r: Floats) -> Floats:
    """Correlation of values at distances r, over their length: nu = 5/2."""
    return (1 + ROOT5 * r + 5 / 3 * r * r) * np.exp(-ROOT5 * r)


def _misfit(logs: Floats, square: Floats, values: Floats, doubt: Floats) -> tuple[float, Floats]:
    """Minus the logarithm of the posterior of lengths and noise, and its gradient by their logs.

    With the mean and the size that are most likely for them (Rasmussen and Williams, eq. 5.8 and
    5.9).

    square  (n, n, d) squares of differences of the points
    """
    length, noise, n = np.exp(logs[:-1]), math.exp(logs[-1]), len(values)
    r = np.sqrt(square @ length**-2.0)
    factor = np.linalg.cholesky(matern(r) + np.diag(noise + doubt))
    inverse = scipy.linalg.cho_solve((factor, True), np.eye(n))
    total = inverse.sum(axis=0)
    weight = inverse @ values - total * float(total @ values) / float(total.sum())
    variance = max(float(values @ weight) / n, 1e-300)
    prior = (logs[:-1] - math.log(TYPICAL_LENGTH)) / LENGTH_SPREAD
    misfit = n / 2 * math.log(variance) + np.log(np.diag(factor)).sum() + (prior**2).sum() / 2
    pull = inverse - np.outer(weight, weight) / variance
    slope = 5 / 3 * (1 + ROOT5 * r) * np.exp(-ROOT5 * r) * pull
    by_length = np.tensordot(slope, square, 2) / length**2 / 2 + prior / LENGTH_SPREAD
    by_noise = noise * np.trace(pull) / 2
    return float(misfit), np.append(by_length, by_noise)
