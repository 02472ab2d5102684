"""Sections of the page: design, verdicts, lost trials, error budget, units, worst trials."""

import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from startrack import verification
from startrack.budget import (
    Budget,
    BudgetLine,
    SkySample,
    analytic,
    caveats,
    differences,
    measured,
    refusal,
)
from startrack.catalog import open_sky
from startrack.core import YEAR, Advance, Floats, Ints, Refused, Rows, Streams, arcsec, deg, mm, um
from startrack.design import Case, Fidelity, Objective
from startrack.io import celestial
from startrack.metrics import STATED_ALONE, Summary, bracketed, fraction_interval, rms_interval
from startrack.montecarlo import Ending, Serial, Store, endings, run
from startrack.plots import BLACK, BLUE, RED, draw_solution, legend_below, say, styled
from startrack.population import PerUnit, Units, explain, per_unit, unit_errors
from startrack.report import page
from startrack.report.page import table
from startrack.trial import observe, searched

# number of the first trial in the other conditions; no command uses these numbers
OTHER = 2 * 10**8


def design(case: Case) -> page.Section:
    """The design in ten lines."""
    instrument, tracker = case.instrument, case.tracker
    optics, detector, camera = instrument.optics, instrument.detector, instrument.camera
    field = [
        2 * math.atan(n / 2 / camera.focal_length_px) / deg for n in (camera.columns, camera.rows)
    ]
    scene, motion, identification = case.scene, instrument.motion, tracker.identification
    sky = "none" if scene.background_g is None else f"G {scene.background_g:g} per arcsec^2"
    if scene.sky is not None:
        sky = f"of the air at {scene.sky.height / 1e3:g} km"
    jitter = " with jitter" if motion.jitters else ""
    rows = [
        [
            "lens",
            f"{optics.focal_length / mm:.4g} mm, f/{optics.f_number:.3g}, aperture "
            f"{optics.aperture / mm:.3g} mm, blur {optics.blur / um:.3g} um",
        ],
        [
            "detector",
            f"{detector.columns} x {detector.rows} pixels of "
            f"{detector.pitch / um:.3g} um, {detector.bits} bit",
        ],
        [
            "field",
            f"{field[0]:.2f} x {field[1]:.2f} deg, {1 / camera.focal_length_px / arcsec:.1f} "
            "arcsec a pixel",
        ],
        ["exposure", f"{1e3 * detector.exposure:.4g} ms, {detector.update_rate:.3g} frames / s"],
        [
            "noise",
            f"read {detector.read_noise:.3g} electron, dark current "
            f"{detector.dark_current:.3g} electron / s, PRNU {100 * detector.prnu:.2g} %",
        ],
        ["sky", f"background {sky}; lights: {', '.join(scene.lights) or 'none'}"],
        ["stars", f"{case.catalog.source} {case.catalog.extent}"],
        ["motion", f"{motion.rate / deg:.3g} deg / s{jitter}"],
        [
            "detection",
            f"threshold {tracker.detection.threshold:g}"
            if tracker.detection.threshold
            else "threshold from the false spots allowed",
        ],
        [
            "identification",
            f"{identification.min_matches} stars at least; focal length known to "
            f"{100 * identification.focal_tolerance:.2g} %",
        ],
    ]
    return page.Section("Design", table("The design in ten lines", ["part", "value"], rows))


def verdict(store: Store, outcomes: Rows, trials: int, advance: Advance) -> page.Section:
    """Each requirement of the campaign, by analysis and by trials.

    trials  number of trials in each further condition; the store has the trials of the design's own
            condition
    """
    campaign = store.campaign
    lacking = ""
    if campaign is None:
        lacking = "The design has no requirements."
    elif store.sampling.attitudes != "random":
        lacking = "A verdict needs trials at random attitudes."
    elif len(outcomes) < 2:
        lacking = "A verdict needs two trials or more."
    if campaign is None or lacking:
        return page.Section("Verdict", page.paragraph(lacking))

    def of(case: Case, number: int) -> Rows:
        if case == store.case:
            return outcomes
        fidelity = store.sampling.fidelity
        return run(case, trials, store.seed, Serial(), OTHER, progress=advance, fidelity=fidelity)

    looks = verification.Looks(len(outcomes), len(outcomes), 1 - campaign.requirements.confidence)
    verified = verification.verify(store.case, campaign, of, store.seed, looks)
    own = verified.verdicts[0].condition
    # Requirements by formula have no trials.
    counted = (
        replace(verdict, number=trials) if verdict.trials and verdict.condition != own else verdict
        for verdict in verified.verdicts
    )
    verified = replace(verified, verdicts=tuple(counted))
    lines = verification.verdict_notes(verified)
    lines[-1] = (
        f"Tested once: the design's own condition on the {len(outcomes)} trials of the campaign, "
        f"each other one on {trials}. {lines[-1].partition('decided; ')[2]} Bounds are "
        "one-sided, as in the test; limited errors in the summary have the same bounds, all "
        "other values two-sided intervals of 95 %."
    )
    return page.Section(
        "Verdict",
        page.paragraph(f"All requirements together: {verified.answer.value}.")
        + page.records("Requirements", verification.verdict_table(verified))
        + "".join(page.paragraph(line) for line in lines),
    )


