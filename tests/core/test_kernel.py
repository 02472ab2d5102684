"""Compiled code is kept on disk, and never used after what it is made of has changed."""

import os
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from types import ModuleType

import pytest
from numba import config

import startrack
from startrack import core

INNER = """
from typing import NamedTuple
import numpy as np
from numba.extending import register_jitable
from startrack.core import kernel

FACTOR = 3.0
TABLE = np.array([1.0, 2.0])

class Pair(NamedTuple):
    first: float
    second: float

@register_jitable
def product(x):
    return FACTOR * x

@kernel
def inner(x):
    return product(x)

@kernel
def first_of(pair):
    return pair.first
"""
OUTER = """
from startrack.core import kernel
from inner import TABLE, Pair, first_of, inner

@kernel
def middle(x):
    return inner(x) + TABLE[1]

@kernel(fastmath={"contract", "reassoc", "nsz", "arcp"})
def outer(x, pair):
    return middle(x) + 100 * first_of(pair)
"""
CALL = """
import inner, outer
pair = getattr(inner, "Pair", None) or inner.Couple
value = outer.outer(1.0, pair(first=7.0, second=9.0))
print(value, sum(outer.outer.stats.cache_hits.values()))
"""


def result(folder: Path, **environment: str) -> tuple[float, int]:
    """What the outermost kernel of modules imported anew gives, and whether it came from disk."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
        patch.setattr("numba.core.config.CACHE_DIR", "")
        for name in ("UNKEPT", "FOLDERS"):  # which `startrack warm` reports
            patch.setattr(sys.modules["startrack.core.kernel"], name, type(getattr(core, name))())
        patch.setattr("sys.dont_write_bytecode", True)  # known by time and size: edits keep both
        patch.syspath_prepend(str(folder))
        for name, value in environment.items():
            patch.setenv(name, value)
        for name in ("inner", "outer"):
            patch.setitem(sys.modules, name, ModuleType(name))  # puts back what was there
            del sys.modules[name]
        exec(CALL, {})
    value, hits = printed.getvalue().split()
    return float(value), int(hits)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder whose kernels have been compiled and kept."""
    folder = tmp_path_factory.mktemp("kernels")
    (folder / "inner.py").write_text(INNER)
    (folder / "outer.py").write_text(OUTER)
    assert result(folder) == (705.0, 0)
    return folder


@pytest.fixture
def folder(compiled, tmp_path):
    """A copy of it; kernels are kept beside the code, by content."""
    return shutil.copytree(compiled, tmp_path / "kernels")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
def test_two_processes_compile_a_kernel_once(tmp_path):
    """The one that comes second waits, and finds it on disk."""
    (tmp_path / "inner.py").write_text(INNER)
    (tmp_path / "outer.py").write_text(OUTER)
    variables = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    variables["PYTHONPATH"] = f"{Path(startrack.__file__).parents[1]}:{tmp_path}"
    code = f"import os, startrack.core\nother = os.fork()\n{CALL}\nif other: os.wait()"
    printed = subprocess.check_output([sys.executable, "-c", code], env=variables, text=True)
    assert sorted(printed.splitlines()) == ["705.0 0", "705.0 1"]


def edit(folder, old, new):
    for name in ("inner.py", "outer.py"):
        path = folder / name
        path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("FACTOR = 3.0", "# three\nFACTOR = 3.0", (705.0, 1)),  # nothing that is compiled
        ("return FACTOR * x", "return FACTOR * x + 0.5", (705.5, 0)),
        ("FACTOR = 3.0", "FACTOR = 4.0", (706.0, 0)),
        ("[1.0, 2.0]", "[1.0, 5.0]", (708.0, 0)),
        ("first: float\n    second: float", "second: float\n    first: float", (705.0, 0)),
        ("Pair", "Couple", (705.0, 0)),
    ],
    ids=["comment", "code", "number", "array", "order of fields", "name of a class"],
)
def test_an_edit_below_reaches_the_kernels_above(folder, old, new, expected):
    """The outermost kernel's own file only imports what is edited."""
    edit(folder, old, new)
    assert result(folder) == expected


def test_where_nothing_can_be_written_kernels_work_all_the_same(compiled, tmp_path):
    """Neither beside the code nor in the user's folder."""
    for name in ("inner.py", "outer.py"):
        shutil.copy(compiled / name, tmp_path)
    for blocked in ("__pycache__", "home"):  # files where folders would be
        (tmp_path / blocked).write_text("")
    home = str(tmp_path / "home")
    assert result(tmp_path, HOME=home, XDG_CACHE_HOME=home) == (705.0, 0)


@pytest.mark.parametrize("change", ["cut", "flipped", "another's", "anyone's"])
def test_a_damaged_or_foreign_cache_is_made_anew(folder, change):
    files = list((folder / "__pycache__").glob("*.nbc"))
    assert files
    for file in files:
        data = file.read_bytes()
        if change == "cut":
            file.write_bytes(data[: len(data) // 2])
        elif change == "flipped":
            file.write_bytes(data[:99] + bytes([data[99] ^ 1]) + data[100:])
        elif change == "anyone's":
            file.chmod(0o666)
        elif os.geteuid() == 0:
            os.chown(file, 65534, 65534)
        else:
            pytest.skip("only root can give a file away")
    assert result(folder) == (705.0, 0)


def test_without_a_compiler_a_kernel_is_its_python_code(monkeypatch):
    """As under NUMBA_DISABLE_JIT; some functions of arrays call the code of a kernel itself."""
    monkeypatch.setattr(config, "DISABLE_JIT", True)

    @core.kernel
    def double(x):
        return 2 * x

    assert type(double) is type(double.py_func)
    assert double(3.0) == double.py_func(3.0) == 6.0
