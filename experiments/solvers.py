"""How often is a lost-in-space solver wrong? The same skies for all of them, by the million.

Each sky is made from its number (`solvers_skies`), so that nothing but counts is kept: fields of 2
to 60 deg, and of each thirteen kinds of difficulty. Programs:

    startrack    `identify`, with the settings of a design
    tetra3rs     with its tolerances set for the noise of each kind, where it is installed
    cedar-solve  through the interpreter that STARTRACK_CEDAR names, on fields from 10 to 30 deg,
                 which its database holds
    astrometry   `solve-field` of astrometry.net with Tycho-2 indexes, where it is installed, on
                 fields up to 20 deg; it is started anew for each sky, and its time is not shown

The part `stated` counts frames without a star that startrack, asked for any evidence, takes for a
sky, by the probability of a false match that it states.

Beside it, detection_fast_ms and detection_fast_found: CPU milliseconds of the quick search of a
megapixel with 25 stars of SNR 10, and the share of these that it finds.

Counts are lines of the file `--counts`, a block of skies each: a stopped run continues, and a
larger `--skies` adds blocks to the file. Times are CPU times.

With `--holding RA DEC` only those of the skies count whose field holds a direction, such as that of
the Pleiades (56.75 24.12): stars of clusters are not at random.

    python experiments/solvers.py [--json FILE] [--markdown FILE] [--counts FILE] [--skies N]
                                  [--fields DEG ...] [--kinds KIND ...] [--holding RA DEC]
                                  [--programs NAME ...] [--workers N] [--quick]
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import math
import os
import shutil
import subprocess
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import command
import solvers_skies as skies
from identification import cedar, database_of, pointed, tetra3rs_solver, toward, tuned
from scipy.spatial.transform import Rotation

from startrack import deg
from startrack.benchmark import STAGES, measure, solving, versions
from startrack.core import Status
from startrack.identification import identify
from startrack.metrics import fraction_interval

BLOCK = 500  # skies
PROGRAMS = ("startrack", "tetra3rs", "cedar-solve", "astrometry", "stated")
OTHERS = PROGRAMS[1:4]
# Skies of each field and kind, as many as a program's time allows; None: those that are asked for.
MOST = {"startrack": None, "tetra3rs": None, "cedar-solve": 50, "astrometry": 10, "stated": None}
FIELDS = {"cedar-solve": (12, 20), "astrometry": (2, 4, 8, 12, 20)}
MOST_FALSE = 20  # false attitudes that are named
BINS = 50  # of a histogram of times, per decade
STATED_KINDS = ("no stars", skies.FEW)
DECADES = 6  # of stated probabilities


class Answer(NamedTuple):
    """A program's answer to a sky: attitude, CPU seconds, and the stated probability."""

    attitude: Rotation | None
    seconds: float
    stated: float = math.nan


Program = Callable[[solving.BenchmarkView], Answer]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="file for the page")
    parser.add_argument("--counts", type=Path, default=Path("solver-counts.jsonl"), metavar="FILE")
    parser.add_argument(
        "--skies", type=int, default=10**6, help="number of skies, over all fields and kinds"
    )
    parser.add_argument("--programs", nargs="+", choices=PROGRAMS, default=PROGRAMS)
    parser.add_argument("--fields", nargs="+", type=int, choices=skies.LIMIT_G, metavar="DEG")
    parser.add_argument(
        "--kinds",
        nargs="+",
        choices=skies.KINDS,
        metavar="KIND",
        help=f"all but {skies.FEW!r}, which only the part `stated` counts, if left out",
    )
    parser.add_argument("--holding", nargs=2, type=float, metavar=("RA", "DEC"), help="degree")
    parser.add_argument("--workers", type=int, default=1)
    options = command.read(parser, skies=100, programs=("startrack", "tetra3rs", "stated"))
    if options.quick:
        with tempfile.TemporaryDirectory() as folder:
            options.counts = Path(folder) / "counts.jsonl"
            run(options, [12], ["plain", *STATED_KINDS], 20)
            report(options, read(options.counts))
        return
    kinds = options.kinds or [kind for kind in skies.KINDS if kind != skies.FEW]
    kinds = [kind for kind in kinds if skies.KINDS[kind].sky or not options.holding]
    run(options, options.fields or list(skies.LIMIT_G), kinds, BLOCK)
    report(options, read(options.counts))


