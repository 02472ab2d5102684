"""A function enters; compiled code leaves, kept on disk until anything that it is made of changes.

Numba keeps compiled code by the text of the file that holds the function. A function that calls
another one holds a copy of it, so that an edit of the other one would go unnoticed. Here the key
covers all that is compiled into the code: the function, the kernels that it calls, and theirs.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba import config, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.serialize import loads

from startrack.core.dispatcher import InnerCode, KernelDispatcher
from startrack.core.trust import PRIVATE, trusted

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

HASHED = b"startrack sha256"  # begins a file of compiled code, before the hash of the rest
DIGEST = 32  # byte, of that hash
OTHERS = ("math", "numba", "numpy", "scipy")  # whose versions stand in the key
CLAIMS = "compiling.claims"  # file of a folder of compiled code, in which processes claim kernels
PATIENCE = 120.0  # second that a process waits for another one; chosen by hand
UNKEPT = list[str]()  # kernels that no folder could be found for
FOLDERS = set[str]()  # where those of this process are kept


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function when it is first called, and keep it on disk.

    As `numba.njit(cache=True, error_model="numpy")`, with a key that covers all that is compiled
    into it.

    options   further ones of njit, such as fastmath or forceinline
    Returns   what njit returns; a decorator where there is no function
    """
    if function is None:
        return lambda found: kernel(found, **options)
    if getattr(config, "DISABLE_JIT", False):
        plain: Any = function
        plain.py_func = function  # where those look who call the Python code of a kernel
        return plain
    compiled: Any = KernelDispatcher(
        function, targetoptions={"nopython": True, "error_model": "numpy", **options}
    )
    try:
        compiled._cache = _Cache(function, options)
        _close(compiled._cache.cache_path)
    except RuntimeError:  # numba found no folder that can be written to
        UNKEPT.append(f"{function.__module__}.{function.__qualname__}")
    return compiled


def _close(folder: str) -> None:
    """Close a folder of compiled code to other users, except beside the package."""
    if folder not in FOLDERS and not folder.endswith("__pycache__"):
        with suppress(OSError):  # one of the system, whose owner has set who may read it
            os.chmod(folder, PRIVATE)
    FOLDERS.add(folder)


def is_compiled(compiled: Any) -> bool:
    """Whether a kernel is on disk, for this machine and all that it is made of now."""
    kept: Any = getattr(compiled, "_cache", None)
    return not isinstance(kept, _Cache) or kept.holds()


def digest(function: Callable[..., Any], options: object = ()) -> bytes:
    """A hash of all that is compiled into a function, whichever files that stands in."""
    return hashlib.sha256("\n".join(_parts(function, options, set())).encode()).digest()


def _parts(function: Any, options: object, seen: set[int]) -> Iterator[str]:
    seen.add(id(function))
    yield f"{function.__module__}.{function.__qualname__} {_written(options)}"
    code = function.__code__
    yield from _code(code)
    names = {name for one in _codes(code) for name in one.co_names}
    known = function.__globals__
    held = {name: known[name] for name in sorted(names) if name in known}
    cells = function.__closure__ or ()
    held |= dict(zip(code.co_freevars, (cell.cell_contents for cell in cells), strict=True))
    for name, value in held.items():
        yield name
        yield from _value(value, seen)