def other_conditions(store: Store) -> int:
    """Number of conditions whose trials `verdict` runs."""
    campaign = store.campaign
    return len(verification.cases(store.case, campaign)[0]) - 1 if campaign else 0


def lost(store: Store, outcomes: Rows) -> page.Section:
    """Outcomes of trials, with counts."""
    needs = campaign.requirements if (campaign := store.campaign) else None
    attitudes = store.sampling.attitudes_of(store.seed, outcomes["trial"].tolist())
    limits, keep_out = (needs.limits, needs.min_keep_out) if needs else (STATED_ALONE, None)
    ends = endings(store.case, store.seed, outcomes, attitudes, limits, keep_out)
    rows = []
    for ending, count in ends.count().items():
        share = fraction_interval(count, len(outcomes))
        examples = (
            f"trial {outcomes['trial'][n]}: {ends.reason[n]}"
            for n, actual in enumerate(ends.ending)
            if actual is ending and ending is not Ending.CORRECT
        )
        cells = (f"{100 * value:.3g}" for value in (share.value, share.low, share.high))
        rows.append([ending.value, str(count), *cells, next(examples, "")])
    head = ["end", "trials", "%", "from", "to", "the first"]
    return page.Section("Lost trials", table("How the trials ended", head, rows))


TITLE = "Error budget"


def budget(
    case: Case, seed: int, members: int, summary: Summary | None, advance: Advance
) -> page.Section:
    """Each cause in the terms of ECSS-E-ST-60-20C, analytic and measured; or the reason why there
    is no budget.

    summary  of the campaign's trials, for comparison with the formulas; None: no comparison, as for
             trials of different units

    A scanning detector has no budget, and neither has a design without attitudes.
    """
    try:
        expected = analytic(case)
        by_trials = measured(case, members, seed, Serial(), progress=advance)
    except Refused as error:
        return page.Section(TITLE, page.paragraph(f"This design has no budget: {error}."))
    beside = {line.name: line for line in by_trials.lines}
    named = {line.name: line for line in expected.lines}
    rows = []
    for name in dict.fromkeys([*named, *beside]):
        line, other = named.get(name), beside.get(name)
        term = next(cause.term.value for cause in (line, other) if cause and cause.term)
        rows.append([name, term, *_cells(line), *_intervals(other)])
    rows.append(["root sum square", "", *_sum(expected), *_sum(by_trials)])
    rows.append(["end to end", "", *_cells(expected.whole), *_intervals(by_trials.whole)])
    head = ["cause", "term", "across", "about", "across, measured", "about, measured"]
    apart = differences(expected, summary) if summary else ()
    differ = (f"formula and trials differ: {text}" for text in apart)
    return page.Section(
        TITLE,
        # the reason for large errors comes first
        "".join(map(_sentence, refusal(case, expected.refused)))
        + table("Rms per axis, arcsec", head, rows)
        + page.paragraph(
            "By the analytic budget an attitude is available in "
            f"{100 * expected.availability:.2f} % of the sky with {expected.stars:.1f} stars; "
            f"over {members} trials, with each cause switched off in turn, in "
            f"{100 * by_trials.availability:.2f} % with {by_trials.stars:.1f}."
        )
        + "".join(map(_sentence, [*caveats(case, expected.left_out), *differ])),
    )


def _sentence(text: str) -> str:
    return page.paragraph(f"{text[0].upper()}{text[1:]}.")


def _cells(line: Any) -> list[str]:
    if line is None:
        return ["none", "none"]
    return [f"{line.across / arcsec:.3f}", f"{line.about / arcsec:.3f}"]


def _intervals(line: BudgetLine[SkySample] | None) -> list[str]:
    """Measured values, with 95 % intervals over the members."""
    if line is None:
        return ["none", "none"]
    square = (line.spread.error**2).mean(axis=1)
    intervals = rms_interval(square[:, :2].mean(axis=1)), rms_interval(square[:, 2])
    return [bracketed(interval, ".3f", arcsec) for interval in intervals]


def _sum(budget: Budget[Any]) -> list[str]:
    across, about = budget.sum
    return [f"{across / arcsec:.3f}", f"{about / arcsec:.3f}"]


SHOWN = 6  # numbers with the largest effect on the worst unit


