"""Windows against the whole frame, and which pixels need a window."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core import Workspace
from startrack.core.streams import Streams
from startrack.core.values import Frame, Psf
from startrack.detector import Defects, Detector, Hits, Pattern
from startrack.detector.collect import background, background_tables
from startrack.detector.effects import require_independent_pixels
from startrack.detector.exposure import draw, frame_of
from startrack.detector.imperfections import tracks
from startrack.detector.maps import dark
from startrack.detector.windows import (
    expose_within,
    independent_pixels,
    outlier_pixels,
    write_numbers,
)

DETECTOR = Detector(200, 150, 5e-6, 0.1, dark_current=10.0, read_noise=5.0, prnu=0.01, bits=16)


def test_pixels_of_nearly_even_response_are_none_of_them():
    """Ten thousand electrons with a response of 1 % rms: a third of the shot noise, far from
    five times it."""
    assert len(outlier_pixels(DETECTOR, 1000.0, 5.0)) == 0
    assert len(outlier_pixels(replace(DETECTOR, prnu=0.3), 1000.0, 5.0)) > 1000


def test_hot_and_dead_pixels_are():
    """Sky 100, read noise 5: outliers are above 100 + 5 sqrt(125 + 1) = 156 electrons, or below
    44."""
    one = replace(DETECTOR, prnu=0.0, defects=Defects(hot=0.02, hot_current=3000.0, dead=0.01))
    outliers = outlier_pixels(one, 100.0, 5.0)
    level = dark(one).ravel() * 0.1 + 100
    assert set(np.flatnonzero(level > 100 + 160)) <= set(outliers)  # dead ones have no sky
    hot, dead = (level > 158).sum(), 0.01 * level.size
    assert len(outliers) == pytest.approx(hot + dead, abs=5 * np.sqrt(dead))
    assert hot > 200


STARS = 60
OTHERS = {"hits": Hits(5e9), "prnu": 0.05, "defects": Defects(dsnu=5.0)}


@pytest.mark.parametrize("tabled", ["flat", "bumpy"])
@pytest.mark.parametrize(
    "changes",
    [{}, {"crosstalk": 0.1}, OTHERS, {"crosstalk": 0.1, **OTHERS}],
    ids=["plain", "crosstalk", "uneven", "all"],
)
def test_windows_hold_the_numbers_of_the_frame(changes, tabled):
    """Number by number, for images with sharp edges, in windows that overlap and touch borders."""
    rng = np.random.default_rng(6)
    table = np.ones((27, 27)) if tabled == "flat" else rng.uniform(0.5, 1, (27, 27))
    psf = Psf(table / 20, 3, 1.0)
    one = replace(DETECTOR, **{"columns": 150, "rows": 140, "prnu": 0.0, "offset": 50, **changes})
    x, y = (rng.uniform(-9, n + 9, STARS) for n in (150, 140))
    x[0] = y[0] = np.nan  # behind the camera
    course = np.array([[-3.0, 1.0], [0.0, 0.0], [4.0, -2.0]])
    places = np.array([0.2, 0.5, 0.3]), x + course[:, :1], y + course[:, 1:]
    star = rng.uniform(1e3, 1e4, STARS)
    electrons = background(one, 100.0).copy()
    draw(electrons, psf, [places], star, one)
    whole = frame_of(electrons, one, Streams(3, 0), background_tables(one, 100.0)).image
    corner = rng.integers([-5, -5], [150, 140], (80, 2))
    windows = np.hstack([corner, corner + rng.integers(1, 14, (80, 2))])
    windows = np.clip(windows, 0, [150, 140, 150, 140])
    windows = windows[(windows[:, 2:] > windows[:, :2]).all(axis=1)]
    part = expose_within(windows, places, star, psf, one, 100.0, Streams(3, 0), Workspace()).image
    seen = np.zeros(whole.shape, bool)
    for left, top, right, bottom in windows:
        seen[top:bottom, left:right] = True
    np.testing.assert_array_equal(part[seen], whole[seen])
    # Elsewhere the sky and the dark current, 100 + 1 electrons, above the offset.
    np.testing.assert_allclose(part[~seen], 50 + 101 / one.electrons_per_dn, rtol=1e-6)


def test_numbers_are_put_as_into_a_wider_frame_that_is_cut():
    """3 x 5 numbers around pixels in corners, at borders and inside; the last one written
    counts."""
    image = np.zeros((7, 9), np.float32)
    pixel = np.array([0, 8, 54, 62, 3, 40, 41, 27, 35])
    numbers = np.arange(1, 136).reshape(9, 3, 5)
    write_numbers(Frame(image), pixel, numbers)
    wider = np.zeros((9, 13))
    for (row, column), some in zip(zip(*np.divmod(pixel, 9), strict=True), numbers, strict=True):
        wider[row : row + 3, column : column + 5] = some
    np.testing.assert_array_equal(image, wider[1:-1, 2:-2])


def test_independent_pixels_are_outliers_and_hits():
    outliers, hits = np.array([5, 17]), Hits(5e9)
    assert independent_pixels(DETECTOR, outliers, Streams(1, 0)) is outliers
    got = independent_pixels(replace(DETECTOR, hits=hits), outliers, Streams(1, 0))
    pixel, _ = tracks(hits, (150, 200), 5e-6, 0.1, Streams(1, 0))
    assert len(pixel) > 10
    np.testing.assert_array_equal(got, [*outliers, *pixel])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("blooming", True),
        ("em_gain", 2.0),
        ("pattern", Pattern(1.0, 0.0, 0.0)),
        ("settling", 0.1),
        ("read_noise_spread", 0.1),
        ("lag", 0.1),
    ],
)
def test_pixels_that_know_of_each_other_are_refused(name, value):
    require_independent_pixels(replace(DETECTOR, crosstalk=0.1))
    with pytest.raises(ValueError, match=f"without {name}; choose the fidelity frame"):
        require_independent_pixels(replace(DETECTOR, **{name: value}))
