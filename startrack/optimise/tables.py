"""The results of studies as CSV, JSON lines and Markdown."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from startrack.budget import caveats, differences, refusal
from startrack.core import YEAR, Refused, arcsec
from startrack.design import NOMINAL, Campaign, Objective
from startrack.io import save_csv
from startrack.metrics import Interval, Row, bracketed, end_text, markdown, summary_rows, to_json
from startrack.optimise.budgets import budget_of, without_units
from startrack.optimise.ensemble import Chains
from startrack.optimise.evaluate import Evaluation
from startrack.optimise.optimise import Optimum, lacking
from startrack.optimise.tolerance import Tolerance
from startrack.optimise.units import ComparedUnits, least_units_for_interval
from startrack.verification import margins as margins_of

FRACTIONS = (0.025, 0.16, 0.5, 0.84, 0.975)


def write_evaluations(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Write all evaluated designs; variables in SI, errors in arcsecond."""
    margins = list(dict.fromkeys(name for evaluation in evaluations for name in evaluation.margins))
    variables = list(evaluations[0].values)
    head = [
        "evaluation",
        *variables,
        "across_rms_arcsec",
        "about_rms_arcsec",
        "availability",
        *(f"margin {name}" for name in margins),
        "score",
        "feasible",
        "note",
    ]
    rows = (
        [
            number,
            *evaluation.values.values(),
            *_errors(evaluation),
            *(evaluation.margins.get(name, math.nan) for name in margins),
            evaluation.score,
            evaluation.feasible,
            evaluation.note,
        ]
        for number, evaluation in enumerate(evaluations)
    )
    save_csv(path, head, rows)


def span_texts(optimum: Optimum) -> dict[str, str]:
    """Range of each variable in which the objective stays within the precision, by name.

    The other variables follow; three digits.
    """
    if optimum.landscape is None:
        return {}
    texts, space = dict[str, str](), optimum.space
    for name, span in optimum.landscape.spans.items():
        low, high = (space.values(end)[name] for end in (span.at_low, span.at_high))
        ends = f"{space.shown(name, low, 3)} to {space.shown(name, high, 3)}"
        texts[name] = f"any value ({ends}): it does not matter" if span.everywhere else ends
    return texts


def landscape_lines(optimum: Optimum, campaign: Campaign) -> list[str]:
    """The design space by the forecasts, as Markdown paragraphs."""
    landscape = optimum.landscape
    if landscape is None:
        return []
    lines = [
        "",
        f"{len(landscape.forecasts)} designs were forecast by the analytic budget; "
        f"{landscape.ending}. By these forecasts no design is better by more than "
        f"{100 * math.expm1(landscape.left):.1f} % (98 % confidence). The last column is the "
        "range of a variable if the others are adapted to it.",
    ]
    if landscape.prices:
        prices = ", ".join(f"{name} {-100 * by:.1f} %" for name, by in landscape.prices.items())
        lines += [
            "",
            "What limits it: if a limit is relaxed by 1 %, the "
            f"{campaign.made_small[0]} is expected to change by: {prices}.",
        ]
    return lines


def comparison(optimum: Optimum, campaign: Campaign) -> str:
    """Answer, start and best side by side, and what limits the best, as Markdown."""
    lines, spans = [_answer(optimum, campaign), ""], span_texts(optimum)
    within = f"within {100 * campaign.precision:g} %, by the budget"
    head = ["", "start", "best", *([within] if spans else [])]
    rows = [
        *_variable_rows(optimum, spans),
        *_units_rows(optimum, campaign),
        *_error_rows(optimum),
        *_requirement_rows(optimum, campaign),
    ]
    lines += markdown(head, [(*row, "")[: len(head)] for row in rows])
    lines += ["", _judgement(optimum, campaign)]
    lines += landscape_lines(optimum, campaign)
    lines += ["", *(f"{text[0].upper()}{text[1:]}." for text in optimum_caveats(optimum, campaign))]
    for sentence in _closing_sentences(optimum):
        lines += ["", sentence]
    return "\n".join(lines)


def _answer(optimum: Optimum, campaign: Campaign) -> str:
    """Improvement of the best design, and the requirements that it misses."""
    doubt = optimum.fresh[1].doubt
    gain = kept_start if optimum.candidate else _gain
    parts = [f"Best design: {doubt}."] if doubt else []
    parts.append(gain(optimum, campaign))
    if optimum.lacking:
        short = ", ".join(f"{name} by {-margin:.3g}" for name, margin in optimum.lacking.items())
        parts.append(f"NOT MET, the worst first: {short}.")
    elif optimum.feasible:
        parts.append("All requirements are met.")
    return " ".join(parts)


