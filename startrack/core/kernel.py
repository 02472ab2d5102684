"""A function enters; compiled code leaves, kept in a folder that is named by a hash of all sources.

Compiled code contains copies of the kernels that it calls and of constants of other files. Numba
alone would not notice an edit there; here each state of the sources has a separate folder.
"""

import hashlib
import os
import shutil
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np

PACKAGE = Path(__file__).parents[1]
# Rooms without kernels, none of whose values are compiled into those of other rooms.
WITHOUT_KERNELS = {
    "prediction",
    "benchmark",
    "calibration",
    "cli",
    "mission",
    "onboard",
    "optimise",
    "page",
    "plots",
    "report",
    "verification",
}
config: Any = numba.config  # its names are made when it is read
NAME = "kernels-"  # begins the name of a folder of compiled code
PRIVATE = 0o700  # mode of a folder
READABLE = 0o755  # mode of a folder beside the package, whatever the umask is
CODE = (".nbi", ".nbc")  # ends the names of numba's files
OTHERS = stat.S_IWGRP | stat.S_IWOTH
KEPT = 4  # folders, those used last; chosen by hand
READY = "ready"  # file of a folder that holds all that one trial and its identification need
FAILED = "kernels take twice as long to compile, because this version of numba has changed"

compiler: Any = None
try:
    from startrack.core import compiler
except (ImportError, AttributeError, TypeError) as error:  # a name that numba has no more
    warnings.warn(f"{FAILED}: {error}", RuntimeWarning, stacklevel=2)


def kernel(
    function: Callable[..., Any] | None = None, borrows: bool = False, **options: Any
) -> Any:
    """Compile a function when it is first called, and keep it on disk.

    As `numba.njit(cache=True, error_model="numpy")`. Only kernels of this package are kept: the
    sources of other kernels are unknown.

    borrows   whether it makes and returns no arrays. Then numba need not count references to the
              given arrays; this counting takes most of the time of short kernels
    options   further options of njit, such as fastmath or forceinline
    Returns   what njit returns; a decorator where there is no function
    """
    if function is None:
        return partial(kernel, borrows=borrows, **options)
    if getattr(config, "DISABLE_JIT", False):
        plain: Any = function
        plain.py_func = function  # where those look who call the Python code of a kernel
        return plain
    options = {"error_model": "numpy", **options}
    global compiler
    plainly = in_folder(partial(numba.njit, cache=True), numba.njit)
    if not compiler:
        return plainly(function, **options)
    try:
        decorate = in_folder(compiler.compiled, compiler.uncached)
        return decorate(function, borrows=borrows, **options)
    except (AttributeError, TypeError) as error:  # numba has changed, or the kernel is wrong:
        plain = plainly(function, **options)  # then this raises, too
        compiler = None
        warnings.warn(f"{FAILED}: {error}", RuntimeWarning, stacklevel=2)
        return plain


def in_folder(kept: Callable[..., Any], unkept: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator of numba that keeps compiled code in the folder of these sources.

    unkept  the decorator for functions that cannot be kept
    """

    def decorate(function: Callable[..., Any], **options: Any) -> Any:
        file = Path(function.__code__.co_filename)
        folder = kernel_folder() if PACKAGE in file.parents and file.is_file() else None
        if folder is None:
            return unkept(function, **options)
        before = config.CACHE_DIR
        config.CACHE_DIR = str(folder)  # which numba reads when it decorates
        try:
            return kept(function, **options)
        finally:
            config.CACHE_DIR = before

    return decorate


@cache
def kernel_folder() -> Path | None:
    """The folder of compiled code of these sources; None where none can be written to."""
    name = NAME + _hash_of_sources()
    for base, private in _bases():
        folder = base / name
        if not folder.is_dir() and not _made(folder, private):
            continue
        try:
            os.utime(folder)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        if all_trusted(folder):
            return folder
    return None


def _bases() -> list[tuple[Path, bool]]:
    """Folders to keep compiled code in, the first one first; whether it is to be private."""
    if config.CACHE_DIR:
        return [(Path(config.CACHE_DIR), True)]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    # Beside the package: users who may read the package may read its kernels.
    return [(PACKAGE / "__pycache__", False), (home / "startrack", True)]


def _made(folder: Path, private: bool) -> bool:
    """Make a folder, and remove those of other sources that were not used for long."""
    with suppress(OSError):
        if private:
            private_folder(folder)
        else:
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=READABLE)
        used = {other.stat().st_mtime: other for other in folder.parent.glob(f"{NAME}*")}
        for moment in sorted(used)[:-KEPT]:
            shutil.rmtree(used[moment], ignore_errors=True)
    return folder.is_dir()


def _hash_of_sources() -> str:
    """Hash of all files that contain a kernel or a value used by one, and of the compilers."""
    versions = sys.version, numba.__version__, llvmlite.__version__, np.__version__
    state = hashlib.sha256(f"{versions} {compiler is None}".encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if place.parts[0] not in WITHOUT_KERNELS:
            state.update(f"\n{place}\n".encode() + path.read_bytes())
    return state.hexdigest()[:16]


def is_ready() -> bool:
    """Whether all kernels of one trial and its identification have been compiled."""
    folder = kernel_folder()
    return folder is not None and (folder / READY).exists()


@contextmanager
def compiling_reports(report: Callable[[float], None]) -> Iterator[None]:
    """Call a function with the seconds that each kernel took to compile or to load."""
    reports: list[Any] = compiler.REPORTS if compiler else []
    reports.append(report)
    try:
        yield
    finally:
        reports.remove(report)


def trusted(path: str | os.PathLike[str]) -> bool:
    """Whether a file or folder is of this user or of the system, and no other can write to it.

    "Other" includes the group. An installation by the administrator belongs to the system: its
    users trust its code already.
    """
    if not hasattr(os, "geteuid"):  # Windows: the user's folders are closed to others
        return True
    try:
        status = os.stat(path)
    except OSError:
        return False
    return status.st_uid in (os.geteuid(), 0) and not status.st_mode & OTHERS


def all_trusted(folder: Path) -> bool:
    """Whether a folder and all compiled code in it is trusted.

    Files that others can write to are removed, and compiled again.
    """
    if not trusted(folder):
        return False
    for place, folders, files in os.walk(folder):
        for name in (*folders, *(name for name in files if name.endswith(CODE))):
            path = os.path.join(place, name)
            if not trusted(path):
                with suppress(OSError):
                    shutil.rmtree(path) if name in folders else os.unlink(path)
                if os.path.lexists(path):
                    return False
    return True


def private_folder(path: Path) -> bool:
    """Make a folder that only this user can open; returns whether such a folder then exists."""
    with suppress(OSError):
        path.mkdir(parents=True, exist_ok=True, mode=PRIVATE)
    return trusted(path)
