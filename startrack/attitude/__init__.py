"""Attitude estimation: Matches become an Estimate.

parameters  SolverSettings: errors assumed of centroids, and when a star is left out; Mounting of
            the camera on the spacecraft, with its thermo-elastic error.
linear      The best rotation of a 3 x 3 matrix of products, by one-sided Jacobi rotations; least
            squares in three unknowns, without normal equations (they would square the condition).
wahba       Solvers of Wahba's problem: Davenport's eigenvector, SVD, QUEST and FOAM.
align       Attitudes from many sets of matched unit vectors, to rounding error.
consensus   The largest set of matched directions that one attitude explains.
refine      Gauss-Newton on the residuals in the image plane, and the covariance of the attitude,
            with the errors that the stars of a frame share.
solve       Estimate from Spots and Matches: attitude, covariance and status; by user code.
camera      Identified frames of one camera -> the camera model that fits them all.
camera_filter  Matches of frames in sequence -> the estimated camera, with temperature terms.
follow      Kalman filter: attitudes and rates in time -> attitude, gyroscope bias, lasting errors.
"""

from startrack.attitude.align import Alignment, Observability, align
from startrack.attitude.camera import (
    UNKNOWNS,
    Calibrated,
    Calibration,
    MatchedFrame,
    calibrate,
    camera_slopes,
    camera_vector,
    huber_weights,
    matched_pixels,
    moved_camera,
    typical_square,
)
from startrack.attitude.camera_filter import CameraFilter, after_frame, attitude_doubt, first_camera
from startrack.attitude.follow import (
    Gyroscope,
    LastingErrors,
    MeasuredAttitude,
    State,
    correct,
    correct_together,
    predict,
    start,
)
from startrack.attitude.parameters import UNKNOWN_FLOOR, Mounting, SolverSettings
from startrack.attitude.refine import SharedErrors, attitude_gain, independent, refine, refine_all
from startrack.attitude.solve import FEWEST, AttitudeInput, KnownErrors, solve
from startrack.attitude.wahba import davenport, foam, quest, svd

# Public; the other imports serve other rooms.
__all__ = [
    "AttitudeInput",
    "CameraFilter",
    "KnownErrors",
    "Mounting",
    "SharedErrors",
    "SolverSettings",
    "after_frame",
    "align",
    "first_camera",
    "solve",
]
