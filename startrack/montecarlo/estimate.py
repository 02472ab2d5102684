"""Values of trials, control variates, faster fidelities -> a mean with its standard error."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from startrack.core import Flags, Floats, Ints, Refused, Rows
from startrack.design import Fidelity
from startrack.metrics import Interval
from startrack.montecarlo.attitudes import REPLICATES
from startrack.montecarlo.sampling import squares

FOLDS = 8  # parts, each corrected with coefficients from the others; chosen by hand


class Mean(NamedTuple):
    """An unbiased estimate of a mean.

    value    in the unit of the values
    error    its standard error, likewise
    freedom  degrees of freedom of the error
    """

    value: float
    error: float
    freedom: float

    def interval(self, confidence: float = 0.95) -> Interval:
        """Student's interval."""
        half = float(special.stdtrit(self.freedom, (1 + confidence) / 2)) * self.error
        return Interval(self.value, self.value - half, self.value + half)

    def root(self, confidence: float = 0.95) -> Interval:
        """The interval of the root: for a mean of squares, the interval of the rms.

        With few values and a control, a mean square may be negative; its root is set to zero.
        """
        square = self.interval(confidence)
        return Interval(*(math.sqrt(max(end, 0.0)) for end in vars(square).values()))


def plain(values: Floats) -> Mean:
    """Mean of independent values (n,)."""
    n = len(values)
    return Mean(float(values.mean()), float(values.std(ddof=1)) / math.sqrt(n), n - 1)


def replicated(values: Floats, replicate: Ints) -> Mean:
    """Mean of values that are independent only between replicates (n,) of equal size.

    The scatter of the replicates' means is valid for any dependence of points within a replicate.
    """
    count = np.bincount(replicate)
    if len(np.unique(count[count > 0])) != 1:
        raise Refused("replicates must have equally many values")
    return plain(np.bincount(replicate, values)[count > 0] / count.max())


def controlled(values: Floats, controls: Floats) -> Mean:
    """Estimate from values (n,) with the help of controls (n, k) whose expectation is zero.

        mean of v - c b,   b by least squares from the other folds

    With b from the same values, the mean would have a bias of about 1 / n; with b from the other
    folds it has no bias.

    Source: Glasserman (2004), Monte Carlo Methods in Financial Engineering, section 4.1.
    """
    return plain(values - explained(values, controls))


def explained(values: Floats, controls: Floats) -> Floats:
    """The part (n,) of each value that the controls explain, with b from the other folds."""
    fold = np.arange(len(values)) % FOLDS
    part = np.empty(len(values))
    for number in range(FOLDS):
        mine = fold == number
        part[mine] = controls[mine] @ _slope(values[~mine], controls[~mine])
    return part


def two_levels(fine: Floats, coarse: Floats, rest: Mean, controls: Floats | None = None) -> Mean:
    """Mean of fine values (n,), with coarse values of the same trials and the coarse mean of
    others.

        mean(fine - b (coarse - rest)),   b from the other folds

    Source: Giles (2015), Acta Numerica 24, 259; Peherstorfer, Willcox and Gunzburger (2016), SIAM
    J. Sci. Comput. 38, A3163, for the weight b.

    rest      the mean of coarse values over other trials
    controls  (n, k) of the fine values, whose expectation is zero
    """
    beside = coarse[:, None] - rest.value
    if controls is not None:
        beside = np.column_stack([beside, controls])
    first = controlled(fine, beside)
    # All folds use the same rest, so they share its error.
    second = float(_slope(fine, beside)[0]) * rest.error
    error = math.hypot(first.error, second)
    freedom = error**4 / max(first.error**4 / first.freedom + second**4 / rest.freedom, 1e-300)
    return Mean(first.value, error, freedom)


def probability(happened: Flags, weight: Floats) -> Mean:
    """Probability of the event with its error, from trials with weights."""
    return plain(happened * weight)


def _slope(values: Floats, controls: Floats) -> Floats:
    centred = controls - controls.mean(axis=0)
    return np.asarray(np.linalg.lstsq(centred, values - values.mean(), rcond=None)[0], float)


FEWEST = 2 * FOLDS  # trials that a level needs


