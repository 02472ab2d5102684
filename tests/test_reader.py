"""Measures of how the package reads stay as they are, or improve."""

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


def test_the_walk_of_the_light_does_not_grow():
    """Measured over the syntax trees: it may not exceed the value after its last improvement."""
    assert house_reader.returns_of_the_walk() <= 81


def test_an_experiment_enters_a_room_by_its_door():
    experiments = house_reader.sources(ROOT / "experiments")
    assert [path.name for path in experiments if house_reader.private_imports(path)] == []


def test_an_import_past_a_door_is_noticed(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import startrack.optimise\n"
        "import startrack.trial.window\n"
        "from startrack.optimise import optimize, search\n"
        "from startrack.optimise.search import minimise\n"
        "from startrack.benchmark import detection\n"
    )
    assert house_reader.private_imports(script) == 3


def test_a_name_is_that_of_one_class():
    names = Counter(
        node.name
        for path in house_reader.sources(house_reader.HOME)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in names.items() if count > 1] == []
