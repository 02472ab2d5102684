"""The page from a campaign's store."""

import json
import math

import tomli_w

from startrack import budget, metrics, verification
from startrack.core import Advance, Parameters, Range, Rows, arcsec, deg, parameter
from startrack.design import Case, Fidelity
from startrack.io import to_table
from startrack.montecarlo import Sampling, Store, fidelity_comparison, origin
from startrack.population import AS_DESIGNED
from startrack.report import pictures, sections
from startrack.report.page import Section, code, page, panels, paragraph, table

MOST_POINTS = 5000  # largest number of trials on the map


class Depth(Parameters):
    """Numbers of trials that are repeated for details of the page.

    stars                trials with an evaluation of single stars
    slews                trials at each slew rate
    budget               trials of the measured budget
    fidelity_comparison  trials at each fidelity
    worst                trials shown with their frames
    conditions           trials in each further condition of the verdict
    """

    stars: int = parameter(limit=Range(1, 10**6), default=60)
    slews: int = parameter(limit=Range(1, 10**6), default=60)
    budget: int = parameter(limit=Range(2, 10**6), default=60)
    fidelity_comparison: int = parameter(limit=Range(2, 10**6), default=60)
    worst: int = parameter(limit=Range(0, 100), default=3)
    conditions: int = parameter(limit=Range(2, 10**6), default=200)

    @property
    def trials(self) -> int:
        """Sum of all trials."""
        again = self.stars + self.slews * len(budget.SMEARS) + self.worst
        return again + self.budget + self.fidelity_comparison * len(Fidelity)


def repeated(store: Store, depth: Depth) -> int:
    """Number of trials that the page of a store repeats or runs in other conditions."""
    return depth.trials + depth.conditions * sections.other_conditions(store)


def write_report(
    store: Store, title: str, depth: Depth, progress: Advance | None = None, author: str = ""
) -> str:
    """The page as HTML.

    title     plain text
    author    name, for the head of the page
    progress  called with the number of newly repeated trials
    Raises    ValueError if the store has no trial, or is of another version of startrack whose
              trials cannot be repeated.
    """
    if store.startrack != (version := origin()["startrack"]):
        raise ValueError(
            f"{store.path} holds trials of startrack {store.startrack}, which this startrack "
            f"{version} cannot repeat"
        )
    store.require_inputs()
    outcomes = store.outcomes()
    if not len(outcomes):
        raise ValueError(f"{store.path} must hold trials, but holds none")
    advance = progress or (lambda _: None)
    case, seed = store.case, store.seed
    # The formula is for the design as designed, so that it is not compared with trials of different
    # units.
    alike = metrics.summarise(outcomes) if store.sampling.units == AS_DESIGNED else None
    shown = [
        sections.design(case),
        sections.verdict(store, outcomes, depth.conditions, advance),
        _summary(store, outcomes),
        *sections.units(store, outcomes),
        sections.lost(store, outcomes),
        sections.budget(case, seed, depth.budget, alike, advance),
        _distributions(outcomes),
        _sky(outcomes, store.sampling, seed),
        *_closer(store, outcomes, depth, advance),
        _worst(store, outcomes, depth, advance),
        _fidelities(case, seed, depth, advance),
        _inputs(store),
    ]
    date = store.sessions()[-1][0][:10]
    lead = (
        f"startrack {version}, {date}, author: {author or 'not named'}. "
        f"{len(outcomes)} trials of seed {seed}, {store.sampling}. "
        "Brackets hold the true value with 95 % confidence; a trial is one random attitude with "
        f"random noise.{''.join(f' {named}.' for named in store.code)}"
    )
    doubt = metrics.summarise(outcomes).doubt
    if doubt:
        lead = f"{doubt[0].upper()}{doubt[1:]}. {lead}"
    return page(title, lead, shown)


def _summary(store: Store, outcomes: Rows) -> Section:
    campaign = store.campaign
    limits = campaign.requirements.limits if campaign else metrics.STATED_ALONE
    summary = metrics.summarise(outcomes, limits)
    if campaign and store.sampling.attitudes == "random":
        needs = campaign.requirements
        judged = verification.counted(needs, store.case, store.seed, outcomes)
        summary = metrics.summarise(judged, limits)
        claims = verification.number_of_claims(verification.cases(store.case, campaign)[0])
        sky = verification.boresights(store.seed, judged)
        bounds = verification.bounds_of_errors(needs, judged, sky, claims)
        summary = verification.with_bounds(summary, needs, bounds)
    text = (
        f"On average {summary.stars:.1f} stars are matched. The mean squared error over the "
        f"variance stated by the tracker is {summary.nees:.2f}; a correct covariance gives 3."
    )
    alone = f" {budget.noise_only(store.case)}." if store.sampling.units == AS_DESIGNED else ""
    cells = metrics.to_cells(metrics.summary_rows(summary, limits))
    over = f" of {summary.units} units" if summary.units else ""
    shown = table(f"Over {summary.trials} trials{over}", ["", "value", "from", "to", "unit"], cells)
    return Section("Summary", shown + paragraph(text + alone) + _verdict(summary))


def _verdict(summary: metrics.Summary) -> str:
    if summary.trials == round(summary.trials * summary.availability.value):
        return paragraph("Every trial gave a correct attitude.")
    counts = [
        round(summary.trials * share.value)
        for share in (summary.availability, summary.inaccurate, summary.false)
    ]
    return paragraph(
        f"{summary.trials - sum(counts)} trials gave no attitude, {counts[1]} an inaccurate and "
        f"{counts[2]} a false one. Errors include all attitudes that are not false."
    )


