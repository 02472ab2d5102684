"""Figures of commands over a design's unknown values: intervals, and fractions of draws that meet
limits."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from startrack.cli.options import Option, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack.cli.files import design_file
    from startrack.cli.predict import prediction_answer, prediction_values
    from startrack.cli.terminal import progress
    from startrack.core import Refused, arcsec
    from startrack.design import load_design
    from startrack.montecarlo import pool
    from startrack.prediction import DesignedDraws, draw_as_designed, predict

if TYPE_CHECKING:
    from startrack.core import Floats

QUANTILES = (0.5, 0.16, 0.84, 0.025, 0.975)
AXES = ("across", "about")
DRAWS = Option(
    "--draws N",
    "draws of unknown values, which give intervals to figures for their median (0: none)",
    whole(0, 10**4),
    32,
)


def draws_of(options: argparse.Namespace, path: Path) -> DesignedDraws | None:
    """Draws of a design's unknown values; None if all are known, or without draws."""
    path = design_file(path)
    if not options.draws or not load_design(path, options.set).unknowns:
        return None
    with progress("draws of what is not known", options.draws + 1) as advance:
        return draw_as_designed(path, options.seed, options.draws, options.set, advance)


def over_unknowns(values: Sequence[float], factors: Floats) -> dict[str, Any]:
    """Errors over the unknown values, for JSON: median and intervals, by axis.

    values   (2,) across and about, with all unknowns at their median
    factors  (n, 2) error of each draw over the error with all unknowns at their median; NaN: no
             attitude
    """
    seen = factors[~np.isnan(factors).any(axis=1)]
    if not len(seen):
        return {}
    found = dict[str, Any]()
    for axis, value, column in zip(AXES, values, seen.T, strict=True):
        median, *ends = (float(end) for end in np.quantile(value * column, QUANTILES))
        found[axis] = {"median": median, "68": ends[:2], "95": ends[2:]}
    return found


def errors_over_unknowns(
    drawn: DesignedDraws, errors: Sequence[float]
) -> tuple[dict[str, Any], list[str]]:
    """Errors of trials over the unknown values: values for JSON, arcsecond, and lines.

    errors  (2,) radian, across and about, with all unknowns at their median
    """
    found = over_unknowns([error / arcsec for error in errors], drawn.factors)
    values = {"unknowns": drawn.unknowns, "draws": len(drawn.draws), "without_attitude": drawn.lost}
    values |= {f"{axis}_arcsec": levels for axis, levels in found.items()}
    if not found:
        return values, [f"not known: none of {len(drawn.draws)} draws has an attitude"]
    across, about = (written(found[axis]) for axis in AXES)
    text = (
        f"over {drawn.unknowns} unknown values: {across} arcsec across and {about} about, rms "
        f"per axis; {len(drawn.draws)} draws; the error of a draw is the error above times the "
        "ratio of its error to the median's by the formula"
    )
    return values, [text + lost_text(drawn)]


def units_over_unknowns(
    options: argparse.Namespace, path: Path, age: float | None = None
) -> tuple[dict[str, Any], list[str]]:
    """The accuracy of units over the unknown values, as `startrack predict` computes it.

    age      second; None: the end of life
    Returns  values for JSON, and lines; without an accuracy, a line with the reason
    """
    title = "draws of what is not known"
    with pool(options.workers) as executor, progress(title, options.draws) as advance:
        try:
            sure = predict(
                design_file(path),
                options.set,
                options.seed,
                options.draws,
                age=age,
                executor=executor,
                progress=advance,
            )
        except Refused as error:
            return {"refused": str(error)}, [f"no interval over the unknown values: {error}"]
    return prediction_values(sure), [f"with all unknown values, {prediction_answer(sure)}"]


def lost_text(drawn: DesignedDraws) -> str:
    """Number of omitted draws, as the end of a sentence."""
    return f"; {drawn.lost} draws have no attitude and are left out" if drawn.lost else ""


def written(levels: dict[str, Any]) -> str:
    """A median with its 68 and 95 % intervals."""
    (low, high), (least, most) = levels["68"], levels["95"]
    return (
        f"{levels['median']:.3g} [{low:.3g}, {high:.3g}] in 68 % and [{least:.3g}, {most:.3g}] "
        "in 95 %"
    )


def limits_text(drawn: DesignedDraws) -> str:
    """Number of draws that meet each requirement, in words; one sentence for requirements that all
    draws meet."""
    open_ = {name: n for name, n in drawn.count_met().items() if n < len(drawn.draws)}
    if not open_:
        return f"by the formula all {len(drawn.draws)} draws meet all requirements"
    parts = ", ".join(f"{name} in {number}" for name, number in open_.items())
    others = "" if len(open_) == len(drawn.count_met()) else ", all else in all"
    return f"by the formula of {len(drawn.draws)} draws meet their limits: {parts}{others}"
