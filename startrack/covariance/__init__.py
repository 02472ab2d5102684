"""Trials whose spots are drawn, without an image; matches are taken as known, or are looked for.

response  what the detection makes of a star, by its flux and its place in the pixel
plan      what the trials of a case share, and what they refuse
star      a star in one trial: whether it is found, and where
trials    many trials at once, whose matches are taken as known
fit       their attitudes
spots     the Spots of one trial, for the identification
"""

from startrack.covariance.plan import plan_of, refuse
from startrack.covariance.spots import spots_of
from startrack.covariance.trials import outcomes

__all__ = ["outcomes", "plan_of", "refuse", "spots_of"]
