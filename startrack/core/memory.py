"""Bytes that a step needs -> refused, with the figure, where they exceed the limit of a process."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from startrack.core.checks import Refused

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
    """Bytes that this process may take: STARTRACK_MEMORY, else half of the machine's memory."""
    given = os.environ.get(VARIABLE, "")
    return int(given) if given.isdecimal() and len(given) < 20 else machine_memory() // 2


_releases: list[Callable[[float], None]] = []


def release_with(release: Callable[[float], None]) -> None:
    """Let a function free what is only kept to save time, down to so many bytes, before steps."""
    _releases.append(release)


def require_memory(size: float, what: str) -> None:
    """Refuse a step before it takes more memory than there may be.

    size  bytes that it takes at its largest
    what  takes them, for the message: "a frame of 65536 x 65536 pixels"

    Raises  Refused with what, the bytes and the limit; no ledger keeps it, as the limit is the
            machine's.
    """
    limit = memory_limit()
    for release in _releases:
        release(limit - size)
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
    """Let this process and those that it starts take at most so many bytes more than now.

    What has no estimate, or a wrong one, then ends in MemoryError instead of a machine that swaps.
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
    most = _data() + limit
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    try:
        yield
    finally:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _data() -> int:
    """Bytes of private data of this process, as the system counts them for the limit."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    return pages * os.sysconf("SC_PAGE_SIZE")


def begin_limited() -> None:
    """Limit a worker process for as long as it lives to what STARTRACK_MEMORY says."""
    if os.environ.get(VARIABLE):
        _data_limit(memory_limit()).__enter__()
