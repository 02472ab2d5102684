"""Expected numbers of stars in separate cells."""

import numpy as np
import pytest
from scipy import special

from startrack.core.values import Psf
from startrack.detector import Detector
from startrack.detector.exposure import star_grid

SIDE, ACROSS, SIGMA = 15, 3, 0.8
STILL = np.array([[1.0, 0.0, 0.0]])
DETECTOR = Detector(64, 64, 5e-6, 0.2, offset=50, full_well=65535.0, bits=16, read_noise=5.0)


def gaussian() -> Psf:
    x = np.arange(-112, 113) / 16
    line = special.ndtr((x + 0.5) / SIGMA) - special.ndtr((x - 0.5) / SIGMA)
    return Psf(np.outer(line, line), 16, 1.0)


def electrons(stars, companions=None, smear=STILL, sky=40.0, **changes):
    """Electrons (cells, SIDE, SIDE) above nothing, and the stars' places in their cells."""
    one = Detector(**{**DETECTOR.__dict__, **changes})
    stars = np.atleast_2d(np.array(stars, float))
    companions = np.zeros_like(stars) if companions is None else np.atleast_2d(companions)
    frame, place = star_grid(stars, companions, ACROSS, SIDE, smear, gaussian(), one, sky)
    down = len(stars) // ACROSS
    cells = (frame.image - frame.offset) * frame.electrons_per_dn
    cells = cells.reshape(down, SIDE, ACROSS, SIDE).swapaxes(1, 2).reshape(-1, SIDE, SIDE)
    corner = SIDE * np.stack(np.divmod(np.arange(len(stars)), ACROSS)[::-1], axis=1)
    return cells, place - corner


def centre(cell):
    """Place (x, y) of the light above the cell's corner."""
    light = cell - cell[0, 0]
    row, column = np.indices(cell.shape)
    return np.array([(light * column).sum(), (light * row).sum()]) / light.sum()


def test_a_cell_without_a_star_holds_sky_and_dark_current():
    cells, _ = electrons(np.zeros((6, 3)), dark_current=30.0)
    np.testing.assert_allclose(cells, 40 + 30 * 0.2, atol=1e-3)


def test_each_star_lies_in_its_own_cell_where_it_should():
    stars = [
        [0.3, -0.2, 1e4],
        [0, 0, 2e4],
        [-0.4, 0.1, 3e4],
        [0, 0, 4e4],
        [0, 0.5, 5e4],
        [0.1, 0, 0],
    ]
    cells, place = electrons(stars)
    np.testing.assert_allclose(place, np.array(stars)[:, :2] + SIDE // 2)
    light = cells.sum(axis=(1, 2)) - 40 * SIDE**2
    np.testing.assert_allclose(light, np.array(stars)[:, 2], rtol=1e-4, atol=0.5)
    for cell, wanted in zip(cells[:5], place[:5], strict=True):
        np.testing.assert_allclose(centre(cell), wanted, atol=2e-3)


def test_a_companion_stands_beside_its_star():
    """A third of the light two pixels to the right and one below pulls the centre by as much."""
    cells, place = electrons([[0.2, 0.1, 2e4]] * 3, [[2.0, 1.0, 1e4]] * 3)
    np.testing.assert_allclose(centre(cells[1]) - place[1], [2 / 3, 1 / 3], atol=3e-3)


def test_a_path_spreads_a_star_over_its_points():
    """Second moments add: half of the time a pixel to the right, half a pixel to the left."""
    path = np.array([[0.5, 1.0, 0.0], [0.5, -1.0, 0.0]])
    (cell, *_), _ = electrons([[0, 0, 2e4]] * 3, smear=path)
    light = cell - cell[0, 0]
    row, column = np.indices(cell.shape) - SIDE // 2
    spread = [(light * each**2).sum() / light.sum() for each in (column, row)]
    np.testing.assert_allclose(spread, [SIGMA**2 + 1 / 12 + 1, SIGMA**2 + 1 / 12], atol=0.01)


def test_crosstalk_spreads_and_keeps():
    """To the left and the right goes twice the fraction, one pixel far."""
    (sharp, *_), _ = electrons([[0, 0, 2e4]] * 3)
    (wide, *_), _ = electrons([[0, 0, 2e4]] * 3, crosstalk=0.1)
    assert wide.sum() == pytest.approx(sharp.sum(), rel=1e-6)
    column = np.arange(SIDE) - SIDE // 2
    rise = ((wide - sharp) * column**2).sum() / 2e4
    assert rise == pytest.approx(2 * 0.1, rel=1e-2)


def test_stars_of_one_column_share_unequal_pixels():
    cells, _ = electrons(np.zeros((30, 3)), sky=1e4, prnu=0.05)
    rows = cells.reshape(10, ACROSS, SIDE, SIDE)
    np.testing.assert_array_equal(rows, np.broadcast_to(rows[0], rows.shape))
    # Of 675 pixels, a deviation is known to 2.7 %.
    assert rows[0].std() / rows[0].mean() == pytest.approx(0.05, rel=0.11)
