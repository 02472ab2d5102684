"""Values at nodes -> values between them: on a line, over wavelength, over a frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from startrack.core.arrays import Floats, Ints
from startrack.core.checks import Refused
from startrack.core.declared import NON_NEGATIVE, POSITIVE, Parameters, Range, parameter
from startrack.core.kernel import kernel
from startrack.core.units import Unit


def local_weights(nodes: Floats, at: Floats) -> tuple[Ints, Floats]:
    """First of the four nodes around each place, and the weights (n, 4) of a cubic through them."""
    step = nodes[1] - nodes[0]
    place = np.clip((at - nodes[0]) / step, 0, len(nodes) - 1)
    first = np.clip(np.floor(place).astype(np.int64) - 1, 0, len(nodes) - 4)
    return first, lagrange_weights(np.arange(4.0), place - first)


def lagrange_weights(nodes: Floats, at: Floats) -> Floats:
    """(n, k) weights of values at nodes, (k,) or (n, k), in their polynomial at places (n,)."""
    away = at[:, None] - nodes
    weight = np.ones(away.shape)
    for k in range(away.shape[1]):
        for other in range(away.shape[1]):
            if other != k:
                weight[:, k] *= away[:, other] / (nodes[..., k] - nodes[..., other])
    return weight


def hermite_weights(nodes: Floats, at: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Weights of values and slopes at nodes (n, k) in their polynomial at places (n,).

        y(t) = sum_k (1 - 2 l_k'(t_k) (t - t_k)) l_k(t)^2 y_k + (t - t_k) l_k(t)^2 y'_k

    with l_k the polynomials of Lagrange.

    Returns  (n, k) each: of the values and of the slopes in y, and of both in its derivative
    """
    away = at[:, None] - nodes
    basis, slope = lagrange_weights(nodes, at), np.zeros(away.shape)
    at_node = np.zeros(away.shape)
    for k in range(away.shape[1]):
        for other in range(away.shape[1]):
            if other == k:
                continue
            apart = nodes[:, k] - nodes[:, other]
            at_node[:, k] += 1 / apart
            factor = 1 / apart
            for third in range(away.shape[1]):
                if third not in (k, other):
                    factor = factor * away[:, third] / (nodes[:, k] - nodes[:, third])
            slope[:, k] += factor
    square, twice = basis * basis, 2 * basis * slope
    tilt = 1 - 2 * at_node * away
    return (
        tilt * square,
        away * square,
        tilt * twice - 2 * at_node * square,
        square + away * twice,
    )


