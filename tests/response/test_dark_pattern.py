"""Windows of stars with hot pixels, against the distance from each pixel to the nearest one."""

import dataclasses

import numpy as np
from scipy.spatial import KDTree

from startrack.design import load_design
from startrack.detector import Defects
from startrack.io import shipped
from startrack.response.dark_pattern import dark_pattern, near_stars

CASE = load_design(shipped("designs/noise_only.toml")).case
SIDE, ROWS, COLUMNS = 9, 90, 120


def test_the_chance_of_a_hot_pixel_is_that_of_one_within_half_a_window():
    defects = Defects(hot=2e-3, hot_current=3e4)
    detector = dataclasses.replace(
        CASE.instrument.detector, rows=ROWS, columns=COLUMNS, defects=defects
    )
    instrument = dataclasses.replace(CASE.instrument, detector=detector)
    case = dataclasses.replace(CASE, instrument=instrument)
    pattern = dark_pattern(case)
    hot = np.stack(np.divmod(pattern.outlying, COLUMNS), axis=1)
    assert len(hot) > 5
    half = SIDE // 2
    place = np.mgrid[half : ROWS - half, half : COLUMNS - half].reshape(2, -1).T
    distance, _ = KDTree(hot).query(place, p=np.inf)
    chance, windows = near_stars(case, SIDE, 50)
    assert chance == np.mean(distance <= half)
    assert 0.1 < chance < 0.9
    assert np.abs(windows).max(axis=(1, 2)).min() > 0
