"""`startrack mission`: heads of a spacecraft over orbit and attitude law."""

from __future__ import annotations

import argparse
import math
from datetime import UTC, timedelta
from itertools import combinations
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, WrongUse, as_wrong_use, out, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack import metrics, mission, plots, report
    from startrack.cli import terminal
    from startrack.cli.simulate import draw_record
    from startrack.cli.terminal import attitude_values, finite, print_result, progress
    from startrack.core import DAY, YEAR, Floats, Refused, Rows, Streams, arcsec, deg, utc, utc_text
    from startrack.io import save_json, save_text, shipped, write_fits
    from startrack.metrics import ARCSEC, Column, DisplayUnit
    from startrack.montecarlo import cluster, export, pool
    from startrack.space import two_line_record
    from startrack.trial import observe

ROWS = 20_000  # largest number of rows of the table, without --every
STORE = "mission.sqlite"  # store in the folder of the results
OLD_ELEMENTS = 7.0  # days; a larger age of two-line elements is reported; chosen by hand


declare = Options(
    "Simulates a spacecraft along its orbit and attitude law, and prints the times when Sun, "
    "Moon and Earth blind each head, the number of valid heads, and whether the mission's "
    "requirements are met. Writes report.html, summary.json, mission.png, beta.png, tracks.png "
    "and timeline.csv. The status is 3 if a requirement is not met.",
    Option(
        "mission MISSION.toml",
        "mission file (default: the example, catalogs/missions/sun-synchronous.toml: three "
        "heads, a year); each of several missions has a folder of its name",
        Path,
        many="*",
    ),
    Option(
        "--set KEY=VALUE",
        "a value in place of the mission file's, such as 'time.duration=30 d' or 'heads.0.age=5 "
        "yr'; may be given several times",
        default=[],
        append=True,
    ),
    shared.ALLOW_CODE,
    Option(
        "--every N",
        f"steps between two rows of the timeline's table (default: for at most {ROWS} rows)",
        whole(1, 10**8),
    ),
    Option(
        "--table",
        "format of the timeline (default: csv; parquet needs pyarrow)",
        ("csv", "parquet", "netcdf"),
        "csv",
    ),
    Option(
        "--spice",
        "write orbit and attitude of the rows of the table as kernels of SPICE: "
        "orbit.bsp, attitude.bc with its clock, attitude.tsc (extra spice)",
    ),
    Option(
        "--place",
        "search for better mountings of the heads first, and compare; writes placed.toml and "
        "placement.png. With --baffle LEAST LARGEST: search for the lightest heads that meet the "
        "requirements, over directions and baffle angle together",
    ),
    Option(
        "--heads N",
        "compare these numbers of heads instead, each placed by a coarse search (default with "
        "--baffle: the mission's number)",
        whole(1, 8),
        many="+",
    ),
    Option(
        "--baffle DEG",
        "compare baffles of these Sun exclusion angles instead, with length and mass (default "
        "with --heads: the exclusion angle of the first head)",
        shared.decimal(1, 89),
        many="+",
    ),
    Option(
        "--units N",
        "also simulate N spacecraft with drawn units as heads: error that 95 %% of them do not "
        "exceed, temperatures, and gain of alignment in flight",
        whole(1, 10**6),
    ),
    Option(
        "--frames N",
        "also render all heads at N random instants (fidelity: check.fidelity): frames.csv, "
        "agreement with the mission's expectation, and the angles between heads before and after "
        "a thermal model",
        whole(1, 10**6),
    ),
    Option(
        "--frame SECOND",
        "instead of flying, render the view of each head this time after the begin: HEAD.fits, "
        "HEAD.png",
        shared.decimal(0, 1e12),
    ),
    Option(
        "--scheduler ADDRESS",
        "simulate several missions on workers of a Dask cluster that share the folder of the "
        "results (tcp://host:port)",
        shared.address,
    ),
    shared.WORKERS,
    shared.SEED,
    out("startrack-mission"),
)


