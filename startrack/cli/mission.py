"""`startrack mission`: heads of a spacecraft over orbit and attitude law."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from startrack.cli.imports import deferred
from startrack.cli.options import Exit, add_out, as_wrong_use, describe, whole

with deferred():
    import numpy as np

    from startrack.cli.terminal import finite, print_result, progress
    from startrack.core import arcsec, deg
    from startrack.io import save_json, shipped
    from startrack.mission import (
        EDGES,
        PLANETS,
        Availability,
        Blind,
        Flown,
        Plan,
        Verdict,
        angles_of,
        availability_of,
        fly,
        load_mission,
        map_of,
        moved_plan,
        place,
        plan_of,
        save_mission,
        timeline,
        verdicts,
    )
    from startrack.montecarlo import export
    from startrack.plots import draw_mission, draw_placement

ROWS = 20_000  # of the table, where --every is not given
WORST = 10  # longest times without a valid head that are listed


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack mission`."""
    describe(
        parser,
        "Moves a spacecraft along its orbit and attitude law, and prints when Sun, Moon and Earth "
        "blind each of its heads, how many heads are valid, and whether the mission's requirements "
        "are met. Writes summary.json, mission.png and timeline.csv. The status is 3 if a "
        "requirement is not met.",
    )
    parser.add_argument(
        "mission", type=Path, nargs="?", metavar="MISSION.toml",
        help="mission file (default: the example, catalogs/missions/sun-synchronous.toml: three "
        "heads, a year)",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE",
        help="a value over that of the mission file, such as 'time.duration=30 d'; may be given "
        "several times",
    )  # fmt: skip
    parser.add_argument(
        "--every", type=whole(1, 10**8), metavar="N",
        help="steps between two rows of the table of the timeline (default: so that it has at "
        f"most {ROWS} rows)",
    )  # fmt: skip
    parser.add_argument(
        "--table", default="csv", choices=("csv", "parquet"),
        help="format of the timeline (default: csv; parquet needs pyarrow)",
    )  # fmt: skip
    parser.add_argument(
        "--place", action="store_true",
        help="search for better mountings of the heads first, and compare; writes placed.toml and "
        "placement.png",
    )  # fmt: skip
    add_out(parser, "startrack-mission")


