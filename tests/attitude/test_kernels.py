"""The kernels of three unknowns against numpy's decompositions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.attitude.align import _loss
from startrack.attitude.linear import best_rotation, invert, largest_eigenvalue, least_squares

pytestmark = pytest.mark.usefixtures("in_python")


def matrices(count=50):
    return np.random.default_rng(1).standard_normal((count, 3, 3))


def test_the_largest_eigenvalue_is_numpys():
    for m in [*matrices(), np.eye(3), np.diag([1.0, 1, 3]), np.zeros((3, 3))]:
        symmetric = m + m.T
        wanted = np.linalg.eigvalsh(symmetric)[-1]
        assert largest_eigenvalue(symmetric) == pytest.approx(wanted, rel=1e-7, abs=1e-7)


def test_the_inverse_of_a_triangle_is_numpys():
    for m in matrices():
        triangle, inverse = np.triu(m) + 2 * np.eye(3), np.full((3, 3), np.nan)
        invert(triangle, inverse)
        np.testing.assert_allclose(inverse, np.linalg.inv(triangle), rtol=1e-9, atol=1e-12)


def test_least_squares_are_numpys():
    rng = np.random.default_rng(2)
    for _ in range(50):
        columns, triangle, step = rng.standard_normal((4, 9)), np.zeros((3, 3)), np.empty(3)
        a, target = columns[:3].T.copy(), columns[3].copy()
        least_squares(columns, triangle, step)
        np.testing.assert_allclose(step, np.linalg.lstsq(a, target)[0], rtol=1e-9)
        np.testing.assert_allclose(triangle.T @ triangle, a.T @ a, rtol=1e-9, atol=1e-12)
        assert (np.tril(triangle, -1) == 0).all()


def products():
    """Matrices of full rank, mirrored ones, of rank two, one and none."""
    turned = Rotation.random(rng=np.random.default_rng(3)).as_matrix()
    special = [
        np.diag(d) for d in ([3.0, 2, 1], [3.0, 2, -1], [3.0, 2, 0], [3.0, 0, 0], [0.0, 0, 0])
    ]
    return [*matrices(), *special, *(turned @ d for d in special), *(d @ turned for d in special)]


def test_the_best_rotation_has_the_trace_of_numpys_decomposition():
    """trace(R^T B) is the sum of the singular values, with the smallest subtracted if B mirrors."""
    for b in products():
        rotation = np.full((3, 3), np.nan)
        first = best_rotation(b.copy(), rotation)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(rotation) == pytest.approx(1)
        u, s, vt = np.linalg.svd(b)
        most = s[0] + s[1] + s[2] * np.sign(np.linalg.det(u) * np.linalg.det(vt))
        assert np.trace(rotation.T @ b) == pytest.approx(most, abs=1e-13)
        assert np.linalg.norm(b.T @ first) == pytest.approx(s[0], abs=1e-13)


def test_of_rank_one_the_second_axis_is_any_at_right_angles():
    """The first axis follows the single direction to the last digits; the second is at right
    angles."""
    rng = np.random.default_rng(4)
    for one, other in rng.standard_normal((200, 2, 3)):
        rotation = np.full((3, 3), np.nan)
        first = best_rotation(np.outer(one, other), rotation)
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=2e-15)
        np.testing.assert_allclose(rotation @ other, one, atol=2e-15)
        assert abs(first @ one) == pytest.approx(1, abs=1e-15)


def test_the_loss_curves_as_its_second_derivative_does():
    """Markley's loss is -trace(M) + const, M = sum w b (R r)^T, with the second derivative trace(M)
    I - (M + M^T) / 2.

    The attitudes are random, so that none to all three of its eigenvalues are negative.
    """
    rng = np.random.default_rng(5)
    negative = []
    for a in Rotation.random(300, rng=rng).as_matrix():
        b, r = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 4, 3)))
        w = rng.uniform(0.2, 1, 4)
        p = r @ a.T
        information = w.sum() * np.eye(3) - (w[:, None] * p).T @ p
        loss, curved = _loss(b, r, w, a, np.linalg.inv(np.linalg.cholesky(information).T))
        m = (w[:, None] * b).T @ p
        eigenvalue = np.linalg.eigvalsh(np.trace(m) * np.eye(3) - (m + m.T) / 2)
        assert loss == pytest.approx(w @ ((b - p) ** 2).sum(axis=1) / 2, rel=1e-12)
        assert curved == (eigenvalue > 0).all()
        negative.append((eigenvalue < 0).sum())
    assert np.bincount(negative).min() > 10
