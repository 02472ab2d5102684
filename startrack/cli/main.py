"""The command `startrack`: the list of commands, and the exit status of their errors.

Exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved, 130 stopped by Ctrl-C,
143 by SIGTERM.
"""

import argparse
import gc
import io
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stdout, suppress
from importlib import import_module
from typing import cast

from startrack import __version__
from startrack.cli import stopping
from startrack.cli.options import REFUSE, load, memory_of, postpone

# Each command is a file of this name with `declare`, its table of options, and `command(options)`.
# Only the file of the called command is imported; its computing packages are imported when it runs.
COMMANDS = {
    "simulate": "render one frame of a design to FITS and PNG",
    "psf": "compute the blur of a star by a design's optics: width, energy, MTF",
    "lens": "trace a lens prescription into a table; show a table",
    "detect": "find the stars of images",
    "solve": "find the attitude of images",
    "calibrate": "fit a camera model (focal length, distortion) to images of stars",
    "budget": "compute the error of a design cause by cause",
    "predict": "predict the errors of a design with unknown values, with intervals",
    "montecarlo": "measure the error of a design over many trials",
    "merge": "merge parts of a campaign from several machines",
    "combine": "estimate one error from campaigns of different fidelity",
    "compare": "show two designs or campaigns side by side",
    "compare-flight": "compare a design with flight images of its tracker",
    "report": "write a campaign as a self-contained HTML page",
    "sequence": "simulate a tracker in time: tracking, loss, reacquisition",
    "serve": "answer a control loop: attitudes in, frames and attitudes out",
    "mission": "simulate heads on a spacecraft over years: blinding, availability",
    "export": "write a design as data and code for other programs",
    "requirements": "compute the margins of a design to its requirements, without trials",
    "verify": "judge each requirement of a design by trials: pass, fail or not shown",
    "sweep": "compute errors and margins of a design over the values of one or two keys",
    "solve-for": "find the value of a key at which a design just meets a limit",
    "optimize": "find a better design",
    "page": "show a design in a browser: sliders, budget, frame, searches",
    "sample": "compute the tolerance of each parameter of a design",
    "pareto": "find the Pareto front of two goals",
    "what-matters": "show what the error and the tightest margin of a design depend on",
    "init": "write a new design file",
    "keys": "print the keys of a design file: units, ranges, defaults",
    "earth": "simulate Earth cameras over terrain: geometry, images",
    "warm": "compile all kernels before they are needed",
    "bench": "measure CPU time and error of every stage on this machine",
}
# Order of the list of commands; commands without a group come last.
GROUPS = {
    "begin here": ("init", "budget", "optimize", "page"),
    "design": ("keys", "requirements", "psf", "lens", "simulate"),
    "predict": (
        *("predict", "montecarlo", "merge", "combine", "verify", "compare", "report", "sequence"),
    ),
    "improve": ("sweep", "solve-for", "what-matters", "pareto", "sample"),
    "real images": ("detect", "solve", "calibrate", "compare-flight"),
    "fly": ("mission", "export", "serve", "earth"),
    "this machine": ("warm", "bench"),
}
# Commands that are called after another word; their names alone also work.
WITHIN = {"merge": "montecarlo", "combine": "montecarlo", "warm": "tools", "bench": "tools"}
# Earlier names of commands; they work until version 0.3.
EARLIER = {"sensitivity": "what-matters"}
# Commands that find or identify stars; at the first run a second core compiles their kernels.
IDENTIFY = (
    "simulate",
    "detect",
    "solve",
    "budget",
    "montecarlo",
    "compare",
    "sequence",
    "serve",
    "verify",
    "sweep",
    "solve-for",
    "optimize",
    "page",
    "sample",
    "pareto",
    "what-matters",
    "bench",
)
EPILOG = """
exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved; 130, 143 stopped

startrack COMMAND --help lists the options and the output files of a command. Examples:
  startrack simulate                        one frame of the example design
  startrack psf                             the blur of its optics
  startrack budget                          its error, cause by cause
  startrack verify startrack-optimize/best.toml   whether it meets its requirements
  startrack optimize                        a better design, in a few minutes
  startrack page --open                     a design with sliders, in a browser
  startrack montecarlo startrack-optimize/best.toml --out trials
  startrack report trials/campaign.sqlite   the results as an HTML page
  startrack montecarlo combine frames.sqlite windows.sqlite   one error from few frames and many
                                                              windows
  startrack sample startrack-optimize/best.toml   the tolerance of each parameter
  startrack sweep nanosatellite instrument.optics.f_number=1.2..2.4   errors and margins over a key
  startrack what-matters noise_only         causes of the error and of the tightest margin
  startrack pareto                          accuracy against mass
  startrack sequence                        a slew: acquisition, loss, reacquisition
  startrack detect photo.jpg                the stars of a real image
  startrack solve photo.jpg --fov 12        the attitude of a real image
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    Errors become messages only here.
    """
    alone = arguments is None  # this process runs a single command
    if alone:
        # Processes share the cores; a second thread for small matrices mostly waits.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        postpone()
    arguments = named_now(parts_alone(sys.argv[1:] if arguments is None else arguments))
    with stopping.stopped_by_signals() as signals:
        try:
            if alone:
                stopping.open_streams()
                stopping.stop_with_input()
            # A signal may arrive during the imports, which take seconds.
            status, message = _run(_parsed(arguments)), ""
        except SystemExit:  # after help, or for wrong arguments
            if alone:
                stopping.drop_unwritten_messages()
            raise
        except (Exception, KeyboardInterrupt) as error:
            ended = stopping.Stopped(signals[0]) if signals else error
            status, message = stopping.status_and_sentence(ended)
            if "--debug" in arguments and not isinstance(error, KeyboardInterrupt):
                traceback.print_exception(error)
    if message:
        with suppress(OSError):  # the status suffices if the message cannot be written
            print(f"{' '.join(('startrack', *_called(arguments)))}: {message}", file=sys.stderr)
    if alone:
        stopping.ignore_signals()
        stopping.drop_unwritten_messages()
        gc.freeze()  # without it Python searches all objects for garbage at the end: 0.6 s
    return int(status)


