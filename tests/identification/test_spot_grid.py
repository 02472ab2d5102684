"""Cells of the grid of spots against a scan of all spots, and the radius of a hit."""

import numpy as np
import pytest

from startrack.identification.grids import hits, spot_grid

pytestmark = pytest.mark.usefixtures("in_python")

LOW, HIGH = np.array([-0.10, -0.06]), np.array([0.12, 0.07])
LONGER = 0.22  # of both sides


def test_each_cell_has_the_spot_nearest_to_its_centre():
    """The nearest of the spots in the nine cells around it, by a scan; spots lie up to all
    borders."""
    rng = np.random.default_rng(1)
    plane = LOW + (HIGH - LOW) * rng.random((60, 2))
    plane[0], plane[1] = LOW, HIGH
    screen = spot_grid(plane, LOW, HIGH, 0.011)
    home = np.floor((plane - LOW) / screen.width)
    columns, rows = screen.cell.shape
    for k in range(columns):
        for m in range(rows):
            near = np.flatnonzero((np.abs(home - [k, m]) <= 1).all(axis=1))
            centre = LOW + screen.width * np.array([k + 0.5, m + 0.5])
            away = np.linalg.norm(plane[near] - centre, axis=1)
            assert screen.cell[k, m] == (near[np.argmin(away)] if len(near) else -1)


def test_cells_are_as_wide_as_the_radius_but_few_enough_for_the_cache():
    nothing = np.empty((0, 2))
    wide = spot_grid(nothing, LOW, HIGH, 0.02)
    assert (wide.width, wide.radius) == (0.02, 0.02)
    assert wide.cell.shape == (12, 8)  # 11 and 6.5 of them, and one for the border itself
    assert (wide.cell == -1).all()
    fine = spot_grid(nothing, LOW, HIGH, 1e-5)
    assert fine.width == pytest.approx(LONGER / 160)
    assert fine.radius == 1e-5
    high = spot_grid(nothing, LOW[::-1].copy(), HIGH[::-1].copy(), 1e-5)
    assert high.width == pytest.approx(LONGER / 160)
    assert max(high.cell.shape) <= 162


@pytest.mark.parametrize("spot", [(0.013, 0.021), (0.0151, -0.0299), (-0.0999, 0.0699)])
@pytest.mark.parametrize("radius", [0.011, 4e-4])
def test_a_position_hits_a_spot_up_to_the_radius(spot, radius):
    """A single spot, and positions about it, also in the neighbouring cells."""
    turn = np.linspace(0, 2 * np.pi, 60)
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    plane = np.array([[0.1, 0.05], spot])
    screen = spot_grid(plane, LOW, HIGH, radius)

    def inside(place):
        return place[((place >= LOW) & (place <= HIGH)).all(axis=1)]

    for fraction in (0.0, 0.5, 0.999):
        place = inside(np.array(spot) + fraction * circle)
        assert hits(screen, plane, place) == len(place) > 0
    assert hits(screen, plane, inside(np.array(spot) + 1.001 * circle)) == 0


def test_a_position_at_the_radius_hits_the_spot():
    plane = np.array([[0.5, 0.5]])
    screen = spot_grid(plane, np.zeros(2), np.ones(2), 0.25)
    assert hits(screen, plane, np.array([[0.75, 0.5], [0.5, 0.25], [0.25, 0.5]])) == 3


def test_corners_of_the_image_are_positions_too():
    plane = np.array([LOW, HIGH])
    screen = spot_grid(plane, LOW, HIGH, 0.005)
    corners = np.array([LOW, HIGH, [LOW[0], HIGH[1]], [HIGH[0], LOW[1]]])
    assert hits(screen, plane, corners) == 2
