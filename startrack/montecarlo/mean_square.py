"""Outcomes of a campaign, and of faster fidelities -> the mean square of its errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Refused
from startrack.design import Fidelity
from startrack.montecarlo.attitudes import REPLICATES
from startrack.montecarlo.estimate import FOLDS, Mean, explained, plain, replicated, two_levels
from startrack.montecarlo.sampling import squares

Outcomes = NDArray[np.void]

FEWEST = 2 * FOLDS  # trials that a level needs


def mean_square(outcomes: Outcomes, about: bool = False, sobol: bool = False) -> Mean:
    """Radian^2, over trials with a correct attitude: across the boresight per axis, or about it.

        q = sum S / sum A,   error(q) = error(S - q A) / mean A

    S the square of a trial's error, or 0 without a correct attitude; A whether it has one. A
    control is subtracted from S - q A.

    Source: Cochran (1977), Sampling Techniques, eq. (2.46), for the error of a ratio.

    outcomes  with `surplus_across` and `surplus_about` where trials have a control
    sobol     whether they are at the points of `by_sobol`: only whole rounds of all scrambles count
    Raises    NaN where too few trials have a correct attitude.
    Accuracy  numerical: a ratio is biased by 1 / n of its error's square.
    """
    if sobol:
        outcomes = _whole_rounds(outcomes)
    fraction = float(_correct(outcomes).mean()) if len(outcomes) else 0.0
    if len(outcomes) < FEWEST or fraction == 0:
        return Mean(math.nan, math.nan, 1.0)
    ratio = float(squares(outcomes, about).mean()) / fraction
    rest = _rest(outcomes, ratio, about)
    name = "surplus_about" if about else "surplus_across"
    if name in (outcomes.dtype.names or ()):
        rest = rest - explained(rest, outcomes[name][:, None])
    mean = replicated(rest, outcomes["trial"] % REPLICATES) if sobol else plain(rest)
    return Mean(ratio + mean.value / fraction, mean.error / fraction, mean.freedom)


def combined(levels: Sequence[tuple[Outcomes, Fidelity]], about: bool = False) -> Mean:
    """`mean_square` of the first level, with the faster ones that follow, each of more trials.

        mean(S0 - b S1) + b (mean(S1 - c S2) + c mean(S2))

    where each mean is over different trials, and b and c come from other trials, so that there is
    no bias, whatever the faster levels leave out. A trial of `spots` or `covariance` has other
    errors; its control is the variance that it states for its attitude.

    levels  outcomes at random attitudes, finest first, of the same case and seed; those with a
            control use it, too
    Raises  ValueError where a level has fewer than 16 separate trials, or shares fewer with the
            one before.
    """
    finest = levels[0][0]
    fraction = float(_correct(finest).mean()) if len(finest) else 0.0
    if fraction == 0:
        return Mean(math.nan, math.nan, 1.0)
    ratio = float(squares(finest, about).mean()) / fraction
    mean = _telescope(levels, ratio, about)
    return Mean(ratio + mean.value / fraction, mean.error / fraction, mean.freedom)


def _telescope(levels: Sequence[tuple[Outcomes, Fidelity]], ratio: float, about: bool) -> Mean:
    (fine, kind), *others = levels
    if len(fine) < FEWEST:
        raise Refused(f"{kind} must have at least {FEWEST} separate trials, got {len(fine)}")
    if not others:
        return plain(_value(fine, kind, ratio, about))
    coarse, faster = others[0]
    _, of_fine, of_coarse = np.intersect1d(fine["trial"], coarse["trial"], return_indices=True)
    if len(of_fine) < FEWEST:
        raise Refused(
            f"{kind} and {faster} must share at least {FEWEST} trials, got {len(of_fine)}"
        )
    fine = fine[of_fine]
    further = [(more[~np.isin(more["trial"], fine["trial"])], kind) for more, kind in others]
    name = "surplus_about" if about else "surplus_across"
    has_control = name in (fine.dtype.names or ())
    return two_levels(
        _value(fine, kind, ratio, about),
        _value(coarse[of_coarse], faster, ratio, about),
        _telescope(further, ratio, about),
        fine[name][:, None] if has_control else None,
    )


def _value(outcomes: Outcomes, fidelity: Fidelity, ratio: float, about: bool) -> Floats:
    if fidelity in (Fidelity.FRAME, Fidelity.WINDOW):
        return _rest(outcomes, ratio, about)
    axes = "z" if about else "xy"
    stated = sum(outcomes[f"sigma_{axis}"] ** 2 for axis in axes) / len(axes)
    return np.where(_correct(outcomes), stated - ratio, 0.0)


def _rest(outcomes: Outcomes, ratio: float, about: bool) -> Floats:
    return squares(outcomes, about) - ratio * _correct(outcomes)


def _correct(outcomes: Outcomes) -> NDArray[np.bool_]:
    return np.asarray(outcomes["solved"] & ~outcomes["false"])


def _whole_rounds(outcomes: Outcomes) -> Outcomes:
    """Without the points that not all scrambles have."""
    turn, found = np.unique(outcomes["trial"] // REPLICATES, return_counts=True)
    return outcomes[np.isin(outcomes["trial"] // REPLICATES, turn[found == REPLICATES])]
