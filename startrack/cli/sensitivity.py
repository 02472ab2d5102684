"""`startrack sensitivity`: which parameters the error of a design depends on."""

from __future__ import annotations

import argparse
import math

from startrack.cli.options import Exit, Option, Options, power_of_two, study, wanted

if wanted(__name__):
    from startrack import plots
    from startrack.cli.campaign import open_runner, read_study, write_study
    from startrack.cli.terminal import progress
    from startrack.design import DesignSpace
    from startrack.metrics import Column, Table
    from startrack.optimise import Sensitivity, TrackerSource, sensitivities, units_text


MEANING = (
    "Sobol indices of ln(objective) over the ranges of the variables, by forecasts, with "
    "95 % intervals of the emulator that they are computed with."
)

declare = Options(
    "Computes by the analytic budget the error with each variable at its bounds, its slope, and "
    "its Sobol indices over the ranges of all variables. Writes sensitivity.md, tornado.png and "
    "result.json.",
    *study("sensitivity"),
    Option(
        "--designs N",
        "number of designs over the ranges that the Sobol indices are computed "
        "from, a power of two",
        power_of_two,
        128,
    ),
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write sensitivity.md, tornado.png and result.json, all by the analytic budget."""
    opened = read_study(options)
    case, campaign = opened.design.case, opened.campaign
    with open_runner(options, opened, "computing the sensitivities of") as runner:
        space = DesignSpace(case, campaign.variables, campaign.links)
        count = 4 * len(space) + (options.designs if len(space) > 1 else 0)
        with progress("forecasts", count) as advance:
            source = TrackerSource(space, campaign, runner)
            studied = sensitivities(source, options.designs, advance)
    over = campaign.over_units(case)
    objective = units_text(over, campaign) if over else str(campaign.goal)
    return write_sensitivities(options, studied, space.labels(), objective, "arcsec", "_arcsec")


def write_sensitivities(
    options: argparse.Namespace,
    studied: list[Sensitivity],
    labels: dict[str, str],
    objective: str,
    unit: str,
    ending: str = "",
) -> int:
    """Print sensitivities and write them.

    ending  of fields of JSON that have the unit of the objective
    """
    shown = _table(studied, plots.with_unit(f"{objective} at its bounds", unit), labels, ending)
    table = "\n".join([*shown.markdown(), "", MEANING])
    plots.draw_tornado(options.out / "tornado.png", studied, objective, unit)
    variables = dict(zip((variable.name for variable in studied), shown.json(), strict=True))
    result = {"out": str(options.out), "objective": objective, "variables": variables}
    write_study(options, "sensitivity", table, result)
    return Exit.DONE


def _table(variables: list[Sensitivity], bounds: str, labels: dict[str, str], ending: str) -> Table:
    return Table(
        [
            Column("", "variable", lambda row: labels[row.name]),
            Column(f"low{ending}", "", lambda row: row.low),
            Column(f"high{ending}", "", lambda row: row.high),
            Column("", bounds, lambda row: f"{_text(row.low)} to {_text(row.high)}"),
            Column("slope", "", lambda row: row.slope),
            Column("", "d ln objective / d ln variable", lambda row: _slope(row.slope)),
            Column("first", "first-order index", lambda row: row.first, form=".2f"),
            Column("total", "total index", lambda row: row.total, form=".2f"),
        ],
        variables,
    )


def _slope(slope: float) -> str:
    return "none at zero" if math.isnan(slope) else f"{slope:+.2f}"


def _text(error: float) -> str:
    if not math.isfinite(error):
        return "no forecast"
    return f"{error:.3f}" if error >= 1 else f"{error:.3g}"