def run(options: argparse.Namespace, fields: list[int], kinds: list[str], block: int) -> None:
    """Count the missing blocks; all cells advance together."""
    done = {key(row) for row in read(options.counts)}
    cells = [(field, kind) for field in fields for kind in kinds]
    blocks = max(1, math.ceil(options.skies / len(cells) / block))
    jobs = [
        (program, field, kind, number, min(block, MOST[program] or block))
        for number in range(blocks)
        for field, kind in cells
        for program in options.programs
        if runs(program, field, kind) and number * block < (MOST[program] or math.inf)
    ]
    left = [job for job in jobs if job[:4] not in done]
    options.counts.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.workers) as pool, options.counts.open("a") as file:
        futures = [pool.submit(counted, *job, options.holding) for job in left]
        for number, future in enumerate(as_completed(futures), 1):
            file.write(json.dumps(future.result()) + "\n")
            file.flush()
            if number % 50 == 0:
                print(f"{number} of {len(left)} blocks", flush=True)


def runs(program: str, field: int, kind: str) -> bool:
    """Whether a program is available and handles skies of a field and a kind."""
    if field not in FIELDS.get(program, skies.LIMIT_G):
        return False
    if kind == skies.FEW and program != "stated":
        return False
    match program:
        case "stated":
            return kind in STATED_KINDS
        case "tetra3rs":
            return not command.missing("tetra3rs is", "tetra3rs")
        case "cedar-solve":
            return bool(os.environ.get("STARTRACK_CEDAR"))
        case "astrometry":
            return shutil.which("solve-field") is not None
    return True


def key(row: dict[str, Any]) -> tuple[str, int, str, int]:
    return row["program"], row["field"], row["kind"], row["block"]


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of a file of counts; a truncated last line does not count."""
    rows = list[dict[str, Any]]()
    for line in path.read_text().splitlines() if path.is_file() else ():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def counted(
    program: str,
    field: int,
    kind: str,
    block: int,
    count: int,
    holding: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """Counts of one block of skies.

    holding  degree, right ascension and declination inside their fields
    """
    solve = program_of(program, field, kind)
    solve(skies.sky(field, kind, 0))  # compiles and loads
    solved, false, times, stated = 0, list[int](), Counter[int](), Counter[int]()
    numbers = list(range(block * BLOCK, block * BLOCK + count))
    if holding:
        towards = toward(*(angle * deg for angle in holding))
        numbers = [number for number in numbers if skies.holds(field, kind, number, towards)]
    for number in numbers:
        seen = skies.sky(field, kind, number)
        answer = solve(seen)
        times[math.floor(BINS * math.log10(max(answer.seconds, 1e-7)))] += 1
        if answer.attitude is None:
            continue
        if skies.is_wrong(answer.attitude, seen, kind):
            false.append(number)
        else:
            solved += 1
        if math.isfinite(answer.stated):
            stated[max(-DECADES, math.floor(math.log10(max(answer.stated, 1e-300))))] += 1
    return {
        "program": program,
        "field": field,
        "kind": kind,
        "block": block,
        "skies": len(numbers),
        "solved": solved,
        "false": false,
        "times": times,
        "stated": stated,
    }


@lru_cache(maxsize=4)
def program_of(name: str, field: int, kind: str) -> Program:
    match name:
        case "startrack":
            return ours(field, solving.SETTINGS)
        case "stated":
            return ours(field, replace(solving.SETTINGS, max_false_probability=0.999))
        case "tetra3rs":
            limit = min(skies.LIMIT_G[field] + 1, skies.DEEPEST_G)
            solve = tetra3rs_solver(database_of(field, limit), tuned(skies.noise_of(kind)))
            return lambda seen: clocked(lambda: solve(seen))
        case "cedar-solve":
            by_cedar = cedar(os.environ["STARTRACK_CEDAR"])
            return lambda seen: Answer(*by_cedar(seen))
    return astrometry


def ours(field: int, settings: Any) -> Program:
    known = skies.tracker(field)

    def solve(seen: solving.BenchmarkView) -> Answer:
        began = time.process_time()
        found = identify(seen.spots, seen.believed, known.stars, known.index, settings)
        seconds = time.process_time() - began
        good = found.status is Status.SOLVED
        return Answer(found.icrs_to_camera if good else None, seconds, found.false_probability)

    return solve


def clocked(solve: Callable[[], Rotation | None]) -> Answer:
    began = time.process_time()
    attitude = solve()
    return Answer(attitude, time.process_time() - began)


def astrometry(seen: solving.BenchmarkView) -> Answer:
    """`solve-field` on a list of places; its direction is judged, with the true roll."""
    from astropy.io import fits
    from astropy.table import Table

    spots, side = seen.spots, skies.SIZE
    field = seen.believed.fov_x / deg
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "spots.fits"
        table = {"X": spots.x + 1, "Y": spots.y + 1, "FLUX": spots.flux}
        Table(table).write(path)
        low, high = (field * (1 + sign * 1.1 * skies.TOLERANCE) for sign in (-1, 1))
        words = ["solve-field", "--no-plots", "--overwrite", "--width", side, "--height", side]
        words += ["--scale-units", "degwidth", "--scale-low", low, "--scale-high", high]
        words += ["--cpulimit", 20, "--no-tweak", "--crpix-center", "--sort-column", "FLUX", path]
        began = time.perf_counter()
        subprocess.run([str(word) for word in words], capture_output=True, check=False, text=True)
        seconds = time.perf_counter() - began
        if not (solution := path.with_suffix(".wcs")).is_file():
            return Answer(None, seconds)
        header = fits.getheader(solution)
    return Answer(pointed(header["CRVAL1"] * deg, header["CRVAL2"] * deg, seen), seconds)


def report(options: argparse.Namespace, rows: list[dict[str, Any]]) -> None:
    """Print the table, write the page and the figures."""
    figures = figures_of(rows)
    text = page(rows, figures)
    print(text)
    if options.markdown:
        options.markdown.write_text(text, encoding="utf-8")
    command.save(options, figures | quick_detection())


def figures_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Totals of each program over all of its skies."""
    figures: dict[str, Any] = defaultdict(dict)
    for program in PROGRAMS[:-1]:
        own = [row for row in rows if row["program"] == program]
        if not own:
            continue
        skies_of, solved, false = totals(own)
        figures["skies"][program] = skies_of
        figures["solved"][program] = solved / max(stars_in(own), 1)
        figures["false"][program] = false
        figures["false_bound"][program] = fraction_interval(false, skies_of, 0.90).high
        for name, part in (("median_us", 0.5), ("p99_us", 0.99)):
            figures[name][program] = 1e6 * quantile(own, part)
    stated = [row for row in rows if row["program"] == "stated"]
    if stated:
        for kind in STATED_KINDS:
            if own := [row for row in stated if row["kind"] == kind]:
                figures["stated"][kind] = calibration(own)
        lines = (line for kind in figures["stated"].values() for line in kind)
        ratios = [line["upper_over_stated"] for line in lines if line["resolved"]]
        figures["calibrated"] = max(ratios, default=math.nan)
    return dict(figures)


