"""Kernels enter; machine code leaves, made once for each kernel that Python calls.

Numba makes machine code of each function, with a copy of all that it calls, and wraps it for
Python: a kernel six calls deep is optimised six times and wrapped without need. Here a kernel that
only other kernels call stays intermediate code, which becomes machine code as a part of those that
Python calls: half of the time of compiling, the same speed.

Numba has no public interface for this. Only this file uses names that may change with any version.
If one of them fails, here or later, `kernel` compiles by `numba.njit`.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from types import FunctionType
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

from startrack.core.interpret import interpreter

config: Any = numba.config  # its names are made when it is read
COUNTING = "_nrt"  # numba's option to count references to arrays
DIGEST = 32  # byte, of the hash at the end of a file of compiled code
FAILED = "kernels take twice as long to compile, because this version of numba has changed"
OTHERS = stat.S_IWGRP | stat.S_IWOTH
KERNELS = list["KernelDispatcher"]()
REPORTS = list[Callable[[float], None]]()  # called with the seconds that compiling has lasted


def compiled(function: FunctionType, **options: Any) -> KernelDispatcher:
    """Like `uncached`, kept on disk."""
    made = uncached(function, **options)
    made._cache, made.kept_in = _Cache(function), config.CACHE_DIR
    return made


def uncached(function: FunctionType, borrows: bool, **options: Any) -> KernelDispatcher:
    """Like `numba.njit`; for `borrows` see `kernel`."""
    if borrows and hasattr(CPUDispatcher.targetdescr.options, COUNTING):
        options[COUNTING] = False
    return KernelDispatcher(function, targetoptions={"nopython": True, **options})


class _File(IndexDataCacheFile):
    """Compiled code on disk, each file with a hash: damaged code is compiled again.

    The hash includes the file's name, so that the code of another kernel counts as damage.
    """

    _named = ""  # file that is being written

    def _dump(self, obj: Any) -> bytes:
        data: bytes = super()._dump(obj)
        return data + self._hash_of(self._named, data)

    def _hash_of(self, name: str, data: bytes) -> bytes:
        place = os.path.join(os.path.basename(self._cache_path), name)
        return hashlib.sha256(place.encode() + b"\0" + data).digest()

    def _save_index(self, overloads: Any) -> None:
        self._named = self._index_name
        super()._save_index(overloads)
        close_to_others(os.path.dirname(self._index_path))
        close_to_others(self._index_path)

    def _save_data(self, name: str, data: Any) -> None:
        self._named = name
        super()._save_data(name, data)
        close_to_others(self._data_path(name))

    def _load_index(self) -> Any:
        try:
            with open(regular(self._index_path), "rb") as file:
                # Numba's version stands before what is hashed.
                data = file.read().removeprefix(pickle.dumps(self._version, protocol=-1))
            self._require_whole(self._index_name, data)
            return super()._load_index()
        except Exception:  # reading a damaged file may raise any error
            return {}

    def _load_data(self, name: str) -> Any:
        with open(regular(self._data_path(name)), "rb") as file:
            self._require_whole(name, file.read())
        return super()._load_data(name)

    def _require_whole(self, name: str, data: bytes) -> None:
        if self._hash_of(name, data[:-DIGEST]) != data[-DIGEST:]:
            raise OSError(f"{name} is damaged")


def close_to_others(path: str) -> None:
    """Let no other user write to a file or folder, whatever the umask is."""
    os.chmod(path, os.stat(path).st_mode & ~OTHERS)


def regular(path: str) -> str:
    """The path of a regular file that nobody else can write to; raises OSError of all else.

    Opening another kind could wait for ever, and loading a file of another user would run its code.
    """
    status = os.stat(path)
    own = not hasattr(os, "geteuid") or status.st_uid in (os.geteuid(), 0)
    if not stat.S_ISREG(status.st_mode) or not own or status.st_mode & OTHERS:
        raise OSError(f"{path} must be a regular file that no other user can write to")
    return path


class _Cache(FunctionCache):
    """Numba's cache of a function, of such files."""

    def __init__(self, function: FunctionType):
        super().__init__(function)
        locator = self._impl.locator
        # No stamp: the folder is of these sources, and numba's would be of the time of writing.
        self._cache_file = _File(locator.get_cache_path(), self._impl.filename_base, "")

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code, unless its path cannot be replaced, for example a folder."""
        with suppress(OSError):
            super().save_overload(sig, data)

    def holds(self, sig: Any, codegen: Any) -> bool:
        """Whether code for these types is kept."""
        return self._index_key(sig, codegen) in self._cache_file._load_index()


class InnerCode(JITCodeLibrary):
    """Intermediate code of a kernel and of the kernels that it calls, each shortened separately.

    The passes over single functions are needed: without them the later ones find functions too long
    to include, and terrain takes 1.8 times as long.
    """

    def _optimize_final_module(self) -> None:
        """Left to the kernel that Python calls."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Inner(Compiler):
    """Numba's compiler up to the intermediate code."""

    def define_pipelines(self) -> Any:
        """Numba's passes, without wrappers and machine code."""
        state = self.state
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = True
        state.flags.no_compile = True
        state.library = InnerCode(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


class _EntryPoint:
    """Key under which numba finds the intermediate code of an inner kernel."""


class KernelDispatcher(CPUDispatcher):
    """A function that is compiled for the types that it is called with, as `numba.njit` does."""

    kept_in = ""  # folder of compiled code
    plain = False  # compile as numba does
    depth = 0  # of kernels that are being compiled, which call this one
    _cache: Any
    _compiler: Any
    targetctx: Any

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, **options)
        KERNELS.append(self)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Template with which numba types a call of this kernel from another kernel."""
        with global_compiler_lock:
            KernelDispatcher.depth += 1
            try:
                return super().get_call_template(args, kws)
            finally:
                KernelDispatcher.depth -= 1

    def compile(self, sig: Any) -> Any:
        """The callable for these types, from memory, from disk, or compiled."""
        with global_compiler_lock:
            if KernelDispatcher.plain:
                return super().compile(sig)
            args = tuple(normalize_signature(sig)[0])
            made = self.overloads.get(args)
            if KernelDispatcher.depth > 0:
                return made.entry_point if made else self._compile_inner(args)
            if made is None or _is_inner(made):
                python = interpreter(self, lambda: self.holds(sig))
                if python is not None:
                    return python
                self.overloads.pop(args, None)
            began = time.perf_counter()
            try:
                self._compiler.pipeline_class = Compiler
                result = super().compile(sig)
            except Exception as error:
                return self._compile_plainly(sig, error)
            for report in REPORTS:
                report(time.perf_counter() - began)
            return result

    def holds(self, sig: Any) -> bool:
        """Whether compiled code for these types is on disk."""
        kept = self._cache
        return isinstance(kept, _Cache) and kept.holds(sig, self.targetctx.codegen())

    def _compile_inner(self, args: tuple[Any, ...]) -> _EntryPoint:
        self._compiler.pipeline_class = _Inner
        result, place = self._compiler.compile(args, None), _EntryPoint()
        result.target_context.insert_user_function(place, result.fndesc, [result.library])
        self.overloads[args] = result._replace(entry_point=place)
        return place

    def _compile_plainly(self, sig: Any, error: Exception) -> Any:
        """Compile as numba does from now on, with a warning why."""
        KernelDispatcher.plain, before = True, config.CACHE_DIR
        caches = [(kernel, kernel._cache) for kernel in KERNELS]
        for kernel in KERNELS:
            if kernel.kept_in:
                config.CACHE_DIR = kernel.kept_in  # which numba reads now
                kernel.enable_caching()
            kernel._compiler.pipeline_class = Compiler
            getattr(kernel._compiler, "_failed_cache", {}).clear()
            for args in [args for args, made in kernel.overloads.items() if _is_inner(made)]:
                del kernel.overloads[args]
        config.CACHE_DIR = before
        try:
            result = super().compile(sig)
        except Exception:  # the kernel itself is wrong
            KernelDispatcher.plain = False
            for kernel, cache in caches:
                kernel._cache = cache
            raise
        warnings.warn(f"{FAILED}: {error}", RuntimeWarning, stacklevel=3)
        return result


def _is_inner(made: Any) -> bool:
    return isinstance(made.library, InnerCode)
