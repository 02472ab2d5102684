"""Imports point up the page, rooms are strangers, and each heavy package has its one place."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "startrack"
ROOMS = (
    "catalog",
    "scene",
    "optics",
    "motion",
    "detector",
    "detection",
    "identification",
    "attitude",
    "error",
)
BASE = (
    *("units", "checks", "shipped", "seeds", "streams"),
    *("scratch", "dates", "curve", "turns", "camera", "values"),
)
# From top to bottom: a module may import those before it.
ORDER = (
    *BASE,
    *("exits", "saving", "sqlite", "tables"),
    *ROOMS,
    *(
        "wcs",
        "images",
        "case",
        "view",
        "single",
        "sweep",
        "window",
        "covariance",
        "chain",
        "products",
        "imager",
        "sequence",
        "variance",
        "budget",
        "study",
        "campaign",
        "design",
        "draw",
        "draw_psf",
        "draw_earth",
        "draw_sequence",
        "draw_budget",
        "draw_study",
        "report",
        "benchmark",
        "commands",
        "cli",
    ),
)
ONE_PLACE = {
    "nlopt": "study/search.py",
    "emcee": "study/ensemble.py",
    "rich": "commands/terminal.py",
}
FILES = sorted(ROOT.rglob("*.py"))


def imports(path: Path) -> set[str]:
    """All modules that a file imports, those inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            if node.module == "startrack":
                found |= {f"startrack.{alias.name}" for alias in node.names}
    return found


def place(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_up_the_page(path):
    here = place(path)
    for module in imports(path):
        parts = module.split(".")
        if parts[0] != "startrack" or len(parts) == 1 or parts[1] == here:
            continue
        assert here != "__init__", "the package itself must stay light"
        if here == "cli":
            assert parts[1] in ("exits", "__version__"), (
                "the command line imports commands when it runs them"
            )
        elif here in ROOMS:
            assert parts[1] in BASE, f"the room {here} must not know {module}"
        else:
            assert ORDER.index(parts[1]) < ORDER.index(here), f"{here} must not import {module}"


def test_every_module_has_its_place():
    assert {place(path) for path in FILES} - {"__init__"} == set(ORDER)


def test_the_packages_map_names_every_module_in_this_order():
    lines = (ast.get_docstring(ast.parse((ROOT / "__init__.py").read_text())) or "").splitlines()
    named = [re.match(r"(\w+(?:, \w+)*)(?:  |$)", line) for line in lines]
    assert [name for one in named if one for name in one[1].split(", ")] == list(ORDER)


@pytest.mark.parametrize("package", ["nlopt", "emcee", "rich"])
def test_one_file_imports(package):
    users = [
        str(path.relative_to(ROOT))
        for path in FILES
        if any(module.split(".")[0] == package for module in imports(path))
    ]
    assert users == [ONE_PLACE[package]]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_hidden_randomness_and_no_pickle(path):
    allowed = {"SeedSequence", "Generator", "SFC64", "default_rng", "RandomState", "MT19937"}
    for node in ast.walk(ast.parse(path.read_text())):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Attribute)
            and node.value.attr == "random"
            and isinstance(node.value.value, ast.Name)
            and node.value.value.id == "np"
        ):
            assert node.attr in allowed, f"np.random.{node.attr} draws from a global state"
    assert not {"pickle", "shelve", "marshal", "random"} & imports(path)


def test_importing_the_package_is_light():
    assert imports(ROOT / "cli.py") <= {
        *(
            "__future__",
            "argparse",
            "os",
            "sys",
            "collections.abc",
            "concurrent.futures",
            "importlib",
            "math",
            "pathlib",
            "textwrap",
            "typing",
        ),
        *("startrack", "startrack.__version__", "startrack.exits"),
    }
