import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.attitude import SolverSettings, solve
from startrack.attitude.consensus import consensus
from startrack.core.camera import Camera
from startrack.core.units import arcsec
from startrack.core.values import Matches, Spots, Status

CAMERA = Camera(1024, 1024, 4800.0)
SIGMA = 10 * arcsec


def field(count: int, wrong: int, seed: int):
    """Measured and catalogue directions of a field; the last `wrong` are unrelated."""
    rng = np.random.default_rng(seed)
    attitude = Rotation.from_quat(rng.standard_normal(4))
    seen = CAMERA.unproject(rng.uniform(0, 1023, (count, 2)))
    known = attitude.inv().apply(seen)
    known[count - wrong :] = attitude.inv().apply(
        CAMERA.unproject(rng.uniform(0, 1023, (wrong, 2)))
    )
    noisy = seen + SIGMA * rng.standard_normal(seen.shape)
    return attitude, noisy / np.linalg.norm(noisy, axis=1, keepdims=True), known


@pytest.mark.parametrize("wrong", [0, 5, 12])
def test_it_finds_the_correct_matches_among_false_ones(wrong):
    """At five sigma correct matches are hardly ever lost; false matches agree only by chance."""
    lost = 0
    for seed in range(30):
        _, seen, known = field(20, wrong, seed)
        agree = consensus(seen, known, np.full(20, SIGMA), 5.0)
        lost += (~agree[: 20 - wrong]).sum()
        assert agree[20 - wrong :].sum() <= 1
    assert lost <= 3


def test_the_order_of_the_stars_does_not_matter():
    _, seen, known = field(15, 6, 7)
    order = np.random.default_rng(0).permutation(15)
    agree = consensus(seen, known, np.full(15, SIGMA), 5.0)
    assert (agree[order] == consensus(seen[order], known[order], np.full(15, SIGMA), 5.0)).all()


def test_nothing_agrees_where_there_are_no_two_directions():
    one = np.array([[0, 0, 1.0]])
    for seen in (one[:0], one, np.repeat(one, 3, axis=0)):
        assert not consensus(seen, seen, np.full(len(seen), SIGMA), 5.0).any()


def test_solve_works_with_more_false_matches_than_correct_ones():
    for seed in range(10):
        attitude, seen, known = field(14, 8, seed)
        index, ones = np.arange(14), np.ones(14)
        x, y = CAMERA.project(seen).T
        sigma = SIGMA * CAMERA.focal_length_px
        covariance = np.tile(np.eye(2) * sigma**2, (14, 1, 1))
        got = solve(
            Spots(x, y, ones, covariance, ones, np.ones(14, int)),
            Matches(Status.SOLVED, "", index, index, known, CAMERA, None, 1e-9),
            SolverSettings(centroid_floor=0.0, sift=True),
        )
        assert (got.icrs_to_camera * attitude.inv()).magnitude() < 400 * arcsec
        assert 5 <= got.stars <= 7