def _variable_rows(optimum: Optimum, spans: Mapping[str, str]) -> list[list[str]]:
    """Values of the variables; `spans` as `span_texts` gives them."""
    labels = optimum.space.labels()
    before, after = optimum.space.text(optimum.start), optimum.space.text(optimum.best)
    return [[labels[name], before[name], after[name], spans.get(name, "")] for name in before]


def _error_rows(optimum: Optimum) -> list[list[str]]:
    """Errors, availability and stars on fresh frames."""
    rows = [
        [
            f"rms error {name} the boresight (arcsec)",
            *(_written(getattr(fresh, name)) for fresh in optimum.fresh),
        ]
        for name in ("across", "about")
    ]
    return [
        *rows,
        ["availability (%)", *(_written(fresh.availability, 0.01) for fresh in optimum.fresh)],
        ["matched stars", *(end_text(fresh.stars, ".1f") for fresh in optimum.fresh)],
    ]


def _requirement_rows(optimum: Optimum, campaign: Campaign) -> list[list[str]]:
    """Costs, rate and stars in the sky, with their limits."""
    pair, needs = (optimum.start, optimum.best), campaign.requirements
    rows = [
        [f"mass (kg), at most {needs.max_mass:g}", *(f"{needs.mass(case):.3f}" for case in pair)],
        [f"power (W), at most {needs.max_power:g}", *(f"{needs.power(case):.3f}" for case in pair)],
    ]
    if needs.max_cost is not None or campaign.minimise == "cost":
        most = "" if needs.max_cost is None else f", at most {needs.max_cost:g}"
        rows.append([f"cost{most}", *(f"{needs.cost(case):.5g}" for case in pair)])
    if campaign.minimise not in ("error", "mass", "power", "cost"):
        name, unit = campaign.made_small
        rows.append([f"{name} ({unit})", *(f"{campaign.cost(case):.5g}" for case in pair)])
    rates = (f"{case.instrument.detector.update_rate:.2f}" for case in pair)
    rows.append([f"update rate (Hz), at least {needs.min_update_rate:g}", *rates])
    sky = f"{needs.min_stars} stars in {100 * needs.sky_fraction:g} % of the sky"
    margins = (f"{margins_of(needs, case)['stars in the sky']:+.2f}" for case in pair)
    rows.append([f"margin (mag) for {sky}", *margins])
    return rows


def _judgement(optimum: Optimum, campaign: Campaign) -> str:
    """Improvement of the best design, and its trials."""
    designs, trials = len(optimum.evaluations), sum(optimum.trials.values())
    evaluated = "design was evaluated" if designs == 1 else "designs were evaluated"
    compared = "" if optimum.candidate else _optimism(optimum)
    needs, false = campaign.requirements, optimum.fresh[1].false
    fewest, most = campaign.trials, campaign.most_trials
    each = str(most) if fewest == most else f"{fewest} to {most}"
    return (
        f"{compared}{designs} {evaluated}, "
        f"{each} trials each. {trials} trials "
        f"were done in all. The availability is at least {100 * optimum.availability.low:.2f} % "
        f"(required: {100 * needs.min_availability:g} %); at most {100 * false.high:.2f} % of "
        "the frames have a false attitude. Brackets and bounds hold with 95 % confidence."
    )


def _gain(optimum: Optimum, campaign: Campaign) -> str:
    """The factor of improvement, if both designs have an attitude."""
    if not math.isfinite(optimum.factor.value):
        pair = zip(("start", "best"), optimum.fresh, strict=True)
        blind = [name for name, one in pair if not math.isfinite(one.across.value)]
        where = " nor with the ".join(blind) or "best"
        return f"No factor of improvement: fresh trials have no attitude with the {where}."
    if campaign.minimise != "error":
        name, unit = campaign.made_small
        costs = (f"{campaign.cost(case):.4g}" for case in (optimum.best, optimum.start))
        by = f"{optimum.factor.value:.3g} in the {name}: {' instead of '.join(costs)} {unit}"
        return f"Better by a factor of {by}."
    errors, fresh = list[str](), f"{optimum.fresh[0].trials} fresh frames, paired"
    quantity = f"{campaign.goal}"
    for axis in ("across", "about"):
        if quantity == str(Objective(axis)):
            errors = [_written(getattr(one, axis)) for one in reversed(optimum.fresh)]
    if units := optimum.units:
        fresh = f"{units.count} fresh units, the same of both designs"
        quantity = f"{quantity} {units.over.words}"
        errors = [_written(units.best), _written(units.start)]
    by = f"{bracketed(optimum.factor, '.2f')} in the {quantity}"
    values = f": {' instead of '.join(errors)} arcsec" if errors else ""
    return f"Better by a factor of {by}{values}, on {fresh}."


