"""Outcome of one trial from its estimate and the true attitude."""

import typing
from typing import Annotated, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Estimate, Flags, Floats, Ints, Rows, Status, Unit, deg, printed

# An attitude farther from the truth is false. Chosen by hand: far above all noise and far below the
# error of a false match, so that the exact value hardly matters.
FALSE_ANGLE = 0.5 * deg
# Number of stated standard deviations; the tracker's statement does not cover a larger error. With
# a correct covariance, normal errors are larger in 4 of a million attitudes.
STATED = 5.0


class ErrorLimits(NamedTuple):
    """Largest error of a correct attitude, radian; None without a requirement.

    across  angle between the estimated and the true boresight
    about   size of the rotation about it
    """

    across: float | None = None
    about: float | None = None


STATED_ALONE = ErrorLimits()


@printed
class Outcome(NamedTuple):
    """Result of one trial; angles in radian, in the camera's axes, NaN where unsolved.

    error_x, error_y  about the camera's x and y axes: across the boresight
    error_z           about the boresight
    sigma_x, _y, _z   standard deviations that the tracker states
    nees              1, normalised estimation error squared; its mean is 3 where the stated
                      covariance is correct
    stars             number of matched stars
    spots             number of detected spots
    solved            whether there is an attitude
    false             whether that attitude is false: more than half a degree from the truth
    """

    error_x: Annotated[float, Unit("rad", "arcsec")]
    error_y: Annotated[float, Unit("rad", "arcsec")]
    error_z: Annotated[float, Unit("rad", "arcsec")]
    sigma_x: Annotated[float, Unit("rad", "arcsec")]
    sigma_y: Annotated[float, Unit("rad", "arcsec")]
    sigma_z: Annotated[float, Unit("rad", "arcsec")]
    nees: float
    stars: int
    spots: int
    solved: bool
    false: bool


def correct(outcomes: Rows, limits: ErrorLimits = STATED_ALONE) -> Flags:
    """Trials that have a correct attitude.

        across: hypot(x, y) <= required,   or hypot(x / sigma_x, y / sigma_y) <= 5 where nothing is
        about:  |z| <= required,           or |z| / sigma_z <= 5

    A correct trial is solved, less than half a degree off, and within the required errors; without
    a requirement, within five of the standard deviations that the tracker states.

    outcomes  (n,) structured array with the fields of `Outcome`
    Returns   (n,)
    """
    x, y, z = (outcomes[f"error_{axis}"] for axis in "xyz")
    if limits.across is None:
        with np.errstate(divide="ignore", invalid="ignore"):  # nothing stated covers no error
            good = np.hypot(x / outcomes["sigma_x"], y / outcomes["sigma_y"]) <= STATED
    else:
        good = np.hypot(x, y) <= limits.across
    if limits.about is None:
        good &= np.abs(z) <= STATED * outcomes["sigma_z"]
    else:
        good &= np.abs(z) <= limits.about
    return np.asarray(good & outcomes["solved"] & ~outcomes["false"])


JUDGED = np.dtype(list(typing.get_type_hints(Outcome).items()))


def judge(estimate: Estimate, truth: Rotation, spots: int) -> Outcome:
    """Compare with the true attitude at the middle of the exposure.

        error = rotation vector of estimate * truth^-1, in camera axes

    truth    icrs_to_camera
    spots    number of detected spots
    Returns  Outcome
    """
    if estimate.status is not Status.SOLVED or estimate.icrs_to_camera is None:
        n = float("nan")
        return Outcome(
            error_x=n,
            error_y=n,
            error_z=n,
            sigma_x=n,
            sigma_y=n,
            sigma_z=n,
            nees=n,
            stars=estimate.stars,
            spots=spots,
            solved=False,
            false=False,
        )
    error = (estimate.icrs_to_camera * truth.inv()).as_rotvec()
    x, y, z = error.tolist()
    sigma_x, sigma_y, sigma_z = np.sqrt(np.diag(estimate.covariance)).tolist()
    nees = float(error @ np.linalg.solve(estimate.covariance, error))
    false = bool(np.linalg.norm(error) > FALSE_ANGLE)
    return Outcome(
        error_x=x,
        error_y=y,
        error_z=z,
        sigma_x=sigma_x,
        sigma_y=sigma_y,
        sigma_z=sigma_z,
        nees=nees,
        stars=estimate.stars,
        spots=spots,
        solved=True,
        false=false,
    )


def judge_all(
    estimate: Rotation, covariance: Floats, truth: Rotation, stars: Ints, spots: Ints, solved: Flags
) -> Rows:
    """`judge` of many trials.

    estimate, truth  m rotations each
    covariance       (m, 3, 3) radian^2; ignored where not solved
    stars, spots     (m,) number of matched stars and of detected spots
    solved           (m,) whether there is an attitude
    Returns          (m,) structured array with the fields of `Outcome`
    """
    judged = np.zeros(len(stars), JUDGED)
    error = np.where(solved[:, None], (estimate * truth.inv()).as_rotvec(), np.nan)
    valid = np.where(solved[:, None, None], covariance, np.eye(3))
    sigma = np.sqrt(np.diagonal(valid, axis1=1, axis2=2))
    for k, axis in enumerate("xyz"):
        judged[f"error_{axis}"] = error[:, k]
        judged[f"sigma_{axis}"] = np.where(solved, sigma[:, k], np.nan)
    judged["nees"] = np.einsum("ni,ni->n", error, np.linalg.solve(valid, error[..., None])[..., 0])
    judged["stars"], judged["spots"], judged["solved"] = stars, spots, solved
    judged["false"] = np.linalg.norm(error, axis=1) > FALSE_ANGLE
    return judged
