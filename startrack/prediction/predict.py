"""Design file -> Prediction: median and intervals of each figure, and what makes their width."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from startrack.budget import PUBLISHED
from startrack.core import Advance, Floats, Refused, Unit, printed
from startrack.design import Told, Unknown, load_design
from startrack.prediction.draws import MIDDLE, Draw, draw_unknowns
from startrack.prediction.learn import Learned, learn
from startrack.prediction.surface import PredictionSurface, columns_of, fit_surface

DRAWS, UNITS = 32, 3  # of a prediction, and units of each draw; chosen by hand: 20 s on two cores
# Of the logarithm: all draws see the same 32 fields of the sky. What the middle is off with them
# corrects all, and leaves 2 % at most of three shipped designs (`BY_FIELDS` of draws.py).
COMMON = 0.02
AXES = ("across", "about")
SAMPLES = 8192  # of the surface: quantiles of 95 % are known to 3 % of the width
PARTS = 32  # of these, by the score of an unknown, whose means say what it makes of the variance
QUANTILES = (0.5, 0.16, 0.84, 0.025, 0.975)
ACCURACY = "and thermo-elastic: accuracy"  # the figure whose width is explained
OTHERS = "fields, units, and what is not linear"


class PredictedFigure(NamedTuple):
    """A figure as datasheets state it, about one axis: rms over units, radian per axis (1 sigma).

    figure   name in `PUBLISHED`, with the classes of error that it counts
    axis     "across" (per axis) or "about"
    middle   with all unknowns at their middle values
    median   over the unknowns
    low_68   16 % lie below
    high_68  84 % lie below
    low_95   2.5 % lie below
    high_95  97.5 % lie below
    causes   unknowns and the fraction of the variance of its logarithm that each makes alone,
             largest first
    """

    figure: str
    axis: str
    middle: float
    median: float
    low_68: float
    high_68: float
    low_95: float
    high_95: float
    causes: tuple[tuple[str, float], ...]

    @property
    def factor(self) -> float:
        """Factor about the median that holds 68 %: the root of the ratio of its ends."""
        return float(np.sqrt(self.high_68 / self.low_68))


@printed
@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted errors of a design with values that are not known.

    figures       each figure about each axis, of those that count a class of error of the design
    unknowns      with their laws
    age           second
    draws, units  number of draws, and units of each
    lost          fraction of the draws in which the design has no attitude anywhere, or a value
                  out of its limits; the figures are of the others
    reasons       why, with the number of draws
    availability  1, least, median and largest over the draws
    surface       of the classes of error
    learned       what told figures say of the unknowns; None: none was told
    """

    figures: tuple[PredictedFigure, ...]
    unknowns: tuple[Unknown, ...]
    age: Annotated[float, Unit("s", "yr")]
    draws: int
    units: int
    lost: float
    reasons: tuple[tuple[str, int], ...]
    availability: tuple[float, float, float]
    surface: PredictionSurface
    learned: Learned | None = None

    def figure(self, name: str, axis: str) -> PredictedFigure:
        """The figure of a name in `PUBLISHED` about an axis."""
        return next(
            figure for figure in self.figures if (figure.figure, figure.axis) == (name, axis)
        )


def predict(
    path: Path,
    changes: Sequence[str] = (),
    seed: int = 1,
    draws: int = DRAWS,
    units: int = UNITS,
    age: float | None = None,
    executor: Executor | None = None,
    progress: Advance | None = None,
    watch: Callable[[Draw], None] | None = None,
) -> Prediction:
    """Predict the errors of a design with values that are not known.

    Each draw has one value of each unknown, and the analytic budgets of a few units. A surface
    through the draws (`fit_surface`) gives the distribution of each figure. Where the design file
    has `[[told]]` figures, the unknowns are estimated under them first (`learn`).

    path      of the design file
    changes   values over those of the file, as for `load_design`
    age       second; None: the end of life
    executor  whose workers compute the draws; None: this process
    progress  called with 1 after each draw
    watch     called with the draw of the middle, before the others are computed
    Raises    Refused where nothing is unknown, or too few draws have an attitude.
    Accuracy  model: that of `unit_budgets` and `fit_surface`. numerical: of errors that are
              products of powers of 6 or 12 unknowns, with a scatter of 10 %, the ends of both
              intervals scatter by 2 % of its width with 32 draws.
    """
    design = load_design(path, changes)
    if not design.unknowns:
        raise Refused(
            f"{path} must have a value that is not known, such as f_number = {{ low = 1.2, "
            "high = 2.0 }, to be predicted with an interval; `startrack budget` has its error"
        )
    age = design.case.end_of_life if age is None else age
    made = draw_unknowns(path, seed, draws, units, age, changes, executor, progress, watch=watch)
    return prediction_of(made, seed, units, age, design.told, COMMON)


