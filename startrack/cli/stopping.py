"""A signal or an error -> the end of a command, and its message."""

import errno
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from startrack.cli.options import Exit, WrongUse

PACKAGE = Path(__file__).parents[1]
LONGEST = 600  # characters of a message
AGAIN = 1.0  # second; an unhandled signal is sent again after this time
STOPS_WITH_INPUT = "STARTRACK_STOPS_WITH_INPUT"  # environment variable, set by `startrack.page`
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")


class Stopped(KeyboardInterrupt):
    """A request to end the process. It is not an Exception, so that code that handles exceptions
    does not continue."""

    def __init__(self, number: int):
        self.signal = number
        super().__init__(signal.Signals(number).name)


@contextmanager
def stopped_by_signals() -> Iterator[list[int]]:
    """Let Ctrl-C, SIGTERM and SIGHUP end a command: files are closed, workers ended.

    Yields the received signals. An error after a signal counts as that signal, because a library in
    C may convert the handler's exception.

    The signal is sent again each second until it is handled: Python discards exceptions raised
    during the deletion of an object, and so do libraries that call Python code.
    """
    asked, again = list[int](), list[int]()  # without locks: handlers must not wait
    over, sending = threading.Event(), threading.Lock()
    main = threading.current_thread()
    if main is not threading.main_thread():
        yield asked
        return

    def remind() -> None:
        while not over.wait(AGAIN):
            with sending:
                if not over.is_set():
                    again.append(asked[0])
                    signal.pthread_kill(main.ident or 0, asked[0])

    def stop(number: int, _: Any) -> None:
        if again:
            again.clear()
            if over.is_set() or _is_handled(sys.exc_info()[1]):
                return
        elif not asked and hasattr(signal, "pthread_kill"):  # not on Windows
            threading.Thread(target=remind, daemon=True).start()
        asked.append(number)
        raise Stopped(number)

    def discarded(thing: Any) -> None:
        if not asked:  # or a half-deleted object raises an error
            sys.__unraisablehook__(thing)

    kinds = [getattr(signal, name) for name in ENDING if hasattr(signal, name)]
    before = {kind: signal.getsignal(kind) for kind in kinds}
    for kind, handler in before.items():
        if handler != signal.SIG_IGN:  # for nohup
            signal.signal(kind, stop)
    hook, sys.unraisablehook = sys.unraisablehook, discarded
    try:
        yield asked
    finally:
        over.set()
        with sending:  # no signal is sent to the earlier handlers
            sys.unraisablehook = hook
        for kind, handler in before.items():
            signal.signal(kind, handler or signal.SIG_DFL)


def _is_handled(error: BaseException | None) -> bool:
    """Whether a Stopped is being handled: code up to its handler is ending."""
    while error is not None and not isinstance(error, Stopped):
        error = error.__context__
    return error is not None


def stop_with_input() -> None:
    """End the command as by SIGTERM when standard input ends, if the parent process requests that.
    The parent has the other end, which is closed at its end, even by SIGKILL.
    """
    if not os.environ.pop(STOPS_WITH_INPUT, ""):
        return

    def watch() -> None:
        while os.read(0, 1024):
            pass
        os.kill(os.getpid(), signal.SIGTERM)  # background processes of a shell ignore SIGINT

    threading.Thread(target=watch, daemon=True).start()


def ignore_signals() -> None:
    """Ignore signals from here on: the command is done, and Python cleans up."""
    for name in ENDING:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


def drop_unwritten_messages() -> None:
    """Keep the exit status if messages cannot be written; Python would return 120."""
    try:
        sys.stderr.flush()
    except OSError:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def open_streams() -> None:
    """Open closed standard streams, so that no other file gets their numbers.

    Raises  OSError without a standard output, which receives results.
    """
    closed = False
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
            setattr(sys, name, os.fdopen(number, mode))
            if name == "stdout":
                closed = True
    if closed:
        raise OSError("standard output must be open, such as > /dev/null")


def status_and_sentence(error: BaseException) -> tuple[int, str]:
    """The exit status and the message of a command's exception."""
    match error:
        case Stopped() if error.signal != signal.SIGINT:
            return 128 + error.signal, f"stopped by {error}; no file is left half-written"
        case KeyboardInterrupt():
            return Exit.INTERRUPTED, "stopped; no file is left half-written"
        case WrongUse():
            return Exit.WRONG_USE, one_line(error)
        case BrokenPipeError():
            # The reader of the output, such as `head`, has ended: nobody would read a message.
            _drop_output()
            return Exit.FAILED, ""
        case OSError(errno=errno.ENOSPC, filename=None):
            _drop_output()  # its buffer cannot be written either
            return Exit.FAILED, error.strerror or one_line(error)
        case FileExistsError(filename=str() | bytes() as name):
            place = os.fsdecode(name)
            return Exit.FAILED, f"{place} must be a folder or a new name, but it is a file"
        case OSError(filename=str() | bytes() as name):
            return Exit.FAILED, f"{os.fsdecode(name)}: {error.strerror}"
        case BrokenExecutor():
            return Exit.FAILED, "a worker process died; no file is left half-written"
        case ValueError() | ImportError() | OSError():
            return Exit.FAILED, one_line(error)
        case MemoryError():
            from startrack.core import gib, memory_limit

            return Exit.FAILED, (
                f"more memory is needed than the limit of {gib(memory_limit())} (option --memory): "
                f"{one_line(error) or 'no more could be had'}"
            )
    return Exit.FAILED, (
        f"{place_of(error)}: unexpected {type(error).__name__}: {one_line(error)} (--debug prints "
        "where)"
    )


def _drop_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def one_line(error: object) -> str:
    """Message of an error or a warning, in one line of printable characters."""
    # The text of a KeyError is its key alone.
    text = f"no {error}" if isinstance(error, KeyError) else str(error)
    text = ", ".join([text, *getattr(error, "__notes__", [])])  # notes, such as the trial
    words = " ".join(text.split())
    clean = "".join(letter if letter.isprintable() else "?" for letter in words)
    return clean if len(clean) <= LONGEST else f"{clean[: LONGEST - 3]}..."


def place_of(error: BaseException) -> str:
    """File and line in the package where an error comes from."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).is_relative_to(PACKAGE)
    ]
    if not frames:
        return "startrack"
    where = Path(frames[-1].filename).relative_to(PACKAGE)
    return f"{where}, line {frames[-1].lineno}"