def units(store: Store, outcomes: Rows) -> list[page.Section]:
    """The section on units; empty where all trials use the unit as designed."""
    how = store.sampling.units
    if not isinstance(how, Units):
        return []
    by_unit, years = per_unit(outcomes), how.age / YEAR
    needs = store.campaign.requirements.accuracy if store.campaign else ()
    rows, limits = [], {}
    for limit in needs:
        errors = unit_errors(limit.objective, outcomes, outcomes["unit"])
        share = fraction_interval(int((errors <= limit.most).sum()), len(errors))
        cells = [f"{100 * end:.1f}" for end in (share.value, share.low, share.high)]
        rows.append([str(limit.objective), f"{limit.most / arcsec:.4g}", *cells])
        if limit.objective == Objective(limit.name):
            limits[limit.name] = limit.most
    shown = (
        table(
            f"Yield: units that meet each limit, at {years:g} years",
            ["requirement", "at most (arcsec)", "%", "from", "to"],
            rows,
        )
        if rows
        else page.paragraph("The design has no limit of errors, so that there is no yield.")
    )
    pictures = [
        _spread(errors, name, limits.get(name))
        for name, errors in (("across", by_unit.across), ("about", by_unit.about))
    ]
    caption = (
        f"Rms error of each of {len(by_unit.unit)} units, over {how.trials} trials in "
        f"{how.environments} environments at {years:g} years."
    )
    text = page.paragraph(
        "Summary, distributions and sky are for all units together; each worst trial is for its "
        "unit. The sections on stars, slew rate, budget and fidelities, and the verdict's other "
        "conditions, are for the unit as designed."
    )
    drawn = page.panels(pictures, "units", caption)
    return [page.Section("Units", shown + drawn + _worst(store, by_unit) + text)]


@styled
def _spread(errors: Floats, name: str, limit: float | None) -> page.PagePicture:
    """Histogram of the rms of the units."""
    figure = Figure(figsize=(page.WIDE, page.HIGH), layout="constrained")
    axes, finite = figure.subplots(), errors[np.isfinite(errors)] / arcsec
    text = f"Histogram of the rms {name} the boresight of {len(finite)} units"
    picture = page.PagePicture(figure, text)
    axes.set(xlabel=f"rms {name} the boresight (arcsec)", ylabel="units")
    if not len(finite):
        say(axes, "no attitude")
        return picture
    bins = min(max(int(2 * len(finite) ** 0.5), 5), 40)
    axes.hist(finite, bins=bins, color=BLUE, alpha=0.6)
    for fraction, style in ((0.5, "-"), (0.95, "--")):
        axes.axvline(
            float(np.quantile(finite, fraction)),
            color=BLACK,
            ls=style,
            lw=1.2,
            label=f"{100 * fraction:g} % of units below",
        )
    if limit is not None:
        axes.axvline(limit / arcsec, color=RED, lw=1.5, label="required")
    axes.set_xlim(0, None)
    legend_below(axes, 2)
    return picture


def _worst(store: Store, by_unit: PerUnit) -> str:
    """Causes of the worst unit's errors, parameter by parameter."""
    how, worst = store.sampling.units, by_unit.worst
    if not isinstance(how, Units) or worst is None:
        return ""
    rms = float(np.nanmax(by_unit.across)) / arcsec
    if store.sampling.fidelity is not Fidelity.COVARIANCE:
        return page.paragraph(
            f"The worst unit is {worst}, with {rms:.3g} arcsec rms across. Causes are explained "
            "only for trials of fidelity covariance."
        )
    parts = explain(store.case, store.seed, how, worst)[:SHOWN]
    rows = [[name, f"{100 * change:+.0f}"] for name, change in parts]
    head = ["as designed instead", "change of its rms across (%)"]
    return table(f"The worst unit, {worst}: {rms:.3g} arcsec rms across", head, rows)


def worst(outcomes: Rows, count: int) -> Ints:
    """Numbers of the worst trials: false attitudes, then trials without attitude, then the largest
    errors."""
    size = np.hypot(outcomes["error_x"], outcomes["error_y"])
    badness = np.where(outcomes["solved"], size, math.pi)
    badness = np.where(outcomes["false"], 2 * math.pi, badness)
    return np.asarray(outcomes["trial"][np.argsort(-badness, kind="stable")[:count]], np.int64)


def show(case: Case, seed: int, number: int, icrs_to_camera: Rotation) -> str:
    """A repeated trial as a picture, with the result as caption (HTML)."""
    record = observe(case, icrs_to_camera, Streams(seed, number))
    outcome = record.outcome
    ra, dec, _ = celestial(record.icrs_to_camera)
    where = f"Trial {number}, boresight at RA {ra:.1f} deg, dec {dec:+.1f} deg"
    if not outcome.solved:
        result = f"no attitude: {record.estimate.reason}"
    else:
        error = math.hypot(outcome.error_x, outcome.error_y) / arcsec
        result = (
            f"{'FALSE, ' if outcome.false else ''}{error:.2f} arcsec across, "
            f"{abs(outcome.error_z) / arcsec:.1f} about the boresight, {outcome.stars} stars"
        )
    seen, stars = searched(case, record.frame), open_sky(case.believed_catalog).stars
    found = record.spots, record.matches, record.estimate.icrs_to_camera
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frame.jpg"
        draw_solution(path, seen, *found, stars, f"trial {number}")
        return page.embedded(f"{where}: {result}.", path, where)
