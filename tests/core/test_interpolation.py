"""Integrals of products of curves against adaptive quadrature by SciPy, and closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad

from startrack.core import Curve, means_around, nm, quadrature

NODES = np.arange(325.0, 1100.0, 10.0) * nm
FILTER = Curve((655.9 * nm, 656 * nm, 657.2 * nm, 657.5 * nm), (0.0, 0.9, 0.7, 0.0))
DETECTOR = Curve((320 * nm, 500 * nm, 656.7 * nm, 1000 * nm), (0.1, 0.6, 0.65, 0.0))


def test_the_mean_around_each_node_is_an_integral_over_its_two_cells():
    mean = means_around(NODES, (FILTER, DETECTOR))
    for k in np.flatnonzero(abs(NODES - 656 * nm) < 25 * nm):

        def weighted(place, node=NODES[k]):
            hat = max(1 - abs(place - node) / (10 * nm), 0.0)
            return hat * float(FILTER(place)) * float(DETECTOR(place)) / (10 * nm)

        breaks = [*FILTER.wavelength, 656.7 * nm]
        right = quad(weighted, 655.9 * nm, 657.5 * nm, points=breaks, epsabs=1e-16)[0]
        assert mean[k] == pytest.approx(right, rel=1e-9, abs=1e-15)


def test_a_spectrum_of_straight_lines_is_integrated_exactly():
    spectrum = np.linspace(2.0, 5.0, len(NODES))  # over wavelength
    edges = 400 * nm, 737.3 * nm  # a rectangle with ends between the nodes
    mean = means_around(NODES, (Curve(edges, (1.0, 1.0)),))
    at_ends = np.interp(edges, NODES, spectrum)
    right = (edges[1] - edges[0]) * at_ends.mean()
    assert spectrum @ mean * 10 * nm == pytest.approx(right, rel=1e-12)


def test_flat_curves_weigh_all_nodes_alike():
    np.testing.assert_allclose(means_around(NODES, (Curve(), Curve((), (0.5,)))), 0.5, rtol=1e-12)


def test_a_product_of_five_straight_lines_is_exact():
    line = Curve((0.25, 1.0), (0.25, 1.0))
    place, weight, cell = quadrature(np.array([0.0, 0.5, 1.0]), [line])
    value = weight * line(place) ** 5
    right = [(0.5**6 - 0.25**6) / 6, (1 - 0.5**6) / 6]
    np.testing.assert_allclose(np.bincount(cell, value), right, rtol=1e-13)