@dataclass(frozen=True, eq=False)
class Samples:
    """Values at rising times; between them, a polynomial goes through the nearest values.

    second   (n,)
    values   (k, n)
    degree   of the polynomials; lower if there are too few values
    slopes   (k, n) a second, slopes that the polynomials match; None: only values
    """

    second: Floats
    values: Floats
    degree: int
    slopes: Floats | None = None

    def at(self, second: Floats) -> tuple[Floats, Floats | None]:
        """(k, m) at (m,) seconds, and with slopes the derivatives (k, m)."""
        count = self.degree + 1 if self.slopes is None else (self.degree + 1) // 2
        points = min(count, len(self.second))
        nearest = np.searchsorted(self.second, second)
        if points % 2:  # the nearest in the middle, else one more on either side
            low, high = (
                self.second[np.clip(nearest + k, 0, len(self.second) - 1)] for k in (-1, 0)
            )
            nearest = nearest - (second - low < high - second)
        first = np.clip(nearest - points // 2, 0, len(self.second) - points)
        index = first + np.arange(points)[:, None]

        def total(weight: Floats, values: Floats) -> Floats:
            return np.einsum("kn,akn->an", np.ascontiguousarray(weight.T), values[:, index])

        nodes = self.second[index].T
        if self.slopes is None:
            return total(lagrange_weights(nodes, second), self.values), None
        value, of_slope, turned, of_turned = hermite_weights(nodes, second)
        return (
            total(value, self.values) + total(of_slope, self.slopes),
            total(turned, self.values) + total(of_turned, self.slopes),
        )


class Curve(Parameters):
    """Values in [0, 1] at wavelengths, linear between them and zero outside.

    A curve with one value and no wavelength is constant.
    """

    wavelength: tuple[float, ...] = parameter(
        "rising, one for each value", unit=Unit("m", "nm"), limit=POSITIVE, default=()
    )
    value: tuple[float, ...] = parameter(
        "at each wavelength, or one for all", limit=Range(0, 1), default=(1.0,)
    )
    factor: float = parameter(
        "on all values, which stay within [0, 1]: the level of a curve by one number, such as one "
        "that is not known",
        limit=NON_NEGATIVE,
        default=1.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.value or len(self.wavelength) != (
            len(self.value) if len(self.value) > 1 else 0
        ):
            raise Refused(
                "wavelength and value must have the same length (or one value and no wavelength), "
                f"got {len(self.wavelength)} and {len(self.value)}"
            )
        if any(b <= a for a, b in zip(self.wavelength, self.wavelength[1:], strict=False)):
            raise Refused(f"wavelength must rise, got {self.wavelength}")

    def __call__(self, wavelength: Floats) -> Floats:
        """The curve at wavelengths in metre."""
        if not self.wavelength:
            return np.full(np.shape(wavelength), min(self.factor * self.value[0], 1.0))
        values = np.interp(wavelength, self.wavelength, self.value, left=0.0, right=0.0)
        return values if self.factor == 1 else np.minimum(self.factor * values, 1.0)

    def scaled(self, factor: float) -> Curve:
        """The curve times a factor, within [0, 1]."""
        return replace(
            self, value=tuple(min(max(value * factor, 0.0), 1.0) for value in self.value)
        )


ALL = Curve()  # nothing is lost at any wavelength

# Gauss and Legendre's rule of three points: exact for polynomials of degree five.
GAUSS_PLACES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


class Quadrature(NamedTuple):
    """Nodes and weights for integrals over wavelength between edges.

    place   (n,) metre
    weight  (n,) metre
    cell    (n,) index of the edge below each node
    """

    place: Floats
    weight: Floats
    cell: Ints


def quadrature(edges: Floats, curves: Iterable[Curve]) -> Quadrature:
    """Nodes and weights for the integral of a product of curves between edges.

    edges     (k + 1,) metre, rising
    curves    the curves, at whose nodes the integral is divided
    Accuracy  numerical: exact for products of up to five factors that are linear between nodes.
    """
    nodes = np.array([node for curve in curves for node in curve.wavelength], float)
    ends = np.union1d(edges, nodes[(nodes > edges[0]) & (nodes < edges[-1])])
    half = np.diff(ends) / 2
    place = (ends[:-1] + half)[:, None] + half[:, None] * GAUSS_PLACES
    cell = np.searchsorted(edges, ends[:-1], side="right") - 1
    return Quadrature(
        place.ravel(), (half[:, None] * GAUSS_WEIGHTS).ravel(), np.repeat(cell, len(GAUSS_PLACES))
    )


def means_around(nodes: Floats, curves: Sequence[Curve]) -> Floats:
    """Mean of a product of curves around each node, for integrals of spectra.

        mean_k = integral(hat_k curves) / step,   integral(s curves) = sum_k s_k step mean_k

    where hat_k is 1 at its node and falls along straight lines to 0 at the next ones, so that the
    sum is the integral of a spectrum s that has straight lines between the nodes. It is constant
    in half a step beyond the first and the last node.

    nodes     (k,) metre, evenly spaced
    Returns   (k,) 1
    Accuracy  numerical: exact for products of up to four curves that are linear between nodes.
    """
    step = nodes[1] - nodes[0]
    edges = np.concatenate([[nodes[0] - step / 2], nodes, [nodes[-1] + step / 2]])
    place, weight, cell = quadrature(edges, curves)
    value = weight / step
    for curve in curves:
        value = value * curve(place)
    before = np.clip(cell - 1, 0, len(nodes) - 2)
    above = np.clip((place - nodes[before]) / step, 0.0, 1.0)
    mean = np.zeros(len(nodes))
    np.add.at(mean, before, value * (1 - above))
    np.add.at(mean, before + 1, value * above)
    return mean


NODES = 9  # along each side; cubic between them


class Displacement(Parameters):
    """Displacement of places of a frame from those of a camera model.

    Between the nodes, which span the frame evenly, the values are cubic polynomials of x and of y;
    beyond the frame the values are those at its edge.
    """

    columns: int = parameter("pixel, of the frame")
    rows: int = parameter("pixel, of the frame")
    value: tuple[float, ...] = parameter("pixel, 2 NODES^2 numbers: x, then y, each row by row")

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.value) != 2 * NODES**2:
            raise Refused(f"value must have {2 * NODES**2} numbers, got {len(self.value)}")

    def __call__(self, pixel: Floats) -> Floats:
        """Pixel (n, 2) at places (n, 2) pixel; NaN where a place is NaN."""
        return _displaced(np.ascontiguousarray(pixel, float), *self._nodes)

    @cached_property
    def _nodes(self) -> tuple[Floats, Floats, Floats]:
        """Values (2, NODES, NODES) at the nodes, and their x and y."""
        x, y = (np.linspace(-0.5, size - 0.5, NODES) for size in (self.columns, self.rows))
        return np.array(self.value).reshape(2, NODES, NODES), x, y


@kernel
def _displaced(pixel: Floats, table: Floats, x: Floats, y: Floats) -> Floats:
    """The sums (n, 2) of the 16 nodes around each place."""
    last, moved = table.shape[1] - 1, np.empty((len(pixel), 2))
    across, down = np.empty(4), np.empty(4)
    for k in range(len(pixel)):
        if not np.isfinite(pixel[k, 0] + pixel[k, 1]):
            moved[k] = np.nan
            continue
        u = min(max((pixel[k, 0] - x[0]) / (x[1] - x[0]), 0.0), float(last))
        v = min(max((pixel[k, 1] - y[0]) / (y[1] - y[0]), 0.0), float(last))
        left = min(max(math.floor(u) - 1, 0), last - 3)
        top = min(max(math.floor(v) - 1, 0), last - 3)
        for i in range(4):
            across[i], down[i] = 1.0, 1.0
            for other in range(4):
                if other != i:
                    across[i] *= (u - left - other) / (i - other)
                    down[i] *= (v - top - other) / (i - other)
        for c in range(2):
            total = 0.0
            for j in range(4):
                for i in range(4):
                    total += table[c, top + j, left + i] * down[j] * across[i]
            moved[k, c] = total
    return moved


@kernel
def bilinear(grid: Floats, row: float, column: float) -> float:
    """The value of a grid between its nodes, at a place within it."""
    i, j = int(row), int(column)
    s, t = row - i, column - j
    upper = grid[i, j] + t * (grid[i, j + 1] - grid[i, j])
    lower = grid[i + 1, j] + t * (grid[i + 1, j + 1] - grid[i + 1, j])
    return upper + s * (lower - upper)


def node_places(columns: int, rows: int, nodes: int = NODES) -> Floats:
    """Places (nodes^2, 2) pixel of nodes that span a frame evenly, row by row."""
    edges = (np.linspace(-0.5, size - 0.5, nodes) for size in (columns, rows))
    return np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2)


def map_weights(columns: int, rows: int, place: Floats, nodes: int) -> Floats:
    """Weights (n, nodes^2) of a map's nodes, which span a frame evenly, at places (n, 2).

    Straight lines in x and in y between the nodes, row by row.
    """
    weights = [
        np.maximum(1 - np.abs(at[:, None] - np.arange(nodes)), 0.0)
        for at in np.clip((place + 0.5) / (columns, rows) * (nodes - 1), 0, nodes - 1).T
    ]
    return (weights[1][:, :, None] * weights[0][:, None, :]).reshape(len(place), nodes**2)


def map_displacement(columns: int, rows: int, node: Floats) -> Displacement:
    """The displacement of a map by its nodes (nodes^2, 2) pixel, row by row."""
    weight = map_weights(columns, rows, node_places(columns, rows), math.isqrt(len(node)))
    return Displacement(columns, rows, tuple((weight @ node).T.ravel().tolist()))
