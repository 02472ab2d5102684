"""Problem: the interface of everything that the engines search, sample or test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from startrack.core import POSITIVE, Parameters, Range, Refused, Rows, parameter
from startrack.problem.values import Bounds, Expectation, Judgement, Margin, Words


class SearchSettings(Protocol):
    """Settings of a search; a campaign has these keys."""

    @property
    def search(self) -> str:
        """Search of designs: "emulator", or algorithms of nlopt."""

    @property
    def precision(self) -> float:
        """Relative change of the objective below which no further evaluation is made."""

    @property
    def analytic_evaluations(self) -> int:
        """Forecasts at most before the first trial."""

    @property
    def evaluations(self) -> int:
        """Designs at most that are tried by trials."""

    @property
    def trials(self) -> int:
        """Trials of each design at first."""

    @property
    def most_trials(self) -> int:
        """Trials of each of the best designs."""

    @property
    def fresh_trials(self) -> int:
        """Fresh trials on which start and best are compared at the end."""

    @property
    def margin(self) -> float:
        """Fraction by which the objective may grow in the tolerance region."""

    @property
    def span(self) -> float:
        """Half the width of that region's box, as a fraction of each variable's range."""


class Settings(Parameters):
    """Settings of a search."""

    search: str = parameter(
        'how designs are chosen: "emulator", or algorithms of nlopt, such as "direct+sbplx"',
        default="emulator",
    )
    precision: float = parameter(
        "fraction of the objective that is worth no further evaluation",
        limit=Range(1e-4, 0.5),
        default=0.01,
    )
    analytic_evaluations: int = parameter(
        "designs at most that the forecast evaluates, before the first trial",
        limit=Range(0, 10**6),
        default=300,
    )
    evaluations: int = parameter(
        "designs at most that are tried by trials", limit=Range(1, 10**6), default=20
    )
    trials: int = parameter("of each design at first", limit=Range(2, 10**6), default=200)
    most_trials: int = parameter(
        "of each of the best designs at last", limit=Range(2, 10**6), default=800
    )
    fresh_trials: int = parameter(
        "on which start and best are compared at the end", limit=Range(2, 10**6), default=1000
    )
    margin: float = parameter(
        "fraction by which the objective may grow in the tolerance region of `sample`",
        limit=POSITIVE,
        default=0.2,
    )
    span: float = parameter(
        "half the width of that region's box, as a fraction of each variable's range",
        limit=Range(0.001, 0.5),
        default=0.15,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.most_trials < self.trials:
            raise Refused(f"most_trials must be at least trials, {self.trials}")


class Problem(Protocol):
    """A design with an objective to be minimised and limits to be met.

    It must be possible to pickle it, so that workers can run its trials.
    """

    @property
    def columns(self) -> np.dtype[Any]:
        """Names and types of a row of one trial."""

    @property
    def variables(self) -> Sequence[Bounds]:
        """Variables of a search."""

    @property
    def settings(self) -> SearchSettings:
        """Settings of the search."""

    def replaced(self, values: Mapping[str, float]) -> Problem:
        """The problem with other values (SI); Refused if one does not fit."""

    def costs(self) -> Mapping[str, Margin]:
        """Margins that need neither forecast nor trial."""

    def expect(self) -> Expectation:
        """Expectation by formula. Raises Refused if there is no answer."""

    def trials(self, seed: int, numbers: range) -> Rows:
        """A row for each number, the same for any worker and any order."""

    def judge(self, rows: Rows, confidence: float = 0.95) -> Judgement:
        """Judgement of the rows of trials, with intervals of a confidence."""

    def described(self) -> str:
        """Text of all settings on which results depend."""

    def text(self) -> Words:
        """Names and units."""
