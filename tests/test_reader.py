"""What a reader of the package meets stays as it is, or gets better."""

import ast
from collections import Counter
from pathlib import Path

import house_reader

ROOT = Path(__file__).parents[1]

MARK = "# fmt: " + "skip"


def test_the_formatter_writes_all_but_tables_of_numbers():
    marks = [
        path
        for folder in ("startrack", "tests", "experiments", "docs", "catalogs")
        for path in house_reader.sources(ROOT / folder)
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.endswith(MARK)
    ]
    assert len(marks) <= 60


def test_the_walk_of_the_light_and_the_private_imports_do_not_grow():
    """Measured over the syntax trees: no figure may rise above that of its last improvement."""
    assert house_reader.returns_of_the_walk() <= 86
    experiments = house_reader.sources(ROOT / "experiments")
    assert sum(map(house_reader.private_imports, experiments)) <= 135


def test_a_name_is_that_of_one_class():
    names = Counter(
        node.name
        for path in house_reader.sources(house_reader.HOME)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in names.items() if count > 1] == []
