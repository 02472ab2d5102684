"""Units of a campaign: their yields, the spread of their errors, and what made the worst bad."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from startrack.core import Floats, arcsec
from startrack.design import YEAR, Fidelity, Objective
from startrack.metrics import fraction_interval
from startrack.montecarlo import Store
from startrack.plots import BLACK, BLUE, RED, legend_below, say, styled
from startrack.population import PerUnit, explain, per_unit, unit_errors
from startrack.report.page import HIGH, WIDE, Picture, Section, panels, paragraph, table

SHOWN = 6  # numbers that changed the worst unit most


def units(store: Store, outcomes: NDArray[np.void]) -> list[Section]:
    """The section on units; none where all trials are of the unit as designed."""
    how = store.sampling.units
    if how is None:
        return []
    found, years = per_unit(outcomes), how.age / YEAR
    needs = store.campaign.requirements.accuracy if store.campaign else ()
    rows, limits = [], {}
    for one in needs:
        errors = unit_errors(one.objective, outcomes, outcomes["unit"])
        share = fraction_interval(int((errors <= one.most).sum()), len(errors))
        cells = [f"{100 * each:.1f}" for each in (share.value, share.low, share.high)]
        rows.append([str(one.objective), f"{one.most / arcsec:.4g}", *cells])
        if one.objective == Objective(one.name):
            limits[one.name] = one.most
    shown = table(
        f"Yield: units that meet each limit, at {years:g} years",
        ["requirement", "at most (arcsec)", "%", "from", "to"],
        rows,
    ) if rows else paragraph("The design limits no error, so that there is no yield.")  # fmt: skip
    pictures = [
        _spread(errors, name, limits.get(name))
        for name, errors in (("across", found.across), ("about", found.about))
    ]
    caption = (
        f"Rms error of each of {len(found.unit)} units, over {how.trials} trials in "
        f"{how.environments} environments at {years:g} years."
    )
    text = paragraph(
        "Summary, distributions and sky are of all units together, the worst trials each of its "
        "unit; the sections on stars, slew rate, budget and fidelities, and the verdict's other "
        "conditions, are of the unit as designed."
    )
    return [
        Section("Units", shown + panels(pictures, "units", caption) + _worst(store, found) + text)
    ]


@styled
def _spread(errors: Floats, name: str, limit: float | None) -> Picture:
    """Histogram of the rms of the units."""
    figure = Figure(figsize=(WIDE, HIGH), layout="constrained")
    axes, known = figure.subplots(), errors[np.isfinite(errors)] / arcsec
    picture = Picture(figure, f"Histogram of the rms {name} the boresight of {len(known)} units")
    axes.set(xlabel=f"rms {name} the boresight (arcsec)", ylabel="units")
    if not len(known):
        say(axes, "no attitude")
        return picture
    bins = min(max(int(2 * len(known) ** 0.5), 5), 40)
    axes.hist(known, bins=bins, color=BLUE, alpha=0.6)
    for fraction, style in ((0.5, "-"), (0.95, "--")):
        axes.axvline(float(np.quantile(known, fraction)), color=BLACK, ls=style, lw=1.2,
                     label=f"{100 * fraction:g} % of units below")  # fmt: skip
    if limit is not None:
        axes.axvline(limit / arcsec, color=RED, lw=1.5, label="required")
    axes.set_xlim(0, None)
    legend_below(axes, 2)
    return picture


def _worst(store: Store, found: PerUnit) -> str:
    """What made the worst unit bad, number by number."""
    how, worst = store.sampling.units, found.worst
    if how is None or worst is None:
        return ""
    rms = float(np.nanmax(found.across)) / arcsec
    if store.sampling.fidelity is not Fidelity.COVARIANCE:
        return paragraph(
            f"The worst unit is {worst}, with {rms:.3g} arcsec rms across. What made it bad is "
            "explained for trials of fidelity covariance."
        )
    parts = explain(store.case, store.seed, how, worst)[:SHOWN]
    rows = [[name, f"{100 * change:+.0f}"] for name, change in parts]
    head = ["as designed instead", "change of its rms across (%)"]
    return table(f"The worst unit, {worst}: {rms:.3g} arcsec rms across", head, rows)
