"""`startrack earth`: a camera in flight over terrain."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from startrack.cli.exits import Exit, WrongUse
from startrack.cli.options import add_out, add_seed, describe
from startrack.cli.terminal import progress, tell
from startrack.core import Floats, Streams, um
from startrack.earth.geometry import EarthScene, Strip, find, observe_earth
from startrack.earth.imager import (
    Channel,
    Picture,
    Setting,
    cameras,
    load_survey,
    open_fits,
    render,
    thinned,
    write_geotiff,
)
from startrack.earth.terrain import EQUATORIAL, Raster
from startrack.io import from_table, read_table, save_netcdf, shipped, whole
from startrack.motion import Motion, realise_motion
from startrack.plots import draw_geometry, draw_picture

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


PANEL = 1500  # lines and columns of a quick look, at most

# What is written of each pixel, with its unit and what it is.
MAPS = {
    "height": ("m", "height above the ellipsoid WGS84"),
    "longitude": ("degree", "geodetic longitude of the ray nearest to the pixel's middle"),
    "latitude": ("degree", "geodetic latitude"),
    "incidence": ("degree", "between the slope's normal and the way to the camera"),
    "sun_incidence": ("degree", "between the slope's normal and the sun"),
    "shadow": ("1", "fraction of the pixel without direct sunlight"),
    "sky_view": ("1", "fraction of a uniform sky's light that reaches the slope"),
    "level": ("1", "level of the terrain's pyramid"),
    "tangent_height": ("m", "least height of a ray that misses the Earth"),
    "hit": ("1", "fraction of the pixel that sees the Earth"),
}


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack earth` and its parts."""
    parser.description = EARTH
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    geometry = _part(
        parts, "geometry", "height, shadow, incidence and level of each pixel: picture and NetCDF",
        "Leaves geometry.png and geometry.nc.",
    )  # fmt: skip
    geometry.add_argument(
        "scene", type=Path, nargs="?", metavar="SCENE.toml",
        help="scene file (default: the example, mountains)",
    )  # fmt: skip
    add_seed(geometry)
    add_out(geometry, "startrack-earth")
    render = _part(
        parts, "render",
        "what a camera sees: digital numbers and the radiance in its five terms, FITS and PNG",
        "Leaves a FITS and a PNG file of each channel.",
    )  # fmt: skip
    render.add_argument(
        "scene", nargs="?", metavar="SCENE",
        help="scene file, or one of the catalogue: waoss, hsrs (default), mertis, ads40",
    )  # fmt: skip
    add_seed(render)
    render.add_argument("--geotiff", action="store_true", help="write GeoTIFF, too (extra `earth`)")
    add_out(render, "startrack-earth")
    terrain = _part(parts, "terrain", "what files of heights cover, and how a scene names them")
    terrain.add_argument(
        "files", nargs="+", metavar="FILE", help="or a quoted pattern: 'dem/*.tif'"
    )


