"""Every command of `startrack` on a small example, on a given day and without a network.

    python -W error tests/cli/every_command.py quick|all FOLDER YEAR ...

The clock starts in the middle of each year; all files go to a folder of its name. The status is 1
where a command fails, warns or tries to reach the network. A year has a process of its own, since
astropy looks for new leap seconds once in a process; several years have copies of one that has
loaded the commands of a quick run.
"""

import datetime
import gc
import ipaddress
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import time_machine

from startrack.cli.main import main
from startrack.io import shipped

# Audited events that can leave the machine, and which of their arguments is the address.
EVENTS = {
    "socket.connect": 1,
    "socket.sendto": 1,
    "socket.getaddrinfo": 0,
    "socket.gethostbyname": 0,
}
# A date beyond the Earth orientation and the leap seconds that are installed.
DATED = """
[scene]
lights = ["planets", "sun", "moon", "zodiacal"]
date = "2044-06-21T10:00:00"
"""
COMMANDS = """
simulate dated.toml --out dated
simulate design.toml --ra 83 --dec -5 --pixels ser --out frame
psf design.toml --out psf
lens show petzval
detect frame/frame.fits --overlay detect
solve frame/frame.fits --fov 9.5 --overlay solve
calibrate frame/frame.fits --fov 9.5 --distortion none --out calibration.json
requirements design.toml
requirements hsrs
keys scene
init begun.toml
verify design.toml --trials 4 --first 2 --out verify --workers 1
budget dated.toml --out budget --workers 1
predict design.toml --set scene.background_g={low=21,high=22} --draws 8 --out sure --workers 1
montecarlo dated.toml --trials 4 --out dated --workers 1
montecarlo design.toml --trials 16 --out frames --control --workers 1
montecarlo design.toml --trials 32 --out covariance --fidelity covariance --workers 1
combine frames/campaign.sqlite covariance/campaign.sqlite
merge frames/campaign.sqlite --out merged.sqlite
compare frames/campaign.sqlite covariance/campaign.sqlite
report frames/campaign.sqlite --stars 1 --slews 1 --budget 2 --fidelity-trials 2 --worst 1
sequence design.toml --sequences 1 --out sequence --workers 1
export aocs design.toml --out export
export catalogue design.toml --limit 4 --out guide
mission --set time.duration=1d --set time.begin="2044-06-21T10:00:00" --out mission
sweep design.toml instrument.optics.f_number=1.4,1.6 --out swept --workers 1
solve-for design.toml instrument.optics.f_number=1..2 --until mass=0.4kg --points 3 --out solved
optimize design.toml --out optimize --workers 1
sample design.toml --out sample --workers 1
pareto design.toml --points 2 --out pareto --workers 1
what-matters design.toml --designs 2 --out matters --workers 1
compare-flight trackers/chandra-aca.toml windows.npz --devices 2 --out flown
earth geometry mountains.toml --out geometry
earth render hsrs.toml --calibration 8 --geotiff --out render
earth process hsrs.toml --raw render --out render
earth aim hsrs.toml --at 47 10
earth terrain dem.tif
warm --json
bench psf --out bench
"""  # those that read what others write come after them
# Those of a quick run: of scenes with dates; `earth process` computes with no others than `render`.
DATED_COMMANDS = "simulate dated.toml", "montecarlo dated.toml", "earth geometry", "earth render"


class NetworkUse(BaseException):
    """Not an Exception, so that no library catches it as an unreachable server."""


def cut_the_network(attempts: list[str]) -> None:
    """From here on, record and refuse each connection to another machine."""

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event not in EVENTS:
            return
        address = arguments[EVENTS[event]]
        if isinstance(address, tuple):
            address = address[0]
        elif event in ("socket.connect", "socket.sendto"):
            return  # a socket of this machine's file system
        if not is_loopback(address):
            attempts.append(f"{event} {address}")
            raise NetworkUse(attempts[-1])

    sys.addaudithook(refuse)