def command(options: argparse.Namespace) -> int:
    """Print availability and verdicts; write report, summary, pictures and the timeline."""
    paths = options.mission or [shipped("missions/sun-synchronous.toml")]
    if len(paths) > 1:
        return _several(options, paths)
    path = paths[0]
    with as_wrong_use(ValueError, ImportError):
        loaded = mission.load_mission(path, options.set)
        _print_unknown(loaded)
        with progress("heads", len(loaded.designs)) as advance:
            plan = mission.plan_of(loaded, advance=advance)
        time = loaded.mission.time
        if options.frame is not None:
            if (second := options.frame) > time.duration:
                raise WrongUse(f"--frame must be at most {time.duration:g} s, got {second:g}")
            return _render(options, path, plan)
        if options.heads or options.baffle:
            return _trade(options, path, plan)
        with progress("trials and steps", loaded.mission.check.trials + time.steps) as advance:
            plan, checks, flown = mission.flown_from(plan, options.out / STORE, advance)
    flight = report.ReportedFlight(plan, checks, flown, mission.availability_of(flown))
    if options.place:
        return _place(options, path, flight)
    met = flight.met
    with as_wrong_use(ValueError, ImportError):
        result, text = _written(options, path, options.out, flight)
        if options.units:
            with progress("steps of units", time.steps) as advance:
                fleet = mission.fly_units(plan, options.units, options.seed, advance)
            result["units"] = _fleet_values(plan, fleet)
            met = met and result["units"]["max_error_met"] is not False
            text += "\n" + _fleet_text(plan, fleet)
        if options.frames:
            fidelity = loaded.mission.check.fidelity
            with progress("instants", options.frames) as advance:
                table = mission.frames_of(plan, options.frames, options.seed, fidelity, advance)
            export(options.out / "frames.csv", table)
            result["frames"], lines = _frames(plan, table)
            text = "\n".join([text, *lines])
        if options.units or options.frames:
            save_json(options.out / "summary.json", finite(result))
    print_result(options, result, text)
    return Exit.DONE if met else Exit.UNSOLVED


def _print_unknown(loaded: mission.Loaded) -> None:
    """Print the unknown values of each design file once."""
    designs = zip(loaded.mission.heads, loaded.designs, strict=True)
    for path, design in {head.design: design for head, design in designs}.items():
        terminal.print_unknown(design, Path(path).name)


def _several(options: argparse.Namespace, paths: list[Path]) -> int:
    """Simulate several missions, each by one worker, into folders of their names."""
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        raise WrongUse(f"several missions must have different names, got {', '.join(names)}")
    if options.place or options.heads or options.baffle or options.frame is not None:
        raise WrongUse(
            "--place, --heads, --baffle and --frame must be left out with several missions"
        )
    met = True
    with as_wrong_use(ValueError, ImportError, OSError):
        missions = [mission.load_mission(path, options.set) for path in paths]
        for loaded in missions:
            _print_unknown(loaded)
        workers = min(options.workers, len(paths))
        made = cluster(options.scheduler) if options.scheduler else pool(workers)
        with made as executor, progress("missions", len(paths)) as advance:
            running = [
                executor.submit(
                    fly_whole, options, path, (options.out / path.stem).resolve(), loaded
                )
                for path, loaded in zip(paths, missions, strict=True)
            ]
            for job in running:
                result, text, good = job.result()
                print_result(options, result, f"{result['mission']}\n{text}\n")
                met &= good
                advance(1)
    return Exit.DONE if met else Exit.UNSOLVED


def fly_whole(
    options: argparse.Namespace, path: Path, out: Path, loaded: mission.Loaded
) -> tuple[dict[str, Any], str, bool]:
    """Plan, check and simulate a mission, and write its files. Returns values, text, and whether
    all requirements are met."""
    plan, checks, flown = mission.flown_from(mission.plan_of(loaded), out / STORE)
    flight = report.ReportedFlight(plan, checks, flown, mission.availability_of(flown))
    return *_written(options, path, out, flight), flight.met


