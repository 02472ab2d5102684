"""Judgement, expectation -> lines with the values by trials and by formula."""

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


def with_interval(value: Interval, unit: str) -> str:
    """A value as a text, with its interval and unit."""
    return f"{bracketed(value, '.4g')} {unit}".strip()
