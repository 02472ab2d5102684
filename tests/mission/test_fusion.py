"""Fused attitudes have the error that their covariance states."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import arcsec
from startrack.mission.fusion import fuse, fused_variance, head_covariance, relative_alignment
from startrack.mission.parameters import mounted

COUNT = 20_000  # one standard deviation of the mean of 3 is 0.017: false alarms below 1e-8
HEADS = (mounted(1.0, -0.9), mounted(-1.2, -1.0, 0.5))
ACROSS, ABOUT = (3 * arcsec) ** 2, (20 * arcsec) ** 2


def drawn(covariance, generator):
    return Rotation.from_rotvec(
        generator.standard_normal((COUNT, 3)) @ np.linalg.cholesky(covariance).T
    )


def nees(estimate, truth, covariance):
    error = (estimate * truth.inv()).as_rotvec()
    weight = np.linalg.inv(np.broadcast_to(covariance, (len(error), 3, 3)))
    return float(np.einsum("ni,nij,nj->n", error, weight, error).mean())


@pytest.fixture
def sky():
    generator = np.random.default_rng(7)
    truth = Rotation.from_quat(generator.standard_normal((COUNT, 4)))
    covariance = [head_covariance(one, ACROSS, ABOUT) for one in HEADS]
    return generator, truth, covariance


def test_normalised_errors_are_three(sky):
    generator, truth, covariance = sky
    seen = [drawn(one, generator) * truth for one in covariance]
    fused, stated = fuse(seen, covariance)
    assert nees(fused, truth, stated) == pytest.approx(3, abs=0.1)
    # Two heads at a wide angle are good about all axes, where each alone is poor about one.
    assert np.sqrt(np.diag(stated)).max() < 6 * arcsec


def test_common_errors_count_once(sky):
    generator, truth, covariance = sky
    shared = np.diag([4.0, 1.0, 9.0]) * arcsec**2
    common = drawn(shared, generator)
    seen = [common * drawn(one, generator) * truth for one in covariance]
    fused, stated = fuse(seen, covariance, shared)
    assert nees(fused, truth, stated) == pytest.approx(3, abs=0.1)
    counted_in_each = fuse(seen, [one + shared for one in covariance])[1]
    assert nees(fused, truth, counted_in_each) > 3.2


def test_a_drift_of_one_head_is_estimated(sky):
    """The second head drifts with the orbit; the covariance holds after its estimation alone."""
    generator, truth, covariance = sky
    phase = np.linspace(0, 60 * np.pi, COUNT)
    features = np.stack([np.ones(COUNT), np.cos(phase), np.sin(phase)], axis=1)
    drift = features @ (arcsec * np.array([[20, -10, 5], [15, 8, -12], [-6, 10, 9]]))
    first = drawn(covariance[0], generator) * truth
    second = Rotation.from_rotvec(drift) * drawn(covariance[1], generator) * truth
    assert (
        nees(*[fuse([first, second], covariance)[0], truth, fuse([first], covariance[:1])[1]]) > 4
    )
    model = relative_alignment(first, second, features)
    estimate, spread = model(features)
    assert np.abs(estimate - drift).max() < 2 * arcsec
    fused, stated = fuse(
        [first, model.corrected(second, features)], [covariance[0], covariance[1] + spread]
    )
    assert nees(fused, truth, stated) == pytest.approx(3, abs=0.1)
    assert model.noise == pytest.approx(covariance[0] + covariance[1], rel=0.1, abs=10 * arcsec**2)


def test_the_fast_variance_is_that_of_the_fusion():
    boresight = [one.as_matrix()[:, 2] for one in HEADS]
    valid = [np.array([True, True, False, False]), np.array([True, False, True, False])]
    across, about = (np.full(4, one) for one in (ACROSS, ABOUT))
    common = np.array([1.0, 2.0, 3.0]) * arcsec**2
    got = fused_variance(boresight, [across] * 2, [about] * 2, valid, common)
    each = [head_covariance(one, ACROSS, ABOUT) for one in HEADS]
    nothing = [Rotation.identity()] * 2
    assert got[:, 0] == pytest.approx(np.diag(fuse(nothing, each, np.diag(common))[1]), rel=1e-9)
    assert got[:, 1] == pytest.approx(np.diag(each[0]) + common, rel=1e-9)
    assert got[:, 2] == pytest.approx(np.diag(each[1]) + common, rel=1e-9)
    assert np.isinf(got[:, 3]).all()


def test_features_are_refused_by_name():
    attitudes = Rotation.identity(5)
    with pytest.raises(ValueError, match="more than their 5 columns"):
        relative_alignment(attitudes, attitudes, np.eye(5))
    with pytest.raises(ValueError, match="depend on each other"):
        relative_alignment(attitudes, attitudes, np.ones((5, 2)))
    with pytest.raises(ValueError, match="one or more, and as many"):
        fuse([attitudes], [])
