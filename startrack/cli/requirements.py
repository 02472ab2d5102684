"""`startrack requirements`: margins of a design to its requirements; figures of Earth cameras."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from startrack.cli.options import Exit, Options, WrongUse, as_wrong_use, campaign, wanted

if wanted(__name__):
    from startrack.budget import caveats, refusal
    from startrack.cli.files import GOALS, SCENE, SEARCH, kind_of, shipped_by_name
    from startrack.cli.terminal import example, print_result, read_design, sections, stage
    from startrack.core import Refused, arcsec, deg, um
    from startrack.design import COSTS, NOMINAL, Campaign, Case, Requirements, bounds_of, branches
    from startrack.earth import imager
    from startrack.earth.retrieval import EarthProblem, load_earth_design
    from startrack.io import aligned, from_table, read_table, recalled
    from startrack.optimise import ExpectedDesign, expect, expected_objective
    from startrack.problem import Expectation, Problem
    from startrack.verification import cost_margins, limited, needed_magnitude

EARTH_TOO = (
    "; or an Earth camera (sentinel2-msi, landsat8-oli, landsat8-tirs, waoss, hsrs, mertis, "
    "ads40 or a scene file), to print its ground resolution, MTF, SNR, dynamic range and data "
    "rate with required and measured values, and the margins of its retrieval; or a search for "
    "moving objects (asteroidfinder), to print its margins; or a file with a table [goals] "
    "(catalogs/scenes/goals.toml), to compute focal length, aperture and pixel rate"
)

HEADING = ["requirement", "value", "limit", "margin", ""]
PACE = 0.5  # pixel over all stages; a larger mismatch is reported; chosen by hand


declare = Options(
    "Prints the margin of each requirement and the error by the analytic budget. The status is 3 "
    "if a requirement is not met.",
    *campaign(EARTH_TOO),
)


def command(options: argparse.Namespace) -> int:
    """Print the margins of a design, a scene or a search, by formula."""
    path = options.campaign or example()
    actions = {None: _tracker, SEARCH: _search, SCENE: _scene, GOALS: _first_camera}
    return actions.get(kind_of(path), _tracker)(options, path)


def _tracker(options: argparse.Namespace, path: Path) -> Exit:
    """Print the margins of a star tracker and its error by the analytic budget."""
    design = read_design(path, options.set)
    campaign, case = design.asked, design.case
    if campaign is None:
        raise WrongUse(f"{path} must have a table [campaign] with requirements")
    with as_wrong_use(path=path):
        for branch in branches(case, campaign.choices):
            bounds_of(branch.case, campaign.variables)
    needs, show = campaign.requirements, sections(options)
    margins = cost_margins(needs, case)
    result = {"design": str(path), "met": False, "margins": margins, **_costs(case, needs)}
    show(_costs_answer(case, needs))
    try:
        with stage("error budget"):
            expected, error = recalled(_expected)(case, campaign)
    except Refused as blind:
        show(f"no forecast: {blind}")
        result |= {"refused": {NOMINAL: str(blind)}}
    else:
        result |= {"met": all(map(_met, expected.margins.values())), "margins": expected.margins}
        result |= _forecast_values(campaign, case, expected, error)
        _show_forecast(show, campaign, case, expected, error)
    if options.json:
        print_result(options, result)
    return Exit.DONE if result["met"] else Exit.UNSOLVED


def _costs(case: Case, needs: Requirements) -> dict[str, float]:
    return {
        "mass_kg": needs.mass(case),
        "volume_m3": needs.volume(case),
        "power_w": needs.power(case),
        "data_rate_bit_per_s": needs.data_rate(case),
        "cost": needs.cost(case),
    }


def _forecast_values(
    campaign: Campaign, case: Case, expected: ExpectedDesign, error: float
) -> dict[str, Any]:
    """The objective, the limits on errors, and what the formula leaves out, for JSON."""
    values: dict[str, Any] = {
        "objective": campaign.goal_of(case),
        "expected_arcsec": error,
        "stars": expected.budget.stars,
        "not_counted": expected.budget.left_out,
        "refused_as_hot_pixels": expected.budget.refused,
        "refused": expected.refused,
    }
    limits = {
        limit.name: {"limit_arcsec": limit.most / arcsec, "statistic": str(limit.objective)}
        for limit in campaign.requirements.accuracy
    }
    return values | ({"accuracy": limits} if limits else {})


def _show_forecast(
    show: Callable[[str], None],
    campaign: Campaign,
    case: Case,
    expected: ExpectedDesign,
    error: float,
) -> None:
    """Print the objective, conditions without a forecast, and the margins with notes."""
    needs, budget = campaign.requirements, expected.budget
    value = f"{error:.3f} arcsec, by formula" if math.isfinite(error) else "no forecast"
    kept = sum(map(_met, expected.margins.values()))
    show(f"{campaign.goal_of(case)}: {value}; {kept} of {len(expected.margins)} requirements met")
    for sentence in refusal(case, budget.refused):
        show(sentence)
    for condition, reason in expected.refused.items():
        show(f"no forecast in the condition {condition}: {reason}")
    show("\n".join(aligned([HEADING, *_rows(case, needs, expected)], (0, 4))))
    lines = [
        *(
            f"{limit.name} is limited to {limit.most / arcsec:g} arcsec, {limit.objective}"
            for limit in needs.accuracy
        ),
        f"Errors and availability by the analytic budget, with {budget.stars:.1f} stars. Margins "
        "are fractions of the limits; the margin of stars is in mag: detection limit minus the "
        f"limit for {needs.min_stars} stars in {100 * needs.sky_fraction:g} % of the sky.",
        *caveats(case, budget.left_out),
    ]
    show("\n".join(lines))


def _search(options: argparse.Namespace, path: Path) -> Exit:
    """Print the objective and the margins of a search for moving objects."""
    # Star trackers do not need this import.
    problems = import_module("startrack.cli.problems")
    return _study(options, problems.problem_of(path, options.set))


def _expected(case: Case, campaign: Campaign) -> tuple[ExpectedDesign, float]:
    """Budget and margins by the formula, and the error that the campaign names, arcsec."""
    return expect(case, campaign), expected_objective(case, campaign) / arcsec


def _met(margin: float) -> bool:
    return math.isfinite(margin) and margin >= 0  # NaN meets no requirement


def _verdict(margin: float) -> str:
    return "" if margin >= 0 else "NOT MET"


def _costs_answer(case: Case, needs: Requirements) -> str:
    """A sentence on the limits of costs and update rate, which need no forecast."""
    margins = cost_margins(needs, case)
    limits = {name: limited(needs, name, margin) for name, margin in margins.items()}
    texts = [
        f"{name} {value} ({limit} {'required' if name == 'update rate' else 'allowed'})"
        for name, (value, limit) in limits.items()
        if limit
    ]
    kept = sum(map(_met, margins.values()))
    return f"{kept} of {len(margins)} limits on costs met: {', '.join(texts)}; errors follow"


def _rows(case: Case, needs: Requirements, expected: ExpectedDesign) -> list[list[str]]:
    """A row for each requirement: name, value, limit, margin and verdict."""
    needed = needed_magnitude(case, needs.min_stars, needs.sky_fraction)
    margins, rows = expected.margins, list[list[str]]()
    for name, margin in margins.items():
        value, limit = expected.value_and_limit(needs, name, needed)
        shown = "" if value == "no forecast" else f"{margin:+.3f}"
        rows.append([name, value, limit, shown, _verdict(margin)])
    rows += [
        [name, f"{cost:.4g} {unit.removesuffix('1')}".strip(), "no limit", "", ""]
        for name, unit in COSTS.items()
        if name not in margins and (cost := needs.cost_named(name, case)) > 0
    ]
    return rows + [
        [f"{body} keep-out", "", f"{angle / deg:g} deg", "", "judged by startrack verify"]
        for body, angle in needs.min_keep_out.angles.items()
    ]


def _study(options: argparse.Namespace, problem: Problem) -> Exit:
    """Print the objective of a scene or a search and the margins of its limits, by formula."""
    words, refused = problem.text(), ""
    _ = problem.variables  # refuses bounds of a wrong unit or order
    try:
        expected = problem.expect()
    except Refused as reason:  # costs, and figures of channels, do not need the formula
        expected, refused = Expectation(math.nan, {}), str(reason)
    margins = {**problem.costs(), **expected.margins}
    met = not refused and all(margin.relative >= 0 for margin in margins.values())
    result = {
        "met": met,
        "objective": words.value,
        "expected": expected.value,
        "unit": words.unit,
        "margins": {name: margin.relative for name, margin in margins.items()},
        "refused": refused,
        "not_counted": list(expected.left_out),
    }
    rows = [
        [
            name,
            margin.value_text,
            margin.limit_text,
            f"{margin.relative:+.3f}",
            _verdict(margin.relative),
        ]
        for name, margin in margins.items()
    ]
    value = f"{expected.value:.4g} {words.unit}".strip() + ", by formula"
    value = f"no forecast: {refused}" if refused else value
    kept, left_out = sum(not row[-1] for row in rows), "; ".join(expected.left_out)
    print_result(
        options,
        result,
        f"{words.value}: {value}; {kept} of {len(rows)} requirements met"
        + (" of those that need no forecast" if refused else ""),
        "",
        *aligned([HEADING, *rows], (0, 4)),
        *([f"not counted: {left_out}"] if left_out else []),
    )
    return Exit.DONE if met else Exit.UNSOLVED


def _first_camera(options: argparse.Namespace, path: Path) -> Exit:
    """Print the parameters of the smallest camera that meets a file of goals."""
    file = shipped_by_name(path, [GOALS.folder])
    with as_wrong_use(path=file):
        if options.set:
            raise ValueError("--set must be left out for a file of goals")
        goals: Any = read_table(file, "a file of goals")
        first = imager.first_parameters(from_table(imager.Goals, goals["goals"], "goals"))
        print_result(options, {"goals": str(path), **asdict(first)}, *_first_text(first))
    return Exit.DONE


def _scene(options: argparse.Namespace, path: Path) -> Exit:
    """Print the figures of each channel of a scene, and the margins of its retrieval, if any."""
    file, status = shipped_by_name(path, [SCENE.folder]), Exit.DONE
    with as_wrong_use(path=file):
        design = load_earth_design(file, options.set)
        if design.retrieval and design.campaign:
            status = _study(options, EarthProblem(design))
        for channel, height, figures in imager.figures_of(design):
            margins = imager.margins_of(channel, figures)
            if any(margin < 0 for margin in margins.values()):
                status = Exit.UNSOLVED
            result = {
                "channel": channel.name,
                "height_m": height,
                **asdict(figures),
                "exposure": _exposure(channel, figures),
                "required": imager.known(channel.required),
                "measured": imager.known(channel.measured),
                "margins": margins,
            }
            print_result(options, result, *_figures_text(channel, figures, height, margins))
    return status


def _first_text(first: imager.First) -> list[str]:
    """The parameters of the smallest camera that meets the goals."""
    return [
        f"focal length  {1e3 * first.focal_length:.4g} mm",
        f"aperture      {1e3 * first.aperture:.4g} mm, f/{first.f_number:.3g}: for Rayleigh "
        f"{1e3 * first.for_rayleigh:.4g} mm, MTF {1e3 * first.for_mtf:.4g} mm, "
        f"SNR {1e3 * first.for_snr:.4g} mm",
        f"line          {first.columns} pixel every {1e3 * first.period:.4g} ms, exposed "
        f"{1e3 * first.exposure:.4g} ms: {first.electrons:.4g} electrons",
        f"pixel rate    {first.clock / 1e6:.4g} Mpixel / s, {first.data_rate / 1e6:.4g} Mbit / s",
    ]


def _figures_text(
    channel: imager.Channel, figures: imager.Figures, height: float, margins: dict[str, float]
) -> list[str]:
    bits = math.log2(figures.dynamics)
    beside = {name: _beside(channel, name) for name in vars(channel.required)}
    missed = [name for name, margin in margins.items() if margin < 0]
    edge = ""
    if figures.illumination is not None:
        edge = f", lowest over the field; light {100 * figures.illumination:.1f} % of the middle's"
    if channel.detector.scan and channel.detector.scan.kind == "staggered":
        edge += ", at half a cycle per pixel; staggered lines sample twice as finely"
    if channel.restore is not None:
        edge += f", after a Wiener filter for SNR {channel.restore:g}"
    amplified = "" if figures.amplified == 1 else f", times {figures.amplified:.3g} by the filter"
    step = "" if figures.nedt is None else f", NEdT {1e3 * figures.nedt:.4g} mK{beside['nedt']}"
    return [
        f"{channel.name} from {height / 1e3:.4g} km",
        f"  pixel on the ground  {figures.gsd:.4g} m, every {figures.sampling_across:.4g} m "
        f"across{beside['gsd']} and {figures.sampling_along:.4g} m along",
        f"  swath                {figures.swath / 1e3:.4g} km, "
        f"{math.degrees(figures.field):.2f} deg",
        f"  Rayleigh             {figures.rayleigh:.4g} m on the ground",
        f"  MTF at Nyquist       {figures.mtf_across:.3f} across, {figures.mtf_along:.3f} along"
        f"{beside['mtf']}{edge}",
        f"  SNR                  {figures.snr:.4g} at {figures.radiance * um:.4g} "
        f"W / m^2 / sr / um{beside['snr']}: {figures.electrons:.4g} electrons, "
        f"noise {figures.noise:.4g}{amplified}{step}",
        f"  dynamic range        {figures.dynamics:.4g}, {bits:.1f} bit; saturates at "
        f"{figures.saturation * um:.4g} W / m^2 / sr / um{beside['saturation']}",
        *_saturated(figures),
        f"  pixel rate           {figures.clock / 1e6:.4g} Mpixel / s, a line in "
        f"{1e3 * figures.period:.4g} ms; {figures.data_rate / 1e6:.4g} Mbit / s",
        *_cut(channel, figures),
        *_smeared(channel, figures),
        *([f"  NOT MET              {', '.join(missed)}"] if missed else []),
    ]


def _exposure(channel: imager.Channel, figures: imager.Figures) -> float:
    """Exposure of one line, stage or frame, second."""
    return channel.exposure_of_line(figures.period if channel.detector.scan else 0.0)


def _cut(channel: imager.Channel, figures: imager.Figures) -> list[str]:
    """A warning if the time of a line is shorter than the detector's exposure in the file."""
    given, own = channel.detector.exposure, _exposure(channel, figures)
    if own == given:
        return []
    return [
        f"  EXPOSED FOR LESS     a line is exposed for {1e3 * own:.4g} ms, not "
        f"{1e3 * given:.4g} ms (detector.exposure)"
    ]


def _smeared(channel: imager.Channel, figures: imager.Figures) -> list[str]:
    """A warning if the line rate of a TDI detector does not match the ground; gives the right
    period."""
    if abs(figures.ahead) <= PACE:
        return []
    right = figures.period / (1 + figures.ahead / (channel.stages - 1))
    return [
        f"  SMEARED ALONG        the ground runs {figures.ahead:+.3g} pixel ahead of the charge "
        f"over {channel.stages} stages; lines every {1e3 * right:.4g} ms would match (period)"
    ]


def _saturated(figures: imager.Figures) -> list[str]:
    if figures.radiance <= figures.saturation:
        return []
    return ["  SATURATED            the light of this SNR exceeds full well"]


def _beside(channel: imager.Channel, name: str) -> str:
    """Required and measured value, as text after the predicted value."""
    units = {"saturation": ("", um), "nedt": (" mK", 1e3), "gsd": (" m", 1.0)}
    unit, scale = units.get(name, ("", 1.0))
    shown = [
        f"{kind} {value * scale:.4g}{unit}"
        for kind in ("required", "measured")
        if (value := getattr(getattr(channel, kind), name)) is not None
    ]
    return f" ({', '.join(shown)})" if shown else ""
