"""Compiled code is kept on disk, and never used after one of its sources has changed."""

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba import config
from numba.core.errors import TypingError

import startrack
from startrack import core
from startrack.core import compiler
from startrack.core.variates import poisson_quantile

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


MODULE = sys.modules["startrack.core.kernel"]  # whose name in the package is the function's


def result(folder: Path, **environment: str) -> tuple[float, int]:
    """The result of the outermost kernel of freshly imported modules, and whether it came from
    disk."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
        patch.setattr(config, "CACHE_DIR", "")
        patch.setattr(MODULE, "PACKAGE", folder)
        patch.setattr("sys.dont_write_bytecode", True)  # known by time and size: edits keep both
        patch.syspath_prepend(str(folder))
        for name, value in environment.items():
            patch.setenv(name, value)
        for name in ("inner", "outer"):
            patch.setitem(sys.modules, name, ModuleType(name))  # puts back what was there
            del sys.modules[name]
        core.kernel_folder.cache_clear()
        try:
            exec(CALL, {})
        finally:
            core.kernel_folder.cache_clear()
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
def folder(compiled):
    """The same folder; its sources are restored after a test."""
    yield compiled
    (compiled / "inner.py").write_text(INNER)
    (compiled / "outer.py").write_text(OUTER)


@pytest.mark.slow
def test_processes_that_compile_at_once_find_the_same(tmp_path):
    """The next process finds the kernel on disk."""
    (tmp_path / "inner.py").write_text(INNER)
    (tmp_path / "outer.py").write_text(OUTER)
    code = (
        f"import sys; sys.path[:0] = ['.', {str(tmp_path)!r}]\n"
        "from tests.core.test_kernel import Path, result\n"
        f"print(*result(Path({str(tmp_path)!r})))"
    )
    command = [sys.executable, "-c", code]
    root = Path(__file__).parents[2]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root) for _ in "ab"]
    assert [process.communicate()[0].split()[0] for process in both] == ["705.0"] * 2
    assert result(tmp_path) == (705.0, 1)


def edit(folder, old, new):
    for name in ("inner.py", "outer.py"):
        path = folder / name
        path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("", "", (705.0, 1)),
        ("return FACTOR * x", "return FACTOR * x + 0.5", (705.5, 0)),
        ("FACTOR = 3.0", "FACTOR = 4.0", (706.0, 0)),
        ("[1.0, 2.0]", "[1.0, 5.0]", (708.0, 0)),
        ("first: float\n    second: float", "second: float\n    first: float", (705.0, 0)),
        ("Pair", "Couple", (705.0, 0)),
    ],
    ids=["nothing", "code", "number", "array", "order of fields", "name of a class"],
)
def test_an_edit_below_reaches_the_kernels_above(folder, old, new, expected):
    """The file of the outermost kernel only imports the edited one."""
    edit(folder, old, new)
    assert result(folder) == expected


def test_where_nothing_can_be_written_kernels_work_all_the_same(compiled, tmp_path):
    """Neither the folder of the code nor the user's folder can be written to."""
    for name in ("inner.py", "outer.py"):
        shutil.copy(compiled / name, tmp_path)
    for blocked in ("__pycache__", "home"):  # files where folders would be
        (tmp_path / blocked).write_text("")
    home = str(tmp_path / "home")
    assert result(tmp_path, HOME=home, XDG_CACHE_HOME=home) == (705.0, 0)


