"""Verification -> the table of its verdicts as texts, and the sentences below it."""

from __future__ import annotations

import math
from typing import Any

from startrack.core import arcsec
from startrack.io import aligned
from startrack.verification.decide import Answer
from startrack.verification.verify import Verdict, Verification

HEAD = ("condition", "requirement", "limit", "analysis", "trials", "bounds", "n", "margin",
        "verdict")  # fmt: skip
LEFT = (0, 1, 8)  # columns of words


def rows(found: Verification) -> list[list[str]]:
    """A row of HEAD for each verdict; errors in arcsecond, availability in percent."""
    return [_row(one) for one in found.verdicts]


def notes(found: Verification) -> list[str]:
    """What the table means, and what it leaves out."""
    limited = dict.fromkeys(f"{one.name}: {one.statistic}" for one in found.verdicts if one.trials)
    lines = list(limited)
    lines += [f"{one.condition}: {one.note}" for one in found.verdicts if one.note]
    lines += [f"not judged: {reason}" for reason in found.left]
    sizes, alpha = ", ".join(map(str, found.looks.sizes)), 100 * found.looks.alpha
    lines.append(
        f"tested at {sizes} trials until decided; a pass or a fail of the whole is wrong with a "
        f"probability of at most {alpha:g} %. Errors in arcsec, availability in %; margins are "
        "fractions of the limits, that of stars is in mag."
    )
    return lines


def text(found: Verification) -> str:
    """The table and its notes as plain text."""
    lines = aligned([HEAD, *rows(found)], LEFT)
    return "\n".join([*lines, "", f"verdict: {_written(found.answer)}", *notes(found)])


def values(found: Verification) -> dict[str, Any]:
    """A verification for JSON; errors in arcsecond, availability as a fraction."""
    return {
        "verdict": found.answer.value,
        "requirements": [_values(one) for one in found.verdicts],
        "not_judged": list(found.left),
        "looks": found.looks.sizes,
        "wrong_verdict_probability": found.looks.alpha,
    }


def _values(one: Verdict) -> dict[str, Any]:
    unit = 1.0 if one.name == "availability" else arcsec
    bounds = one.trials
    return {
        "condition": one.condition,
        "requirement": one.name,
        "statistic": one.statistic,
        "limit": one.limit / unit,
        "analysis": one.analysis / unit,
        "trials": bounds.value / unit if bounds else None,
        "bounds": [bounds.low / unit, bounds.high / unit] if bounds else None,
        "number": one.number,
        "margin": one.margin,
        "verdict": one.answer.value,
        "trials_needed": one.needed,
        "note": one.note,
    }


def _row(one: Verdict) -> list[str]:
    answer, margin = _written(one.answer), f"{one.margin:+.3f}"
    if one.trials is None:
        return [one.condition, one.name, *[""] * 5, margin, answer]
    if one.answer is Answer.NOT_SHOWN:
        enough = f"about {one.needed} trials" if one.needed else "no number of trials"
        answer += f": {enough} would do"
    unit = 0.01 if one.name == "availability" else arcsec
    limit, analysis, value, low, high = (
        _number(each / unit)
        for each in (one.limit, one.analysis, one.trials.value, one.trials.low, one.trials.high)
    )
    bounds = f"[{low}, {high}]"
    return [
        one.condition,
        one.name,
        limit,
        analysis,
        value,
        bounds,
        str(one.number),
        margin,
        answer,
    ]


def _written(answer: Answer) -> str:
    return answer.value if answer is Answer.PASS else answer.value.upper()


def _number(value: float) -> str:
    if math.isnan(value):
        return "none"
    return "open" if math.isinf(value) else f"{value:.4g}"
