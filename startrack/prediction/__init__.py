"""Uncertainty of predictions: designs with unknown values -> errors with intervals.

draws    Design file -> draws of its unknown values, with the classes of error of each draw's units.
as_designed  Design file -> errors of the unit as designed, by formula, in draws of its unknowns.
surface  Draws -> response surface: the logarithm of each class of error, linear in the scores of
         the unknowns.
learn    Surface and told figures -> the posterior distribution of each unknown.
predict  Design file -> Prediction: median and intervals of each figure, and causes of their width.
"""

from startrack.prediction.as_designed import DesignedDraw, DesignedDraws, draw_as_designed
from startrack.prediction.draws import MIDDLE, Draw, draw_unknowns, drawn_cases
from startrack.prediction.learn import TERMS, Learned, Posterior, learn, save_posterior, save_told
from startrack.prediction.predict import (
    ACCURACY,
    AXES,
    DRAWS,
    MODEL_ERROR,
    OTHERS,
    UNITS,
    PredictedFigure,
    Prediction,
    predict,
    prediction_of,
)
from startrack.prediction.surface import PredictionSurface, fit_surface

# Public; the other imports serve other rooms.
__all__ = [
    "DesignedDraw",
    "DesignedDraws",
    "Draw",
    "Learned",
    "Posterior",
    "PredictedFigure",
    "Prediction",
    "PredictionSurface",
    "draw_as_designed",
    "draw_unknowns",
    "drawn_cases",
    "fit_surface",
    "learn",
    "predict",
    "prediction_of",
    "save_posterior",
    "save_told",
]