def _part(parts: Any, name: str, text: str, more: str = "") -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = parts.add_parser(
        name, help=text, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    describe(parser, more)
    return parser


def command(options: argparse.Namespace) -> int:
    """Run one of its parts."""
    return {"geometry": geometry, "render": rendered, "terrain": terrain}[options.part](options)


def geometry(options: argparse.Namespace) -> int:
    """Leave geometry.png and geometry.nc; print what they hold."""
    path = options.scene or shipped("scenes/mountains.toml")
    scene, motion = read_scene(path)
    shaken = jitter(scene, motion, options.seed)
    lines, columns = scene.sensor.lines, scene.sensor.columns
    maps: dict[str, Floats] = {}
    with progress("lines", lines) as advance:
        for strip in observe_earth(scene, path.parent, shaken):
            for name, values in _values(strip).items():
                whole = maps.setdefault(name, np.full((lines, columns), math.nan))
                whole[strip.first : strip.first + strip.shape[0]] = values
            advance(strip.shape[0])
    result: dict[str, Any] = {
        "scene": str(path),
        "lines": lines,
        "columns": columns,
        "seen": float(maps["hit"].mean()),
        "shadow": _mean(maps["shadow"]),
        "height_m": [_least(maps["height"]), _most(maps["height"])],
        "levels": sorted({int(level) for level in maps["level"][maps["hit"] > 0]}),
        "png": str(options.out / "geometry.png"),
        "netcdf": str(options.out / "geometry.nc"),
    }
    save_netcdf(options.out / "geometry.nc", maps, MAPS, ("line", "column"))
    draw_geometry(options.out / "geometry.png", maps, path.stem)
    tell(options, result, _text(result))
    return Exit.DONE


def rendered(options: argparse.Namespace) -> int:
    """Leave a FITS and a PNG file of each channel; print what they hold."""
    path = _scene_path(options.scene or "hsrs")
    try:
        survey = load_survey(path)
    except ValueError as error:
        raise WrongUse(str(error)) from None
    for channel in survey.channels:
        lines, columns = channel.detector.rows, channel.columns
        start = options.out / channel.name
        fits, png = start.with_suffix(".fits"), start.with_suffix(".png")
        cards = {"SCENE": path.name, "CHANNEL": channel.name, "SEED": options.seed}
        with whole(fits) as draft, progress(channel.name, lines) as advance:
            picture = open_fits(draft, lines, columns, cards)
            setting = render(survey, channel, path.parent, options.seed, picture, advance)
            if options.geotiff:
                write_geotiff(start.with_suffix(".tif"), picture)
        small = {name: thinned(each, PANEL) for name, each in picture.terms._asdict().items()}
        draw_picture(png, thinned(picture.numbers, PANEL), small, f"{path.stem}: {channel.name}")
        result = _told(channel, picture, setting) | {"fits": str(fits), "png": str(png)}
        tell(options, result, _picture_text(result))
    return Exit.DONE


def _scene_path(scene: str) -> Path:
    """A file, or the scene of a camera of the catalogue."""
    if scene in cameras():
        return shipped(f"scenes/{scene}.toml")
    if not Path(scene).exists():
        known = ", ".join(cameras())
        raise WrongUse(f"{scene} must be a scene file, or one of {known}, but there is none")
    return Path(scene)


def _told(channel: Channel, picture: Picture, setting: Setting) -> dict[str, Any]:
    largest = 2**channel.detector.bits - 1
    lines, columns = picture.numbers.shape
    return {
        "channel": channel.name,
        "lines": lines,
        "columns": columns,
        "period_s": setting.period,
        "exposure_s": setting.exposure,
        "smear_px": setting.smear,
        "electrons_per_radiance": setting.electrons / um,
        "surroundings": setting.surroundings,
        "seen": float(np.isfinite(picture.latitude).mean()),
        "number_mean": float(picture.numbers.mean()),
        "saturated": float((picture.numbers >= largest).mean()),
        "radiance": {name: float(each.mean()) for name, each in picture.terms._asdict().items()},
    }


def _picture_text(result: dict[str, Any]) -> str:
    terms = ", ".join(f"{name} {value:.4g}" for name, value in result["radiance"].items())
    return "\n".join(
        [
            f"{result['channel']}: {result['columns']} x {result['lines']} pixel, "
            f"{100 * result['seen']:.1f} % see the ground",
            f"radiance  {terms} W / m^2 / sr / um",
            f"numbers   mean {result['number_mean']:.1f}, {100 * result['saturated']:.2f} % "
            f"saturated; {result['electrons_per_radiance']:.4g} electrons for 1 W / m^2 / sr / um",
            f"exposure  {1e3 * result['exposure_s']:.4g} ms, smear {result['smear_px']:.2f} pixel",
            f"wrote {result['fits']} and {result['png']}",
        ]
    )


def terrain(options: argparse.Namespace) -> int:
    """Tell what files of heights cover, and print the table of a scene file that reads them."""
    try:
        grids = {path: Raster(path).grid for path in find(Path(), tuple(options.files))}
    except (ValueError, OSError) as error:
        raise WrongUse(str(error)) from None
    for path, grid in grids.items():
        east = grid.west + (grid.columns - 1) * grid.step_x
        result = {
            "file": str(path),
            "west_deg": math.degrees(grid.west), "east_deg": math.degrees(east),
            "south_deg": math.degrees(grid.south), "north_deg": math.degrees(grid.north),
            "cell_m": grid.step_y * EQUATORIAL, "columns": grid.columns, "rows": grid.rows,
        }  # fmt: skip
        tell(
            options, result,
            f"{path}: {result['columns']} x {result['rows']} cells of {result['cell_m']:.1f} m, "
            f"longitude {result['west_deg']:.4f} to {result['east_deg']:.4f}, "
            f"latitude {result['south_deg']:.4f} to {result['north_deg']:.4f}",
        )  # fmt: skip
    if not options.json:
        names = ", ".join(f'"{path}"' for path in grids)
        print(f"\n[terrain]\nfiles = [{names}]")
        print('# geoid = "egm2008.tif"  # name its grid where the heights are above the geoid')
    return Exit.DONE


def read_scene(path: Path) -> tuple[EarthScene, Motion]:
    """The scene of a file and its table [motion], their errors as wrong use."""
    try:
        table = read_table(path, "a scene file")
    except ValueError as error:
        raise WrongUse(str(error)) from None
    try:
        motion = from_table(Motion, table.pop("motion", {}), "motion")
        return from_table(EarthScene, table), motion
    except ValueError as error:
        raise WrongUse(f"{path}: {error}") from None


def jitter(scene: EarthScene, motion: Motion, seed: int) -> Callable[[Floats], Floats] | None:
    """How the camera turns while it takes the image, from its zero at the epoch; None for not."""
    if motion == Motion():
        return None
    duration = scene.sensor.lines * scene.sensor.dating(scene.flight).period
    return realise_motion(motion, duration, Streams(seed, 0)).at


def _values(strip: Strip) -> dict[str, Floats]:
    """The maps of some lines; angles in degree."""
    ground, middle = strip.ground, strip.shape[2] // 2
    values = {
        "height": strip.mean(ground.height),
        "incidence": np.degrees(strip.mean(ground.incidence)),
        "sun_incidence": np.degrees(strip.mean(ground.sun_incidence)),
        "shadow": strip.mean(np.where(ground.hit, ground.shadow, math.nan)),
        "sky_view": strip.mean(ground.sky_view),
        "tangent_height": strip.mean(ground.tangent_height),
        "hit": strip.mean(ground.hit.astype(float)),
    }
    # A mean of longitudes has no sense across the date line, nor one of levels.
    for name, one in (
        ("longitude", np.degrees(ground.longitude)),
        ("latitude", np.degrees(ground.latitude)),
        ("level", ground.level),
    ):
        values[name] = np.asarray(one, float).reshape(strip.shape)[..., middle]
    return values | {name: strip.mean(each) for name, each in ground.maps.items()}


def _mean(values: Floats) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan


def _least(values: Floats) -> float:
    return float(np.nanmin(values)) if np.isfinite(values).any() else math.nan


def _most(values: Floats) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else math.nan


def _text(result: dict[str, Any]) -> str:
    low, high = result["height_m"]
    return "\n".join(
        [
            f"image     {result['columns']} x {result['lines']} pixel, "
            f"{100 * result['seen']:.1f} % see the Earth",
            f"height    {low:.1f} to {high:.1f} m above the ellipsoid",
            f"shadow    {100 * result['shadow']:.1f} % of what is seen",
            f"levels    {', '.join(map(str, result['levels'])) or 'none'}",
            f"wrote {result['png']} and {result['netcdf']}",
        ]
    )