def is_loopback(host: str | bytes | None) -> bool:
    name = host.decode() if isinstance(host, bytes) else host
    if not name or name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def changed(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


def write_windows(path: Path) -> None:
    """Forty images of a star that does not move."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:8, :8] - 3.5
    light = 2000 * np.exp(-(x**2 + y**2) / 3) + 20.0
    place = np.full(40, 100)
    np.savez(
        path,
        s1_time=2.05 * np.arange(40),
        s1_number=rng.poisson(light, (40, 8, 8)),
        s1_col0=place,
        s1_row0=place,
        s1_magnitude=9.0,
    )


def write_designs(folder: Path) -> None:
    write_windows(folder / "windows.npz")
    """A design with two variables and few trials, and one with a dated scene."""
    design = changed(
        shipped("designs/noise_only.toml").read_text(),
        ("columns = 512", "columns = 256"),
        ("rows = 512", "rows = 256"),
        ('pixel_pitch = "11 um"', 'pixel_pitch = "22 um"'),
        ('blur = "5 um"', 'blur = "10 um"'),
        ("\ntrials = 50\nmost_trials = 200", "\ntrials = 4\nmost_trials = 4\nsample_trials = 4"),
        ("evaluations = 120", "evaluations = 3\nanalytic_evaluations = 2"),
        ("fresh_trials = 1000", "fresh_trials = 20"),
    )
    dated = changed(
        design,
        ("\n[scene]\nbackground_g = 22.0\n", DATED),
        ("epoch = 2026.0", "epoch = 2044.5\naberration = true\nparallax = true"),
    )
    (folder / "dated.toml").write_text(dated)
    variables = design.split("[[campaign.variables]]")
    (folder / "design.toml").write_text("[[campaign.variables]]".join(variables[:3]))


def write_scenes(folder: Path) -> None:
    """Two scenes over small terrain, one of them with a single channel, and a file of heights."""
    import rasterio

    mountains = changed(
        shipped("scenes/mountains.toml").read_text(),
        ("sky_rays = 16", "sky_rays = 0"),
        ("= 480", "= 24"),
        ('"20 um"', '"400 um"'),
        ("cells = 768", "cells = 300"),
    )
    camera = shipped("cameras/hsrs.toml").read_text()
    fires = changed(
        shipped("scenes/hsrs.toml").read_text(),
        ('camera = "hsrs"', 'camera = "mir.toml"'),
        ("lines = 300", "lines = 16"),
        ("columns = 300", "columns = 16"),
        ("cells = 1024", "cells = 300"),
    )
    (folder / "mountains.toml").write_text(mountains)
    (folder / "hsrs.toml").write_text(fires)
    (folder / "mir.toml").write_text(camera[: camera.rindex("[[channels]]")])
    with rasterio.open(
        folder / "dem.tif",
        "w",
        driver="GTiff",
        width=9,
        height=9,
        count=1,
        dtype="float32",
        crs="EPSG:4326",
        transform=rasterio.Affine(1e-3, 0, 10, 0, -1e-3, 47),
    ) as file:
        file.write(np.ones((9, 9), np.float32), 1)


def succeeds(line: str) -> bool:
    """Whether the exit status is 0 or 3; with few trials some requirements may stay unsolved."""
    try:
        return main(line.split()) in (0, 3)
    except (Exception, SystemExit, NetworkUse):
        traceback.print_exc()
        return False


def run(quick: bool, year: int, folder: Path) -> int:
    """All commands, or those with dates; the exit status."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    write_designs(folder)
    write_scenes(folder)
    attempts: list[str] = []
    cut_the_network(attempts)
    with time_machine.travel(datetime.datetime(year, 7, 1, tzinfo=datetime.UTC)):
        lines = COMMANDS.strip().splitlines()
        if quick:
            lines = [line for line in lines if line.startswith(DATED_COMMANDS)]
        failed = [line for line in lines if not succeeds(line)]
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    for attempt in attempts:
        print(f"network: {attempt}", file=sys.stderr)
    return int(bool(failed or attempts))


def run_years(quick: bool, folder: Path, years: Sequence[str]) -> int:
    """As `run`, each year in a process of its own."""
    if len(years) == 1:
        return run(quick, int(years[0]), folder / years[0])
    commands = (f"startrack.cli.{words.split()[0]}" for words in DATED_COMMANDS)
    for name in ("astropy.coordinates", "rasterio", "scipy.signal", "scipy.stats", *commands):
        import_module(name)
    for name in ("draw_geometry", "draw_picture"):  # pictures of stars are drawn
        setattr(sys.modules["startrack.cli.earth"], name, lambda *_, **__: None)
    gc.freeze()  # what is imported stays: searching it, also at each end, takes seconds
    status = 0
    for year in years:  # one after the other: the second finds the kernels that the first compiled
        child = os.fork()
        if not child:
            sys.exit(run(quick, int(year), folder / year))
        status |= os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return status


if __name__ == "__main__":
    sys.exit(run_years(sys.argv[1] == "quick", Path(sys.argv[2]).resolve(), sys.argv[3:]))
