"""Matches into an attitude with its covariance.

parameters  Attitude: how far the tracker trusts its centroids
svd         the rotation that fits weighted directions best
refine      Gauss-Newton on pixel residuals, and the covariance
solve       Spots, Matches -> Estimate
"""

from startrack.attitude.parameters import Attitude
from startrack.attitude.refine import Refinement, refine
from startrack.attitude.solve import solve
from startrack.attitude.svd import svd

__all__ = ["Attitude", "Refinement", "refine", "solve", "svd"]