def _optimism(optimum: Optimum) -> str:
    """The error of the best before fresh trials; empty if there is none."""
    if not math.isfinite(optimum.tuning_error):
        return ""
    tuned, later = "error on the tuning trials was", "fresh frames show"
    if optimum.units:
        tuned, later = "level that the search expected was", "fresh units show"
    tuning = optimum.tuning_error / arcsec
    return (
        f"The {tuned} {tuning:.{_digits(tuning)}f} arcsec; {later} "
        f"{bracketed(optimum.optimism, '.3f')} of that. "
    )


def _closing_sentences(optimum: Optimum) -> Iterator[str]:
    """Margins, choices and bounds of the best."""
    by_trials = {
        name: margin
        for name, margin in optimum.margins.items()
        if name.startswith(("across", "about", "availability"))
    }
    if len(by_trials) > 1:
        named = ", ".join(f"{name} {margin:+.3f}" for name, margin in by_trials.items())
        yield f"Margins of the best on fresh trials, by the bound that must hold: {named}."
    if optimum.branch:
        yield f"The best design has the choices {optimum.branch}."
    space, best = optimum.space, optimum.space.text(optimum.best)
    labels = space.labels()
    bounds = [
        f"{labels[name]} ({end}, {best[name]})"
        for name, end in space.on_bounds(optimum.best).items()
    ]
    if bounds:
        yield (
            f"On a bound of its variable: {', '.join(bounds)}. The range decides there, not the "
            "model; beyond it the best may be another design."
        )


def kept_start(optimum: Optimum, campaign: Campaign) -> str:
    """Message that no design is better than the start, with the reason."""
    assert optimum.candidate is not None
    factor, lacks = optimum.candidate.factor, lacking(optimum.candidate.margins)
    short = ", ".join(f"{name} by {-margin:.3g}" for name, margin in lacks.items())
    misses = f" and misses {short}" if lacks else ""
    times = Interval(
        *(1 / bound if bound else math.nan for bound in (factor.value, factor.high, factor.low))
    )
    names = optimum.space.labels()
    values = ", ".join(
        f"{names[name]} {value}"
        for name, value in optimum.space.text(optimum.candidate.design).items()
    )
    return (
        "No design that was found is better than the start, which stays. The best of the search "
        f"({values}) has {bracketed(times, '.2f')} times the {campaign.minimise} of the start"
        f"{misses}."
    )


def _units_rows(optimum: Optimum, campaign: Campaign) -> list[list[str]]:
    """Rows of the level over fresh units, and of the yields; none without units."""
    units = optimum.units
    if units is None:
        return []
    level = f"{campaign.goal} {units.over.words} (arcsec)"
    rows = [
        [
            level,
            *(
                _written(one) if math.isfinite(one.value) else "units without an attitude"
                for one in (units.start, units.best)
            ),
        ]
    ]
    for share in units.yields:
        most = share.accuracy.most / arcsec
        label = f"yield: {share.accuracy.objective} at most {most:.{_digits(most)}f} arcsec (%)"
        rows.append([label, _written(share.start, 0.01), _written(share.best, 0.01)])
    return rows


def units_values(units: ComparedUnits) -> dict[str, Any]:
    """Start and best over fresh units, for JSON; yields as for other commands."""
    values: dict[str, Any] = {
        "fraction": units.over.fraction,
        "age_years": units.over.age / YEAR,
        "count": units.count,
        "trials_each": units.trials,
        "predicted_level_arcsec": units.predicted / arcsec,
    }
    for name, level in (("start", units.start), ("best", units.best)):
        yields = [
            {
                "requirement": str(share.accuracy.objective),
                "most_arcsec": share.accuracy.most / arcsec,
                **asdict(getattr(share, name)),
            }
            for share in units.yields
        ]
        bounds = [level.low / arcsec, level.high / arcsec]
        level_arcsec = level.value / arcsec
        values[name] = {"level_arcsec": level_arcsec, "level_arcsec_95": bounds, "yields": yields}
    return values


