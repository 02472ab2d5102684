"""`startrack page`: a design and its searches in a browser."""

from __future__ import annotations

import argparse
import os
import threading
import webbrowser
from concurrent.futures import Executor
from pathlib import Path

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, wanted, whole

if wanted(__name__):
    from startrack.cli import terminal
    from startrack.cli.files import SCENE, SEARCH, design_file, kind_of, shipped_by_name
    from startrack.montecarlo import pool
    from startrack.page import EARTH, MOVING, PageServer, ProblemPage, Routes, TrackerPage

BESIDE = 2  # processes: one for later results, one for trials


declare = Options(
    "Shows a design in the browser of this machine: its values as a form and sliders; error "
    "budget, frame, sky, curves and requirements, which follow each change; a search and trials, "
    "which can be watched and stopped. The numbers are the same as by budget, requirements, "
    "optimize and montecarlo. The page is served on 127.0.0.1 alone, requires the token in the "
    "printed address, and needs no network. Files are written only to the folder of --out. "
    "Ctrl-C ends it.",
    Option(
        "design DESIGN.toml",
        "design file, a scene of an Earth camera with [retrieval] and [campaign], or a search for "
        "moving objects (default: the example, a nanosatellite)",
        Path,
        many="?",
    ),
    *shared.SET,
    Option("--port N", "port (default: a free port)", whole(0, 65535), 0),
    Option("--open", "open the address in the browser"),
    shared.SEED,
    shared.WORKERS,
    shared.out("startrack-page"),
)


def command(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    page = _page(options)
    options.out.mkdir(parents=True, exist_ok=True)
    if options.allow_code:  # also in the computing processes
        os.environ["STARTRACK_ALLOW_CODE"] = "*"
    try:
        with pool(1) as painter, pool(max(options.workers, BESIDE)) as executor:
            _serve(options, page, painter, executor)
    except KeyboardInterrupt:  # Ctrl-C has already ended the processes
        terminal.print_message("startrack page: ended")
    return Exit.DONE


def _serve(
    options: argparse.Namespace,
    page: TrackerPage | ProblemPage,
    painter: Executor,
    executor: Executor,
) -> None:
    folder = options.out.resolve()
    routes = Routes(page, folder, painter, executor, options.workers, options.set)
    first = {"changes": options.set}
    try:
        server = PageServer(routes, options.port)
    except OSError as error:
        raise shared.WrongUse(
            f"--port must be free, but {options.port} is not: {error.strerror}"
        ) from None
    with server:
        result = {"address": server.address, "out": str(options.out)}
        terminal.print_result(options, result, f"open {server.address}\nCtrl-C ends the page")
        # Before the browser's request: the first design compiles kernels and reads the sky.
        for name in ("paint", "images"):
            threading.Thread(target=routes.answer, args=(name, first), daemon=True).start()
        if options.open:
            webbrowser.open(server.address)
        try:
            with terminal.waiting():
                server.serve_forever()
        finally:
            routes.close()


def _page(options: argparse.Namespace) -> TrackerPage | ProblemPage:
    """The design or scene of the command, read once so that a fault in the file ends the
    command."""
    path = options.design or terminal.example()
    with shared.as_wrong_use():
        for kind, files in ((SCENE, EARTH), (SEARCH, MOVING)):
            if kind_of(path) is kind:
                file = shipped_by_name(path, [kind.folder]).resolve()
                page = ProblemPage(file, options.seed, files)
                page.load(options.set)
                return page
        tracker = TrackerPage(design_file(path).resolve(), options.seed)
        terminal.read_design(tracker.path, options.set)
        return tracker