def prediction_of(
    draws: Sequence[Draw],
    seed: int,
    units: int,
    age: float,
    told: Sequence[Told] = (),
    common: float = 0.0,
) -> Prediction:
    """The prediction that draws give; units and age are those of the draws.

    told    figures under which the unknowns are estimated (`learn`); none: they have their laws
    common  error that all draws have in common, as in `fit_surface`
    """
    drawn = [draw for draw in draws if draw.number != MIDDLE]
    middle = next((draw for draw in draws if draw.number == MIDDLE), None)
    surface = fit_surface(drawn, common)
    learned = learn(surface, told, seed) if told else None
    quantiles = learned.quantiles(SAMPLES) if learned else surface.sample(seed, SAMPLES)
    scores = surface.scores(quantiles)
    errors = surface.scattered(surface.errors(scores), seed)
    figures = [
        _figure(surface, middle, name, axis, scores, errors)
        for name in PUBLISHED
        if surface.counted(PUBLISHED[name])
        for axis in range(len(AXES))
    ]
    lost = [draw.refused for draw in drawn if draw.refused]
    available = [draw.availability for draw in drawn if not draw.refused]
    least, most = min(available), max(available)
    return Prediction(
        tuple(figures),
        surface.unknowns,
        age,
        len(drawn),
        units,
        len(lost) / len(drawn),
        tuple(Counter(lost).most_common()),
        (least, float(np.median(available)), most),
        surface,
        learned,
    )


def _figure(
    surface: PredictionSurface,
    middle: Draw | None,
    name: str,
    axis: int,
    scores: Floats,
    errors: Floats,
) -> PredictedFigure:
    value = surface.figure(errors, PUBLISHED[name])[:, axis]
    as_designed = float("nan")
    if middle and not middle.refused:
        parts = [middle.terms[term][axis] for term in PUBLISHED[name] if term in middle.terms]
        as_designed = float(np.linalg.norm(parts))
    median, low_68, high_68, low_95, high_95 = np.quantile(value, QUANTILES).tolist()
    causes = _causes(surface, scores, np.log(value))
    return PredictedFigure(
        name, AXES[axis], as_designed, median, low_68, high_68, low_95, high_95, causes
    )


def _causes(
    surface: PredictionSurface, scores: Floats, logarithm: Floats
) -> tuple[tuple[str, float], ...]:
    """Fraction of the variance that each unknown makes alone, largest first.

        S_i = Var(E[y | x_i]) / Var(y)

    Source: Sobol (1993), Mathematical Modelling and Computational Experiment 1, 407; from means
    over parts of the given samples.
    """
    total, parts, first = float(logarithm.var()), list[tuple[str, float]](), 0
    for unknown in surface.unknowns:
        of_unknown = scores[:, first : first + columns_of(unknown)]
        first += columns_of(unknown)
        if unknown.choice:
            group = np.unique(of_unknown, axis=0, return_inverse=True)[1].ravel()
        else:
            group = np.argsort(np.argsort(of_unknown[:, 0])) * PARTS // len(of_unknown)
        sizes = np.bincount(group.astype(int))
        means = np.bincount(group.astype(int), logarithm)[sizes > 0] / sizes[sizes > 0]
        weight = sizes[sizes > 0] / len(of_unknown)
        between = float(weight @ (means - logarithm.mean()) ** 2)
        by_chance = (len(means) - 1) * (total - between) / len(of_unknown)
        parts.append((unknown.name, max(between - by_chance, 0.0) / total))
    rest = max(1 - sum(fraction for _, fraction in parts), 0.0)
    return tuple(sorted([*parts, (OTHERS, rest)], key=lambda cause: -cause[1]))
