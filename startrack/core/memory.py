"""Bytes that a step needs -> refused, with the number, if they exceed the limit of a process.

Cached values and arrays of a plan are dropped first.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import partial, update_wrapper
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar
from weakref import WeakSet

import numpy as np
from numpy.typing import DTypeLike, NDArray

from startrack.core.arrays import Ints, Singles
from startrack.core.checks import Refused
from startrack.core.kernel import kernel

try:
    import resource
except ImportError:  # Windows has no such limits
    resource = None  # type: ignore[assignment]

GIB = 2**30  # byte
# The variable hands the limit on to worker processes.
VARIABLE = "STARTRACK_MEMORY"  # byte, of one process
LEAST = GIB  # byte; a process of startrack, with its libraries, takes a third of it


def machine_memory() -> int:
    """Bytes of the machine's memory."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows
        return 8 * GIB


def memory_limit() -> int:
    """Bytes that this process may take: STARTRACK_MEMORY, else half of the machine's memory.

    Raises  Refused if STARTRACK_MEMORY is not a number.
    """
    given = os.environ.get(VARIABLE, "")
    if not given:
        return machine_memory() // 2
    if not (given.isascii() and given.isdecimal() and len(given) < 20):
        raise Refused(
            f"{VARIABLE} must be a whole number of bytes, got {given[:40]!r}", lasting=False
        )
    return int(given)


def require_memory(size: float, what: str) -> None:
    """Refuse a step before it takes more memory than allowed.

    size  bytes that it takes at its largest
    what  purpose of the memory, for the message: "a frame of 65536 x 65536 pixels"

    Raises  Refused with the purpose, the bytes and the limit; no ledger keeps it, as the limit is
            the machine's.
    """
    limit = memory_limit()
    shrink_kept(limit - size)
    if not size <= limit:
        raise Refused(
            f"{what} would need {gib(size)} of memory, more than the limit of {gib(limit)} "
            "(option --memory)",
            lasting=False,
        )


def gib(size: float) -> str:
    """A number of bytes as text."""
    return f"{size / GIB:.3g} GiB"


@contextmanager
def limited_memory(limit: int) -> Iterator[None]:
    """Let this process and those that it starts take at most `limit` bytes more than now.

    A step without an estimate, or with a wrong one, then ends in MemoryError instead of swapping.
    The limit is that of the system on private data (Linux); elsewhere only estimates are compared.

    limit  byte
    """
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(limit)
    try:
        with _data_limit(limit):
            yield
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before


@contextmanager
def _data_limit(limit: int) -> Iterator[None]:
    if resource is None or not Path("/proc/self/statm").is_file():
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    # Of private data, as the system counts it for the limit.
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    most = pages * os.sysconf("SC_PAGE_SIZE") + limit
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    try:
        yield
    finally:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def begin_limited() -> None:
    """Limit the memory of a worker process, over its life, to STARTRACK_MEMORY."""
    if os.environ.get(VARIABLE):
        _data_limit(memory_limit()).__enter__()


P = ParamSpec("P")
T = TypeVar("T")
SHARE = 4  # of the memory limit of a process, all kept values take one part; chosen by hand

_lock = threading.RLock()
_stores: WeakSet[Kept[Any]] = WeakSet()
_clock = iter(range(2**62))


