"""`startrack predict`: the errors of a design with unknown values, with intervals."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import DESIGN, Exit, Option, Options, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack import plots
    from startrack.budget import PUBLISHED
    from startrack.cli import terminal
    from startrack.cli.files import design_file
    from startrack.cli.options import as_wrong_use
    from startrack.core import YEAR, arcsec
    from startrack.io import aligned, finite, save_json
    from startrack.montecarlo import pool
    from startrack.prediction import (
        ACCURACY,
        DRAWS,
        MODEL_ERROR,
        UNITS,
        Draw,
        Learned,
        PredictedFigure,
        Prediction,
        predict,
        save_posterior,
    )

MOST_CAUSES = 5  # largest number of causes in text; JSON has all
LEAST_CAUSE = 0.02  # least fraction of the variance of a printed cause


declare = Options(
    "Predicts the errors of a design with unknown values. Each unknown value has a law: f_number "
    "= { low = 1.2, high = 2.0 }, { median = 1.4, factor = 1.2 } or { among = [1.2, 1.4] }. "
    "Prints the median, the 68 and 95 % intervals, and the share of each unknown in their width. "
    "[[told]] figures of the design, measured or published, constrain the unknowns. With --out "
    "it writes prediction.json, prediction.png and, with [[told]] figures, posterior.toml: the "
    "design with posterior laws.",
    *DESIGN,
    Option("--draws N", "draws of all unknowns (default: 32)", whole(8, 10**4)),
    Option("--units N", "units of each draw (default: 3)", whole(1, 1000)),
    Option("--age TIME", 'age of the units, such as "3 yr" (default: the end of life)'),
    shared.SEED,
    shared.WORKERS,
    Option("--out DIR", "folder for prediction.json and prediction.png", Path),
    claims=True,
)


def command(options: argparse.Namespace) -> int:
    """Print the prediction; with --out, write prediction.json and prediction.png."""
    path = design_file(options.design or terminal.example())
    draws = options.draws or DRAWS
    age = terminal.age_of(options)
    with (
        as_wrong_use(path=path),
        pool(options.workers) as executor,
        terminal.progress("draws of what is not known", draws) as advance,
    ):
        prediction = predict(
            path,
            options.set,
            options.seed,
            draws,
            options.units or UNITS,
            age,
            executor,
            advance,
            _print_middle,
        )
    result = {"design": str(path), "seed": options.seed, **prediction_values(prediction)}
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        plots.draw_prediction(options.out / "prediction.png", prediction, Path(path).stem)
        save_json(options.out / "prediction.json", finite(result))
        if prediction.learned:
            save_posterior(options.out / "posterior.toml", path, prediction.learned)
            if options.set:
                terminal.print_message(
                    f"startrack: posterior.toml lies over {path}, without the changes of --set"
                )
        result["out"] = str(options.out)
    terminal.print_result(options, result, _text(prediction))
    return Exit.UNSOLVED if prediction.lost else Exit.DONE


def _print_middle(draw: Draw) -> None:
    """The error with medians, some seconds before the intervals."""
    if draw.refused:
        terminal.print_message(
            f"with every unknown at its median there is no error: {draw.refused}"
        )
        return
    terms = [draw.terms[term] for term in PUBLISHED[ACCURACY] if term in draw.terms]
    across, about = np.linalg.norm(terms, axis=0) / arcsec
    terminal.print_message(
        f"with every unknown at its median: accuracy {across:.3g} arcsec across and {about:.3g} "
        "about, rms per axis (1 sigma); intervals follow"
    )


def prediction_values(prediction: Prediction) -> dict[str, Any]:
    """A prediction for JSON, arcsecond per axis (1 sigma)."""
    return {
        "age_years": prediction.age / YEAR,
        "draws": prediction.draws,
        "units": prediction.units,
        "without_attitude": prediction.lost,
        "reasons": dict(prediction.reasons),
        "availability": dict(
            zip(("least", "median", "most"), prediction.availability, strict=True)
        ),
        "unknowns": {unknown.name: dict(unknown.law) for unknown in prediction.unknowns},
        "contradicted": dict(prediction.learned.contradicted) if prediction.learned else {},
        "learned": {
            posterior.unknown.name: dict(posterior.unknown.law) | {"narrowing": posterior.narrowing}
            for posterior in (prediction.learned.posteriors if prediction.learned else ())
        },
        "figures_arcsec": {
            name: {
                figure.axis: {
                    "middle": figure.middle / arcsec,
                    "median": figure.median / arcsec,
                    "68": [figure.low_68 / arcsec, figure.high_68 / arcsec],
                    "95": [figure.low_95 / arcsec, figure.high_95 / arcsec],
                    "causes": dict(figure.causes),
                }
                for figure in prediction.figures
                if figure.figure == name
            }
            for name in PUBLISHED
        },
    }


def prediction_answer(prediction: Prediction) -> str:
    """The accuracy with its intervals, and the unknown with the largest share of their width."""
    across, about = (prediction.figure(ACCURACY, axis) for axis in ("across", "about"))
    number = len(prediction.unknowns)
    learned = prediction.learned
    contradicted = [
        f"; CONTRADICTED: {name} was told, {factor:.3g} times what the design can have"
        for name, factor in (learned.contradicted if learned else ())
    ]
    return (
        f"accuracy, rms per axis (1 sigma): {across.median / arcsec:.3g} arcsec across "
        f"{_interval(across.low_68, across.high_68)} and {about.median / arcsec:.3g} about "
        f"{_interval(about.low_68, about.high_68)} in 68 %, at {prediction.age / YEAR:g} yr; "
        f"{across.causes[0][0]} has the largest share of the width across, "
        f"{across.causes[0][1]:.0%}, and {number} value{'s are' if number > 1 else ' is'} unknown"
        f"{''.join(contradicted)}"
    )


def _text(prediction: Prediction) -> str:
    across, about = (prediction.figure(ACCURACY, axis) for axis in ("across", "about"))
    rows = [["arcsec, rms per axis (1 sigma)", "axis", "middle", "median", "68 %", "95 %"]]
    rows += [
        [
            figure.figure,
            figure.axis,
            f"{figure.middle / arcsec:.3g}",
            f"{figure.median / arcsec:.3g}",
            _interval(figure.low_68, figure.high_68),
            _interval(figure.low_95, figure.high_95),
        ]
        for figure in prediction.figures
    ]
    lines = [
        prediction_answer(prediction),
        "",
        *aligned(rows, (0, 1)),
        "",
        *(f"width of the accuracy {one.axis}: {_causes(one)}" for one in (across, about)),
        "",
        "not known:",
        *(f"  {unknown.name}: {unknown}" for unknown in prediction.unknowns),
        *(_learned(prediction.learned) if prediction.learned else []),
    ]
    lines += [
        f"{count} of {prediction.draws} draws have no error and are left out: {reason}"
        for reason, count in prediction.reasons
    ]
    lines.append(
        f"availability {prediction.availability[1]:.2%} in the median, "
        f"{prediction.availability[0]:.2%} at least; {prediction.draws} draws of "
        f"{prediction.units} units each, by the formula, rms over units (`startrack budget` has "
        "their median); middle: with every unknown at its median; the intervals include "
        f"{MODEL_ERROR:.0%} for what no law describes, as published figures of trackers show"
    )
    return "\n".join(lines)


def _learned(learned: Learned) -> list[str]:
    """The posterior of each unknown by the told figures."""
    count = len(learned.told)
    figures = f"{count} told figure{'s' * (count != 1)}"
    lines = ["", f"after {figures}, which the intervals above include:"]
    lines += [
        f"  {posterior.unknown.name}: "
        + ("not constrained by the figures" if posterior.silent else f"{posterior.unknown}")
        + (f" ({posterior.shift:+.1f} sigma of its prior)" if posterior.far else "")
        for posterior in learned.posteriors
    ]
    if reason := learned.chains.reason_unconverged:
        lines.append(f"the sampling has not converged: {reason}")
    return lines


def _interval(low: float, high: float) -> str:
    return f"[{low / arcsec:.3g}, {high / arcsec:.3g}]"


def _causes(figure: PredictedFigure) -> str:
    """The largest causes of the width of an interval, in words."""
    largest = [cause for cause in figure.causes[:MOST_CAUSES] if cause[1] >= LEAST_CAUSE]
    return ", ".join(f"{name} {part:.0%}" for name, part in largest)
