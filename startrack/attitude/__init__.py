"""Matches into an attitude: Matches become an Estimate.

parameters     Attitude: how far the tracker trusts its centroids.
mounting       Mounting: how the camera sits on the spacecraft, and how that swings with the heat.
jacobi         The best rotation of a 3 x 3 matrix of products, by one-sided Jacobi turns: a
               kernel.
least_squares  Least squares in three unknowns without normal equations, which would square the
               condition.
wahba          Solvers of Wahba's problem: Davenport's eigenvector, SVD, QUEST and FOAM.
align          Many sets of matched unit vectors into attitudes that keep every digit the sets
               hold.
consensus      Which of the matched directions agree on one attitude, however wrong the others
               are.
refine         Gauss-Newton on the residuals in the image plane, and the covariance of the
               attitude.
solve          Spots and Matches enter; an Estimate leaves: attitude, covariance and status.
follow         Attitudes in time and the rates of a gyroscope into a filtered attitude and the
               rates' bias.
"""

from startrack.attitude.align import Alignment, Observability, align
from startrack.attitude.consensus import consensus
from startrack.attitude.follow import Gyroscope, State, correct, predict, start
from startrack.attitude.mounting import Mounting
from startrack.attitude.parameters import UNKNOWN_FLOOR, SolverSettings
from startrack.attitude.refine import Refinement, refine, tangent
from startrack.attitude.solve import scale_unknown, solve
from startrack.attitude.wahba import davenport, foam, quest, svd

# Public; the other imports serve other rooms.
__all__ = [
    "Alignment",
    "Gyroscope",
    "Mounting",
    "Observability",
    "Refinement",
    "SolverSettings",
    "State",
    "align",
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
