"""Matches into an attitude: Matches become an Estimate.

parameters     SolverSettings: errors assumed of centroids, and when a star is left out.
mounting       Mounting: orientation of the camera on the spacecraft, with its thermo-elastic error.
jacobi         The best rotation of a 3 x 3 matrix of products, by one-sided Jacobi rotations.
least_squares  Least squares in three unknowns without normal equations, which would square the
               condition.
wahba          Solvers of Wahba's problem: Davenport's eigenvector, SVD, QUEST and FOAM.
align          Attitudes from many sets of matched unit vectors, to rounding error.
consensus      The largest set of matched directions that one attitude explains.
extension_method  Matched directions -> attitude and covariance, by code that is not part of
               startrack.
refine         Gauss-Newton on the residuals in the image plane, and the covariance of the
               attitude.
shared         Errors that the stars of a frame share -> what they add to the covariance of an
               attitude.
solve          Estimate from Spots and Matches: attitude, covariance and status.
camera         Identified frames of one camera -> the camera model that fits them all.
follow         Filtered attitude and gyroscope bias from attitudes in time and gyroscope rates.
"""

from startrack.attitude.align import Alignment, Observability, align
from startrack.attitude.camera import UNKNOWNS, Calibrated, Calibration, calibrate, camera_slopes
from startrack.attitude.consensus import consensus
from startrack.attitude.extension_method import AttitudeInput, AttitudeMethod
from startrack.attitude.follow import Gyroscope, State, correct, predict, start
from startrack.attitude.mounting import Mounting
from startrack.attitude.parameters import UNKNOWN_FLOOR, SolverSettings
from startrack.attitude.refine import Refinement, refine, tangent
from startrack.attitude.shared import SharedErrors, attitude_gain
from startrack.attitude.solve import scale_unknown, solve
from startrack.attitude.wahba import davenport, foam, quest, svd

# Public; the other imports serve other rooms.
__all__ = [
    "Alignment",
    "AttitudeInput",
    "AttitudeMethod",
    "Calibrated",
    "Calibration",
    "Gyroscope",
    "Mounting",
    "Observability",
    "Refinement",
    "SharedErrors",
    "SolverSettings",
    "State",
    "align",
    "calibrate",
    "consensus",
    "correct",
    "davenport",
    "foam",
    "predict",
    "quest",
    "refine",
    "solve",
    "start",
    "svd",
]
