"""Errors of several heads -> covariance of their fused attitude; their relative alignment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Flags, Floats, Refused, printed


def fused_variance(
    boresights: Sequence[Floats],
    across: Sequence[Floats],
    about: Sequence[Floats],
    valid: Sequence[Flags],
    common: Floats,
    moved: Sequence[Floats] | None = None,
) -> Floats:
    """Variance of the fused attitude about the body's axes at n instants.

        P = (sum_h V_h^-1)^-1,   V_h^-1 = (I - b b^T) / across + b b^T / about
        P + M M^T + C,   M = P sum_h V_h^-1 S_h

    The sum is over the valid heads; b is the boresight of each. S_h is the response of a head to
    the motion of the platform, which all heads share. C is the covariance of errors that all heads
    share. If all S_h equal one matrix S, M is S: fusion does not reduce a common error, which
    counts once.

    boresights     (3,) unit vectors in body axes, of each head
    across, about  (n,) radian^2 of each head, independent between heads
    valid          (n,) of each head
    common         (3,) radian^2 about the body's axes
    moved          (n, 3, 3) radian of each head, as `platform_motion`; None: nothing
    Returns        (3, n) radian^2; infinite where no head is valid
    Accuracy       model: small errors, of the same size about all axes across a boresight; heads
                   exposed at one time; weights are for the independent parts of the errors.
    """
    xx, yy, zz, xy, xz, yz = (np.zeros(len(valid[0])) for _ in range(6))
    for b, square, square_about, here in zip(boresights, across, about, valid, strict=True):
        plane = here / square
        along = here / square_about - plane
        for total, value in (
            (xx, plane + b[0] * b[0] * along),
            (yy, plane + b[1] * b[1] * along),
            (zz, plane + b[2] * b[2] * along),
            (xy, b[0] * b[1] * along),
            (xz, b[0] * b[2] * along),
            (yz, b[1] * b[2] * along),
        ):
            total += value
    minors = np.stack([yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy])
    known = np.any(valid, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = xx * minors[0] - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
        fused = minors / size + common[:, None]
    if moved is not None:
        pull: Floats = np.zeros((len(known), 3, 3))
        for b, square, square_about, here, motion in zip(
            boresights, across, about, valid, moved, strict=True
        ):
            inverse = _inverse(b, here / square, here / square_about)
            pull += inverse @ motion
        total = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1).copy()
        total[~known] = np.eye(3)
        fused = fused + (np.linalg.solve(total, pull) ** 2).sum(axis=2).T
    return np.where(known, fused, np.inf)


def _inverse(boresight: Floats, across: Floats, about: Floats) -> Floats:
    """(n, 3, 3) with eigenvalues (n,) across and about a boresight."""
    outer = np.outer(boresight, boresight)
    return across[:, None, None] * (np.eye(3) - outer) + about[:, None, None] * outer


def platform_motion(camera_to_body: Floats, rms: Floats) -> Floats:
    """(..., 3, 3) radian, response of a head to unit motions of the platform about the body's axes.

        S = A diag(rms) A^T

    It is the symmetric root of the covariance. Heads whose designs have the same isotropic motion
    of the platform have the same S; each head keeps the rms of its own design.

    camera_to_body  (3, 3) matrix A
    rms             (..., 3) radian about the axes of the camera
    """
    return np.asarray((camera_to_body * rms[..., None, :]) @ camera_to_body.T)


def fuse(
    attitudes: Sequence[Rotation], covariances: Sequence[Floats], common: Floats | None = None
) -> tuple[Rotation, Floats]:
    """The attitude that fits several estimates of it best, by their covariances.

        x = P sum_h V_h^-1 log(q_h q_0^-1),   P = (sum_h V_h^-1)^-1,   q = exp(x) q_0

    repeated from q_0 = q_1 until it converges: the maximum of likelihood for small errors.
    Source: Markley and Crassidis (2014), Fundamentals of Spacecraft Attitude Determination and
    Control, section 5.5, for the error vector and its covariance.

    attitudes    icrs_to_body by each head, with its mounting; single or (n,) rotations each
    covariances  (3, 3) or (n, 3, 3) radian^2 of each, about the body's axes, without common parts
    common       (3, 3) radian^2 of the errors that they share, added once; None: none
    Returns      the attitude, and its covariance (3, 3) or (n, 3, 3)
    Raises       ValueError if there is no attitude, or not a covariance for each.
    """
    if not attitudes or len(attitudes) != len(covariances):
        raise Refused(
            "attitudes and covariances must be one or more, and as many, got "
            f"{len(attitudes)} and {len(covariances)}"
        )
    weight = [np.linalg.inv(covariance) for covariance in covariances]
    covariance = np.linalg.inv(np.sum(np.broadcast_arrays(*weight), axis=0))
    best = attitudes[0]
    for _ in range(3):
        pull = sum(
            np.einsum("...ij,...j->...i", inverse, (attitude * best.inv()).as_rotvec())
            for inverse, attitude in zip(weight, attitudes, strict=True)
        )
        best = Rotation.from_rotvec(np.einsum("...ij,...j->...i", covariance, pull)) * best
    return best, covariance if common is None else covariance + common


def head_covariance(camera_to_body: Rotation, across: float, about: float) -> Floats:
    """(3, 3) radian^2 about the body's axes, of a head with variances across and about."""
    axes = camera_to_body.as_matrix()
    return axes @ np.diag([across, across, about]) @ axes.T


