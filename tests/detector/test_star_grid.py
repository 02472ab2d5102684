"""Expected numbers of stars in separate cells."""

import numpy as np
import pytest
from scipy import special

from startrack.core.values import Psf
from startrack.detector import Detector, exposure
from startrack.detector.exposure import star_grid

SIDE, ACROSS, SIGMA = 15, 3, 0.8
MIDDLE = np.zeros((ACROSS, 2))
STILL = np.array([[1.0, 0.0, 0.0]])
DETECTOR = Detector(64, 64, 5e-6, 0.2, offset=50, full_well=65535.0, bits=16, read_noise=5.0)


def gaussian() -> Psf:
    x = np.arange(-112, 113) / 16
    line = special.ndtr((x + 0.5) / SIGMA) - special.ndtr((x - 0.5) / SIGMA)
    return Psf(np.outer(line, line), 16, 1.0)


def electrons(place, flux, companions=None, smear=STILL, sky=40.0, dark=None, **changes):
    """Electrons (cells, SIDE, SIDE) above the background, and the stars' places in their cells."""
    one = Detector(**{**DETECTOR.__dict__, **changes})
    place, flux = np.array(place, float), np.array(flux, float)
    frame, at = star_grid(place, flux, SIDE, smear, gaussian(), one, sky, companions, dark)
    across = frame.image.shape[1] // SIDE
    cells = (frame.image - frame.offset) * frame.electrons_per_dn
    cells = cells.reshape(len(flux), SIDE, across, SIDE).swapaxes(1, 2).reshape(-1, SIDE, SIDE)
    corner = SIDE * np.stack(np.divmod(np.arange(len(cells)), across)[::-1], axis=1)
    return cells, at - corner


def centre(cell):
    """Place (x, y) of the centroid of the light, from the cell's corner."""
    light = cell - cell[0, 0]
    row, column = np.indices(cell.shape)
    return np.array([(light * column).sum(), (light * row).sum()]) / light.sum()


def test_a_cell_without_a_star_holds_sky_and_dark_current():
    cells, _ = electrons(MIDDLE, [0, 0], dark_current=30.0)
    np.testing.assert_allclose(cells, 40 + 30 * 0.2, atol=1e-3)


def test_each_star_lies_in_its_own_cell_where_it_should():
    place, flux = [[0.3, -0.2], [0, 0.5], [-0.4, 0.1]], [1e4, 5e4]
    cells, at = electrons(place, flux)
    np.testing.assert_allclose(at, np.tile(place, (2, 1)) + SIDE // 2)
    light = cells.sum(axis=(1, 2)) - 40 * SIDE**2
    np.testing.assert_allclose(light, np.repeat(flux, 3), rtol=1e-4, atol=0.5)
    for cell, wanted in zip(cells, at, strict=True):
        np.testing.assert_allclose(centre(cell), wanted, atol=2e-3)


def test_a_companion_stands_beside_its_star():
    """A third of the light two pixels to the right and one below displaces the centroid by its
    fraction."""
    beside = np.tile([2.0, 1.0], (3, 1)), np.array([1e4, 0.0])
    cells, place = electrons([[0.2, 0.1]] * 3, [2e4, 2e4], beside)
    np.testing.assert_allclose(centre(cells[1]) - place[1], [2 / 3, 1 / 3], atol=3e-3)
    np.testing.assert_allclose(centre(cells[4]), place[4], atol=2e-3)


def test_windows_of_dark_signal_take_the_places_again_and_again():
    """Six windows for three places: each has its own dark signal below the star of its place."""
    place, dark = [[0.3, -0.2], [0, 0.5], [-0.4, 0.1]], np.zeros((6, SIDE, SIDE))
    dark[np.arange(6), 3, np.arange(6)] = 500.0 * np.arange(6)
    plain, _ = electrons(place, [1e4, 5e4])
    cells, at = electrons(place, [1e4, 5e4], dark=dark)
    np.testing.assert_allclose(at, np.tile(place, (4, 1)) + SIDE // 2)
    for k, cell in enumerate(cells):
        star = plain[3 * (k // 6) + k % 3]
        np.testing.assert_allclose(cell - star, dark[k % 6], atol=0.02)


def test_a_path_spreads_a_star_over_its_points():
    """Second moments add up: half of the time a pixel to the right, half of it half a pixel to
    the left."""
    path = np.array([[0.5, 1.0, 0.0], [0.5, -1.0, 0.0]])
    (cell, *_), _ = electrons(MIDDLE, [2e4], smear=path)
    light = cell - cell[0, 0]
    row, column = np.indices(cell.shape) - SIDE // 2
    spread = [(light * each**2).sum() / light.sum() for each in (column, row)]
    np.testing.assert_allclose(spread, [SIGMA**2 + 1 / 12 + 1, SIGMA**2 + 1 / 12], atol=0.01)


def test_crosstalk_spreads_and_keeps():
    """Crosstalk spreads twice its fraction along the row, by one pixel."""
    (sharp, *_), _ = electrons(MIDDLE, [2e4])
    (wide, *_), _ = electrons(MIDDLE, [2e4], crosstalk=0.1)
    assert wide.sum() == pytest.approx(sharp.sum(), rel=1e-6)
    column = np.arange(SIDE) - SIDE // 2
    rise = ((wide - sharp) * column**2).sum() / 2e4
    assert rise == pytest.approx(2 * 0.1, rel=1e-2)


def test_stars_of_one_column_share_unequal_pixels():
    cells, _ = electrons(MIDDLE, np.zeros(10), sky=1e4, prnu=0.05)
    rows = cells.reshape(10, ACROSS, SIDE, SIDE)
    np.testing.assert_array_equal(rows, np.broadcast_to(rows[0], rows.shape))
    # Of 675 pixels, a deviation is known to 2.7 %.
    assert rows[0].std() / rows[0].mean() == pytest.approx(0.05, rel=0.11)


def test_middles_of_cells_are_those_of_whole_cells():
    """Stars, pixels that respond differently, and dark signal are in both; the frame is smaller."""
    place, smear = np.array([[0.3, -0.2], [0, 0.5]]), np.array([[0.5, 1.0, 0.0], [0.5, -1.0, 0.0]])
    dark = np.arange(4.0 * SIDE**2).reshape(4, SIDE, SIDE)
    one = Detector(**{**DETECTOR.__dict__, "prnu": 0.05})
    whole, middles = (
        star_grid(
            place, np.array([1e4, 3e4]), SIDE, smear, gaussian(), one, 40.0, None, dark, reach
        )
        for reach in (None, 4)
    )
    assert middles[0].image.shape == (2 * 9, 4 * 9)
    cells = whole[0].image.reshape(2, SIDE, 4, SIDE)[:, 3:12, :, 3:12]
    np.testing.assert_array_equal(middles[0].image, cells.reshape(18, 36))
    corner = np.stack(np.divmod(np.arange(8), 4)[::-1], axis=1)
    np.testing.assert_allclose(middles[1] - 9 * corner, whole[1] - SIDE * corner - 3, atol=1e-12)


def test_grids_of_one_detector_share_the_response_of_their_pixels(monkeypatch):
    """Its numbers are drawn once for images of all shapes."""
    streams, drawn = exposure.device_streams, []
    monkeypatch.setattr(exposure, "device_streams", lambda one: drawn.append(1) or streams(one))
    for flux in ([1e3], [1e4], [1e3, 1e5]):
        electrons(MIDDLE, flux, sky=7e3, prnu=0.031)
    assert len(drawn) == 1
