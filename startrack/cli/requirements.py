"""`startrack requirements`: margins of a design to its requirements; figures of Earth cameras."""

from __future__ import annotations

import argparse
import math

from startrack.cli.imports import wanted
from startrack.cli.options import Exit, WrongUse, add_campaign, describe

if wanted(__name__):
    from startrack.budget import caveats
    from startrack.cli.earth_requirements import earth_requirements
    from startrack.cli.terminal import example, print_result, read_design
    from startrack.core import arcsec
    from startrack.design import Objective
    from startrack.optimise import expect, expected_objective, units_text

EARTH_TOO = (
    "; or an Earth camera (sentinel2-msi, landsat8-oli, landsat8-tirs, waoss, hsrs, mertis, ads40 "
    "or a scene file), to print its ground resolution, MTF, SNR, dynamic range and data rate "
    "beside what is required and measured; or a file with a table [goals] "
    "(catalogs/scenes/goals.toml), to compute focal length, aperture and pixel rate"
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack requirements`."""
    describe(
        parser,
        "Prints the margin of each requirement and the error by the analytic budget. The status "
        "is 3 if a requirement is not met.",
    )
    add_campaign(parser, EARTH_TOO)


def command(options: argparse.Namespace) -> int:
    """Print the margins of a design and its error by the analytic budget."""
    earth = earth_requirements(options)
    if earth is not None:
        return earth
    path = options.campaign or example()
    design = read_design(path, options.set)
    campaign = design.campaign
    if campaign is None:
        raise WrongUse(f"{path} must have a table [campaign] with requirements")
    budget, margins = expect(design.case, campaign)
    over = campaign.over_units(design.case)
    objective = units_text(over, campaign) if over else str(Objective.read(campaign.objective))
    error = expected_objective(design.case, campaign) / arcsec
    # No requirement is met by what is no number.
    met = all(math.isfinite(margin) and margin >= 0 for margin in margins.values())
    needs = campaign.requirements
    costs = {
        "mass_kg": needs.mass(design.case),
        "volume_m3": needs.volume(design.case),
        "power_w": needs.power(design.case),
        "data_rate_bit_per_s": needs.data_rate(design.case),
        "cost": needs.cost(design.case),
    }
    result = {"design": str(path), "met": met, "margins": margins, **costs}
    result |= {"objective": objective, "expected_arcsec": error, "stars": budget.stars}
    result |= {"not_counted": budget.left_out, "refused_as_hot_pixels": budget.refused}
    limits = {
        one.name: {"limit_arcsec": one.most / arcsec, "statistic": str(one.objective)}
        for one in needs.accuracy
    }
    result |= {"accuracy": limits} if limits else {}
    width = max(20, *(len(name) for name in margins))
    lines = [f"{'requirement':{width}} {'margin':>8}"]
    lines += [
        f"{name:{width}} {margin:+8.3f}{'' if margin >= 0 else '  NOT MET'}"
        for name, margin in margins.items()
    ]
    lines += [
        "",
        *(f"{name.replace('_', ' '):24} {value:.4g}" for name, value in costs.items()),
        "",
        *(
            f"{name} is limited to {one['limit_arcsec']:g} arcsec, {one['statistic']}"
            for name, one in limits.items()
        ),
        f"expected {objective}: {error:.3f} arcsec with {budget.stars:.1f} stars; errors and "
        "availability by the analytic budget. Margins are fractions of the limits; "
        "that of stars is in mag.",
        *caveats(design.case, budget.left_out, budget.refused),
    ]
    print_result(options, result, "\n".join(lines))
    return Exit.DONE if met else Exit.UNSOLVED