def quick_detection() -> dict[str, float]:
    """CPU milliseconds of the quick search, and the fraction of stars that it finds."""
    rows = measure(STAGES["quick-detection"](), rounds=50)
    quick = next(row for row in rows if row.way == "detect_quick")
    return {"detection_fast_ms": 1e3 * quick.seconds, "detection_fast_found": 1 - quick.error}


def totals(rows: Iterable[dict[str, Any]]) -> tuple[int, int, int]:
    """Numbers of skies, of solved skies, and of false attitudes."""
    own = list(rows)
    return (
        sum(row["skies"] for row in own),
        sum(row["solved"] for row in own),
        sum(len(row["false"]) for row in own),
    )


def stars_in(rows: Iterable[dict[str, Any]]) -> int:
    """Skies that contain stars."""
    return sum(row["skies"] for row in rows if skies.KINDS[row["kind"]].sky)


def quantile(rows: Iterable[dict[str, Any]], part: float) -> float:
    """A quantile of CPU seconds over the skies, to a bin of 5 %."""
    times = Counter[int]()
    for row in rows:
        times.update({int(at): count for at, count in row["times"].items()})
    total, below = sum(times.values()), 0
    for at in sorted(times):
        below += times[at]
        if below >= part * total:
            return float(10 ** ((at + 1) / BINS))
    return math.nan