class Kept(Generic[T]):
    """Cached values by key: the last `count` used values, fewer if memory is short.

    Each value counts with the bytes of its arrays. If all cached values of the process would take
    more than a quarter of its memory limit, the values used longest ago are dropped. They are also
    dropped before a step that `require_memory` would otherwise refuse.
    """

    def __init__(self, count: int):
        self._count = count
        self._values: dict[Hashable, tuple[T, int, int]] = {}  # value, bytes, time of last use
        self.bytes = 0  # of all values
        _stores.add(self)

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value of a key, made if it is not cached."""
        with _lock:
            entry = self._values.get(key)
            if entry:
                self._values[key] = entry[0], entry[1], next(_clock)
                return entry[0]
        value = make()
        size = bytes_of(value)
        with _lock:
            self._drop(key)  # another thread may have made the same value
            self._values[key] = value, size, next(_clock)
            self.bytes += size
            while len(self._values) > self._count:
                self.drop_oldest()
            shrink_kept(memory_limit() // SHARE)
        return value

    def clear(self) -> None:
        """Drop all values."""
        with _lock:
            self._values.clear()
            self.bytes = 0

    def drop_oldest(self) -> None:
        """Drop the value that was used longest ago."""
        self._drop(min(self._values, key=lambda key: self._values[key][2]))

    def _drop(self, key: Hashable) -> None:
        if entry := self._values.pop(key, None):
            self.bytes -= entry[1]

    def last_use(self) -> int:
        """Time of the last use of the oldest value; later than all others if there is no value."""
        return min((time for _, _, time in self._values.values()), default=2**62)


class KeptFunction(Generic[P, T]):
    """A function of hashable arguments whose last values are `Kept`."""

    def __init__(self, make: Callable[P, T], count: int, reads: Callable[[Any], Any] | None = None):
        self._make, self._store, self._reads = make, Kept[T](count), reads
        update_wrapper(self, make)

    def __call__(self, *args: P.args, **named: P.kwargs) -> T:
        """The value, made where it is not kept."""
        make: Callable[..., T] = self._make
        given = (self._reads(args[0]), *args[1:]) if self._reads else args
        key = (given, *sorted(named.items())) if named else given
        return self._store.get(key, lambda: make(*given, **named))

    def cache_clear(self) -> None:
        """Drop all values."""
        self._store.clear()


def kept(
    count: int, reads: Callable[[Any], Any] | None = None
) -> Callable[[Callable[P, T]], KeptFunction[P, T]]:
    """Like `functools.lru_cache`, for values of megabytes: they count against the memory limit.

    reads  first argument -> the argument with fixed values in all parts that the function does not
           read. The function gets this argument, so that it cannot read a part that the key lacks.
           None: the first argument is used unchanged
    """
    return partial(KeptFunction, count=count, reads=reads)


def kept_bytes() -> int:
    """Bytes of all values that this process keeps."""
    with _lock:
        return sum(store.bytes for store in _stores)


def shrink_kept(limit: float) -> None:
    """Drop the values that were used longest ago, until all others take at most `limit` bytes."""
    with _lock:
        while kept_bytes() > max(limit, 0):
            min(_stores, key=Kept.last_use).drop_oldest()


def bytes_of(value: Any) -> int:
    """Bytes of the arrays in a value: in tuples, lists, dictionaries and the fields of objects."""
    arrays = {id(array): array.nbytes for array in _arrays(value, set())}
    return sum(arrays.values())


def _arrays(value: Any, seen: set[int]) -> Iterator[np.ndarray[Any, Any]]:
    if id(value) in seen or isinstance(value, str | bytes | int | float | type | None):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        yield value.base if isinstance(value.base, np.ndarray) else value
    elif isinstance(value, dict):
        for part in value.values():
            yield from _arrays(part, seen)
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _arrays(part, seen)
    elif hasattr(value, "__dict__") and not callable(value):
        yield from _arrays(vars(value), seen)


class Workspace(threading.local):
    """Arrays by name, separate for each thread; functions that hold this object share them.

    A new array costs a page fault for each written row: milliseconds for windows all over a frame.
    """

    def __init__(self) -> None:
        self._arrays = dict[str, NDArray[Any]]()
        self._canvases = dict[str, tuple[Singles, float, Ints]]()

    def array(self, name: str, shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
        """The array of that name as the last call left it; zeros at first."""
        array = self._arrays.get(name)
        if array is None or array.shape != shape or array.dtype != kind:
            size = math.prod(shape) * np.dtype(kind).itemsize
            require_memory(size, f"an array of {' x '.join(map(str, shape))} numbers")
            array = self._arrays[name] = np.zeros(shape, kind)
        return array

    def canvas(self, name: str, shape: tuple[int, int], level: float, windows: Ints) -> Singles:
        """The float32 image of that name, one level everywhere except in the windows of this call.

        Only the windows of the last call are filled with the level again.

        windows  (w, 4) left, top, right, bottom (exclusive); their pixels hold any values
        """
        image = self.array(name, shape, np.float32)
        last = self._canvases.get(name)
        if last and last[0] is image and last[1] == level:
            _paint(image, last[2], level)
        else:
            image.fill(level)
        self._canvases[name] = image, level, windows
        return image


@kernel
def _paint(image, windows, level):  # type: ignore[no-untyped-def]
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        image[top:bottom, left:right] = level
