"""Laws of unknown values of a design -> variables of a sampling, with the density of each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused
from startrack.design import Campaign, Case, Design, Unknown, Variable, quantity, replaced

SIGMAS = (3.0, 2.5, 2.0, 1.5, 1.0)  # ends of a law that are tried, in sigma; chosen by hand


class LawPrior(NamedTuple):
    """A variable with the law that it has in the design file.

    first, second  SI: low and high of a uniform law; or the median, and the factor of the 68 %
                   interval
    """

    variable: Variable
    unknown: Unknown
    first: float
    second: float

    @property
    def uniform(self) -> bool:
        """Whether the law is uniform; else it is normal in the logarithm."""
        return "low" in self.unknown.law

    def log_density(self, value: Floats) -> Floats:
        """Logarithm of the density at values (n,), SI, up to a constant; minus infinity outside.

        On the scale of the variable, linear or logarithmic.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithm = np.log(value)
            if self.uniform:
                inside = (self.first <= value) & (value <= self.second)
                density = np.where(inside, 0.0, -np.inf)
            else:
                score = (logarithm - math.log(self.first)) / math.log(self.second)
                density = np.where(value > 0, -(score**2) / 2 - logarithm, -np.inf)
        return density + logarithm if self.variable.scale == "log" else density


def priors_of(design: Design, campaign: Campaign) -> list[LawPrior]:
    """The numbers that a design does not know, each with its law as a prior.

    A number that the campaign varies keeps its bounds. Other numbers have bounds from their law:
    the ends of a uniform law; for other laws up to three sigma on either side, as far as the design
    accepts the value. A number that conditions of the campaign draw is left out.
    """
    by_name = {variable.name: variable for variable in campaign.variables}
    others = () if campaign.unknown_draws else design.open_unknowns
    case, found = design.case, list[LawPrior]()
    for unknown in design.unknowns:
        if unknown.choice or not (unknown.name in by_name or unknown in others):
            continue
        law, name = unknown.law, unknown.name
        first = _si(case, unknown, law["low"] if "low" in law else law["median"])
        second = _si(case, unknown, law["high"]) if "low" in law else float(law["factor"])
        variable = by_name.get(name) or _variable(case, unknown)
        found.append(LawPrior(variable, unknown, first, second))
    return found


def _si(case: Case, unknown: Unknown, value: float | str) -> float:
    return quantity(case, unknown.name, value)


def _variable(case: Case, unknown: Unknown) -> Variable:
    law, name = unknown.law, unknown.name
    if "low" in law:
        return Variable(name, law["low"], law["high"])
    return Variable(name, _end(case, unknown, -1), _end(case, unknown, 1), "log")


def _end(case: Case, unknown: Unknown, side: int) -> float | str:
    """The farthest value on one side of a law that a design accepts."""
    median = unknown.numbers(np.array([0.5]))[0]
    refused: Refused | None = None
    for sigmas in SIGMAS:
        value = unknown.written(median * unknown.law["factor"] ** (side * sigmas))
        try:
            replaced(case, unknown.name, _si(case, unknown, value))
        except Refused as error:
            refused = error
        else:
            return value
    assert refused
    raise refused