def mean_square(outcomes: Rows, about: bool = False, sobol: bool = False) -> Mean:
    """Radian^2, over trials with a correct attitude: across the boresight per axis, or about it.

        q = sum S / sum A,   error(q) = error(S - q A) / mean A

    S is the square of a trial's error, or 0 without a correct attitude; A is 1 with a correct
    attitude, else 0. A control is subtracted from S - q A.

    Source: Cochran (1977), Sampling Techniques, eq. (2.46), for the error of a ratio.

    outcomes  with `surplus_across` and `surplus_about` if trials have a control
    sobol     whether they are at the points of `by_sobol`: only complete rounds of all scrambles
              count
    Raises    nothing; NaN if too few trials have a correct attitude.
    Accuracy  numerical: a ratio is biased by 1 / n of its error's square.
    """
    if sobol:
        outcomes = _whole_rounds(outcomes)
    fraction = float(_correct(outcomes).mean()) if len(outcomes) else 0.0
    if len(outcomes) < FEWEST or fraction == 0:
        return Mean(math.nan, math.nan, 1.0)
    ratio = float(squares(outcomes, about).mean()) / fraction
    rest = _rest(outcomes, ratio, about)
    control = _control(outcomes, about)
    if control is not None:
        rest = rest - explained(rest, control)
    mean = replicated(rest, outcomes["trial"] % REPLICATES) if sobol else plain(rest)
    return Mean(ratio + mean.value / fraction, mean.error / fraction, mean.freedom)


def combined(levels: Sequence[tuple[Rows, Fidelity]], about: bool = False) -> Mean:
    """`mean_square` of the first level, with the help of faster levels that have more trials.

        mean(S0 - b S1) + b (mean(S1 - c S2) + c mean(S2))

    Each mean is over different trials, and b and c come from other trials. So there is no bias,
    even if the faster levels leave out effects. A trial of `spots` or `covariance` has other
    errors; its control is the variance that it states for its attitude.

    levels  outcomes at random attitudes, finest first, of the same case and seed; outcomes with a
            control also use it
    Raises  ValueError if a level has fewer than 16 separate trials, or shares fewer with the level
            before.
    """
    finest = levels[0][0]
    fraction = float(_correct(finest).mean()) if len(finest) else 0.0
    if fraction == 0:
        return Mean(math.nan, math.nan, 1.0)
    ratio = float(squares(finest, about).mean()) / fraction
    mean = _telescope(levels, ratio, about)
    return Mean(ratio + mean.value / fraction, mean.error / fraction, mean.freedom)


def _telescope(levels: Sequence[tuple[Rows, Fidelity]], ratio: float, about: bool) -> Mean:
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
    coarse_values = _value(coarse[of_coarse], faster, ratio, about)
    rest = _telescope(further, ratio, about)
    return two_levels(_value(fine, kind, ratio, about), coarse_values, rest, _control(fine, about))


def _value(outcomes: Rows, fidelity: Fidelity, ratio: float, about: bool) -> Floats:
    if fidelity in (Fidelity.FRAME, Fidelity.WINDOW):
        return _rest(outcomes, ratio, about)
    axes = "z" if about else "xy"
    stated = sum(outcomes[f"sigma_{axis}"] ** 2 for axis in axes) / len(axes)
    return np.where(_correct(outcomes), stated - ratio, 0.0)


def _rest(outcomes: Rows, ratio: float, about: bool) -> Floats:
    return squares(outcomes, about) - ratio * _correct(outcomes)


def _control(outcomes: Rows, about: bool) -> Floats | None:
    """(n, 1) of trials that have one."""
    name = "surplus_about" if about else "surplus_across"
    return outcomes[name][:, None] if name in (outcomes.dtype.names or ()) else None


def _correct(outcomes: Rows) -> Flags:
    return np.asarray(outcomes["solved"] & ~outcomes["false"])


def _whole_rounds(outcomes: Rows) -> Rows:
    """Without the points of incomplete rounds."""
    turn, points = np.unique(outcomes["trial"] // REPLICATES, return_counts=True)
    return outcomes[np.isin(outcomes["trial"] // REPLICATES, turn[points == REPLICATES])]
