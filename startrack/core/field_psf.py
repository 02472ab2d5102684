"""FieldPsf: the images of points over a frame and over colour, as sums of a few tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from startrack.core.arrays import Floats
from startrack.core.interpolation import lagrange_weights, local_weights
from startrack.core.interpret import instead_of
from startrack.core.kernel import kernel
from startrack.core.printing import printed
from startrack.core.units import Unit
from startrack.core.values import Psf, PsfTable, arranged

# Electron in a pixel: smaller terms of a star, and smaller corrections of linear interpolation in
# its table, are left out; chosen by hand.
LEAST = 0.5
SHIFT = 2  # columns of `value` before the relative flux


@printed
@dataclass(frozen=True, eq=False)
class FieldPsf:
    """Images of points that change over the frame and with the colour of the light.

        image(x, y, colour) = sum_k coefficient_k(x, y, colour) table_k

    The colour of light is the mean wavelength of its detected photons. Between the nodes, the
    coefficients are cubic polynomials of x and of y, and one polynomial of the colour.

    table         (k, m, m) 1, as in Psf
    oversampling  samples per pixel
    x, y          (p,), (q,) pixel, evenly spaced nodes, at least four; beyond the last node, its
                  image is used
    colour        (c,) metre, nodes, rising; beyond the last node, its image is used
    value         (c, q, p, 3 + k): shift along x and y (pixel) of the centre of the image from the
                  place that the camera projects to; flux relative to that of the instrument's
                  throughput; coefficients
    error         1, of the peak, largest measured error between the nodes
    place_error   pixel, of the shift likewise
    """

    table: Floats
    oversampling: int
    x: Annotated[Floats, Unit("pixel")]
    y: Annotated[Floats, Unit("pixel")]
    colour: Annotated[Floats, Unit("m", "nm")]
    value: Floats
    error: float
    place_error: Annotated[float, Unit("pixel")]

    def at(self, x: Floats, y: Floats, colour: Floats) -> Floats:
        """Shift, relative flux and coefficients (n, 3 + k) at places and colours (n,)."""
        values = np.zeros((len(x), self.value.shape[-1]))
        at = (np.ascontiguousarray(array, float) for array in (x, y, colour))
        _add_near(self.value, self.x, self.y, self.colour, *at, values)
        return values

    @cached_property
    def arranged(self) -> PsfTable:
        """The tables for the kernels."""
        return arranged(self.table, self.oversampling, several=True)

    @cached_property
    def peak(self) -> Floats:
        """Largest value (k,) of each table, 1."""
        return np.abs(self.table).max(axis=(1, 2))

    def mean(self, colour: float) -> Psf:
        """The mean image over the frame at a colour, its flux relative to the mean flux."""
        images = self._over_frame(colour)
        weight = images[:, SHIFT] / images[:, SHIFT].sum()
        return self._sum(weight @ images[:, SHIFT + 1 :])

    def image(self, x: float, y: float, colour: float) -> tuple[Psf, float]:
        """The image at a place (pixel) and a colour (metre), and its relative flux."""
        image = self.at(np.array([x]), np.array([y]), np.array([colour]))[0]
        return self._sum(image[SHIFT + 1 :]), float(image[SHIFT])

    def images(self, x: Floats, y: Floats, colour: Floats) -> list[Psf]:
        """`image` at n places and colours at once, in a sixth of the time."""
        coefficient = self.at(x, y, colour)[:, SHIFT + 1 :]
        tables = coefficient @ self.table.reshape(len(self.table), -1)
        return [self._psf(table) for table in tables.reshape(-1, *self.table.shape[1:])]

    def over_colour(self, values: Floats, colour: Floats) -> Floats:
        """Values (c, ...) at the nodes of the colour -> values (n, ...) between them."""
        inside = np.clip(colour, self.colour[0], self.colour[-1])
        return np.tensordot(lagrange_weights(self.colour, inside), values, 1)

    def of_one_colour(self, colour: float) -> FieldPsf:
        """The images for light of any colour replaced by those of one colour."""
        weight = lagrange_weights(self.colour, np.array([colour]))[0]
        value = np.tensordot(weight, self.value, 1)[None]
        return replace(self, colour=np.array([colour]), value=value)

    def of_one_place(self, colour: float) -> FieldPsf:
        """The mean image over the frame everywhere, at shifts relative to those of a colour."""
        weight = lagrange_weights(self.colour, np.array([colour]))[0]
        value = np.empty_like(self.value)
        value[..., :SHIFT] = self.value[..., :SHIFT] - np.tensordot(
            weight, self.value[..., :SHIFT], 1
        )
        for c, colour in enumerate(self.colour):
            images = self._over_frame(float(colour))
            flux = images[:, SHIFT]
            value[c, ..., SHIFT] = flux.mean()
            value[c, ..., SHIFT + 1 :] = flux @ images[:, SHIFT + 1 :] / flux.sum()
        return replace(self, value=value)

    def _over_frame(self, colour: float) -> Floats:
        """`at` places evenly over the frame."""
        x, y = np.meshgrid(
            np.linspace(self.x[0], self.x[-1], 33), np.linspace(self.y[0], self.y[-1], 33)
        )
        return self.at(x.ravel(), y.ravel(), np.full(x.size, colour))

    def _sum(self, coefficient: Floats) -> Psf:
        return self._psf(np.tensordot(coefficient, self.table, 1))

    def _psf(self, table: Floats) -> Psf:
        return Psf(table, self.oversampling, min(float(table.sum()) / self.oversampling**2, 1.0))

    def split(
        self, x: Floats, y: Floats, electrons: Floats, weight: Floats, colour: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Points along paths, each with the electrons of each table.

        A path has the image at its middle, also if the camera rolls.

        x, y       (m, n) pixel, along the paths of n points
        electrons  (n,)
        weight     (m,) 1, of the points of a path
        colour     (n,) metre
        Returns    (m, l) x and y of the points in front of the camera with any light; (l, k) their
                   electrons, of any sign; those of the first table are not zero
        Accuracy   tables of less than LEAST electrons in each pixel are left out: zero.
        """
        share = weight / weight.sum()
        middle_x, middle_y = share @ x, share @ y
        there = np.flatnonzero(np.isfinite(middle_x + middle_y))
        values = self.at(middle_x[there], middle_y[there], colour[there])
        part = values[:, SHIFT + 1 :] * (values[:, SHIFT] * electrons[there])[:, None]
        part[np.abs(part) * self.peak <= LEAST] = 0.0
        lit = np.flatnonzero(part[:, 0])
        which = there[lit]
        # Row by row in memory; x[:, which] is not, and kernels are compiled anew for it.
        x, y = x.take(which, axis=1), y.take(which, axis=1)
        return x + values[lit, 0], y + values[lit, 1], part[lit]