@printed
@dataclass(frozen=True, eq=False)
class RelativeAlignment:
    """Alignment of a second head against a first, as a linear model of features.

        rotation vector = sum_k features_k coefficient_k,   about the body's axes

    coefficient  (k, 3) radian per unit of each feature
    covariance   (k, k) of the coefficients about each axis, over `noise`
    noise        (3, 3) radian^2, residual of the model for a single pair of attitudes
    """

    coefficient: Floats
    covariance: Floats
    noise: Floats

    def __call__(self, features: Floats) -> tuple[Floats, Floats]:
        """Rotation vectors (n, 3) in radian at (n, k) features, and their covariance (n, 3, 3)."""
        spread = np.einsum("nk,kj,nj->n", features, self.covariance, features)
        return features @ self.coefficient, spread[:, None, None] * self.noise

    def corrected(self, second: Rotation, features: Floats) -> Rotation:
        """Attitudes (n,) of the second head, corrected to agree with the first."""
        return Rotation.from_rotvec(-self(features)[0]) * second


def relative_alignment(first: Rotation, second: Rotation, features: Floats) -> RelativeAlignment:
    """Fit the difference of two heads by least squares over simultaneous attitudes.

    A drift that both heads share is not visible, and stays in the fused attitude.
    Features such as a temperature, its change, or sine and cosine of the orbit's phase describe a
    thermo-elastic drift; a column of ones is its bias.

    first, second  (n,) icrs_to_body by each head, with its assumed mounting
    features       (n, k), n > k
    Raises         ValueError if there are too few attitudes, or features that depend on each
                   other.
    Accuracy       model: rotations of arcseconds, whose noise does not depend on time; changes that
                   the features do not describe count as white noise.
    """
    features = np.atleast_2d(np.asarray(features, float))
    count, parts = features.shape
    if len(first) != count or len(second) != count or count <= parts:
        raise Refused(
            f"features must have a row for each of the attitudes, more than their {parts} columns, "
            f"got {count} for {len(first)} and {len(second)} attitudes"
        )
    scale = np.sqrt((features**2).mean(axis=0))
    if (scale == 0).any() or np.linalg.cond(features / np.where(scale, scale, 1)) > 1e8:
        raise Refused("features must not depend on each other, nor be zero")
    apart = (second * first.inv()).as_rotvec()
    coefficient = np.linalg.lstsq(features / scale, apart, rcond=None)[0] / scale[:, None]
    rest = apart - features @ coefficient
    noise = rest.T @ rest / (count - parts)
    inverse = np.linalg.inv((features / scale).T @ (features / scale))
    return RelativeAlignment(coefficient, inverse / np.outer(scale, scale), noise)
