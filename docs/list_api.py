"""Write docs/api.md: each public name of the package with its types and its first paragraph.

    python docs/list_api.py

Public are the names in startrack/__init__.pyi, and in the `__all__` of the packages named there.
"""

from __future__ import annotations

import ast
import copy
import inspect
import re
from collections.abc import Iterator
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, get_args, get_type_hints

import startrack

PAGE = Path(__file__).parent / "api.md"
HOME = Path(startrack.__file__).parent
# Inner parts of large indexes, which are not for users.
INSIDE = {"Cache", "Deck", "CodeTable", "SkyGrid", "VerificationStars", "Workspace"}
HEAD = """\
# The public API
The names that scripts may use: those of `startrack`, and those of the packages below. Each is \
loaded at its first use, so that `import startrack` takes 8 ms.

```python
from startrack import Streams, arcsec, budget, load_design, observe, pointing, shipped

case = load_design(shipped("designs/nanosatellite.toml")).case
record = observe(case, pointing(84, -1, 0), Streams(seed=1, trial=0))
print(record.outcome.stars, "stars matched;", budget.analytic(case).whole.across / arcsec)
```

A class that a function returns, and that nobody makes, stands below the functions of its package: \
its attributes are public, the place that it is imported from is not. \
All else may change without notice: the files inside a package, and modules that are not named \
here. Type checkers read the same list, `startrack/__init__.pyi` and \
`py.typed`. Units are SI; `Floats`, `Singles`, `Ints`, `Flags` and `Rows` are NumPy arrays of \
float64, float32, int64, bool and of a structured type, `Advance` a function of the steps that \
were just done, for a progress. Each name's equation, source, shapes and errors are in its \
docstring; `docs/build_api.py` makes pages of them. `python docs/list_api.py` writes this \
list.
"""


class Name(NamedTuple):
    """A public name: where it is listed, where it is written, and what it is."""

    package: str
    name: str
    home: str
    thing: Any


def public() -> Iterator[tuple[ModuleType, list[Name]]]:
    """Each public module with its names, the package first and then as its map has them."""
    waiting: list[ModuleType] = [startrack]
    while waiting:
        module = waiting.pop(0)
        things = {name: getattr(module, name) for name in module.__all__}
        inner = [thing for thing in things.values() if isinstance(thing, ModuleType)]
        inner += [getattr(module, name) for name in rooms_of(module)]
        waiting += sorted(inner, key=lambda one: _place(module, one))
        homes = _homes(module)
        yield (
            module,
            [
                Name(module.__name__, name, homes[name], thing)
                for name, thing in things.items()
                if not isinstance(thing, ModuleType)
            ],
        )


def rooms_of(module: ModuleType) -> list[str]:
    """The packages that the stub of a package names."""
    if module is not startrack:
        return []
    tree = ast.parse(Path(module.__file__ or "").with_suffix(".pyi").read_text(encoding="utf-8"))
    return [
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module is None
        for alias in node.names
    ]


def _place(module: ModuleType, inner: ModuleType) -> int:
    """Position of a module in the map that a package's docstring gives."""
    return (module.__doc__ or "").index("\n" + inner.__name__.rpartition(".")[2])


def _homes(module: ModuleType) -> dict[str, str]:
    """The file in which each name of a package is defined, through the doors between."""
    source = Path(module.__file__ or "")
    stub = source.with_suffix(".pyi")
    tree = ast.parse((stub if stub.exists() else source).read_text(encoding="utf-8"))
    homes: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            home = f"{module.__name__}.{node.module}" if node.level else str(node.module)
            inner = _homes(import_module(home)) if _is_door(home) else {}
            homes |= {alias.name: inner.get(alias.name, home) for alias in node.names}
    return homes


def _is_door(name: str) -> bool:
    inside = name.removeprefix("startrack.").split(".")
    return name.startswith("startrack.") and HOME.joinpath(*inside, "__init__.py").exists()


def function_of(thing: Any) -> Any:
    """The Python function below caches and compilers."""
    return inspect.unwrap(getattr(thing, "py_func", thing))


