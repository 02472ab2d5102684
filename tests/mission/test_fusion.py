"""Fused attitudes have the error that their covariance states."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import arcsec
from startrack.mission.engine import own_errors
from startrack.mission.fusion import (
    fuse,
    fused_variance,
    head_covariance,
    platform_motion,
    relative_alignment,
)
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


@pytest.mark.slow
def test_a_drift_of_one_head_is_estimated(sky):
    """The second head drifts with the orbit; the covariance is right only after the drift's
    estimation."""
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


def test_one_motion_of_the_platform_stays_whole_in_the_fusion():
    """20,000 realisations of a motion that both heads see, fused as rotations.

    A variance of that number of draws has a standard error of 1 %; the limit is five of them: false
    alarms of 3e-6.
    """
    generator, jitter = np.random.default_rng(11), 2.03 * arcsec
    truth = Rotation.from_quat(generator.standard_normal((COUNT, 4)))
    covariance = [head_covariance(one, ACROSS, ABOUT) for one in HEADS]
    motion = Rotation.from_rotvec(jitter * generator.standard_normal((COUNT, 3)))
    seen = [drawn(one, generator) * motion * truth for one in covariance]
    error = (fuse(seen, covariance)[0] * truth.inv()).as_rotvec()
    moved = [platform_motion(one.as_matrix(), np.full((1, 3), jitter)) for one in HEADS]
    boresight = [one.as_matrix()[:, 2] for one in HEADS]
    arrays = [np.full(1, ACROSS)] * 2, [np.full(1, ABOUT)] * 2, [np.full(1, True)] * 2
    stated = fused_variance(boresight, *arrays, np.zeros(3), moved)[:, 0]
    assert np.abs((error**2).mean(axis=0) / stated - 1).max() < 0.05
    assert stated == pytest.approx(
        fused_variance(boresight, *arrays, np.zeros(3))[:, 0] + jitter**2, rel=1e-9
    )
    # Independent between heads, it would be less about two axes: what was wrong.
    alone = np.full(1, ACROSS + jitter**2), np.full(1, ABOUT + jitter**2)
    apart = fused_variance(boresight, [alone[0]] * 2, [alone[1]] * 2, arrays[2], np.zeros(3))
    assert (stated / apart[:, 0]).max() > 1.1


def test_a_motion_that_heads_see_unequally_has_one_cause():
    """For heads with different designs: the square of a sum, not the sum of squares."""
    generator, rms = np.random.default_rng(12), np.array([[3.0, 1.0, 2.0], [0.5, 0.5, 4.0]])
    axes = [one.as_matrix() for one in HEADS]
    covariance = [head_covariance(one, ACROSS, ABOUT) for one in HEADS]
    cause = generator.standard_normal((COUNT, 3))
    gain = np.linalg.inv(sum(np.linalg.inv(one) for one in covariance))
    error = np.zeros((COUNT, 3))
    for one, own, size in zip(axes, covariance, rms * arcsec, strict=True):
        root = sum(np.outer(axis, axis) * rms for axis, rms in zip(one.T, size, strict=True))
        noise = generator.standard_normal((COUNT, 3)) @ np.linalg.cholesky(own).T
        error += (noise + cause @ root) @ np.linalg.inv(own) @ gain
    moved = [platform_motion(one, size[None]) for one, size in zip(axes, rms * arcsec, strict=True)]
    boresight = [one[:, 2] for one in axes]
    arrays = [np.full(1, ACROSS)] * 2, [np.full(1, ABOUT)] * 2, [np.full(1, True)] * 2
    stated = fused_variance(boresight, *arrays, np.zeros(3), moved)[:, 0]
    assert np.abs((error**2).mean(axis=0) / stated - 1).max() < 0.05


def test_features_are_refused_by_name():
    attitudes = Rotation.identity(5)
    with pytest.raises(ValueError, match="more than their 5 columns"):
        relative_alignment(attitudes, attitudes, np.eye(5))
    with pytest.raises(ValueError, match="depend on each other"):
        relative_alignment(attitudes, attitudes, np.ones((5, 2)))
    with pytest.raises(ValueError, match="one or more, and as many"):
        fuse([attitudes], [])


def test_errors_of_a_head_without_its_platform_keep_what_trials_found():
    """(2 + 4) / 2 of 13 across, and 5 of 30 about, are the platform's, each with its own factor."""
    errors = (np.array([13.0, 13.0]), np.array([30.0, 4.0]), np.ones(2))
    moved = np.array([[2.0, 2.0], [4.0, 4.0], [5.0, 5.0]])
    ((across, about),) = own_errors(SimpleNamespace(errors=(errors,), moved=(moved,)))
    np.testing.assert_allclose(across, [10.0, 10.0])
    np.testing.assert_allclose(about, [25.0, 0.0], atol=1e-15)  # never below zero
    assert (about > 0).all()
    ((across, about),) = own_errors(SimpleNamespace(errors=(errors,), moved=None))
    assert (across[0], about[0]) == (13.0, 30.0)
