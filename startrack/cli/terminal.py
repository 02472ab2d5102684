"""Designs and other inputs, and outputs: results on standard output, messages on standard error."""

import argparse
import json
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from startrack import io
from startrack.catalog import Selection, open_sky
from startrack.cli.files import design_file, found_file
from startrack.cli.options import WrongUse, as_wrong_use
from startrack.cli.stopping import one_line, status_and_sentence
from startrack.core import Camera, Frame, Stars, compiling_reports, kernel_folder, parse, used_code
from startrack.design import Campaign, Design, load_design
from startrack.detection import divide_flat, subtract_dark
from startrack.io import finite
from startrack.metrics import Row, to_json, to_lines
from startrack.sequence import Sequence, load_sequence

EXAMPLE = "designs/nanosatellite.toml"
CATALOGS = ("bright", "deep")
LONG_COMPILING = 2.0  # second
# fraction of the steps before the remaining time is printed: the first steps compile
EARLIEST = 0.02
SILENT = 30.0  # second between two lines without a terminal
UNKEPT_CODE = (
    "startrack: compiled code cannot be cached, because no folder is writable: each run compiles "
    "again, up to a minute; set NUMBA_CACHE_DIR to a writable folder"
)
_running = list[Callable[[], str]]()  # texts of running steps, the innermost last
COMPILING = "startrack: compiling for this machine; once after an installation, up to a minute"


def example() -> Path:
    """The shipped example: a tracker for a nanosatellite."""
    return io.shipped(EXAMPLE)


MOST_NAMES = 3  # names of unknown values in a message


def read_design(path: Path, changes: Iterable[str] = (), unknown: str = "") -> Design:
    """The design of a file with the changes of --set. Raises WrongUse for an unusable file.

    A missing file is searched among the shipped files, by path or name.

    unknown  values of unknowns that the figures are for, if not the median of each law
    """
    path = design_file(path)
    with as_wrong_use():
        design = load_design(path, list(changes))
    for code in used_code():
        print_message(f"startrack: {code}")
    print_unknown(design, values=unknown)
    if note := design.case.saturation_note:
        print_message(f"startrack: {note}")
    return design


def print_unknown(design: Design, owner: str = "the design", values: str = "") -> None:
    """Print the values of a design's unknowns that figures are for: the median of each law, or
    other `values`.
    """
    if not design.unknowns:
        return
    names = [unknown.name for unknown in design.unknowns]
    drawn = design.campaign.unknown_draws if design.campaign else 0
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    values = values or (
        "figures are for the medians of their laws"
        + (f", conditions for {drawn} draws" if drawn else "")
        + ", `startrack predict` gives intervals"
    )
    print_message(
        f"startrack: unknown in {owner}: {len(names)} value{'s' * (len(names) > 1)} "
        f"({', '.join(names[:MOST_NAMES])}{more}); {values}"
    )


def read_campaign(path: Path, changes: Iterable[str] = ()) -> tuple[Design, Campaign]:
    """A design with a campaign."""
    design = read_design(path, changes)
    campaign = design.asked
    if campaign is None or not campaign.variables:
        raise WrongUse(f"{path} must have a table [campaign] that names variables")
    return design, campaign


def read_sequence(path: Path) -> Sequence:
    """The sequence of a file, or of a shipped file. Raises WrongUse for an unusable file."""
    with as_wrong_use():
        return load_sequence(found_file(path, ("sequences",), "a sequence file"))


def read_camera(path: Path) -> Camera:
    """The camera in [tracker.camera] of a TOML file. Raises WrongUse for an unusable file."""
    with as_wrong_use():
        table: Any = io.read_table(path, "a file with a table [tracker.camera]")
    for key in ("tracker", "camera"):
        table = table.get(key) if isinstance(table, dict) else None
    if table is None:
        raise WrongUse(f"{path} must have a table [tracker.camera]")
    with as_wrong_use(path=path):
        return io.from_table(Camera, table, "tracker.camera")


def save_camera(path: Path, camera: Camera) -> None:
    """Write a camera for `read_camera`, without loss."""
    io.save_toml(path, {"tracker": {"camera": io.to_table(camera)}})