def signature(one: Name) -> str:
    """As it is written, on one line, without the units of files."""
    thing = function_of(one.thing)
    if inspect.isclass(thing):
        return one.name + _fields(thing)
    if inspect.isfunction(thing):
        written = _written(thing)
        assert isinstance(written, ast.FunctionDef)
        assert written.returns, one
        returns = _plain(written.returns, thing.__module__)
        return f"{one.name}({', '.join(_arguments(written, thing.__module__))}) -> {returns}"
    return f"{one.name}: {_kind(one)}"


def _fields(kind: type) -> str:
    if issubclass(kind, Enum):
        return ": " + ", ".join(member.name for member in kind)
    written = _written(kind)
    assert isinstance(written, ast.ClassDef)
    for node in written.body:
        if isinstance(node, ast.FunctionDef) and node.name == "__init__":
            return f"({', '.join(_arguments(node, kind.__module__)[1:])})"
    fields = [
        _field(ast.unparse(node.target), node.annotation, node.value, kind.__module__)
        for node in written.body
        if isinstance(node, ast.AnnAssign)
        and not ast.unparse(node.target).startswith("_")
        and not ast.unparse(node.annotation).startswith("ClassVar")
    ]
    return f"({', '.join(fields)})"


def _arguments(function: ast.FunctionDef, module: str) -> list[str]:
    taken = function.args
    defaults = [None] * (len(taken.args) - len(taken.defaults)) + taken.defaults
    places = [
        _field(one.arg, one.annotation, default, module)
        for one, default in zip(taken.args, defaults, strict=True)
    ]
    if taken.vararg:
        places.append(_field(f"*{taken.vararg.arg}", taken.vararg.annotation, None, module))
    elif taken.kwonlyargs:
        places.append("*")
    return places + [
        _field(one.arg, one.annotation, default, module)
        for one, default in zip(taken.kwonlyargs, taken.kw_defaults, strict=True)
    ]


def _field(name: str, kind: ast.expr | None, default: ast.expr | None, module: str) -> str:
    if isinstance(default, ast.Call) and ast.unparse(default.func).split(".")[-1] == "parameter":
        default = _default(default)
    text = f"{name}: {_plain(kind, module)}" if kind else name
    return f"{text} = {_plain(default, module)}" if default else text


def _written(thing: Any) -> ast.stmt:
    return next(
        node
        for node in reversed(_tree(thing.__module__).body)
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == thing.__name__
    )


def _default(declared: ast.Call) -> ast.expr | None:
    """The default value of a declared parameter; None where there is none."""
    words = {word.arg: word.value for word in declared.keywords}
    if "default_factory" in words:
        return ast.Call(words["default_factory"], [], [])
    return words.get("default")


def _plain(node: ast.AST, module: str) -> str:
    node = copy.deepcopy(node)  # which stays as it is written
    return ast.unparse(_Plainer(import_module(module)).visit(node))


class _Plainer(ast.NodeTransformer):
    """`Annotated[float, Unit("m")]` is a float, names stand without their room."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        if ast.unparse(node.value) == "Annotated" and isinstance(node.slice, ast.Tuple):
            return node.slice.elts[0]
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if ast.unparse(node.func) == "field":
            made = {word.arg: word.value for word in node.keywords}.get("default_factory")
            if made is not None:
                return ast.Call(self.visit(made), [], [])
        if ast.unparse(node.func) == "code_field":
            return node.args[1]
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Names stand without the room or file that they are written with, `core.Camera`."""
        place = node.value.id if isinstance(node.value, ast.Name) else ""
        thing = getattr(self.module, place, None)
        if isinstance(thing, ModuleType) and thing.__name__.startswith("startrack."):
            return ast.Name(node.attr)
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """The path of a file is told apart from that of a line of sight."""
        if getattr(self.module, node.id, None) is Path:
            return ast.Name("pathlib.Path")
        return node


def _kind(one: Name) -> str:
    """The type of a constant; of a union, what it is made of."""
    for node in _tree(one.home).body:
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == one.name:
            return _plain(node.annotation, one.home)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == one.name:
            return type(one.thing).__name__ if isinstance(one.thing, float) else _union(node.value)
    raise AssertionError(one)


