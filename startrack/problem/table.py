"""Judgement, expectation -> lines with the values by trials and by formula."""

from collections.abc import Mapping

from startrack.metrics import Interval, bracketed
from startrack.problem.values import Expectation, Judgement, Words


def beside_forecast(words: Words, judged: Judgement, expected: Expectation) -> list[list[str]]:
    """The objective and its parts: name, value by trials, value by formula."""
    return [
        [words.value, with_interval(judged.value, words.unit), f"{expected.value:.4g}"],
        *(
            [
                words.parts[name][0],
                with_interval(part, words.parts[name][1]),
                f"{expected.parts[name]:.4g}",
            ]
            for name, part in judged.parts.items()
        ),
    ]


def ratios_answer(names: tuple[str, str], ratios: Mapping[str, Interval]) -> str:
    """A sentence: how much larger errors of a second design are, and which design is better.

    names   of both designs
    ratios  by the name of an error: second over first, with its interval
    """
    first, second = names
    better = {first: list[str](), second: list[str]()}
    for name, ratio in ratios.items():
        if ratio.low > 1:
            better[first].append(name)
        elif ratio.high < 1:
            better[second].append(name)
    verdicts = [f"{who} is better ({', '.join(where)})" for who, where in better.items() if where]
    values = ", ".join(f"{name} {with_interval(ratio, '')}" for name, ratio in ratios.items())
    verdict = "; ".join(verdicts) or "no difference is shown"
    return f"{second} over {first}: {values}; {verdict}"


def with_interval(value: Interval, unit: str) -> str:
    """A value as a text, with its interval and unit."""
    return f"{bracketed(value, '.4g')} {unit}".strip()
