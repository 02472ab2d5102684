"""Kernels enter; machine code leaves, made once for each kernel that Python calls.

Numba optimises each function by itself and with a copy of all that it calls, makes machine code of
it, and wraps it for Python: a kernel six calls deep is optimised six times and wrapped without
need. Here a kernel that only other kernels call stays intermediate code, which is optimised and
becomes machine code as a part of those that Python calls.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from numba.core import sigutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher
from numba.core.target_extension import dispatcher_registry, target_registry

from startrack.core.interpret import interpreter

_REPLACED = list[Any]()  # kernels that include this code point to its constants
_SIGNATURES = dict[Any, Any]()  # of operators, by operator and types
ENVIRONMENT = "_ZN08NumbaEnv"  # how numba names the globals that point to a function's constants


class InnerCode(JITCodeLibrary):
    """Intermediate code of a kernel and of those that it calls, neither optimised nor compiled."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Link what is called."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            if hasattr(library, "_reload_init"):  # from numba 0.63 on
                self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
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


class _Outer(Compiler):
    """Numba's compiler, without the wrapper for C, which nobody calls."""

    def define_pipelines(self) -> Any:
        """Numba's passes."""
        self.state.flags.no_cfunc_wrapper = True
        return super().define_pipelines()


class _Flags(Flags):
    """Numba's options of a function, compared by those that are set.

    Numba looks for each function that a kernel calls under these options, and for that writes out
    all forty of them, a tenth of the time of compiling.
    """

    HASH = hash(Flags())  # of names alone, and so the same for all

    def __hash__(self) -> int:
        return self.HASH

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Flags) and self._values == other._values:
            return True
        return super().__eq__(other)


class _Place:
    """Stands where numba keeps what Python calls: numba finds the intermediate code by it."""


class KernelDispatcher(CPUDispatcher):
    """A function that is compiled for the types that it is called with, as `numba.njit` does."""

    abandoned = False  # by Python: it is to be compiled
    interpreted = 0.0  # second that Python has spent in it
    calls_within = 0  # of `get_call_template`: a kernel is being compiled, and calls this one
    _compiler: Any  # numba's, of this function
    _cache: Any  # its compiled code on disk

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, **options)
        self._compiler._customize_flags = _Flags

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """As numba, which asks when it finds a call of this kernel in another one."""
        with _within():
            return super().get_call_template(args, kws)

    def compile(self, sig: Any) -> Any:
        """The callable for these types, from memory, from disk, or compiled."""
        with global_compiler_lock:
            inner = KernelDispatcher.calls_within > 0
            given = tuple(sigutils.normalize_signature(sig)[0])
            known: Any = self.overloads.get(given)
            if inner:
                self._compiler.pipeline_class = _Inner
                return super().compile(sig)
            holds = getattr(self._cache, "holds", lambda _: False)
            if known is None or isinstance(known.library, InnerCode):
                found = interpreter(self, lambda: bool(holds(sig)))
                if found is not None:
                    return found
                if known is not None:
                    _REPLACED.append(self.overloads.pop(given))
            claimed = nullcontext if holds(sig) else getattr(self._cache, "claimed", nullcontext)
            self._compiler.pipeline_class = _Outer
            with claimed(), _without_collection(), _numbas_own_inside(), _remembered_operators():
                return super().compile(sig)

    def add_overload(self, cres: Any) -> None:
        """Keep what was compiled; Python finds it where it is machine code."""
        if isinstance(cres.library, InnerCode):
            place = _Place()
            cres.target_context.insert_user_function(place, cres.fndesc, [cres.library])
            self.overloads[tuple(cres.signature.args)] = cres._replace(entry_point=place)
            return
        super().add_overload(cres)
        for variable in cres.library._final_module.global_variables:
            if variable.name.startswith(ENVIRONMENT):
                constants = lookup_environment(variable.name)
                if constants is not None:
                    cres.codegen.set_env(variable.name, constants)


@contextmanager
def _without_collection() -> Iterator[None]:
    """Let the garbage collector rest, which takes a tenth of the time of compiling."""
    resting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if resting:
            gc.enable()


@contextmanager
def _numbas_own_inside() -> Iterator[None]:
    """Treat functions that numba compiles for a kernel, as for np.zeros, as kernels that it calls.

    Else each becomes machine code that nothing calls, as the kernel has a copy of it.
    """
    cpu, registry = target_registry["cpu"], dispatcher_registry
    before = registry[cpu]
    dict.__setitem__(registry, cpu, KernelDispatcher)
    try:
        yield
    finally:
        dict.__setitem__(registry, cpu, before)


@contextmanager
def _remembered_operators() -> Iterator[None]:
    """Look up once what an operator makes of numbers of some types.

    Numba tries all rules of the operator anew wherever it stands, in a sixth of the time of
    compiling. A function that numba compiles has one meaning for each set of options, and is left.
    """
    function: Any = types.BaseFunction
    numbas = function.get_call_type

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(one, types.Number | types.Boolean) for one in args):
            return numbas(self, context, args, kws)
        operator = self, tuple(args)
        known = _SIGNATURES.get(operator)
        if known is None:
            known = numbas(self, context, args, kws)
            if self.get_impl_key(known) is self.key[0]:
                _SIGNATURES[operator] = known
        return known

    function.get_call_type = get_call_type
    try:
        yield
    finally:
        function.get_call_type = numbas


@contextmanager
def _within() -> Iterator[None]:
    """A kernel is being compiled; what is compiled now is called by it."""
    with global_compiler_lock:
        KernelDispatcher.calls_within += 1
        try:
            yield
        finally:
            KernelDispatcher.calls_within -= 1