def age_of(options: argparse.Namespace) -> float | None:
    """Age of the units by --age, second; None if it is not given."""
    if options.age is None:
        return None
    try:
        age = parse(options.age, "s")
    except ValueError as error:
        raise WrongUse(f"--age {error}") from None
    if age < 0:
        raise WrongUse(f"--age must not be negative, got {options.age}")
    return age


def image_reader(options: argparse.Namespace) -> Callable[[Path], Frame]:
    """Reader of image files by the options: minus --dark, divided by --flat.

    Raises  WrongUse if the layout is not valid, or a dark frame or flat field cannot be read
    """
    layout, correct = _reading(options)
    return lambda path: correct(io.read_image(path, layout))


def read_series(options: argparse.Namespace) -> tuple[int, Iterator[Frame]]:
    """The frames of all image files in order, as read by `image_reader`, and their number."""
    layout, correct = _reading(options)
    with as_wrong_use(ValueError, OSError):
        single = options.plane is not None
        count = sum(1 if single else io.frames_in(path, layout) for path in options.images)
    frames = (frame for path in options.images for frame in io.read_frames(path, layout))
    return count, map(correct, frames)


def _reading(options: argparse.Namespace) -> tuple[io.Layout, Callable[[Frame], Frame]]:
    """Settings by the options: layout of images, and frames to subtract and divide by."""
    with as_wrong_use(ValueError, TypeError, OSError):
        layout = io.Layout(
            options.plane, options.bayer, options.colour, options.raw, options.extension
        )
        dark, flat = (
            io.read_image(path, layout) if (path := getattr(options, name, None)) else None
            for name in ("dark", "flat")
        )

    def correct(frame: Frame) -> Frame:
        frame = frame if dark is None else subtract_dark(frame, dark)
        return frame if flat is None else divide_flat(frame, flat)

    return layout, correct


def read_stars(catalog: str, epoch: float) -> Stars:
    """The stars of `--catalog` at an epoch. Raises WrongUse for an unusable catalogue."""
    if catalog not in CATALOGS and not Path(catalog).is_file():
        raise WrongUse(f"--catalog must be {' or '.join(CATALOGS)}, or a file, got {catalog!r}")
    with as_wrong_use(ValueError, OSError, ImportError):
        return open_sky(Selection.whole(catalog, epoch)).stars


def print_message(message: str) -> None:
    """Print a message on standard error."""
    print(message, file=sys.stderr)


def print_result(options: argparse.Namespace, result: dict[str, Any], *lines: str) -> None:
    """Print a result: one JSON object on a line with --json, lines of text without it."""
    if options.json:
        if changes := getattr(options, "set", []):
            result = {**result, "set": changes}
        if code := used_code():
            result = {**result, "code": [str(origin) for origin in code]}
        print(json.dumps(finite(result), allow_nan=False), flush=True)
    else:
        _print_text("\n".join(lines))


def sections(options: argparse.Namespace) -> Callable[[str], None]:
    """A function that prints sections of a text, separated by blank lines; nothing with --json."""
    before = ""

    def show(section: str) -> None:
        nonlocal before
        if not options.json:
            _print_text(before + section)
            before = "\n"

    return show


def _print_text(text: str) -> None:
    # The name of a file may have characters outside the encoding of the output.
    encoding = sys.stdout.encoding or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding), flush=True)


def print_rows(options: argparse.Namespace, rows: Iterable[Row], *more: str) -> None:
    """Print the rows of a result, and in text more lines below the rows."""
    shown = list(rows)
    print_result(options, to_json(shown), *to_lines(shown), *more)


