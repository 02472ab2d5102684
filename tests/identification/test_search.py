"""Triangles of spots: their size, noise and order, and a search that finds none."""

from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import Stars
from startrack.core.camera import Camera
from startrack.identification import Identification, build_index
from startrack.identification.index import CELLS_BASE, STRETCH, cell_base
from startrack.identification.search import TripleLimits, _measure, _namings, search
from startrack.identification.seen import see

pytestmark = pytest.mark.usefixtures("in_python")

CAMERA = Camera(1024, 1024, 2000.0)
PIXEL = np.array([[500.0, 480.0], [200.0, 700.0], [850.0, 300.0], [400.0, 150.0], [760.0, 810.0]])


@pytest.fixture
def seen(spots_at):
    spots = spots_at(PIXEL, 0.2)
    spots.covariance[:] = np.eye(2) * np.array([0.1, 0.2, 0.3, 0.4, 0.5])[:, None, None] ** 2
    return see(spots, np.arange(5), CAMERA, Identification())


def test_a_search_that_may_try_nothing_ends_with_no_evidence(seen):
    direction = Rotation.random(60, random_state=1).apply([0.0, 0.0, 1.0])
    index = build_index(Stars(np.arange(60), direction, np.linspace(1, 5, 60), np.zeros(60)), 0.5)
    nothing = np.empty((0, 3), np.int64)
    limits = TripleLimits(40, 0.003, 4, -10.0, 100)
    best, tried = search(seen, nothing, index.table, index.bright, limits)
    assert (best.matches, best.log_p, best.scale, tried) == (0, 0.0, 1.0, 0)
    np.testing.assert_array_equal(best.rotation, np.eye(3))


@pytest.mark.parametrize("choice", list(permutations([1, 2, 4])))
def test_triangles_are_measured_in_any_order(seen, choice):
    """The longest side by scipy's rotations, the noisiest spot, and the spot farthest off the
    axis."""
    base, noise, off_axis = _measure(seen, np.array(choice))
    ray = CAMERA.unproject(PIXEL)
    sides = [
        Rotation.align_vectors(ray[[b]], ray[[a]])[0].magnitude()
        for a, b in ((1, 2), (2, 4), (1, 4))
    ]
    assert base == pytest.approx(max(sides), rel=1e-9)
    assert noise == pytest.approx(3.5 * 0.5 / 2000 / base)
    cosine = ray[[1, 2, 4], 2].min()
    assert off_axis == pytest.approx(1 / cosine**2 - 1)


def named(ray, choice, longest, error):
    names, codes = np.empty((6, 3), np.int64), np.empty((6, 2))
    count = _namings(np.array(ray), np.array(choice), longest, error, names, codes)
    return names[:count].tolist(), codes[:count]


@pytest.mark.parametrize("choice", list(permutations([0, 1, 2])))
def test_a_triangle_has_one_name_however_it_is_given(choice):
    """The base is the longest side, and its first end is the one nearer to the third spot."""
    pixel = np.array([[100.0, 500.0], [900.0, 500.0], [400.0, 300.0]])
    names, codes = named(CAMERA.unproject(pixel), choice, 0.39, 0.01)
    assert names == [[0, 1, 2]]
    assert codes[0] == pytest.approx([3 / 8, -1 / 4], abs=0.02)


def test_triangles_close_to_a_tie_have_several_names():
    """Two names if the third spot is equally near to both ends, six if all sides are equal."""
    even = CAMERA.unproject(np.array([[100.0, 511.5], [923.0, 511.5], [511.5, 300.0]]))
    names, codes = named(even, [0, 1, 2], np.arccos(even[0] @ even[1]), 1e-6)
    assert sorted(names) == [[0, 1, 2], [1, 0, 2]]
    assert codes[:, 0] == pytest.approx([0.5, 0.5], abs=1e-6)
    assert codes[0, 1] == pytest.approx(-codes[1, 1], abs=1e-9)
    turn = 2 * np.pi / 3 * np.arange(3)
    alike = CAMERA.unproject(CAMERA.centre + 300 * np.column_stack([np.cos(turn), np.sin(turn)]))
    names, _ = named(alike, [0, 1, 2], np.arccos(alike[0] @ alike[1]), 1e-6)
    assert sorted(names) == [list(each) for each in permutations(range(3))]


def test_cells_of_length_are_even_in_the_logarithm_and_the_last_ones_hold_the_rest():
    middle = 0.1 * np.exp(STRETCH * (np.arange(-3, CELLS_BASE + 3) + 0.5))
    cells = [cell_base(base, 0.1) for base in middle]
    assert cells == [0, 0, 0, *range(CELLS_BASE), *[CELLS_BASE - 1] * 3]