def _union(node: ast.expr) -> str:
    assert isinstance(node, ast.BinOp), "must have an annotation"
    return f"TypeAlias = {ast.unparse(node)}"


def line(one: Name) -> str:
    """The first paragraph of its docstring; of a constant, the comment beside or above it."""
    thing = function_of(one.thing)
    if inspect.isclass(thing) or inspect.isfunction(thing):
        return first_paragraph(vars(thing).get("__doc__") or thing.__doc__)
    found = re.search(
        rf"((?:^# .*\n)*)^{one.name}\b[^#\n]*(?:  # (.+))?$", _source(one.home), re.MULTILINE
    )
    assert found, one
    return found[2] or " ".join(found[1].replace("# ", "").split())


@cache
def _source(module: str) -> str:
    return inspect.getsource(import_module(module))


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_source(module))


def classes_in(kind: Any) -> Iterator[type]:
    """The classes of the package that a type is made of."""
    ours = inspect.isclass(kind) and kind.__module__.startswith("startrack.")
    if ours and kind.__name__ not in INSIDE:
        yield kind
    for part in get_args(kind):
        for inner in part if isinstance(part, list) else [part]:
            yield from classes_in(inner)


def types_of(thing: Any) -> dict[str, Any]:
    """Types of the arguments and the result of a function, of the fields of a class."""
    thing = function_of(thing)
    if not (inspect.isfunction(thing) or inspect.isclass(thing)):
        return {}
    kinds = get_type_hints(thing, localns=_for_type_checkers(thing.__module__))
    return {name: kind for name, kind in kinds.items() if not name.startswith("_")}


@cache
def _for_type_checkers(module: str) -> dict[str, type]:
    """Names that a module imports for its annotations alone, such as astropy's WCS."""
    return {
        alias.name: object
        for node in _tree(module).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
        if isinstance(inner, ast.ImportFrom)
        for alias in inner.names
    }


def given(names: list[Name]) -> list[type]:
    """Classes of the results of these functions, of their methods and of their fields."""
    classes: list[type] = []
    waiting = [
        kind
        for one in names
        for kind in (
            classes_in(types_of(one.thing).get("return"))
            if not inspect.isclass(one.thing)
            else results_of_methods(one.thing)
        )
    ]
    while waiting:
        kind = waiting.pop(0)
        if kind not in classes:
            classes.append(kind)
            waiting += [part for one in types_of(kind).values() for part in classes_in(one)]
            waiting += results_of_methods(kind)
    return classes


def results_of_methods(kind: type) -> list[type]:
    return [
        part
        for name, method in inspect.getmembers(kind, inspect.isfunction)
        if not name.startswith("_") and method.__module__.startswith("startrack.")
        for part in classes_in(types_of(method).get("return"))
    ]


def page() -> str:
    """The text of docs/api.md."""
    parts = [HEAD]
    modules = list(public())
    shown = {one.thing for _, names in modules for one in names if inspect.isclass(one.thing)}
    for module, names in modules:
        about = first_paragraph(module.__doc__)
        parts.append(f"## `{module.__name__}`\n{about}\n")
        parts.append("".join(_item(one) for one in names))
        returned = [kind for kind in given(names) if kind not in shown and line_of(kind)]
        shown |= set(returned)
        if returned:
            items = [
                Name(kind.__module__, kind.__name__, kind.__module__, kind) for kind in returned
            ]
            parts.append("Returned:\n\n" + "".join(_item(one) for one in items))
    return "\n".join(parts)


def line_of(kind: type) -> str:
    """The first paragraph of a class's own docstring."""
    return first_paragraph(vars(kind).get("__doc__"))


def first_paragraph(text: str | None) -> str:
    """The lines of a docstring before the first empty line, as one."""
    return " ".join((text or "").strip().partition("\n\n")[0].split())


def _item(one: Name) -> str:
    return f"- `{signature(one)}`  \n  {line(one)}\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
