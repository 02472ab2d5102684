"""The command `startrack`: which commands there are, and how their errors end.

Exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor
from importlib import import_module
from typing import TextIO

from startrack import __version__
from startrack.cli.exits import Exit, WrongUse

# Each command is a file of this name with `declare(parser)` and `command(options)`. It imports the
# rooms that it needs, so only the one that is called is imported.
COMMANDS = {
    "simulate": "render one frame of a design to FITS and PNG",
    "psf": "how the optics of a design blur a star",
    "detect": "find the stars of images",
    "solve": "find the attitude of images",
    "calibrate": "find the camera behind images of stars",
    "budget": "what the error of a design is made of, cause by cause",
    "montecarlo": "the error of a design over many trials",
    "combine": "one error from campaigns of different fidelity",
    "report": "a campaign as one HTML page that needs nothing else",
    "sequence": "a tracker in time: tracking, loss, reacquisition",
    "requirements": "how far a design meets what its campaign asks, without a trial",
    "optimize": "find a better design",
    "sample": "how far each parameter may stray from a design",
    "pareto": "what one goal costs in terms of another",
    "sensitivity": "which parameters the error of a design depends on",
    "earth": "a camera in flight over terrain",
    "bench": "CPU time and error of every stage, on this machine",
}
EPILOG = """\
exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved

startrack COMMAND --help says what a command takes and what it leaves. A first hour:
  startrack simulate                        one frame of the example design
  startrack psf                             how its optics blur a star
  startrack budget                          what its error is made of
  startrack optimize                        a better design, in some minutes
  startrack montecarlo startrack-optimize/best.toml --out trials
  startrack report trials/campaign.sqlite   what came out, as a page to read and to send
  startrack combine frames.sqlite windows.sqlite   few frames, made precise by many windows
  startrack sample startrack-optimize/best.toml
  startrack sensitivity                     what the error depends on
  startrack pareto                          what accuracy costs in mass
  startrack sequence                        it follows a slew, loses the sky and finds it again
  startrack detect photo.jpg                the stars of a real image
  startrack solve photo.jpg --fov 12        the attitude of a real image
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = _parser(arguments).parse_args(arguments)
    # The rooms are imported by the command that needs them, so that --help is quick.
    command = import_module(f"startrack.cli.{options.name}").command
    told_of_compiling = import_module("startrack.cli.compiling").told_of_compiling
    try:
        with warnings.catch_warnings(), told_of_compiling():
            warnings.showwarning = _notice
            return int(command(options))
    except WrongUse as error:
        status, message = Exit.WRONG_USE, str(error)
    except OSError as error:
        named = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        status, message = Exit.FAILED, named
    except (ValueError, ImportError) as error:
        status, message = Exit.FAILED, str(error)
    except BrokenExecutor:
        status, message = Exit.FAILED, "a worker died; what is on disk is whole"
    except KeyboardInterrupt:
        status, message = Exit.FAILED, "stopped; what is on disk is whole"
    print(f"startrack {options.name}: {message}", file=sys.stderr)
    return int(status)


def _notice(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning as one line for a person, without the place in the code that gave it."""
    print(f"startrack: {message}", file=sys.stderr)


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="startrack",
        description="Design a star tracker before it is built: render, detect, identify, estimate, "
        "optimise.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"startrack {__version__}")
    commands = parser.add_subparsers(dest="name", required=True, metavar="COMMAND")
    called = next((one for one in arguments if not one.startswith("-")), None)
    for name, text in COMMANDS.items():
        one = commands.add_parser(
            name, help=text, description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip
        if name == called:
            import_module(f"startrack.cli.{name}").declare(one)
    return parser
