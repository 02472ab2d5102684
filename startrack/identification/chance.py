"""A match enters; a bound on the probability that chance alone makes such a match leaves.

Under chance the spots lie anywhere. A hypothesis puts two spots onto two stars, which fixes the
attitude and the scale; these two say nothing. Each other spot then lies within a radius r of one
of the m other stars in the image of area A with a probability p, and

    P(k matches or more) <= h P(Binomial(n - 2, p) >= k - 2),   p = (m - 2) pi (2 r)^2 / A

h is the number of hypotheses that there are: pairs of spots times pairs of stars of the same
separation. Radii are doubled because the match is fitted to all its stars: if all lie within r
of the fit, then all lie within about 2 r of the hypothesis that puts the outermost two exactly.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def log_tail(n: int, k: int, p: float) -> float:  # pragma: no cover
    """ln P(X >= k) of a binomial X of n trials with probability p.

    Errors  numerical: 1e-12 relative to the logarithm's largest term.
    """
    if k <= 0 or p >= 1:
        return 0.0
    if k > n or p <= 0:
        return -math.inf
    log_p, log_q = math.log(p), math.log1p(-p)
    first = (
        (math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0))
        + k * log_p
        + (n - k) * log_q
    )
    total, term = 1.0, 1.0
    for i in range(k, n):  # each term from the one before it
        term *= (n - i) / (i + 1.0) * p / (1 - p)
        total += term
    return min(first + math.log(total), 0.0)


@njit(cache=True, error_model="numpy")
def log_chance(
    matches: int, spots: int, stars: int, disc: float, log_hypotheses: float
) -> float:  # pragma: no cover
    """ln of the bound above, at most 0.

    matches         k, of the spots
    spots           n, that voted
    stars           m, that the hypothesis predicts in the image
    disc            pi r^2 / A
    log_hypotheses  ln h
    """
    p = min(max(stars - 2, 1) * 4 * disc, 1.0)
    return min(log_hypotheses + log_tail(spots - 2, matches - 2, p), 0.0)


def log_hypotheses(spots: int, stars: int, separation: float, tolerance: float) -> float:
    """ln of how many hypotheses there are.

        h = n (n - 1) / 2  *  s * s / (4 pi) * 2 pi theta * 2 tolerance theta

    spots       n, that form patterns
    stars       s, that form patterns, all over the sky
    separation  theta, radian, largest of a base: where most pairs are
    tolerance   relative, of a separation
    """
    pairs = stars * stars * separation**2 * tolerance
    return math.log(max(spots * (spots - 1) / 2 * pairs, 1.0))