def _written(
    options: argparse.Namespace, path: Path, out: Path, flight: report.ReportedFlight
) -> tuple[dict[str, Any], str]:
    """Write the files of a simulated mission. Returns values and text."""
    steps = flight.plan.loaded.mission.time.steps
    every = options.every or -(-steps // ROWS)
    with progress("rows", -(-steps // every)) as advance:
        table = mission.timeline(flight.plan, every, advance)
    if options.table == "netcdf":
        mission.save_timeline(out / "timeline.nc", table)
    else:
        export(out / f"timeline.{options.table}", table)
    if options.spice:
        mission.write_kernels(flight.plan, every, out / "orbit.bsp", out / "attitude.bc")
    check = report.checks_table(flight).json()
    result = {"mission": str(path), **_values(flight), "check": check, "out": str(out)}
    save_json(out / "summary.json", finite(result))
    _draw(out, flight, path.stem)
    return result, "\n".join([*_text(flight), *_check_lines(flight)])


def _check_lines(flight: report.ReportedFlight) -> list[str]:
    if not flight.checks:
        return ["errors without a check by trials (--set check.trials=200)"]
    return [f"{report.CHECKED}:", *report.checks_table(flight).text()]


def _render(options: argparse.Namespace, path: Path, plan: mission.MissionPlan) -> int:
    """Write and print the view of each head at one time, with the expected error."""
    solved = True
    for number, (head, scene) in enumerate(
        zip(plan.heads, mission.scenes_at(plan, options.frame), strict=True)
    ):
        streams = Streams(options.seed, number)
        record = observe(scene.case, scene.icrs_to_camera, streams)
        outcome, attitude = record.outcome, scene.icrs_to_camera
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in head.name)
        fits, png = (options.out / f"{number + 1}-{name}.{end}" for end in ("fits", "png"))
        camera = None if scene.case.instrument.detector.scan else scene.case.instrument.camera
        middle = utc(plan.loaded.mission.time.begin).to_datetime(timezone=UTC)
        begun = middle + timedelta(seconds=options.frame - record.frame.exposure / 2)
        history = f"startrack mission {path.name}, {options.frame:g} s, head {head.name}"
        write_fits(fits, record.frame, camera, attitude, record.stars, history, begun)
        causes = [str(cause.name).lower() for cause in mission.Blind if scene.blind & cause]
        state = f"blind by {', '.join(causes)}" if causes else "valid"
        title = (
            f"{head.name} at {options.frame:g} s, {state}; {terminal.pointing_text(attitude, 3, 1)}"
        )
        draw_record(png, scene.case, record, title)
        error = math.hypot(outcome.error_x, outcome.error_y)
        good = bool(outcome.solved and not outcome.false)
        solved &= good
        result = {
            "mission": str(path),
            "second": options.frame,
            "head": head.name,
            "blind_by": causes,
            "fits": str(fits),
            "png": str(png),
            **attitude_values(attitude),
            "solved": good,
            "stars": outcome.stars,
            "error_across_arcsec": error / arcsec,
            "error_about_arcsec": outcome.error_z / arcsec,
            "expected_across_rms_arcsec": scene.across / arcsec,
            "expected_about_rms_arcsec": scene.about / arcsec,
        }
        seen = f"{outcome.stars} stars matched; error across {error / arcsec:.2f}, about "
        seen = f"{seen}{outcome.error_z / arcsec:.2f} arcsec" if good else "no attitude"
        text = f"{title}\n  {seen} (expected rms per axis {scene.across / arcsec:.2f}, "
        text += f"{scene.about / arcsec:.2f}); wrote {fits} and {png}"
        print_result(options, result, text)
    return Exit.DONE if solved else Exit.UNSOLVED


def _trade(options: argparse.Namespace, path: Path, plan: mission.MissionPlan) -> int:
    """Print numbers of heads and angles of baffles, with quality and mass."""
    counts = options.heads or [len(plan.heads)]
    angles = [angle * deg for angle in options.baffle or [plan.heads[0].limits.sun / deg]]
    how = "96 orbits of 100 instants; heads placed on a grid of 15 deg; mass by the cost laws"
    if options.place:
        if len(angles) != 2:
            raise WrongUse("--baffle must give two angles, the least and the largest, with --place")
        with as_wrong_use(ValueError), progress("numbers of heads", len(counts)) as advance:
            lightest = mission.lightest(plan, counts, (angles[0], angles[1]), advance)
        traded = [trade for trade, _ in lightest]
        best = min(lightest, key=lambda pair: (not pair[0].met, pair[0].mass))
        text = f"{path.name}, the lightest heads and baffles of the search"
        mission.save_mission(options.out / "placed.toml", best[1].mission, text)
        how = "96 orbits of 100 instants; directions and baffles together; mass by the cost laws"
    else:
        with progress("searches", len(counts) * len(angles)) as advance:
            traded = mission.trades(plan, counts, angles, advance)
    table = metrics.Table(
        [
            Column("heads", "heads", lambda row: row.heads, form="d"),
            Column(
                "baffle_deg", "baffle", lambda row: row.angle, DisplayUnit("deg", deg, deg), ".1f"
            ),
            Column(
                "baffle_length_m",
                "length",
                lambda row: row.length,
                DisplayUnit("mm", 1e-3, 1),
                ".0f",
            ),
            Column("mass_kg", "mass", lambda row: row.mass, DisplayUnit("kg", 1, 1), ".2f"),
            Column("longest_s", "longest", lambda row: row.quality.longest, metrics.SECOND, ".0f"),
            Column("one", "one", lambda row: row.quality.one, metrics.PERCENT),
            Column("two", "two", lambda row: row.quality.two, metrics.PERCENT),
            Column("error_arcsec", "error", lambda row: row.quality.error, ARCSEC, ".2f"),
            Column("met", "", lambda row: row.met),
            Column("", "requirements", lambda row: "met" if row.met else "NOT MET"),
        ],
        traded,
    )
    result = {"mission": str(path), "trades": table.json(), "out": str(options.out)}
    save_json(options.out / "trades.json", finite(result))
    print_result(options, result, *table.text(()), how)
    return Exit.DONE if any(trade.met for trade in traded) else Exit.UNSOLVED


def _place(options: argparse.Namespace, path: Path, before: report.ReportedFlight) -> int:
    """Search for mountings, and print the mission with the file's mountings and with the best
    mountings."""
    plan = before.plan
    with progress("mountings", 5000) as advance:
        placement = mission.place(plan, advance)
        better = mission.moved_plan(plan, placement.mission)
        mapped = mission.map_of(better, 0)
    with progress("steps", plan.loaded.mission.time.steps) as advance:
        flown = mission.fly(better, advance)
    after = report.ReportedFlight(better, before.checks, flown, mission.availability_of(flown))
    old, new = (
        [mission.angles_of(head.boresight) for head in placed.heads] for placed in (plan, better)
    )
    mountings: list[dict[str, Any]] = [
        {"name": head.name, "azimuth_deg": azimuth / deg, "elevation_deg": elevation / deg}
        for head, (azimuth, elevation) in zip(plan.heads, new, strict=True)
    ]
    result: dict[str, Any] = {
        "mission": str(path),
        "evaluations": placement.evaluations,
        "ending": placement.ending,
        "mountings": mountings,
        "before": _values(before),
        "after": _values(after),
        "check": report.checks_table(before).json(),
        "out": str(options.out),
    }
    mission.save_mission(
        options.out / "placed.toml", placement.mission, f"{path.name}, new mountings of heads"
    )
    picture, title = options.out / "placement.png", f"directions of {plan.heads[0].name}"
    clear = plan.loaded.mission.keep_out
    plots.draw_placement(picture, mapped, old, new, clear, f"{path.stem}: {title}")
    save_json(options.out / "summary.json", finite(result))
    _draw(options.out, after, f"{path.stem}, placed", picture)
    lines = [f"{placement.evaluations} mountings, {placement.ending}"]
    lines += [
        "{name}: azimuth {azimuth_deg:.1f}, elevation {elevation_deg:.1f} deg".format(**mounting)
        for mounting in mountings
    ]
    text = ["before", *_text(before), "", *lines, "", "after", *_text(after), *_check_lines(after)]
    print_result(options, result, *text)
    return Exit.DONE if after.met else Exit.UNSOLVED


def _draw(out: Path, flight: report.ReportedFlight, title: str, placed: Path | None = None) -> None:
    """Write mission.png, beta.png, tracks.png, and report.html with them and a placement."""
    plan, _, flown, available = flight
    overview, beta = out / "mission.png", out / "beta.png"
    plots.draw_mission(overview, plan, flown, available, title)
    plots.draw_beta(beta, plan, flown, title)
    tracks = out / "tracks.png"
    plots.draw_tracks(tracks, plan, title)
    pictures = [
        ("Heads, Sun and Moon on the sky", tracks),
        ("Blind time, valid heads and error over the mission", overview),
        ("Availability and error over the beta angle and the orbit", beta),
    ]
    if placed:
        pictures.append(("Blind time over the directions of a head, and its mountings", placed))
    save_text(out / "report.html", report.write_mission_report(flight, pictures, title))


def _values(flight: report.ReportedFlight) -> dict[str, Any]:
    plan, _, flown, available = flight
    time, none = plan.loaded.mission.time, available.none
    return {
        "begin_utc": time.begin,
        "duration_s": time.duration,
        "step_s": time.step,
        "steps": time.steps,
        "eclipse": float(flown.eclipse.mean()),
        "availability": {
            "exactly": available.known.tolist(),
            "valid": available.heads.tolist(),
            "at_least": [available.at_least(k) for k in range(len(available.heads))],
        },
        "no_valid_head": {
            "longest_s": none.longest,
            "times": len(none.length),
            "histogram_edges_s": list(mission.EDGES[:-1]),
            "histogram": none.histogram().tolist(),
            "worst": report.outages_table(none, time.begin).json(),
        },
        "heads": [_head_values(flight, h) for h in range(len(plan.heads))],
        "requirements": report.verdict_table(flight.verdicts).json(),
        "by_beta": report.beta_table(flown).json(),
        "left_out": _left_out(plan),
        "radiation": _radiation(plan),
        "fused_rms_arcsec": (flown.rms / arcsec).tolist(),
        "worst_moments": [
            {"second": second, "utc": utc_text(time.begin, second), "error_arcsec": error / arcsec}
            for second, error in flown.worst
        ],
    }


def _head_values(flight: report.ReportedFlight, h: int) -> dict[str, Any]:
    plan, _, flown, available = flight
    head, total, blind = plan.heads[h], flown.head_sum[h], available.each[h]
    across, about = flown.head_rms[h]
    again = mission.reacquisition_of(plan.loaded.designs[h].case, flown.chances[h])
    bodies = ("sun", "moon", "earth", "ground")
    return {
        "name": head.name,
        "boresight_in_body": np.asarray(head.boresight, float).tolist(),
        "exclusion_deg": {name: getattr(head.limits, name) / deg for name in bodies},
        "valid": float(available.alone[h]),
        "blind_by": {
            str(cause.name).lower(): float(available.causes[cause][h]) for cause in mission.Blind
        },
        "across_rms_arcsec": float(across / arcsec),
        "about_rms_arcsec": float(about / arcsec),
        "platform_motion_rms_arcsec": (np.sqrt(head.moved) / arcsec).tolist(),
        "solved": float(total[3] / total[0]) if total[0] else None,
        "longest_blind_s": blind.longest,
        "times_blind": len(blind.length),
        "blind_histogram": blind.histogram().tolist(),
        "reacquisition_s": {"times": again.times, "mean": again.mean, "p99": again.level},
        "closest_deg": dict(
            zip(("sun", "moon", "limb"), (flown.closest[h] / deg).tolist(), strict=True)
        ),
        "planets_in_field_s": dict(zip(mission.PLANETS, map(float, flown.planets[h]), strict=True)),
        "largest_rate_deg_s": dict(
            zip(("across", "about"), (flown.rate[h] / deg).tolist(), strict=True)
        ),
    }


def _which(plan: mission.MissionPlan) -> str:
    """Units and ages of the heads' errors."""
    heads, time = plan.loaded.mission.heads, plan.loaded.mission.time
    drawn = sum(head.unit is not None for head in heads)
    units = "perfect units" if not drawn else f"{drawn} drawn units" * (drawn == len(heads))
    years = sorted(
        {(head.age, head.age + time.duration) for head in plan.heads if head.age is not None}
    )
    ages = ", ".join(f"{a / YEAR:.2g} to {b / YEAR:.2g} years old" for a, b in years)
    return f"{units or 'perfect and drawn units'}{', ' if ages else ''}{ages}"


def _frames(plan: mission.MissionPlan, table: Rows) -> tuple[dict[str, Any], list[str]]:
    """Agreement of rendered heads with the mission, and angles between heads: values and lines."""
    heads, lines, values = range(len(plan.heads)), list[str](), dict[str, Any]()
    values["heads"] = []
    for h in heads:
        frames = mission.agreement(table, h)
        values["heads"].append(
            {
                "name": plan.heads[h].name,
                "tried": frames.tried,
                "right": frames.right,
                "expected": frames.expected,
                "deviations": frames.deviations,
                "across_ratio": list(frames.across),
                "about_ratio": list(frames.about),
            }
        )
        across, about = (
            f"{value:.3f} +- {sigma:.3f}" for value, sigma in (frames.across, frames.about)
        )
        lines.append(
            f"  {plan.heads[h].name}: {frames.right} of {frames.tried} frames have a right "
            f"attitude, {frames.expected:.1f} expected ({frames.deviations:+.1f} sigma); error "
            f"over the expected one across {across}, about {about}"
        )
    values["between"] = []
    for first, second in combinations(heads, 2):
        names = [plan.heads[h].name for h in (first, second)]
        try:
            angle = mission.between(plan, table, first, second)
        except Refused as reason:  # heads that are seldom valid together
            lines.append(f"  angle from {names[0]} to {names[1]}: not judged, {reason}")
            continue
        values["between"].append(
            {
                "heads": names,
                "frames": angle.frames,
                "before_arcsec": angle.before / arcsec,
                "after_arcsec": angle.after / arcsec,
            }
        )
        lines.append(
            f"  angle from {names[0]} to {names[1]}: {angle.before / arcsec:.2f} arcsec rms, "
            f"{angle.after / arcsec:.2f} after a thermal model ({angle.frames} frames of both)"
        )
    return values, ["rendered heads, at random instants:", *lines]


def _fleet_values(plan: mission.MissionPlan, fleet: mission.Fleet) -> dict[str, Any]:
    heat, high = fleet.heat, np.quantile(fleet.heads, 0.95, axis=0) / arcsec

    def ends(kelvin: Floats) -> list[float] | None:
        return [float(kelvin.min()), float(kelvin.max())]

    return {
        "spacecraft": len(fleet.rms),
        "level_95_arcsec": metrics.bounds_json(fleet.level(), ARCSEC),
        "level_95_aligned_arcsec": metrics.bounds_json(fleet.level(aligned=True), ARCSEC),
        "max_error_met": _meets_error(plan, fleet),
        "rms_arcsec": (fleet.rms / arcsec).tolist(),
        "heads": [
            {
                "name": head.name,
                "across_level_95_arcsec": float(high[h, 0]),
                "about_level_95_arcsec": float(high[h, 1]),
                "swing_rms_arcsec": (fleet.swing[h] / arcsec).tolist(),
                "kelvin": ends(heat.heads[h]) if heat else None,
            }
            for h, head in enumerate(plan.heads)
        ],
        "platform_kelvin": ends(heat.platform) if heat else None,
    }


def _meets_error(plan: mission.MissionPlan, fleet: mission.Fleet) -> bool | None:
    """Whether 95 % of the spacecraft keep `max_error`; None without this requirement."""
    limit = plan.loaded.mission.requirements.max_error
    return None if limit is None else bool(fleet.level().value <= limit)


def _fleet_text(plan: mission.MissionPlan, fleet: mission.Fleet) -> str:
    lines = [
        f"{len(fleet.rms)} spacecraft of drawn units: 95 % keep "
        f"{metrics.bracketed(fleet.level(), '.2f', arcsec)} arcsec rms about the worst axis, "
        f"{metrics.bracketed(fleet.level(aligned=True), '.2f', arcsec)} with heads aligned to each "
        "other in flight"
    ]
    if (limit := plan.loaded.mission.requirements.max_error) is not None:
        verdict = "met" if _meets_error(plan, fleet) else "NOT MET"
        lines.append(
            f"  max_error of {limit / arcsec:g} arcsec by 95 % of the spacecraft: {verdict}"
        )
    for h, head in enumerate(plan.heads):
        x, y, z = fleet.swing[h] / arcsec
        across, about = np.quantile(fleet.heads[:, h], 0.95, axis=0) / arcsec
        lines.append(
            f"  {head.name}: 95 % keep {across:.2f} across, {about:.2f} about; thermo-elastic "
            f"{x:.2f}, {y:.2f}, {z:.2f} rms about x, y, z"
        )
    if heat := fleet.heat:
        parts = {"platform": heat.platform, "heads": heat.heads}
        lines += [
            f"  {name}: {kelvin.min() - 273.15:.1f} to {kelvin.max() - 273.15:.1f} degC"
            for name, kelvin in parts.items()
        ]
    return "\n".join(lines)


def _radiation(plan: mission.MissionPlan) -> list[dict[str, Any]]:
    """Dose and displaced atoms in the mission's orbit, for each shield of a detector that ages."""
    if plan.loaded.mission.radiation.ageing != "orbit":
        return []
    ages = (design.case.instrument.detector.age for design in plan.loaded.designs)
    doses = {age.shielding: (age.ionising, age.protons) for age in ages if age and age.shielding}
    return [
        {
            "shielding_mm": 1e3 * shielding,
            "krad_per_year": dose * YEAR / 10,  # of 10 gray
            "protons_10_mev_per_cm2_year": protons * YEAR / 1e4,
        }
        for shielding, (dose, protons) in sorted(doses.items())
    ]


def _left_out(plan: mission.MissionPlan) -> list[str]:
    """Effects of the mission that availability and errors leave out."""
    text = (
        "hits of protons and electrons (radiation.hits), in the availability and the errors; "
        "rendered frames have them (--frames)"
    )
    own = plan.loaded.mission
    old = _days_of_elements(own)
    elements = (
        f"age of two-line elements: the mission is up to {old:.0f} days from their epoch; errors "
        "of SGP4 grow by some kilometres a day"
    )
    return [text] * (own.radiation.hits is not None) + [elements] * (old > OLD_ELEMENTS)


def _days_of_elements(own: mission.Mission) -> float:
    """Largest time in days between the epoch of two-line elements and the mission; 0 without
    them."""
    if not own.orbit.tle:
        return 0.0
    record = two_line_record(own.orbit.tle)
    begin = utc(own.time.begin).utc
    days = begin.jd1 - record.jdsatepoch + begin.jd2 - record.jdsatepochF
    return max(abs(days), abs(days + own.time.duration / DAY))


def _platform_lines(plan: mission.MissionPlan) -> list[str]:
    """Motion of the platform within the errors; empty if no design has any."""
    moved = [
        f"{math.sqrt((x + y) / 2) / arcsec:.2f} across and {math.sqrt(z) / arcsec:.2f} about "
        f"({head.name})"
        for head in plan.heads
        for x, y, z in [head.moved]
        if x or y or z
    ]
    if not moved:
        return []
    said = f"part by motion of the platform in an exposure, arcsec rms: {', '.join(moved)}"
    still = [head.name for head in plan.heads if not head.moved.any()]
    if not still:
        return [f"{said}; it is common to all heads, and fusion does not reduce it"]
    return [
        said,
        f"the design of {', '.join(still)} has no such motion (or tracker.reference is 'mean'), "
        "so that the head counts as at rest; as one platform moves all heads, "
        "[instrument.motion] of all designs should have this motion",
    ]


def _answer(flight: report.ReportedFlight) -> str:
    """Availability, error of the fused attitude, and the requirements that are not met."""
    some = 100 * flight.available.at_least(1)
    answer = f"at least 1 head valid {some:.4f} % of the time"
    if flight.flown.known.any():
        answer += f"; fused attitude {flight.flown.rms.max() / arcsec:.2f} arcsec rms "
        answer += "about the worst axis"
    if verdicts := flight.verdicts:
        failed = [verdict.name for verdict in verdicts if not verdict.met]
        answer += f"; {len(verdicts) - len(failed)} of {len(verdicts)} requirements met"
        answer += f", not {' and '.join(failed)}" if failed else ""
    return answer


def _text(flight: report.ReportedFlight) -> list[str]:
    plan, _, flown, available = flight
    time = plan.loaded.mission.time
    lines = [
        _answer(flight),
        f"{time.steps} steps of {time.step:g} s from {time.begin} UTC, "
        f"{report.number_of_heads(len(plan.heads))}, "
        f"{100 * flown.eclipse.mean():.1f} % in eclipse",
        "blind, % of the time; rms error while valid:",
        *report.heads_table(flight).text(),
    ]
    for count in range(len(plan.heads), 0, -1):
        words = f"at least {report.number_of_heads(count)}"
        lines.append(f"{words:24s}{100 * available.at_least(count):10.4f} % of the time")
    none = available.none
    lines.append(
        f"without a valid head: {len(none.length)} times, at most {none.longest:g} s"
        + (f", from {utc_text(time.begin, none.worst(1)[0][0])} UTC" if len(none.length) else "")
    )
    again = [
        mission.reacquisition_of(design.case, chances)
        for design, chances in zip(plan.loaded.designs, flown.chances, strict=True)
    ]
    if times := sum(one.times for one in again):
        level = max(one.level for one in again if one.times)
        lines.append(
            f"reacquired after a blinding: {times} times, 99 % within "
            f"{level:.3g} s (frames and read-out, without computing time)"
        )
    if flown.known.any():
        x, y, z = flown.rms / arcsec
        lines.append(
            f"fused attitude: {x:.2f}, {y:.2f}, {z:.2f} arcsec rms about x, y, z; by the error "
            f"budget of {_which(plan)}, with the alignments of the mission file"
        )
    else:
        lines.append("fused attitude: none, because no head is ever valid")
    lines += _platform_lines(plan)
    if flown.worst:
        second, error = flown.worst[0]
        lines.append(
            f"largest error about an axis {error / arcsec:.1f} arcsec rms, at "
            f"{utc_text(time.begin, second)} UTC"
        )
    lines += [
        f"behind {row['shielding_mm']:g} mm of aluminium: {row['krad_per_year']:.3g} krad a year, "
        f"and displacement damage of {row['protons_10_mev_per_cm2_year']:.2g} protons of 10 MeV a "
        "square centimetre"
        for row in _radiation(plan)
    ]
    lines += [f"left out: {reason}" for reason in _left_out(plan)]
    if met := flight.verdicts:
        lines += report.verdict_table(met).text((0, 3))
    return lines
