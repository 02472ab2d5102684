"""Imports point upwards, a room is entered by its `__init__`, each heavy package has one place."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1] / "startrack"
# From top to bottom: a room may import those before it. Rooms of Earth cameras stand alone.
ROOMS = (
    *("core", "io", "space"),
    *("catalog", "scene", "optics", "motion", "detector"),
    *("detection", "identification", "attitude", "metrics"),
    *(
        "problem",
        "design",
        "observation",
        "response",
        "trial",
        "photograph",
        "population",
        "sequence",
        "montecarlo",
        "budget",
        "verification",
    ),
    *("optimise", "prediction", "calibration", "mission", "onboard"),
    *("earth.terrain", "earth.geometry", "earth.atmosphere", "earth.imager", "earth.product"),
    *("earth.retrieval", "moving"),
    *("plots", "report", "page", "benchmark", "cli"),
)
# From catalog to metrics: strangers to each other, which meet only in `core`, `io` and `space`.
STATIONS = ROOMS[ROOMS.index("catalog") : ROOMS.index("problem")]
ONE_PLACE = {
    "nlopt": "optimise/search.py",
    "emcee": "optimise/ensemble.py",
    "rich": "cli/terminal.py",
}
FILES = sorted(ROOT.rglob("*.py"))
MODULES = {
    ".".join(("startrack", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")
    for path in FILES
}


@cache
def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def tree(path: Path) -> ast.Module:
    return ast.parse(text(path))


@cache
def imported(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """The imports of a file, including those inside functions."""
    kinds = ast.Import, ast.ImportFrom
    return [one for one in statements(tree(path).body) if isinstance(one, kinds)]


def statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """All statements of a body and of its inner bodies: a tenth of the nodes of the code."""
    for one in body:
        yield one
        for part in ("body", "orelse", "finalbody"):
            yield from statements(getattr(one, part, []))
        for case in (*getattr(one, "handlers", ()), *getattr(one, "cases", ())):
            yield from statements(case.body)


def nodes_where(path: Path, words: str) -> list[ast.AST]:
    """All nodes of a file's code that contain such words."""
    return list(ast.walk(tree(path))) if re.search(words, text(path)) else []


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def room(path: Path) -> str:
    """The room of a file, "" for the package itself."""
    return ".".join(path.relative_to(ROOT).parent.parts)