@kernel
def _add_near(
    value: Floats,
    node_x: Floats,
    node_y: Floats,
    node_c: Floats,
    x: Floats,
    y: Floats,
    colour: Floats,
    total: Floats,
) -> None:
    """Add the weighted values of the nodes around each place."""
    near_x, near_y, near_c = np.empty(4), np.empty(4), np.empty(len(node_c))
    even = np.arange(4.0)
    for n in range(len(total)):
        across = (x[n] - node_x[0]) / (node_x[1] - node_x[0])
        down = (y[n] - node_y[0]) / (node_y[1] - node_y[0])
        across = min(max(across, 0.0), len(node_x) - 1.0)
        down = min(max(down, 0.0), len(node_y) - 1.0)
        u = min(max(int(across) - 1, 0), len(node_x) - 4)
        v = min(max(int(down) - 1, 0), len(node_y) - 4)
        _lagrange(even, across - u, near_x)
        _lagrange(even, down - v, near_y)
        _lagrange(node_c, min(max(colour[n], node_c[0]), node_c[-1]), near_c)
        for c in range(len(value)):
            for j in range(4):
                for i in range(4):
                    weight = near_c[c] * near_y[j] * near_x[i]
                    near = value[c, v + j, u + i]
                    for k in range(len(near)):
                        total[n, k] += weight * near[k]


@instead_of(_add_near)
def _add_near_of_arrays(
    value: Floats,
    node_x: Floats,
    node_y: Floats,
    node_c: Floats,
    x: Floats,
    y: Floats,
    colour: Floats,
    total: Floats,
) -> None:
    (u, near_x), (v, near_y) = local_weights(node_x, x), local_weights(node_y, y)
    near_c = lagrange_weights(node_c, np.clip(colour, node_c[0], node_c[-1]))
    for c, j, i in np.ndindex(len(value), 4, 4):
        weight = near_c[:, c] * near_y[:, j] * near_x[:, i]
        total += weight[:, None] * value[c, v + j, u + i]


@kernel
def _lagrange(nodes: Floats, at: float, weight: Floats) -> None:
    """Write the weights of the values at nodes, as `lagrange_weights`."""
    for k in range(len(nodes)):
        weight[k] = 1.0
        for other in range(len(nodes)):
            if other != k:
                weight[k] *= (at - nodes[other]) / (nodes[k] - nodes[other])
