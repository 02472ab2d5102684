"""`startrack solve-for`: the value of a key at which a design just meets a limit."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, wanted, whole
from startrack.cli.sweep import DESIGN_FILE, SHARED

if wanted(__name__):
    from startrack import optimise, plots
    from startrack.cli import terminal
    from startrack.cli.sweep import opened
    from startrack.design import Fidelity
    from startrack.io import finite, save_json
    from startrack.metrics import Column, Table


declare = Options(
    "Finds the value with zero margin: by formula over the range, then corrected by trials on "
    "the same skies and noise, with a 95 % interval. Several values, or none, are reported. "
    "Writes solve-for.png, result.json and ledger.sqlite, from which the same command continues. "
    "The status is 3 if there is no such value.\n\n startrack solve-for noise_only "
    "instrument.optics.f_number=1..4 --until across=1arcsec\n startrack solve-for mine.toml "
    "instrument.detector.exposure --until availability=0.99\n startrack solve-for mine.toml "
    "instrument.optics.f_number --until 'mass=0.3 kg'",
    DESIGN_FILE,
    Option(
        "key KEY[=A..B]",
        "key of the design file, and the searched range (default: a tenth to ten times the value "
        "of the design, in equal ratios)",
    ),
    Option(
        "--until LIMIT",
        "limit on an error, such as 'across=5 arcsec' for its rms or 'about-99.73=60 arcsec' for a "
        "level; on availability, mass, power, volume, data rate, cost, update rate or stars in the "
        "sky; or the name of a margin of the design (the only form for an Earth camera)",
        str,
        required=True,
    ),
    Option(
        "--points N",
        "values of the range at which the formula is evaluated; two solutions between neighbours "
        "are missed",
        whole(2, 1000),
        25,
    ),
    Option("--trials N", "trials at each tried value; 0: by formula", whole(0, 10**8), 1000),
    *SHARED,
    shared.out("startrack-solve-for"),
    fidelity=None,
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Write solve-for.png and result.json; print the answer."""
    with opened(options) as (path, runner), terminal.progress("designs", options.points) as advance:
        solution = optimise.solve_for(
            path,
            options.key,
            options.until,
            changes=options.set,
            points=options.points,
            log=options.log,
            trials=options.trials,
            fidelity=Fidelity(options.fidelity) if options.fidelity else None,
            runner=runner,
            progress=advance,
            watch=lambda value: advance(0, f"trials at {value}"),
        )
    return write_solution(options, solution, path)


def write_solution(options: argparse.Namespace, solution: optimise.Solution, path: Path) -> int:
    """Print and write a solution.

    path  path of the design; its name is the title of the picture
    """
    unit = solution.key.unit
    table = Table(
        [
            Column(
                "value", f"value ({unit})" if unit else "value", lambda row: row.value, form=".5g"
            ),
            Column("formula", "by formula", lambda row: row.formula, form=".5g"),
            Column("kept_above", "", lambda row: row.above),
            Column("", "kept", lambda row: "above" if row.above else "below"),
            Column("tried", "", lambda row: row.tried),
        ],
        solution.crossings,
    )
    plots.draw_crossings(options.out / "solve-for.png", solution, path.stem)
    result: dict[str, Any] = {"design": str(options.design), "out": str(options.out)}
    result |= {"answer": solution.answer, "seed": options.seed, "by": solution.how}
    result |= {"key": solution.key.name, "unit": unit, "until": options.until}
    result |= {"margin": solution.margin, "values": table.json()}
    if solution.left_out:
        result["not_counted"] = list(solution.left_out)
    save_json(options.out / "result.json", finite(result))
    text = [solution.answer, "", *(table.text(()) if solution.crossings else ())]
    text += [f"Not counted: {'; '.join(solution.left_out)}."] if solution.left_out else []
    terminal.print_result(
        options, result, *text, f"by {solution.how}", f"results are in {options.out}"
    )
    return Exit.DONE if solution.crossings else Exit.UNSOLVED