def optimum_caveats(optimum: Optimum, campaign: Campaign) -> list[str]:
    """Sentences on the best design: formula against fresh trials, causes, and effects left out."""
    best, summary = optimum.best, optimum.fresh[1]
    over = campaign.over_units(best)
    if over:  # whose budgets count their residual
        best = without_units(best)
    try:
        budget = budget_of(best)
    except Refused as reason:
        return [f"there is no analytic budget of the best design: {reason}"]
    # The budget is that of the unit as designed.
    differing = () if over else differences(budget, summary)
    sentences = [f"formula and trials differ: {difference}" for difference in differing]
    if summary.availability.value < campaign.requirements.min_availability:
        sentences.append(
            f"attitudes are lost with {budget.stars:.1f} stars expected on average in the sky "
            "that has enough of them; the effects named next are possible causes"
        )
    sentences += sharp_conditions(optimum, campaign)
    sentences += _limits_of_fresh_trials(optimum)
    sentences += refusal(optimum.best, budget.refused)
    sentences += caveats(optimum.best, budget.left_out)
    if not best.differs:
        return sentences
    return [
        *sentences,
        "noise only: the units of the designs are taken for perfect ones on their "
        "first day (campaign.units)",
    ]


def _limits_of_fresh_trials(optimum: Optimum) -> list[str]:
    """What the fresh trials do not show: a level over too few units; bounds of several designs."""
    sentences = []
    if optimum.units and math.isinf(optimum.units.factor.high):
        fraction, count = optimum.units.over.fraction, optimum.units.count
        sentences.append(
            f"{count} fresh units bound no level of {100 * fraction:g} % of them; "
            f"campaign.fresh_units = {least_units_for_interval(fraction)} would"
        )
    if optimum.rounds > 1:
        sentences.append(
            f"{optimum.rounds} designs were judged, each on its own fresh trials, because one "
            "missed a limit or another was expected to be better; the probability that any of "
            "their bounds is wrong is at most twice that of a single bound"
        )
    return sentences


SHARP = 3.0  # error in a condition over the error in the own one, above which a design is sharp


def sharp_conditions(optimum: Optimum, campaign: Campaign) -> list[str]:
    """The conditions without a weight in which the error of the best is far larger than in its own.

    The objective does not contain these conditions: a design may be the best only for its own rate.
    """
    errors, objective = optimum.errors, campaign.goal
    own = errors.get(NOMINAL, math.nan) / arcsec
    weighted = {judged.name for judged in campaign.judged(optimum.best) if judged.weight}
    return [
        f"the {objective} is {error / arcsec:.3g} arcsec in the condition {name}, "
        f"{own:.3g} arcsec in the design's own: the best is sharp, a small change of what differs "
        "there costs much (campaign.conditions with a weight would count it)"
        for name, error in errors.items()
        if name not in weighted and error / arcsec > SHARP * own
    ]


def tolerance_values(tolerance: Tolerance) -> dict[str, Any]:
    """The tolerance region for JSON, variables in SI."""
    names = tolerance.source.names
    points = np.quantile(tolerance.samples, FRACTIONS, axis=0)
    rows = [tolerance.source.values(coordinates) for coordinates in points]
    return {
        "quantiles": list(FRACTIONS),
        "values_si": {name: [row[name] for row in rows] for name in names},
        "priors": dict(tolerance.source.laws),
        "surface_error": tolerance.surface_error,
        "check_error": tolerance.check_error,
        "checks": tolerance.checks,
        "promised": tolerance.expected,
        "kept": tolerance.kept,
        **chain_values(tolerance.chains),
        "designs": tolerance.designs,
    }


def chain_values(chains: Chains) -> dict[str, Any]:
    """Convergence diagnostics for JSON."""
    return {
        "acceptance": chains.acceptance,
        "autocorrelation_steps": float(chains.autocorrelation.max()),
        "effective_samples": float(chains.effective.min()),
        "split_r_hat": float(chains.split_r_hat.max()),
        "converged": chains.converged,
        "doubt": chains.reason_unconverged,
    }


def chain_text(chains: Chains) -> str:
    """Convergence diagnostics as a sentence."""
    reason = chains.reason_unconverged
    return (
        f"{chains.effective.min():.0f} independent samples, acceptance {chains.acceptance:.2f}, "
        f"split R-hat {chains.split_r_hat.max():.4f} over {len(chains.samples)} independent "
        f"ensembles, {f'NOT converged: {reason}' if reason else 'converged'}"
    )