def print_failed_image(options: argparse.Namespace, path: Path, error: Exception) -> None:
    """Print the reason for a skipped image; with --json also as a result."""
    _, reason = status_and_sentence(error)
    if str(path) not in reason:
        reason = f"{path}: {reason}"
    print_message(f"startrack {options.name}: {one_line(reason)}")
    if options.debug:
        traceback.print_exception(error)
    if options.json:
        print_result(options, {"image": str(path), "status": "failed", "reason": reason}, "")


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[..., None]]:
    """A progress bar on standard error if it is a terminal; otherwise occasional lines.

    Yields a function of the number of steps done and of a note beside the bar.
    """
    if not sys.stderr.isatty():
        done, said, begun = [0.0], [""], time.monotonic()

        def count(steps: float, note: str = "") -> None:
            done[0] += steps
            said[0] = note or said[0]

        def text() -> str:
            left = ""
            if EARLIEST * total <= done[0] < total:
                left = f", some {(time.monotonic() - begun) * (total / done[0] - 1):.0f} s left"
            steps = f"{done[0]:.0f}" if total > 10 or done[0] % 1 == 0 else f"{done[0]:.1f}"
            return f"{title}: {steps} of {total}{left}{said[0] and f', {said[0]}'}"

        with _named(text):
            yield count
        return
    from rich import console
    from rich import progress as rich

    columns = (
        rich.TextColumn("{task.description}"),
        rich.BarColumn(),
        rich.MofNCompleteColumn(),
        rich.TimeRemainingColumn(elapsed_when_finished=True),
        rich.TextColumn("{task.fields[note]}"),
    )
    with rich.Progress(*columns, console=console.Console(stderr=True)) as bars:
        task = bars.add_task(title, total=total, note="")

        def advance(count: float, note: str = "") -> None:
            bars.advance(task, count)
            if note:
                bars.update(task, note=note)

        yield advance


@contextmanager
def _named(text: Callable[[], str]) -> Iterator[None]:
    """In this context, `lines_now_and_then` prints the text for the running step."""
    _running.append(text)
    try:
        yield
    finally:
        _running.remove(text)


def waiting() -> AbstractContextManager[None]:
    """In this context no lines are printed, because the command waits for other processes."""
    return _named(lambda: "")


@contextmanager
def stage(title: str) -> Iterator[None]:
    """A moving sign and a name on a terminal while a step without a bar runs."""
    if not sys.stderr.isatty():
        with _named(lambda: title):
            yield
        return
    from rich.console import Console

    with Console(stderr=True).status(title):
        yield


@contextmanager
def lines_now_and_then() -> Iterator[None]:
    """Without a terminal, print the step and the remaining time every SILENT seconds."""
    if sys.stderr.isatty():
        yield
        return
    over, begun = threading.Event(), time.monotonic()

    def show() -> None:
        while not over.wait(SILENT):
            text = _running[-1]() if _running else "at work"
            if not text:
                continue
            with suppress(OSError, ValueError):  # the output is closed
                print_message(f"startrack: {text}; {time.monotonic() - begun:.0f} s so far")

    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def report_compiling() -> Iterator[None]:
    """Print one message if numba compiles kernels for longer than LONG_COMPILING."""
    if kernel_folder() is None:
        print_message(UNKEPT_CODE)
    spent = 0.0

    def report(seconds: float) -> None:
        nonlocal spent
        if spent <= LONG_COMPILING < spent + seconds:
            print_message(COMPILING)
        spent += seconds

    with compiling_reports(report) if sys.stderr.isatty() else nullcontext():
        yield


@contextmanager
def claimed_out(options: argparse.Namespace) -> Iterator[None]:
    """Claim the folder of --out for this process, if the command writes to a folder."""
    folder: Path | None = options.out if getattr(options, "claims", False) else None
    with io.claimed_folder(folder) if folder else nullcontext():
        yield


def quaternion(rotation: Rotation) -> list[float]:
    """(x, y, z, w) of a rotation, with w >= 0."""
    return [float(x) for x in rotation.as_quat(canonical=True)]


def attitude_values(icrs_to_camera: Rotation) -> dict[str, Any]:
    """An attitude for JSON."""
    names = ("ra_deg", "dec_deg", "roll_deg")
    angles = dict(zip(names, io.celestial(icrs_to_camera), strict=True))
    return {"icrs_to_camera_xyzw": quaternion(icrs_to_camera), **angles}


def pointing_text(icrs_to_camera: Rotation, digits: int, of_roll: int) -> str:
    """An attitude in words; digits of right ascension and declination, and of roll."""
    ra, dec, roll = io.celestial(icrs_to_camera)
    turned = round(roll, of_roll) % 360  # 359.99 must not be printed as 360.0
    return f"RA {ra:.{digits}f}, Dec {dec:+.{digits}f}, roll {turned:.{of_roll}f} deg"
