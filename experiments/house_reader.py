"""Measures of the package's readability, from its syntax trees and calls."""

from __future__ import annotations

import ast
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import startrack

HOME = Path(startrack.__file__).parent
ROOT = HOME.parent
# The path of the light from charge to attitude: entry functions in sequence.
STATIONS = (
    ("startrack.detector.exposure", "expose"),
    ("startrack.detection.detect", "detect"),
    ("startrack.identification.identify", "identify"),
    ("startrack.attitude.solve", "solve"),
)


def measures() -> dict[str, Any]:
    """Measures of readability.

    statements, nodes     of the package's syntax trees
    fmt_skip              marks that keep the formatter from a statement
    formatted_lines       lines as the formatter writes them
    class_names_twice     names of more than one class
    public_names_top      names at the top of the package
    private_imports_experiments  imports by experiments of modules inside a room
    walk_returns          see `returns_of_the_walk`
    units_branches        conditions on whether a design has units
    lru_caches            functions behind `lru_cache` or `cache`
    readme_words          words of the README
    """
    trees = [_tree(path) for path in sources(HOME)]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    written = "".join(path.read_text(encoding="utf-8") for path in sources(HOME))
    tests = (node.test for node in nodes if isinstance(node, ast.If | ast.IfExp))
    return {
        "statements": sum(isinstance(node, ast.stmt) for node in nodes),
        "nodes": len(nodes),
        "fmt_skip": written.count("# fmt: skip"),
        "formatted_lines": formatted_lines(),
        "class_names_twice": sum(count > 1 for count in names.values()),
        "public_names_top": len(dir(startrack)),
        "private_imports_experiments": sum(map(private_imports, sources(ROOT / "experiments"))),
        "walk_returns": returns_of_the_walk(),
        "units_branches": sum(bool(re.search(r"\bunits\b", ast.unparse(test))) for test in tests),
        "lru_caches": len(re.findall(r"^@(?:functools\.)?(?:lru_cache|cache)\b", written, re.M)),
        "readme_words": len((ROOT / "README.md").read_text(encoding="utf-8").split()),
    }


def sources(folder: Path) -> list[Path]:
    """The Python files of a folder."""
    return sorted(folder.rglob("*.py"))


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def formatted_lines() -> int:
    """Lines of the package after the formatter, without marks to skip."""
    command = ["ruff", "format", "--config", str(ROOT / "pyproject.toml"), "-"]
    lines = 0
    for path in sources(HOME):
        text = path.read_text(encoding="utf-8").replace("  # fmt: skip", "")
        done = subprocess.run(command, input=text, capture_output=True, text=True, check=True)
        lines += len(done.stdout.splitlines())
    return lines


def private_imports(path: Path) -> int:
    """Imports of a file from inside a room of the package, past its `__init__`.

    An import is private if its module is inside a room and the room's `__init__` does not name it,
    or if the imported name begins with an underscore.
    """
    count = 0
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            count += sum(not _is_room(alias.name) for alias in node.names if _is_ours(alias.name))
        elif isinstance(node, ast.ImportFrom) and _is_ours(str(node.module)):
            room, names = str(node.module), [alias.name for alias in node.names]
            hidden = any(_is_hidden(room, name) for name in names)
            count += not _is_room(room) or hidden
    return count


def _is_ours(module: str) -> bool:
    return module.split(".")[0] == "startrack"


def _is_room(module: str) -> bool:
    return ROOT.joinpath(*module.split("."), "__init__.py").exists()


def _is_hidden(room: str, name: str) -> bool:
    """Whether a name is private, or a module of a room that its `__init__` does not name."""
    if name.startswith("_"):
        return True
    folder = ROOT.joinpath(*room.split("."))
    if not (folder / f"{name}.py").exists():
        return False
    door = _tree(folder / "__init__.py").body
    bound = (
        alias.asname or alias.name
        for node in door
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    )
    return name not in bound


def returns_of_the_walk() -> int:
    """Number of returns of a reader to an earlier file, along the calls.

    From each entry the functions of the package are read in the order of calls, each once and to
    its end. A call of another file leads there; its end leads to the next call, possibly in an
    earlier file.
    """
    done: set[tuple[str, str]] = set()
    files: list[str] = []
    for module, name in STATIONS:
        _walk(module, name, done, files)
    left: set[str] = set()
    returns = 0
    for before, after in pairwise(files):
        if after != before:
            left.add(before)
            returns += after in left
    return returns


def _walk(module: str, name: str, done: set[tuple[str, str]], files: list[str]) -> None:
    module, name = _home(module, name)
    function = _function(module, name)
    if function is None or (module, name) in done or not module.startswith("startrack."):
        return
    done.add((module, name))
    files.append(module)
    for called in _called(function):
        where = _resolved(module, called)
        if where:
            _walk(*where, done, files)


def _called(function: ast.AST) -> Iterator[ast.expr]:
    calls = [node for node in ast.walk(function) if isinstance(node, ast.Call)]
    for call in sorted(calls, key=lambda call: (call.lineno, call.col_offset)):
        yield call.func


def _resolved(module: str, called: ast.expr) -> tuple[str, str] | None:
    if isinstance(called, ast.Name):
        return module, called.id
    if isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name):
        thing = getattr(import_module(module), called.value.id, None)
        inside = getattr(thing, "__name__", "")
        if _is_module(thing) and inside.startswith("startrack."):
            return inside, called.attr
    return None


def _is_module(thing: Any) -> bool:
    return isinstance(thing, ModuleType)


def _home(module: str, name: str) -> tuple[str, str]:
    """The file of a function, followed through the `__init__` of rooms."""
    thing = getattr(import_module(module), name, None)
    function = getattr(thing, "py_func", getattr(thing, "__wrapped__", thing))
    return getattr(function, "__module__", module) or module, getattr(function, "__name__", name)


def _function(module: str, name: str) -> ast.FunctionDef | None:
    if not module.startswith("startrack."):
        return None
    file = import_module(module).__file__
    body = _tree(Path(str(file))).body
    return next((n for n in body if isinstance(n, ast.FunctionDef) and n.name == name), None)
