"""Phrases that were replaced stay out of code, messages and pages."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NEVER = {
    "of one's own": "a user's, or user code",
    "of one\\'s own": "a user's, or user code",
    "as of `": "as for `",
    "so many": "the quantity by its name",
    "by so much": "the quantity by its name",
    "that of those": "the quantity by its name",
    "take turns": "run alternately",
    "in hand": "margin",
    "lest ": "so that ... not",
    "reckon": "assume, or estimate",
    "strewn": "randomly distributed",
    "is not kind": "is realistic",
    "as a file has": "in the form of a file",
    "as a design file has": "in the form of a design file",
    "is no number": "is not a number",
    "is no outlier": "is not an outlier",
    "as it was asked": "the words of the user",
    "goes on where": "continues",
}
FILES = [
    path
    for folder in ("startrack", "docs", "catalogs", "experiments")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in (".py", ".pyi", ".md", ".toml")
] + [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")]


@pytest.mark.parametrize("phrase", NEVER)
def test_a_phrase_is_not_used(phrase):
    pattern = re.compile(rf"(?<![a-z]){re.escape(phrase)}")
    used = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in FILES
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if pattern.search(line)
    ]
    assert not used, f"{phrase!r} must be {NEVER[phrase]!r}: {', '.join(used)}"