def command(options: argparse.Namespace) -> int:
    """Print availability and verdicts; write summary.json, mission.png and the timeline."""
    path = options.mission or shipped("missions/sun-synchronous.toml")
    with as_wrong_use(ValueError, ImportError):
        loaded = load_mission(path, options.set)
        with progress("heads", len(loaded.designs)) as advance:
            plan = plan_of(loaded, advance=advance)
        steps = loaded.mission.time.steps
        every = options.every or -(-steps // ROWS)
        rows = 0 if options.place else -(-steps // every)
        with progress("steps", steps + rows) as advance:
            flown = fly(plan, advance)
            table = timeline(plan, every, advance) if rows else None
    found = availability_of(flown)
    if options.place:
        return _place(options, path, plan, flown)
    result = {"mission": str(path), **_values(plan, flown, found), "out": str(options.out)}
    assert table is not None
    export(options.out / f"timeline.{options.table}", table)
    draw_mission(options.out / "mission.png", plan, flown, found, f"{Path(path).stem}")
    save_json(options.out / "summary.json", finite(result))
    print_result(options, result, _text(plan, flown, found))
    met = all(one.met for one in _verdicts(plan, flown, found))
    return Exit.DONE if met else Exit.UNSOLVED


def _place(options: argparse.Namespace, path: Path, plan: Plan, before: Flown) -> int:
    """Search for mountings, and print the whole mission with the file's and with the best."""
    with progress("mountings", 5000) as advance:
        placement = place(plan, advance)
        mapped = map_of(plan, 0)
    better = moved_plan(plan, placement.mission)
    with progress("steps", plan.loaded.mission.time.steps) as advance:
        after = fly(better, advance)
    pairs = {"before": (plan, before), "after": (better, after)}
    found = {name: availability_of(flown) for name, (_, flown) in pairs.items()}
    heads = [one.name for one in plan.heads]
    angles = {
        name: [angles_of(head.boresight) for head in one.heads] for name, (one, _) in pairs.items()
    }
    result: dict[str, Any] = {
        "mission": str(path),
        "evaluations": placement.evaluations,
        "ending": placement.ending,
        "mountings": [
            {"name": name, "azimuth_deg": azimuth / deg, "elevation_deg": elevation / deg}
            for name, (azimuth, elevation) in zip(heads, angles["after"], strict=True)
        ],
        **{name: _values(one, flown, found[name]) for name, (one, flown) in pairs.items()},
        "out": str(options.out),
    }
    save_mission(options.out / "placed.toml", placement.mission, f"{path.name}, heads placed anew")
    draw_placement(
        options.out / "placement.png", mapped, angles["before"], angles["after"],
        plan.loaded.mission.keep_out, f"{path.stem}: directions of {heads[0]}",
    )  # fmt: skip
    draw_mission(options.out / "mission.png", better, after, found["after"], f"{path.stem}, placed")
    save_json(options.out / "summary.json", finite(result))
    lines = [f"{placement.evaluations} mountings, {placement.ending}"]
    for name, (azimuth, elevation) in zip(heads, angles["after"], strict=True):
        lines.append(f"{name}: azimuth {azimuth / deg:.1f}, elevation {elevation / deg:.1f} deg")
    text = "\n".join(
        ["before", _text(plan, before, found["before"]), "", *lines, "", "after",
         _text(better, after, found["after"])]
    )  # fmt: skip
    print_result(options, result, text)
    met = all(one.met for one in _verdicts(better, after, found["after"]))
    return Exit.DONE if met else Exit.UNSOLVED


def _verdicts(plan: Plan, flown: Flown, found: Availability) -> list[Verdict]:
    return verdicts(plan.loaded.mission.requirements, found, float(flown.rms.max()))


def _values(plan: Plan, flown: Flown, found: Availability) -> dict[str, Any]:
    time = plan.loaded.mission.time
    return {
        "begin_utc": time.begin,
        "duration_s": time.duration,
        "step_s": time.step,
        "steps": time.steps,
        "eclipse": float(flown.eclipse.mean()),
        "availability": {
            "exactly": [float(one) for one in found.known],
            "valid": [float(one) for one in found.heads],
            "at_least": [found.at_least(k) for k in range(len(found.heads))],
        },
        "no_valid_head": {
            "longest_s": found.none.longest,
            "times": len(found.none.length),
            "histogram_edges_s": list(EDGES[:-1]),
            "histogram": [int(one) for one in found.none.histogram()],
            "worst": [
                {"begin_s": begin, "length_s": length} for begin, length in found.none.worst(WORST)
            ],
        },
        "heads": [_head_values(plan, flown, found, h) for h in range(len(plan.heads))],
        "requirements": [
            {"name": one.name, "limit": one.limit, "value": one.value, "met": one.met}
            for one in _verdicts(plan, flown, found)
        ],
        "fused_rms_arcsec": [float(one / arcsec) for one in flown.rms],
        "worst_moments": [
            {"second": second, "error_arcsec": error / arcsec} for second, error in flown.worst
        ],
    }


def _head_values(plan: Plan, flown: Flown, found: Availability, h: int) -> dict[str, Any]:
    head, total = plan.heads[h], flown.head_sum[h]
    across, about = np.sqrt(total[1:3] / max(total[0], 1))
    return {
        "name": head.name,
        "boresight_in_body": [float(one) for one in head.boresight],
        "exclusion_deg": {
            name: getattr(head.limits, name) / deg for name in ("sun", "moon", "earth", "ground")
        },
        "valid": float(found.alone[h]),
        "blind_by": {str(cause.name).lower(): float(found.causes[cause][h]) for cause in Blind},
        "across_rms_arcsec": float(across / arcsec),
        "about_rms_arcsec": float(about / arcsec),
        "solved": float(total[3] / max(total[0], 1)),
        "longest_blind_s": found.each[h].longest,
        "times_blind": len(found.each[h].length),
        "closest_deg": {
            name: float(flown.closest[h, k] / deg) for k, name in enumerate(("sun", "moon", "limb"))
        },
        "planets_in_field_s": dict(zip(PLANETS, map(float, flown.planets[h]), strict=True)),
        "largest_rate_deg_s": {
            "across": float(flown.rate[h, 0] / deg), "about": float(flown.rate[h, 1] / deg)
        },
    }  # fmt: skip


def _text(plan: Plan, flown: Flown, found: Availability) -> str:
    time = plan.loaded.mission.time
    lines = [
        f"{time.steps} steps of {time.step:g} s from {time.begin} UTC, {len(plan.heads)} heads, "
        f"{100 * flown.eclipse.mean():.1f} % in eclipse",
        f"{'blind (% of the time)':24s}{'Sun':>8s}{'Moon':>8s}{'Earth':>8s}{'ground':>8s}"
        f"{'SAA':>8s}{'any':>8s}{'longest (min)':>15s}{'error across, about (arcsec)':>30s}",
    ]
    for h, head in enumerate(plan.heads):
        values = np.sqrt(flown.head_sum[h, 1:3] / max(flown.head_sum[h, 0], 1)) / arcsec
        parts = "".join(f"{100 * found.causes[cause][h]:8.2f}" for cause in Blind)
        lines.append(
            f"{head.name[:23]:24s}{parts}{100 * (1 - found.alone[h]):8.2f}"
            f"{found.each[h].longest / 60:15.1f}{values[0]:20.2f}{values[1]:10.2f}"
        )
    for count in range(len(plan.heads), 0, -1):
        words = f"at least {count} head{'s' if count > 1 else ''}"
        lines.append(f"{words:24s}{100 * found.at_least(count):10.4f} % of the time")
    none = found.none
    lines.append(
        f"without a valid head: {len(none.length)} times, the longest {none.longest:g} s"
        + (f", {none.worst(1)[0][0] / 86400:.2f} d after the begin" if len(none.length) else "")
    )
    x, y, z = flown.rms / arcsec
    lines.append(
        f"fused attitude: {x:.2f}, {y:.2f}, {z:.2f} arcsec rms about x, y, z; by the error budget "
        "of perfect units, with the alignments of the mission file"
    )
    if flown.worst:
        second, error = flown.worst[0]
        lines.append(
            f"largest error about an axis {error / arcsec:.1f} arcsec rms, {second / 86400:.2f} d "
            "after the begin"
        )
    for one in _verdicts(plan, flown, found):
        size, unit = (arcsec, "arcsec") if one.name == "max_error" else (1.0, "")
        size, unit = (1.0, "s") if one.name == "max_blind" else (size, unit)
        lines.append(
            f"{one.name}: {one.value / size:.6g} {unit}".rstrip()
            + f", required {one.limit / size:.6g} {unit}".rstrip()
            + f": {'met' if one.met else 'NOT MET'}"
        )
    return "\n".join(lines)