def parts_alone(arguments: Sequence[str]) -> list[str]:
    """The arguments without the word before a command, as in "tools warm"."""
    if list(arguments) == ["tools"]:
        return ["tools", "--help"]
    within = len(arguments) > 1 and WITHIN.get(arguments[1]) == arguments[0]
    return list(arguments[1:] if within else arguments)


def named_now(arguments: Sequence[str]) -> list[str]:
    """The arguments with the current name of the command; prints a note for an earlier name."""
    first, *others = arguments or [""]
    if first not in EARLIER:
        return list(arguments)
    now = EARLIER[first]
    print(
        f"startrack: {first} is called {now} now; the earlier name works until version 0.3",
        file=sys.stderr,
    )
    return [now, *others]


def _full_name(name: str) -> str:
    return " ".join(filter(None, (WITHIN.get(name), name)))


def _list_of_commands() -> str:
    """The commands in groups, each with its description."""
    grouped = {name for names in GROUPS.values() for name in names}
    others = tuple(name for name in COMMANDS if name not in grouped)
    lines = list[str]()
    for title, names in (GROUPS | {"others": others}).items():
        lines += [f"\n{title}:"] * bool(names)
        lines += [f"  {_full_name(name):19} {COMMANDS[name]}" for name in names]
    return "\n".join(lines)


def _parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of a command. Ends the process after help.

    Raises  OSError if help cannot be written, which argparse would hide.
    """
    text = io.StringIO()
    try:
        with redirect_stdout(text):
            parser = _parser(arguments)
            options, unknown = parser.parse_known_args(arguments)
            refuse = vars(options).pop(REFUSE, parser.error)
            if unknown:  # argparse itself would print the usage of the root
                refuse(f"unrecognized arguments: {' '.join(unknown)}")
            return options
    except SystemExit:
        print(text.getvalue(), end="", flush=True)
        raise


def _called(arguments: Sequence[str]) -> list[str]:
    """The name of the command, if there is one."""
    return [word for word in arguments if not word.startswith("-")][:1]


def _run(options: argparse.Namespace) -> int:
    """The exit status of a command."""
    with (
        warnings.catch_warnings(),
        _compiled_beside(options),  # first: the kernels are needed soon after the imports
    ):
        said = set[str]()
        warnings.showwarning = lambda message, *_, **__: _print_warning(message, said)
        load()
        module = import_module(_module(options.name))
        command = module.command
        terminal = import_module("startrack.cli.terminal")
        core = import_module("startrack.core")
        with (
            # An overflow is visible in the result, or refused with a message.
            import_module("numpy").errstate(all="ignore"),
            core.code_of_command(getattr(options, "allow_code", False)),
            core.limited_memory(memory_of(options, core.memory_limit())),
            terminal.lines_now_and_then(),
            terminal.report_compiling(),
            terminal.claimed_out(options),
        ):
            # The only place that decides whether files describe star trackers.
            if getattr(options, "problems", False):
                problems = import_module("startrack.cli.problems")
                command = problems.command_of(options, module.declare.given(options)) or command
            status = int(command(options))
            sys.stdout.flush()
            return status


def _module(name: str) -> str:
    return f"startrack.cli.{name.replace('-', '_')}"


def _compiled_beside(options: argparse.Namespace) -> AbstractContextManager[None]:
    if options.name not in IDENTIFY or getattr(options, "part", None):
        return nullcontext()
    beside = import_module("startrack.cli.beside")
    return cast("AbstractContextManager[None]", beside.compiled_beside(options.name))


def _print_warning(message: Warning | str, said: set[str]) -> None:
    """Print a warning once, in one line, without its line of code.

    Python forgets earlier warnings when code sets its filters.
    """
    line = stopping.one_line(message)
    if line not in said:
        said.add(line)
        print(f"startrack: {line}", file=sys.stderr)


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="startrack",
        usage="startrack [-h] [--version] COMMAND ...",
        description="Design a star tracker before it is built: render, detect, identify, estimate, "
        f"optimise.\n{_list_of_commands()}",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"startrack {__version__}")
    commands = parser.add_subparsers(
        dest="name", required=True, metavar="COMMAND", help=argparse.SUPPRESS
    )
    called = _called(arguments)
    # Help before a command lists all commands.
    alone = bool(called) and called[0] in COMMANDS and arguments[0] == called[0]
    for name in called if alone else COMMANDS:
        text = COMMANDS[name]
        command = commands.add_parser(
            name,
            prog=f"startrack {_full_name(name)}",
            description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if [name] == called:
            import_module(_module(name)).declare(command)
    if not alone:
        names = [name for name in WITHIN if WITHIN[name] == "tools"]
        lines = [f"  startrack {_full_name(name)}" for name in names]
        tools = commands.add_parser(
            "tools",
            prog="startrack tools",
            usage="startrack tools COMMAND ...",
            description="\n".join(["tasks once per machine:", *lines]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        tools.add_argument("tool", metavar="COMMAND", choices=names, help=argparse.SUPPRESS)
    return parser
