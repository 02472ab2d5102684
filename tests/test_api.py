"""Public names are listed once and have types and a docstring; the page is that list."""

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

import list_api
import numpy as np
import pytest
from list_api import Name, classes_in, function_of, given, line, public, signature, types_of

import startrack
from startrack import Case
from startrack.core import Parameters

MODULES = list(public())
NAMES = [one for _, names in MODULES for one in names]
CLASSES = {one.thing for one in NAMES if inspect.isclass(one.thing)}
EXPERIMENTS = sorted((Path(__file__).parents[1] / "experiments").glob("*.py"))


def told(one: Name) -> str:
    return f"{one.package}.{one.name}"


def test_the_page_is_of_today():
    assert list_api.PAGE.read_text(encoding="utf-8") == list_api.page(), (
        "python docs/list_api.py writes it anew"
    )


def test_the_pages_example_runs(capsys):
    (block,) = re.findall(r"```python\n(.*?)```", list_api.PAGE.read_text(), re.DOTALL)
    exec(compile(block, "api.md", "exec"), {})
    assert re.fullmatch(r"\d+ stars matched; \d\.\d+\n", capsys.readouterr().out)


def test_a_module_shows_its_list_and_nothing_else():
    faults = []
    for module, _ in MODULES:
        names: dict[str, object] = {}
        exec(f"from {module.__name__} import *", names)
        for name in (set(names) - {"__builtins__"}) ^ set(module.__all__):
            faults.append(f"{module.__name__}: {name} is in __all__ or in the module, not in both")
        if not module.__doc__:
            faults.append(f"{module.__name__} must have a docstring")
    none(faults)


def test_the_package_shows_its_list_alone():
    assert set(dir(startrack)) == set(startrack.__all__)


def test_the_top_of_the_package_is_what_a_script_needs():
    """Names of one case are in their rooms, which are attributes, too, and are not in the list."""
    assert len(dir(startrack)) <= 45
    assert startrack.mission.load_mission
    with pytest.raises(AttributeError, match="nothing"):
        _ = startrack.nothing  # type: ignore[attr-defined]


def test_a_public_name_says_what_it_is():
    none(
        f"{told(one)} must have a docstring, or a comment as a constant, and a signature"
        for one in NAMES
        if len(line(one)) <= 4 or not (":" in signature(one) or "()" in signature(one))
    )


def test_a_public_name_has_all_its_types():
    none(f"{told(one)} has no type of {name}" for one in NAMES for name in untyped(one.thing))


def untyped(thing: Any) -> Iterator[str]:
    """Arguments and results without annotation, of a function or of the methods of a class."""
    thing = function_of(thing)
    if inspect.isfunction(thing):
        parts = inspect.signature(thing)
        if parts.return_annotation is inspect.Signature.empty:
            yield "its result"
        for name, part in parts.parameters.items():
            if part.annotation is inspect.Parameter.empty:
                yield name
    elif inspect.isclass(thing) and not issubclass(thing, Enum):
        for name, method in inspect.getmembers(thing, inspect.isfunction):
            if method.__module__.startswith("startrack") and not name.startswith("_"):
                bare = (set(inspect.signature(method).parameters) - {"self"}) | {"return"}
                yield from (f"{name}: {each}" for each in bare - set(method.__annotations__))


def test_what_a_public_name_takes_can_be_had():
    """Its class is public, or a public name returns it; the page has the fields of all returned
    classes."""
    returned = set(given(NAMES)) | {
        part  # what user code is given
        for one in NAMES
        if one.name.endswith("Input")
        for kind in types_of(one.thing).values()
        for part in classes_in(kind)
    }
    none(
        f"{told(one)} takes {kind.__name__}, which is not public"
        for one in NAMES
        for name, hint in types_of(one.thing).items()
        if name != "return"
        for kind in classes_in(hint)
        if kind not in CLASSES | returned
    )


def test_a_result_that_is_large_prints_itself_on_one_screen():
    """If it contains arrays or a design, whose plain output would be pages long."""
    results = [one for one in given(NAMES) if is_dataclass(one) or hasattr(one, "_fields")]
    none(
        f"{kind.__module__}.{kind.__name__} must be @printed"
        for kind in results
        if not issubclass(kind, Parameters) and not hasattr(kind, "_repr_html_")
        if any(map(is_large, types_of(kind).values()))
    )


def is_large(hint: Any) -> bool:
    kind = getattr(hint, "__origin__", hint)
    return (inspect.isclass(kind) and issubclass(kind, np.ndarray | Case)) or any(
        is_large(inner)
        for part in get_args(hint)
        for inner in (part if isinstance(part, list) else [part])
    )


def test_an_experiment_takes_a_public_name_from_where_it_is_public():
    listed = {id(one.thing) for one in NAMES}
    packages = {module.__name__ for module, _ in MODULES}
    faults = []
    for path in EXPERIMENTS:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or node.module in packages:
                continue
            if (node.module or "").startswith("startrack."):
                with suppress(ImportError):  # of what an extra would bring
                    module = import_module(str(node.module))
                    faults += [
                        f"{path.name} takes {alias.name} from {node.module}"
                        for alias in node.names
                        if id(getattr(module, alias.name, None)) in listed
                    ]
    none(faults)


def none(faults: Iterable[str]) -> None:
    """Fail with all faults, one a line."""
    found = sorted(faults)
    assert not found, "\n" + "\n".join(found)


SCRIPT = """
from startrack import budget, load_design, run_trials, shipped
case = load_design(shipped("designs/noise_only.toml")).case
reveal_type(budget.analytic(case).whole.across)
reveal_type(run_trials)
run_trials(case, "one", [1])
"""


@pytest.mark.slow
def test_a_type_checker_knows_what_a_script_takes(tmp_path):
    """The stub represents the package: a type that it lacks would be Any, without an error."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    checker = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path), str(script)]
    found = subprocess.run(checker, capture_output=True, text=True, cwd=tmp_path).stdout
    assert re.search(r"script.py:4: note: Revealed type is .*float", found), found
    assert re.search(
        r"script.py:5: note: .*def \(case: startrack.design.case.Case, seed:", found
    ), found
    assert re.search(r'script.py:6: error: Argument 2 to "run_trials" has incompatible', found), (
        found
    )
