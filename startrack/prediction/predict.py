"""Design file -> Prediction: median and intervals of each figure, and causes of their width."""

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
from startrack.prediction.surface import PredictionSurface, columns_of, fit_surface, require_draws

DRAWS, UNITS = 32, 3  # draws, and units of each draw; chosen by hand: 20 s on two cores
# Error of the logarithm that all draws share, because all see the same 32 fields of the sky. All
# draws are corrected by the middle draw; at most 2 % remain for three shipped designs (`BY_FIELDS`
# of draws.py).
COMMON = 0.02
# Deviation that no law describes, of the logarithm of each class of error. With it, 68 and 95 %
# intervals contain these fractions of 37 published figures (`experiments/how_sure.py`); without it,
# those of errors without an unknown residual are too narrow.
MODEL_ERROR = 0.2
AXES = ("across", "about")
SAMPLES = 8192  # samples of the surface: 95 % quantiles are known within 3 % of the width
PARTS = 32  # parts of the samples by the score of an unknown; their means give its variance
QUANTILES = (0.5, 0.16, 0.84, 0.025, 0.975)
ACCURACY = "and thermo-elastic: accuracy"  # figure with an explained width
OTHERS = "the model itself, what is not linear, few fields or units"


class PredictedFigure(NamedTuple):
    """A figure as in datasheets, about one axis: rms over units, radian per axis (1 sigma).

    figure   name in `PUBLISHED`, with the classes of error that it counts
    axis     "across" (per axis) or "about"
    middle   value with all unknowns at their middle values
    median   median over the unknowns
    low_68   16 % lie below
    high_68  84 % lie below
    low_95   2.5 % lie below
    high_95  97.5 % lie below
    causes   unknowns, each with the fraction of the variance of the figure's logarithm that it
             causes alone; largest first
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
        """Factor around the median that contains 68 %: the root of the ratio of the ends."""
        return float(np.sqrt(self.high_68 / self.low_68))


@printed
@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted errors of a design with values that are not known.

    figures       each figure about each axis, if it counts a class of error of the design
    unknowns      unknowns with their laws
    age           second
    draws, units  number of draws, and number of units of each
    lost          fraction of the draws without an attitude anywhere, or with a value outside its
                  limits; the figures are those of the other draws
    reasons       reasons for lost draws, each with the number of draws
    availability  1, least, median and largest over the draws
    surface       surface of the classes of error
    learned       posterior distributions of the unknowns; None: no figure was told
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
    """Predict the errors of a design with unknown values.

    Each draw has one value of each unknown, and the analytic budgets of a few units. A surface
    through the draws (`fit_surface`) gives the distribution of each figure. If the design file has
    `[[told]]` figures, the unknowns are first estimated with them (`learn`). The figures also have
    the error of the model, MODEL_ERROR.

    path      path of the design file
    changes   values that replace those of the file, as for `load_design`
    age       second; None: the end of life
    executor  executor whose workers compute the draws; None: this process
    progress  called with 1 after each draw
    watch     called with the middle draw, before the others are computed
    Raises    Refused if nothing is unknown, if the draws are too few for the unknowns, which is
              refused before the first draw, or if too few draws have an attitude.
    Accuracy  model: as `unit_budgets` and `fit_surface`. numerical: with 32 draws, the ends of both
              intervals scatter by 2 % of the width. This was measured for errors that are products
              of powers of 6 or 12 unknowns, with a scatter of 10 %.
    """
    design = load_design(path, changes)
    if not design.unknowns:
        raise Refused(
            f"{path} must have an unknown value, such as f_number = {{ low = 1.2, "
            "high = 2.0 }, for a prediction with an interval; `startrack budget` gives its error"
        )
    require_draws(draws, len(design.unknowns), len(design.unknowns))
    age = design.case.end_of_life if age is None else age
    made = draw_unknowns(path, seed, draws, units, age, changes, executor, progress, watch=watch)
    return prediction_of(made, seed, units, age, design.told, COMMON, MODEL_ERROR)


def prediction_of(
    draws: Sequence[Draw],
    seed: int,
    units: int,
    age: float,
    told: Sequence[Told] = (),
    common: float = 0.0,
    model: float = 0.0,
) -> Prediction:
    """The prediction from draws; units and age are those of the draws.

    told    figures with which the unknowns are estimated (`learn`); none: prior distributions
    common  error that all draws share, as in `fit_surface`
    model   error of the model, as in `scattered`; it is no part of the estimate of the unknowns
    """
    drawn = [draw for draw in draws if draw.number != MIDDLE]
    middle = next((draw for draw in draws if draw.number == MIDDLE), None)
    surface = fit_surface(drawn, common)
    learned = learn(surface, told, seed) if told else None
    quantiles = learned.quantiles(SAMPLES) if learned else surface.sample(seed, SAMPLES)
    scores = surface.scores(quantiles)
    errors = surface.scattered(surface.errors(scores), seed, model)
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
        figures=tuple(figures),
        unknowns=surface.unknowns,
        age=age,
        draws=len(drawn),
        units=units,
        lost=len(lost) / len(drawn),
        reasons=tuple(Counter(lost).most_common()),
        availability=(least, float(np.median(available)), most),
        surface=surface,
        learned=learned,
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
        figure=name,
        axis=AXES[axis],
        middle=as_designed,
        median=median,
        low_68=low_68,
        high_68=high_68,
        low_95=low_95,
        high_95=high_95,
        causes=causes,
    )


def _causes(
    surface: PredictionSurface, scores: Floats, logarithm: Floats
) -> tuple[tuple[str, float], ...]:
    """Fraction of the variance by each unknown alone, largest first.

        S_i = Var(E[y | x_i]) / Var(y)

    These are Sobol's first-order indices, from means over parts of the given samples.

    Source: Sobol (1993), Mathematical Modelling and Computational Experiment 1, 407.
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