def _value(value: Any, seen: set[int]) -> Iterator[str]:
    """What a kernel takes from outside: numba compiles all of it in as constants."""
    if isinstance(value, Dispatcher):
        if id(value.py_func) not in seen:
            kept: Any = getattr(value, "_cache", None)
            options = kept.options if isinstance(kept, _Cache) else value.targetoptions
            yield from _parts(value.py_func, options, seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(value, type) and hasattr(value, "_fields"):
        yield f"{value.__qualname__} {value._fields}"
    elif isinstance(value, ModuleType | type):
        yield value.__name__
    elif isinstance(value, tuple):
        yield f"tuple of {len(value)}"
        for one in value:
            yield from _value(one, seen)
    elif isinstance(value, FunctionType) and value.__module__.split(".")[0] not in OTHERS:
        if id(value) not in seen:
            yield from _parts(value, (), seen)  # as numba's register_jitable leaves it
    elif callable(value):
        yield getattr(value, "__qualname__", type(value).__name__)
    else:
        yield _written(value)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _codes(one)


def _code(code: CodeType) -> Iterator[str]:
    for one in _codes(code):
        constants = [_written(each) for each in one.co_consts if not isinstance(each, CodeType)]
        yield f"{one.co_code.hex()} {one.co_names} {one.co_varnames} {constants}"


def _written(value: Any) -> str:
    """As repr, the same in every process: the order of a set of texts is not."""
    if isinstance(value, dict):
        return repr([(name, _written(one)) for name, one in sorted(value.items())])
    if isinstance(value, set | frozenset):
        return repr(sorted(map(_written, value)))
    return repr(value)


class _File(IndexDataCacheFile):
    """Compiled code on disk, used where it is this user's and as it was written.

    Both kinds of files begin with a hash of the rest; those from before there was one are read
    without. What another user could have written, what is damaged, and what another version of the
    code wrote is compiled anew.
    """

    def _load_index(self) -> Any:
        try:
            if self._is_plain(self._index_name):
                return super()._load_index()
            version, stamp, overloads = self._load_data(self._index_name)
        except Exception:  # whatever reading it raises, such as for a class that is no more
            return {}
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: Any) -> None:
        self._save_data(self._index_name, (self._version, self._source_stamp, overloads))

    def _is_plain(self, name: str) -> bool:
        """Whether a file has no hash: it is one that numba itself wrote.

        Raises  OSError where it is not to be trusted: loading a file runs what it holds.
        """
        path = self._data_path(name)
        if not (trusted(self._cache_path) and trusted(path)):
            raise OSError(f"{path} is of another user, or others can write to it")
        with open(path, "rb") as file:
            return not file.read(len(HASHED)).startswith(HASHED)

    def _load_data(self, name: str) -> Any:
        if self._is_plain(name):
            try:
                return super()._load_data(name)
            except Exception as error:
                raise OSError(f"{name} is damaged: {error}") from None
        with open(self._data_path(name), "rb") as file:
            _, known, data = file.read(len(HASHED)), file.read(DIGEST), file.read()
        if hashlib.sha256(data).digest() != known:
            raise OSError(f"{name} is damaged")
        return loads(data)

    def _save_data(self, name: str, data: Any) -> None:
        written = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(HASHED + hashlib.sha256(written).digest() + written)


class _Cache(FunctionCache):
    """Numba's cache of a function, keyed on the content of all that is compiled into it."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]):
        self.options = options
        super().__init__(function)

    @cached_property
    def stamp(self) -> bytes:
        """Known when the function is first called: then all that it calls has been defined."""
        versions = f"{numba.__version__} {np.__version__}".encode()
        return versions + digest(self._py_func, self.options)

    def holds(self, sig: Any = None) -> bool:
        """Whether code is kept under this key for this processor, and these types if given."""
        codegen = cpu_target.target_context.codegen()
        kept = self._fresh()._load_index()
        if sig is not None:
            return self._index_key(sig, codegen) in kept
        return any(key[1] == codegen.magic_tuple() for key in kept)

    @contextmanager
    def claimed(self) -> Iterator[None]:
        """Compile a kernel in one process at a time: the next one then finds it on disk.

        Where there are no locks, or another process holds one for too long, it is compiled twice.
        """
        file = self._claim() if fcntl else None
        try:
            yield
        finally:
            if file is not None:
                os.close(file)  # which ends the claim, as does the end of the process

    def _claim(self) -> int | None:
        """The open file of claims, in which one byte is that of this kernel."""
        place, began = int.from_bytes(self.stamp[-4:], "big") >> 1, time.monotonic()
        try:
            file = os.open(os.path.join(self.cache_path, CLAIMS), os.O_RDWR | os.O_CREAT, 0o600)
        except OSError:
            return None
        with suppress(OSError):
            while time.monotonic() < began + PATIENCE:
                try:
                    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
                    break
                except (BlockingIOError, PermissionError):
                    time.sleep(0.02)
        return file

    def _fresh(self) -> _File:
        self._cache_file = _File(self._cache_path, self._impl.filename_base, self.stamp)
        return self._cache_file

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        self._fresh()
        return super()._load_overload(sig, target_context)

    def _save_overload(self, sig: Any, data: Any) -> None:
        if isinstance(data.library, InnerCode):
            return  # kept as a part of the kernels that Python calls
        self._fresh()
        super()._save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Numba's key with the fields of the named tuples that the function takes."""
        return *super()._index_key(sig, codegen), tuple(_fields(sig))


def _fields(kind: Any) -> Iterator[str]:
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        yield f"{kind.instance_class.__qualname__} {kind.instance_class._fields}"
    inner = kind if isinstance(kind, tuple) else getattr(kind, "types", ())
    for one in inner if isinstance(inner, tuple | list) else ():
        yield from _fields(one)
    if isinstance(kind, types.NamedUniTuple | types.UniTuple):
        yield from _fields(kind.dtype)
