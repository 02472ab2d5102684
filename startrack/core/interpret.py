"""Kernels that are not yet compiled -> their results by Python, while that is faster.

A command that runs one trial calls most kernels once, on a few stars. Python then takes
milliseconds, while compiling takes a second. So within `interpreted` a kernel that is not on disk
runs as the Python code in which it is written, until another process has compiled it.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial, wraps
from types import CellType, CodeType, FunctionType
from typing import Any, TypeVar

import numpy as np

# CPU second that a kernel may run as Python code if no process compiles it; chosen by hand.
PATIENCE = 1.0
LOOK = 0.2  # second between two checks whether the other process has compiled it

_COMPILING: Callable[[], bool] | None = None  # whether another process compiles; None: compile here
_TWINS = dict[FunctionType, FunctionType]()
_ABANDONED = set[Any]()  # kernels that took Python too long
_SPENT = dict[Any, float]()  # CPU second of Python, by kernel
_LOOKS = list["_Look"]()  # of the kernel that Python runs, none or one
Stand = TypeVar("Stand", bound=Callable[..., Any])
STAND_INS = dict[Any, Any]()  # functions of arrays that Python runs for loops of kernels


class _Abandoned(BaseException):
    """Python has taken too long; nothing in a kernel catches it."""


@contextmanager
def interpreted(compiling: Callable[[], bool]) -> Iterator[None]:
    """Run kernels that are not on disk as Python code, while that takes less time than compiling.

    compiling  whether another process is compiling them now; without one, a kernel is compiled here
               after PATIENCE seconds in Python
    Accuracy   the same operations in the same precision, except sums that `fastmath` lets the
               compiler order anew and for literals of whole numbers beside float32: relative
               differences of 1e-7 in single precision, of 1e-16 elsewhere.
    """
    global _COMPILING
    _COMPILING = compiling
    try:
        yield
    finally:
        _COMPILING = None


def interpreting() -> bool:
    """Whether kernels that are not on disk run as Python code now."""
    return _COMPILING is not None


def interpreter(kernel: Any, is_kept: Callable[[], bool]) -> Callable[..., Any] | None:
    """The Python function that runs in place of a kernel; None where the kernel is to be loaded or
    compiled.

    is_kept  whether it is on disk for these types
    """
    if _COMPILING is None or kernel in _ABANDONED or is_kept():
        return None
    return partial(_run, kernel, is_kept)


def instead_of(kernel: Any) -> Callable[[Stand], Stand]:
    """Decorate a function of arrays that Python runs instead of the loops of a kernel.

    It takes and gives the same. Compiled code never calls it.
    """

    def keep(function: Stand) -> Stand:
        STAND_INS[getattr(kernel, "py_func", kernel)] = function
        return function

    return keep


def python_code(function: FunctionType, is_kernel: Callable[[Any], bool]) -> FunctionType:
    """The Python code of a kernel and of those that it calls, on numbers of numba's types."""
    if function in _TWINS:
        return _TWINS[function]
    names, asked = dict[str, Any](), function
    function = STAND_INS.get(function, function)
    cells = tuple(CellType() for _ in function.__closure__ or ())
    plain = FunctionType(_strong(function.__code__), names, function.__name__, None, cells)
    plain.__defaults__ = function.__defaults__ and tuple(map(_as_argument, function.__defaults__))
    _TWINS[asked] = plain

    def inner(value: Any) -> Any:
        return (
            _looking(python_code(value.py_func, is_kernel))
            if is_kernel(value)
            else _as_argument(value)
        )

    names |= {name: inner(value) for name, value in function.__globals__.items()}
    for cell, original in zip(cells, function.__closure__ or (), strict=True):
        cell.cell_contents = inner(original.cell_contents)
    return plain


def _strong(code: CodeType) -> CodeType:
    """Code whose literals have double precision also in expressions of single precision, as in
    numba."""
    constants = tuple(
        _strong(constant) if isinstance(constant, CodeType) else _as_argument(constant)
        for constant in code.co_consts
    )
    return code.replace(co_consts=constants)


def _as_argument(value: Any) -> Any:
    """A Python number as a NumPy scalar, which keeps its precision in arithmetic with arrays.

    numba does the same; NumPy gives a Python number the precision of the array.
    """
    if type(value) is float:
        return np.float64(value)
    if type(value) is tuple:
        return tuple(map(_as_argument, value))
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(_as_argument, value))
    return value


def _as_result(value: Any) -> Any:
    """A result as numba returns it."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple):
        items = map(_as_result, value)
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value


def _arrays(value: Any) -> Iterator[Any]:
    if isinstance(value, np.ndarray) and value.flags.writeable:
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from _arrays(item)


class _Look:
    """Ends a Python run if compiled code is available, or if it takes long and no process compiles
    it.

    Python looks at each call of an inner kernel: an alarm would be the caller's.
    """

    def __init__(self, kernel: Any, is_kept: Callable[[], bool]):
        self.kernel, self.is_kept = kernel, is_kept
        self.began, self.next = time.process_time(), time.monotonic() + LOOK

    def __call__(self) -> None:
        """Look, if it is time to; raises _Abandoned."""
        if time.monotonic() < self.next:
            return
        self.next = time.monotonic() + LOOK
        working = _COMPILING is not None and _COMPILING()
        if self.is_kept() or (not working and self.spent() > PATIENCE):
            raise _Abandoned

    def spent(self) -> float:
        """CPU seconds that this kernel has taken Python."""
        return _SPENT.get(self.kernel, 0.0) + time.process_time() - self.began


def _looking(python: FunctionType) -> Callable[..., Any]:
    """An inner kernel that checks whether Python should continue."""

    @wraps(python)
    def call(*args: Any) -> Any:
        if _LOOKS:
            _LOOKS[-1]()
        return python(*args)

    return call


def _run(kernel: Any, is_kept: Callable[[], bool], *args: Any, **named: Any) -> Any:
    """The result of Python, or of the compiled kernel if that is available first."""
    before = [(array, array.copy()) for array in _arrays((*args, *named.values()))]
    python = python_code(kernel.py_func, lambda value: isinstance(value, type(kernel)))
    look = _Look(kernel, is_kept)
    _LOOKS.append(look)
    try:
        with np.errstate(all="ignore"):
            given = {name: _as_argument(value) for name, value in named.items()}
            return _as_result(python(*map(_as_argument, args), **given))
    except (_Abandoned, ArithmeticError, ValueError, TypeError, LookupError):
        # Unlike Python, compiled code does not fail at a division by zero or the root of -1.
        _ABANDONED.add(kernel)
        for array, values in before:
            array[...] = values
    finally:
        _LOOKS.remove(look)
        _SPENT[kernel] = look.spent()
    return kernel(*args, **named)