def tolerance_table(tolerance: Tolerance) -> str:
    """Quantiles of each variable in the tolerance region, as Markdown."""
    source, unit = tolerance.source, tolerance.source.unit
    points = np.quantile(tolerance.samples, FRACTIONS, axis=0)
    texts = [source.shown(coordinates) for coordinates in points]
    centre, shown_as = source.shown(), source.labels()
    limit = tolerance.limit / unit.size
    limit_text = f"{limit:.{_digits(limit)}f} {unit.name}".strip()
    head = ["variable", "design", *(f"{100 * fraction:g} %" for fraction in FRACTIONS)]
    rows = [[shown_as[name], centre[name], *(text[name] for text in texts)] for name in centre]
    wide = ", ".join(f"{row[0]} {row[2]} to {row[-1]}" for row in rows)
    lines = [
        f"Of the designs that keep the objective below {limit_text} and meet the requirements, "
        f"95 % have, each variable by itself: {wide}.",
        "",
        *markdown(head, rows),
        "",
        f"Quantiles of the designs that keep the objective below {limit_text} "
        f"and meet the requirements: {chain_text(tolerance.chains)}. The response surface "
        f"has an error of {100 * tolerance.surface_error:.1f} % by leave-one-out and of "
        f"{100 * tolerance.check_error:.1f} % at {tolerance.checks} designs not in the fit "
        f"({tolerance.designs} designs in all); it predicted that a fraction of "
        f"{tolerance.expected:.2f} of these is within the limits, the forecasts found "
        f"{tolerance.kept:.2f}. Forecasts are corrected by {tolerance.centre.trials} trials of the "
        "design.",
    ]
    laws = [f"{shown_as[name]}, {law}" for name, law in source.laws.items()]
    if laws:
        lines[-1] += f" Not known, with the laws of the design as priors: {'; '.join(laws)}."
    return "\n".join(lines)


def write_samples(path: Path, tolerance: Tolerance) -> None:
    """Write the samples of the region; variables in SI."""
    names = tolerance.source.names
    rows = (tolerance.source.values(coordinates).values() for coordinates in tolerance.samples)
    save_csv(path, names, rows)


def _errors(evaluation: Evaluation) -> tuple[float, float, float]:
    if (tried := evaluation.summary) is None:
        return math.nan, math.nan, math.nan
    return tried.across.value / arcsec, tried.about.value / arcsec, tried.availability.value


def _written(interval: Interval, unit: float = arcsec) -> str:
    return bracketed(interval, f".{_digits(interval.value / unit)}f", unit)


def _digits(value: float) -> int:
    """Decimals for at least two significant digits; two where the value is zero or not finite."""
    return max(2, 1 - math.floor(math.log10(value))) if 0 < value < math.inf else 2


def optimum_values(optimum: Optimum, campaign: Campaign) -> dict[str, Any]:
    """An optimum for JSON."""
    space, available, units = optimum.space, optimum.availability, optimum.units
    ends = {"cost_start": optimum.start, "cost_best": optimum.best}
    costs = {name: campaign.cost(case) for name, case in ends.items()}
    costs = costs if campaign.minimise != "error" else {}
    return {
        "objective": str(campaign.goal),
        "minimise": campaign.minimise,
        **costs,
        "branch": optimum.branch,
        "start": to_json(summary_rows(optimum.fresh[0])),
        "best": to_json(summary_rows(optimum.fresh[1])),
        **to_json([Row("factor", optimum.factor), Row("optimism", optimum.optimism)]),
        "availability": available.value,
        "availability_bounds": [available.low, available.high],
        "values": space.text(optimum.best),
        "values_si": space.values(space.coordinates(optimum.best)),
        "on_bounds": space.on_bounds(optimum.best),
        "margins": optimum.margins,
        "lacking": optimum.lacking,
        "caveats": optimum_caveats(optimum, campaign),
        "evaluations": len(optimum.evaluations),
        "trials": optimum.trials,
        "errors_arcsec": {name: error / arcsec for name, error in optimum.errors.items()},
        "rounds": optimum.rounds,
        "feasible": optimum.feasible,
        "ending": optimum.ending,
        "start_stays": optimum.candidate is not None,
        **({"units": units_values(units)} if units else {}),
        **_landscape_values(optimum),
    }


def _landscape_values(optimum: Optimum) -> dict[str, Any]:
    """The design space by the forecasts, for JSON."""
    landscape, space = optimum.landscape, optimum.space
    if landscape is None:
        return {}
    ends = {
        name: [space.values(end)[name] for end in (span.at_low, span.at_high)]
        for name, span in landscape.spans.items()
    }
    return {
        "forecasts": len(landscape.forecasts),
        "possible_gain": landscape.left,
        "spans_si": ends,
        "unimportant": landscape.unimportant,
        "prices": landscape.prices,
    }