@pytest.mark.parametrize(
    "change", ["cut", "flipped", "index", "another's", "anyone's", "group's", "a file of the group"]
)
def test_a_damaged_or_foreign_cache_is_made_anew(folder, tmp_path, change):
    assert result(folder)[0] == 705.0
    kept = max((folder / "__pycache__").glob("kernels-*"), key=lambda path: path.stat().st_mtime)
    files = list(kept.rglob("*.nbi" if change == "index" else "*.nbc"))
    assert files
    for file in files:
        data = file.read_bytes()
        if change in ("cut", "index"):
            file.write_bytes(data[: len(data) // 2])
        elif change == "flipped":
            middle = len(data) // 2
            file.write_bytes(data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :])
        elif change == "a file of the group":
            file.chmod(0o664)
    if change in ("anyone's", "group's"):
        kept.chmod(0o777 if change == "anyone's" else 0o775)
    elif change == "another's":
        if os.geteuid():
            pytest.skip("only root can give a folder away")
        os.chown(kept, 65534, 65534)
    assert result(folder, XDG_CACHE_HOME=str(tmp_path / "cache")) == (705.0, 0)
    kept.chmod(0o700)
    if change == "another's":
        os.chown(kept, os.geteuid(), os.getegid())
    assert result(folder) == (705.0, 1)


def test_code_is_closed_to_others_whatever_the_umask_is(folder):
    before = os.umask(0o002)
    try:
        edit(folder, "FACTOR = 3.0", "FACTOR = 4.0")
        assert result(folder) == (706.0, 0)
        assert result(folder) == (706.0, 1)
    finally:
        os.umask(before)
    kept = max((folder / "__pycache__").glob("kernels-*"), key=lambda path: path.stat().st_mtime)
    files = [kept, *kept.rglob("*.nbi"), *kept.rglob("*.nbc")]
    assert len(files) > 2
    assert not any(path.stat().st_mode & 0o022 for path in files)


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
def test_code_whose_place_cannot_be_replaced_is_not_kept(folder, kind):
    """If a folder has the name of the file, numba itself would end with an error."""
    assert result(folder)[0] == 705.0
    for file in (folder / "__pycache__").glob(f"kernels-*/**/{kind}"):
        file.unlink()
        file.mkdir()
    assert result(folder) == (705.0, 0)


def test_the_code_of_another_kernel_is_damage(tmp_path):
    """Files whose names were exchanged are intact, but must not be run."""
    compiler = pytest.importorskip("startrack.core.compiler")
    one, other = (compiler._File(str(tmp_path), name, "stamp") for name in ("one", "other"))
    for number, file in enumerate((one, other)):
        file.save("types", number)
        assert file.load("types") == number
    for name in ("other.1.nbc", "other.nbi"):
        shutil.copy(tmp_path / name.replace("other", "one"), tmp_path / name)
        assert other.load("types") is None
        other.save("types", 1)
        assert other.load("types") == 1
    (tmp_path / "other.nbi").unlink()
    os.mkfifo(tmp_path / "other.nbi")
    assert other.load("types") is None


def test_folders_of_old_sources_are_removed(folder):
    for number in range(MODULE.KEPT + 2):
        edit(folder, "return FACTOR * x", "return FACTOR * x + 1")
        assert result(folder) == (706.0 + number, 0)
    assert len(list((folder / "__pycache__").glob("kernels-*"))) == MODULE.KEPT


def test_no_room_without_kernels_is_imported_by_one_with_kernels():
    """Otherwise an edit there could be compiled into a kernel without notice."""
    package = Path(startrack.__file__).parent
    for path in package.rglob("*.py"):
        room = path.relative_to(package).parts[0]
        used = set(re.findall(r"(?m)^ *(?:from|import) startrack\.(\w+)", path.read_text()))
        if room in MODULE.WITHOUT_KERNELS:
            assert "@kernel" not in path.read_text(), path
        elif room not in ("__init__.py", "__init__.pyi"):
            assert not used & MODULE.WITHOUT_KERNELS, path


NUMBAS = [
    (node.module, alias.name)
    for node in ast.walk(ast.parse(Path(compiler.__file__).read_text()))
    if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("numba")
    for alias in node.names
]


@pytest.mark.parametrize(("module", "name"), NUMBAS)
def test_without_a_name_that_numba_does_not_publish_kernels_are_compiled(monkeypatch, module, name):
    without = ModuleType(module)
    vars(without).update(
        {key: value for key, value in vars(sys.modules[module]).items() if key != name}
    )
    monkeypatch.setitem(sys.modules, module, without)
    monkeypatch.delitem(sys.modules, "startrack.core.compiler")
    monkeypatch.delattr(core, "compiler")
    spec = importlib.util.spec_from_file_location("kernel_without_names", MODULE.__file__)
    assert spec is not None
    assert spec.loader is not None
    fresh = importlib.util.module_from_spec(spec)
    with pytest.warns(RuntimeWarning, match="this version of numba has changed"):
        spec.loader.exec_module(fresh)
    assert fresh.compiler is None
    assert six_of(fresh.kernel) == 6.0


@pytest.mark.parametrize(
    ("owner", "name"),
    [
        (compiler.InnerCode, "_finalize_dynamic_globals"),
        (compiler.InnerCode, "_linking_libraries"),
        (compiler._Inner, "define_pipelines"),
        (compiler.KernelDispatcher, "_compile_inner"),
        (compiler._File, "_data_path"),
        (compiler._File, "_dump"),
        (compiler._Cache, "_impl"),
        (compiler._Cache, "_index_key"),
    ],
)
def test_where_a_name_fails_later_kernels_are_compiled_as_numba_does(
    folder, monkeypatch, owner, name
):
    """A name of numba that is missing while a kernel is compiled, loaded or saved."""

    def missing(*_):
        raise AttributeError(name)

    monkeypatch.setattr(owner, name, property(missing), raising=False)
    monkeypatch.setattr(compiler.KernelDispatcher, "plain", False)
    monkeypatch.setattr(compiler, "KERNELS", [])
    monkeypatch.setattr(MODULE, "compiler", compiler)
    edit(folder, "return FACTOR * x", "return FACTOR * x + 1")
    with pytest.warns(RuntimeWarning, match="this version of numba has changed"):
        assert result(folder)[0] == 706.0


def test_an_error_of_a_kernel_itself_is_raised_and_changes_nothing():
    @core.kernel
    def wrong(x):
        return x.no_such_attribute

    with pytest.raises(TypingError):
        wrong(1.0)
    assert not compiler.KernelDispatcher.plain
    assert type(poisson_quantile._cache) is compiler._Cache  # or its files would be numba's


def total_of(kernel, **options):
    """A number that a kernel computes from an array with an inner kernel that has these options."""

    @kernel(**options)
    def inner(values, i):
        return values[i]

    @kernel
    def total(values):
        return inner(values, 0) + inner(values, 1)

    return total(np.array([1.0, 2.0]))


def test_a_kernel_that_borrows_cannot_make_an_array():
    """Nothing would count the references to such an array."""

    def new(n):
        return np.zeros(n)

    assert total_of(core.kernel, borrows=True) == 3.0
    assert len(core.kernel(new)(2)) == 2
    with pytest.raises(TypingError):
        core.kernel(new, borrows=True)(2)


def test_without_the_option_not_to_count_references_they_are_counted(monkeypatch):
    monkeypatch.setattr(compiler, "COUNTING", "no_such_option")
    assert total_of(core.kernel, borrows=True) == 3.0


def test_an_error_that_an_inner_kernel_raises_arrives():
    @core.kernel
    def inner(x):
        if x < 0:
            raise ValueError("negative")
        return x

    @core.kernel
    def outer(x):
        return inner(x) + 1

    assert outer(1.0) == 2.0
    with pytest.raises(ValueError, match="negative"):
        outer(-1.0)


def six_of(kernel):
    """A number that an outer kernel computes with an inner one."""

    @kernel
    def double(x):
        return 2 * x

    @kernel
    def six(x):
        return double(x) + double(2 * x)

    return six(1.0)


def test_without_a_compiler_a_kernel_is_its_python_code(monkeypatch):
    """As with NUMBA_DISABLE_JIT; some functions of arrays call the Python code of a kernel."""
    monkeypatch.setattr(config, "DISABLE_JIT", True)

    @core.kernel
    def double(x):
        return 2 * x

    assert type(double) is type(double.py_func)
    assert double(3.0) == double.py_func(3.0) == 6.0
