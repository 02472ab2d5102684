"""Matches into an attitude with its covariance, and attitudes in time into a better one.

parameters     Attitude: how far the tracker trusts its centroids
mounting       how the camera sits on the spacecraft
solve          Spots, Matches -> Estimate
refine         Gauss-Newton on pixel residuals, with a covariance for each centroid
align          many sets of unit vectors -> attitudes to the last digit, covariance, observability
scale          covariance where the camera's scale was fitted with the attitude
consensus      which matches agree, however wrong the others are
follow         gyroscope rates and attitudes in time -> filtered attitude and gyroscope bias

The textbook's solvers, each for one set of vectors or for many:

svd            singular values of the vectors' products
davenport      eigenvector of a 4 x 4 matrix, the q-method
quest          its characteristic polynomial, with sequential rotations
foam           a polynomial of the matrix of products

products       what these start from
jacobi         kernel: the best rotation of a 3 x 3 matrix
least_squares  kernel: three unknowns without normal equations
"""

from startrack.attitude.align import Alignment, Observability, align
from startrack.attitude.consensus import consensus
from startrack.attitude.davenport import davenport
from startrack.attitude.foam import foam
from startrack.attitude.follow import Gyroscope, State, correct, predict, start
from startrack.attitude.mounting import Mounting
from startrack.attitude.parameters import Attitude
from startrack.attitude.quest import quest
from startrack.attitude.refine import Refinement, refine
from startrack.attitude.solve import solve
from startrack.attitude.svd import svd

__all__ = [
    "Alignment",
    "Attitude",
    "Gyroscope",
    "Mounting",
    "Observability",
    "Refinement",
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