@cache
def imports(path: Path) -> frozenset[str]:
    """All modules that a file imports, including those inside functions."""
    found = set()
    for node in imported(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        else:
            assert node.level == 0, f"{name(path)}: relative import"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inner & MODULES
            if not inner <= MODULES:  # else rooms are imported as rooms
                found.add(node.module)
    return frozenset(found)


@cache
def imported_rooms(path: Path) -> dict[str, str]:
    """Each module of the package that a file imports, with its room."""
    found = {}
    for module in imports(path):
        if module.startswith("startrack."):
            inside = module.removeprefix("startrack.")
            found[inside] = max(
                (one for one in ROOMS if f"{inside}.".startswith(f"{one}.")), key=len, default=""
            )
    return found


@cache
def names_bound(path: Path) -> set[str]:
    """Names that an `__init__` takes from its modules: a function may have the name of its file."""
    return {
        alias.asname or alias.name
        for node in tree(path).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_every_file_stands_in_a_room():
    rooms = {room(path) for path in FILES} - {"", "earth"}
    assert rooms == set(ROOMS)


def test_imports_point_up_the_page():
    wrong = []
    for path in FILES:
        here = room(path)
        for module, there in imported_rooms(path).items():
            if there == here or (here == "" and module == "__version__"):
                continue
            if not here or not there or ROOMS.index(there) > ROOMS.index(here):
                wrong.append(f"{name(path)} imports {module}, which stands below it")
    assert not wrong, "\n".join(wrong)


def test_stations_are_strangers():
    wrong = [
        f"{name(path)} imports {module}, but stations meet only in core"
        for path in FILES
        if room(path) in STATIONS
        for module, there in imported_rooms(path).items()
        if there not in (room(path), "core", "io", "space")
    ]
    assert not wrong, "\n".join(wrong)


def test_nothing_else_needs_the_rooms_of_earth_cameras():
    """They could be removed: only their display and their command import them."""
    allowed = ("plots", "report", "page", "benchmark", "cli")
    wrong = [
        f"{name(path)} imports {module}"
        for path in FILES
        if not room(path).startswith("earth") and room(path) not in allowed
        for module, there in imported_rooms(path).items()
        if there.startswith("earth")
    ]
    assert not wrong, "\n".join(wrong)


def test_a_room_is_entered_by_its_door():
    wrong = []
    for path in FILES:
        here = room(path)
        for node in imported(path):
            if not isinstance(node, ast.ImportFrom) or not node.module.startswith("startrack."):
                continue
            there = node.module.removeprefix("startrack.")
            inner = {f"{there}.{alias.name}" for alias in node.names} <= set(ROOMS)
            if there not in ROOMS and not inner and not f"{there}.".startswith(f"{here}."):
                wrong.append(f"{name(path)} imports from {there}, a module inside another room")
            if there in ROOMS and there != here:
                door = names_bound(ROOT.joinpath(*there.split("."), "__init__.py"))
                wrong += [
                    f"{name(path)} imports the module {there}.{alias.name} of another room"
                    for alias in node.names
                    if f"{node.module}.{alias.name}" in MODULES and alias.name not in door
                ]
    assert not wrong, "\n".join(wrong)


def test_no_circles_inside_rooms():
    """The modules of one room can also be put in an order."""
    needs = {
        module: {
            found
            for found in (f"startrack.{one}" for one in imported_rooms(path))
            if found in MODULES
            and found.rpartition(".")[0] == module.rpartition(".")[0]
            and found != module
        }
        for path in FILES
        if path.name != "__init__.py"
        for module in [".".join(("startrack", *path.relative_to(ROOT).with_suffix("").parts))]
    }
    while needs:
        free = {module for module, others in needs.items() if not others & set(needs)}
        assert free, f"a circle among {sorted(needs)}"
        needs = {module: others for module, others in needs.items() if module not in free}


def test_maps_are_of_today():
    """The package lists its rooms in their order, and each room all of its files."""
    wrong = []
    lines = (ast.get_docstring(tree(ROOT / "__init__.py")) or "").splitlines()
    named = [found[1] for line in lines if (found := re.match(r"(\w+)  +\w", line))]
    assert named == list(dict.fromkeys(one.split(".")[0] for one in ROOMS))
    for one in ROOMS:
        door = ROOT.joinpath(*one.split("."), "__init__.py")
        words = re.findall(r"\w+", ast.get_docstring(tree(door)) or "")
        wrong += [
            f"the docstring of {one} must name {path.stem}"
            for path in FILES
            if path.parent == door.parent and not path.stem.startswith("_")
            if path.stem not in words
        ]
    assert not wrong, "\n".join(wrong)


def test_heavy_packages_have_one_place():
    wrong = []
    for package, place in ONE_PLACE.items():
        users = {
            name(path)
            for path in FILES
            if any(module.split(".")[0] == package for module in imports(path))
            or re.search(rf'import_module\(f?"{package}[".]', text(path))
        }
        if users != {place}:
            wrong.append(f"{package} must be imported by {place} alone, got {sorted(users)}")
    assert not wrong, "\n".join(wrong)


def test_functions_are_compiled_in_one_way():
    """Otherwise an edit of a called kernel would go unnoticed; unpublished names are in one
    file."""
    users = {
        name(path)
        for path in FILES
        if any(re.match(r"numba\.(?!extending)|llvmlite\.", module) for module in imports(path))
    }
    assert users == {"core/compiler.py"}
    wrong = [
        f"{name(path)} uses numba's {node.id}, not core.kernel"
        for path in FILES
        if name(path) != "core/kernel.py"
        for node in nodes_where(path, "jit")
        if isinstance(node, ast.Name) and node.id in ("njit", "jit")
    ]
    assert not wrong, "\n".join(wrong)


def test_no_hidden_randomness_and_no_pickle():
    allowed = {"SeedSequence", "Generator", "SFC64", "default_rng", "RandomState", "MT19937"}
    wrong = []
    for path in FILES:
        for node in nodes_where(path, "random"):
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Attribute)
                and ast.unparse(node.value) == "np.random"
                and node.attr not in allowed
            ):
                wrong.append(f"{name(path)}: np.random.{node.attr} draws from a global state")
        hidden = {"pickle", "shelve", "marshal", "random"} & imports(path)
        # What numba writes before its files may be written to compare; nothing is read by pickle.
        if name(path) == "core/compiler.py" and re.findall(r"pickle\.(\w+)", text(path)) == [
            "dumps"
        ]:
            hidden -= {"pickle"}
        wrong += [f"{name(path)} imports {module}" for module in sorted(hidden)]
    assert not wrong, "\n".join(wrong)


def test_the_command_line_starts_light():
    """`startrack --help` loads no room."""
    standard = {
        "__future__",
        "argparse",
        "builtins",
        "errno",
        "gc",
        "io",
        "os",
        "sys",
        "collections.abc",
        "importlib",
        "math",
    }
    standard |= {
        "concurrent.futures",
        "signal",
        "threading",
        "traceback",
        "contextlib",
        "pathlib",
        "textwrap",
        "typing",
        "enum",
        "warnings",
    }
    modules = ("main", "options", "stopping")
    light = {f"startrack.cli.{module}" for module in modules}
    light.add("startrack")
    for module in modules:
        found = imports(ROOT / "cli" / f"{module}.py")
        if module == "stopping":
            found -= {"startrack.core"}  # where a command has run
        assert found <= standard | light, found - standard - light
