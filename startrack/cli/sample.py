"""`startrack sample`: the tolerance of each parameter of a design."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from startrack.cli.options import Exit, Options, WrongUse, as_wrong_use, study, wanted

if wanted(__name__):
    from startrack import optimise, plots
    from startrack.cli.campaign import open_runner, read_study, unmet_text, write_study
    from startrack.cli.terminal import print_result, progress
    from startrack.core import arcsec
    from startrack.design import DesignSpace


declare = Options(
    "Samples the designs around the given design that meet its requirements and whose error is "
    "larger by at most the fraction `margin` of [campaign]. Unknown values with laws are also "
    "sampled, with the laws as priors. Writes tolerance.md, corner.png, samples.csv and "
    "result.json. If the chains did not converge, nothing is written, and the status is 3.",
    *study("sample"),
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write tolerance.md, corner.png, samples.csv and result.json."""
    opened = read_study(options)
    if unmet := unmet_text(opened):
        raise WrongUse(unmet)
    case, campaign = opened.design.case, opened.campaign
    with as_wrong_use(path=opened.path):
        priors = optimise.priors_of(opened.design, campaign)
    own = {variable.name for variable in campaign.variables}
    more = [prior.variable for prior in priors if prior.variable.name not in own]
    variables = (*campaign.variables, *more)
    with (
        open_runner(options, opened, "sampling around") as runner,
        progress("designs", optimise.designs_needed(len(variables))) as advance,
    ):
        campaign = replace(campaign, variables=variables)
        space = DesignSpace(case, variables, campaign.links)
        source = optimise.TrackerSource(space, campaign, runner, priors=priors)
        tolerance = optimise.sample(source, advance)
    return write_tolerance(options, tolerance, {"limit_arcsec": tolerance.limit / arcsec})


def write_tolerance(
    options: argparse.Namespace, tolerance: optimise.Tolerance, limit: dict[str, Any]
) -> int:
    """Print a tolerance region and write it; if the chains have not converged, only the reason."""
    values = limit | optimise.tolerance_values(tolerance)
    if not tolerance.chains.converged:
        reason = tolerance.chains.reason_unconverged
        print_result(options, {"converged": False, "doubt": reason}, f"not converged: {reason}")
        return Exit.UNSOLVED
    table = optimise.tolerance_table(tolerance)
    optimise.write_samples(options.out / "samples.csv", tolerance)
    plots.draw_tolerance(options.out / "corner.png", tolerance)
    result = {"out": str(options.out), "seed": options.seed, **values}
    write_study(options, "tolerance", table, result)
    return Exit.DONE