def calibration(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Fraction of frames without a star whose stated probability is below each decade, and that
    probability.

    resolved  whether the number of frames suffices to measure such a fraction
    """
    frames = sum(row["skies"] for row in rows)
    counts = Counter[int]()
    for row in rows:
        counts.update({int(decade): count for decade, count in row["stated"].items()})
    lines = []
    for decade in range(0, -DECADES, -1):
        seen = sum(count for at, count in counts.items() if at < decade)
        share = fraction_interval(seen, frames, 0.90)
        stated = 10.0**decade
        lines.append(
            {
                "stated_below": stated,
                "frames": frames,
                "seen": seen,
                "share": share.value,
                "share_bound_95": share.high,
                "upper_over_stated": share.high / stated,
                "resolved": frames * stated >= 3,
            }
        )
    return lines


def page(rows: list[dict[str, Any]], figures: dict[str, Any]) -> str:
    """The page of the benchmark."""
    return "\n".join([*_head(rows, figures), *_by_kind(rows), *_by_field(rows), *_stated(figures)])


def _head(rows: list[dict[str, Any]], figures: dict[str, Any]) -> Iterator[str]:
    yield "# How often solvers are wrong"
    yield ""
    yield (
        f"{command.source('solvers.py')}, {versions()}. Lost in space: the places and fluxes of "
        "spots, a focal length that is wrong by up to 1 %, no attitude. Fields of "
        f"{min(skies.LIMIT_G)} to {max(skies.LIMIT_G)} deg, {len(skies.KINDS)} kinds; each program "
        "has the same skies, as many as its time allowed. Solved: of the skies that hold stars. "
        "False: an attitude farther off than noise explains, with the bound that the rate keeps "
        "with 95 %. Times are CPU times of a call, of astrometry wall-clock with its start."
    )
    yield ""
    yield "| program | skies | solved | false | false, at most | median | 99 % |"
    yield "|---|---|---|---|---|---|---|"
    for program, count in figures.get("skies", {}).items():
        yield (
            f"| {program} | {count:,} | {100 * figures['solved'][program]:.2f} % | "
            f"{figures['false'][program]} | {figures['false_bound'][program]:.1e} | "
            f"{figures['median_us'][program] / 1e3:.2g} ms | "
            f"{figures['p99_us'][program] / 1e3:.2g} ms |"
        )

    yield ""
    yield (
        "A wrong field is a focal length that is 3 % further off than is told: an attitude that is "
        "found all the same may have the right stars and be some pixels off, which counts as false."
    )
    false = [
        f"{row['program']} at {row['field']} deg, {row['kind']}, sky {number}"
        for row in rows
        if row["program"] != "stated"
        for number in row["false"]
    ]
    if false:
        yield ""
        yield f"False: {'; '.join(false[:MOST_FALSE])}{'; ...' if len(false) > MOST_FALSE else ''}."


def _by_kind(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from _table(rows, "kind", list(skies.KINDS), "By kind")


def _by_field(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from _table(rows, "field", list(skies.LIMIT_G), "By field, degree")


def _table(rows: list[dict[str, Any]], name: str, values: list[Any], title: str) -> Iterator[str]:
    """Solved and false skies of each program, among the skies that startrack had, too."""
    programs = [one for one in PROGRAMS[:-1] if any(row["program"] == one for row in rows)]
    yield ""
    yield f"## {title}"
    yield "Solved, and false attitudes of how many skies."
    yield ""
    yield f"| {name} | " + " | ".join(programs) + " |"
    yield "|---" * (len(programs) + 1) + "|"
    for value in values:
        cells = []
        for program in programs:
            own = [row for row in rows if row["program"] == program and row[name] == value]
            count, solved, false = totals(own)
            share = f"{100 * solved / stars:.2f} %, " if (stars := stars_in(own)) else ""
            cells.append(f"{share}{false} of {count:,}" if count else "")
        yield f"| {value} | " + " | ".join(cells) + " |"


def _stated(figures: dict[str, Any]) -> Iterator[str]:
    if "stated" not in figures:
        return
    yield ""
    yield "## What startrack states of a false match"
    yield (
        "Frames of random points, without a star, that startrack takes for a sky when it is asked "
        "for any evidence, by the probability of a false match that it states. A probability that "
        "is a bound holds where no more are seen than stated."
    )
    yield ""
    yield "| points | stated below | frames | seen | share | at most (95 %) | resolved |"
    yield "|---|---|---|---|---|---|---|"
    for kind, lines in figures["stated"].items():
        for line in lines:
            yield (
                f"| {skies.KINDS[kind].false} | {line['stated_below']:.0e} | {line['frames']:,} | "
                f"{line['seen']} | {line['share']:.1e} | {line['share_bound_95']:.1e} | "
                f"{'yes' if line['resolved'] else 'no: too few frames'} |"
            )


if __name__ == "__main__":
    command.run(main)