def _distributions(outcomes: Rows) -> Section:
    across, about = pictures.sizes(outcomes)
    units = metrics.summarise(outcomes).units
    rows = [
        [f"{100 * fraction:g} %", *_cells(first, arcsec), *_cells(second, arcsec)]
        for fraction, first, second in zip(
            pictures.FRACTIONS,
            pictures.quantiles(across, units),
            pictures.quantiles(about, units),
            strict=True,
        )
    ]
    head = ["fraction not exceeding", "across, radial", "from", "to", "about", "from", "to"]
    caption = (
        f"Fraction of trials that exceed an error, over {len(across)} attitudes that are not false."
    )
    return Section(
        "Distributions",
        panels(pictures.exceedance(outcomes), "spread", caption)
        + table("Quantiles of the angles, arcsec", head, rows),
    )


def _sky(outcomes: Rows, sampling: Sampling, seed: int) -> Section:
    shown = outcomes[:MOST_POINTS]
    attitudes = sampling.attitudes_of(seed, shown["trial"].tolist())
    drawn = pictures.sky_map(attitudes.inv().apply([0.0, 0.0, 1.0]), shown)
    caption = (
        "ICRS, Mollweide's equal-area projection, right ascension grows to the left; the first "
        f"{len(shown)} trials."
    )
    return Section("Sky", panels(drawn, "sky", caption))


def _closer(store: Store, outcomes: Rows, depth: Depth, advance: Advance) -> list[Section]:
    case, seed = store.case, store.seed
    numbers = outcomes["trial"][: depth.stars].tolist()
    attitudes = store.sampling.attitudes_of(seed, numbers)
    seen = budget.star_errors(case, seed, numbers, attitudes, advance)
    detector = case.instrument.detector
    stars = pictures.draw_stars(seen, math.hypot(detector.columns, detector.rows) / 2)
    slewed = budget.slews(case, seed, depth.slews, advance)
    expected = budget.analytic_curve(case, budget.slew_rates(case, budget.LONGEST))
    turned = pictures.draw_slews(slewed, case.instrument.motion.rate, expected)
    rows = [
        [
            f"{slew.rate / deg:.3f}",
            f"{slew.smear:g}",
            *_cells(slew.across, arcsec),
            *_cells(slew.fraction, 0.01),
        ]
        for slew in slewed
    ]
    ends = ("from", "to")
    head = ["deg / s", "smear (pixel)", "across (arcsec)", *ends, "correct (%)", *ends]
    of_stars = (
        f"{len(seen.magnitude)} matched stars of {seen.trials} trials, against the true position "
        "on the detector; bars: 95 % intervals in bins of equal numbers."
    )
    of_rates = f"{depth.slews} trials at each rate, the same skies and noise."
    shown = table("Error and availability over slew rate", head, rows)
    return [
        Section("Stars", panels(stars, "stars", of_stars)),
        Section("Slew rate", panels(turned, "slews", of_rates) + shown),
    ]


def _worst(store: Store, outcomes: Rows, depth: Depth, advance: Advance) -> Section:
    case, seed, units, shown = store.case, store.seed, store.sampling.units, list[str]()
    for number in sections.worst(outcomes, depth.worst).tolist():
        look_at = store.sampling.attitudes_of(seed, [number])[0]
        shown.append(sections.show(units.case_of(case, seed, number), seed, number, look_at))
        advance(1)
    return Section("Worst trials", "".join(shown) or paragraph("None was requested."))


def _fidelities(case: Case, seed: int, depth: Depth, advance: Advance) -> Section:
    rows = []
    for result in fidelity_comparison(case, seed, range(depth.fidelity_comparison), advance):
        if result.refusal:
            rows.append([result.fidelity.value, *["none"] * 6, result.refusal])
            continue
        time, rate = f"{1e3 * result.seconds:.3g}", f"{1 / result.seconds:.0f}"
        off = metrics.four_digits(result.difference / arcsec)
        off = "0" if result.fidelity is Fidelity.FRAME else off
        rows.append([result.fidelity.value, time, rate, *_cells(result.across, arcsec), off, ""])
    head = ["fidelity", "ms", "trials / s", "across (arcsec)", "from", "to", "difference", ""]
    text = (
        f"{depth.fidelity_comparison} trials each, of this campaign's seed. Difference: rms per "
        "axis between errors and those of the fidelity frame in the same trials, arcsec."
    )
    caption = "Speed against error, on the same trials, one core"
    return Section("Fidelities", table(caption, head, rows) + paragraph(text))


def _inputs(store: Store) -> Section:
    sessions, made_by = store.sessions(), ["startrack", "numpy", "system", "cores"]
    rows = [[began, *(made.get(name, "?") for name in made_by)] for began, made in sessions]
    failures = "".join(
        code(f"Trials {numbers.start} to {numbers.stop - 1} failed", report)
        for numbers, report in store.failures()
    )
    about = f"Seed {store.seed}, {store.sampling}; the design, as a file that startrack reads:"
    worked = table("Sessions of the campaign: times (UTC) and versions", ["began", *made_by], rows)
    machine = json.dumps(dict(sessions[-1][1]), indent=1)
    return Section(
        "Inputs",
        paragraph(about)
        + code("Design", tomli_w.dumps(to_table(store.case)))
        + worked
        + code("Versions and machine of the last session", machine)
        + (failures or paragraph("No block of trials failed.")),
    )


def _cells(interval: metrics.Interval, unit: float) -> list[str]:
    return [metrics.four_digits(end / unit) for end in vars(interval).values()]
