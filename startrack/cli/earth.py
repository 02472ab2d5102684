"""`startrack earth`: geometry, images and products of Earth cameras over terrain."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import SEED, Exit, Option, Options, Parts, as_wrong_use, out, wanted

if wanted(__name__):
    import cv2
    import numpy as np

    from startrack import plots
    from startrack.cli.files import GEOMETRY, SCENE, is_tracker, kind_of, shipped_by_name
    from startrack.cli.terminal import print_result, progress
    from startrack.core import Camera, FieldPsf, Floats, Streams, deg, require_memory, um
    from startrack.design import with_changes
    from startrack.earth import imager, product
    from startrack.earth.atmosphere import Air, RunGeometry, import_tape7
    from startrack.earth.geometry import (
        EarthScene,
        Orbit,
        Strip,
        aimed,
        find,
        flight_height,
        observe_earth,
    )
    from startrack.earth.product import UNITS as PRODUCT_UNITS
    from startrack.earth.retrieval import ground_spectrum, load_earth_design
    from startrack.earth.terrain import EQUATORIAL, Pyramid, Raster
    from startrack.io import (
        from_table,
        read_table,
        save_netcdf,
        save_text,
        shipped,
        to_table,
        whole,
    )
    from startrack.motion import Motion, realise_motion
    from startrack.report import write_earth_report

EARTH = """\
A scene file gives an orbit (or tle), a sensor, a pointing and the terrain. The default is the
example: a pushbroom camera over mountains generated from a seed. For real terrain, put GeoTIFF
files of any resolution, such as tiles of the Copernicus DEM or of SRTM, into a folder:

  startrack earth terrain 'dem/*.tif'         their area, and the table [terrain] to copy
  startrack earth geometry SCENE.toml         the ground in each pixel
  startrack earth render SCENE.toml           the image, in digital numbers
  startrack earth spectrum SCENE.toml         the spectrum at the sensor
  startrack earth process SCENE.toml          radiance and reflectance, on a map
  startrack earth aim SCENE.toml --at 47 10   the orbit for a view of a place
  startrack earth air RUN1.tp7 RUN2.tp7       a table of the air from output of MODTRAN

A scene to render also gives a camera (of the catalogue, or in the file), the land and the air;
catalogs/scenes/hsrs.toml is an example. Heights of both kinds of tiles are above a geoid; the key
`geoid` names its grid. Scale, offset and unit (ft, dm) of a file are applied. Where files overlap,
the finest is used; holes in files need the key `holes`. A table [motion] as in a design gives drift
and jitter of the camera, common to all channels of an image.
"""


LEVELS = 6  # levels of light of calibration frames, from darkness to saturation
PANEL = 1500  # largest number of lines and columns of a preview

# Unit and meaning of each written map.
MAPS = {
    "height": ("m", "height above the ellipsoid WGS84"),
    "longitude": ("degree", "geodetic longitude of the ray nearest to the pixel's middle"),
    "latitude": ("degree", "geodetic latitude"),
    "incidence": ("degree", "angle between the slope's normal and the direction to the camera"),
    "sun_incidence": ("degree", "angle between the slope's normal and the Sun"),
    "shadow": ("1", "fraction of the pixel without direct sunlight"),
    "sky_view": ("1", "fraction of a uniform sky's light that reaches the slope"),
    "level": ("1", "level of the terrain's pyramid"),
    "tangent_height": ("m", "least height of a ray that misses the Earth"),
    "hit": ("1", "fraction of the pixel that sees the Earth"),
}


SET = Option(
    "--set KEY=VALUE",
    "a value in place of the scene's, such as orbit.altitude=600km or "
    "channels.*.optics.f_number=2.5; may be given several times",
    default=[],
    append=True,
)


declare = Parts(
    EARTH,
    geometry=(
        "compute height, shadow, incidence and level of each pixel",
        Options(
            "Writes geometry.png and geometry.nc (NetCDF).",
            Option(
                "scene SCENE",
                "scene file, or one of the catalogue (default: mountains); a camera with "
                "channels: its first channel",
                many="?",
            ),
            SET,
            SEED,
            out("startrack-earth"),
        ),
    ),
    render=(
        "render images: digital numbers, and radiance in five terms",
        Options(
            "Writes a FITS and a PNG file of each channel.",
            Option(
                "scene SCENE",
                "scene file, or one of the catalogue: waoss, hsrs (default), mertis, "
                "ads40, sentinel2-msi, landsat8-oli, landsat8-tirs",
                many="?",
            ),
            SET,
            SEED,
            Option("--geotiff", "also write GeoTIFF files (extra `earth`)"),
            Option(
                "--calibration EXPOSURES",
                "also write dark and flat frames, for `process`: means "
                "of N exposures (default: 256 lines of a scanner, 16 frames of a matrix)",
                int,
                many="?",
                const=0,
            ),
            out("startrack-earth"),
        ),
    ),
    process=(
        "turn raw images into radiance, reflectance and maps on the terrain",
        Options(
            "Reads CHANNEL.fits and CHANNEL-calibration.fits, written by `render --calibration`. "
            "Writes CHANNEL-map.tif and CHANNEL-quality.tif (GeoTIFF; extra `earth`), "
            "CHANNEL-map.png, and earth.html, a page of camera, images and products. The scene "
            "file gives camera, flight and terrain; its land is not used.",
            Option(
                "scene SCENE",
                "rendered scene: file, or name in the catalogue (default: hsrs)",
                many="?",
            ),
            SET,
            Option(
                "--raw DIR",
                "folder of the images and frames (default: startrack-earth)",
                Path,
                Path("startrack-earth"),
            ),
            Option(
                "--projection",
                "projection of the map: UTM in the zone of the image's middle (default), or "
                "longitude and latitude; on WGS84",
                ("utm", "geographic"),
                "utm",
            ),
            Option(
                "--cell METRE",
                "size of a cell (default: size of a pixel in the middle of the image, rounded)",
                float,
            ),
            Option(
                "--resampling",
                "interpolation between pixels",
                ("bilinear", "nearest", "cubic"),
                "bilinear",
            ),
            Option(
                "--uncertainty",
                "also write CHANNEL-uncertainty.tif: standard deviations of each "
                "layer by contributors, from `[knowledge]` of the scene",
            ),
            Option(
                "--restore SNR",
                "signal-to-noise ratio of a Wiener filter that raises the modulation, in place "
                "of the channel's `restore`",
                float,
            ),
            out("startrack-earth"),
        ),
    ),
    spectrum=(
        "compute the spectrum of sunlight at the sensor, and the rectangle of each band",
        Options(
            "Writes spectrum.csv and spectrum.png. The ground is level and straight below, with "
            "the same cover all around; thermal radiance is left out.",
            Option("scene SCENE", "scene file, or one of the catalogue (default: hsrs)", many="?"),
            SET,
            Option("--low NM", "shortest wavelength (default: 400)", float, 400.0),
            Option("--high NM", "longest wavelength (default: 1000)", float, 1000.0),
            Option("--height METRE", "height of the ground above the sea (default: 0)", float, 0.0),
            Option("--sun DEGREE", "zenith angle of the Sun (default: 40)", float, 40.0),
            out("startrack-earth"),
        ),
    ),
    air=(
        "turn output of MODTRAN into a table of the air for scenes",
        Options(
            "Two runs of the same geometry over grounds of different albedo make one geometry of "
            'the table; [air] table = "air.csv" in a scene uses it. docs/own-air.md '
            "describes the format.",
            Option("first RUN1", "tape7, tape7.scn or CSV", Path),
            Option("second RUN2", "tape7, tape7.scn or CSV", Path),
            Option(
                "--albedo A1 A2",
                "albedo of the ground in each run (default: 0.1 0.5)",
                float,
                (0.1, 0.5),
            ),
            Option(
                "--unit",
                "unit of the first column; radiance is then in W / cm2 / sr / cm-1, "
                "uW / cm2 / sr / nm or W / cm2 / sr / um (default: cm-1, as in tape7)",
                ("cm-1", "nm", "um"),
                "cm-1",
            ),
            Option("--height METRE", "height of the ground above the sea (default: any)", float),
            Option(
                "--altitude METRE", "height of the sensor above the ground (default: any)", float
            ),
            Option("--sensor-zenith DEGREE", "zenith angle at the ground (default: any)", float),
            Option("--sun-zenith DEGREE", "zenith angle at the ground (default: any)", float),
            Option("--azimuth DEGREE", "angle between Sun and sensor (default: any)", float),
            Option("--add", "add the geometry to an existing file"),
            Option("--out FILE", "CSV file to write (default: air.csv)", Path, Path("air.csv")),
        ),
    ),
    aim=(
        "print the orbit for a view of a place by a scene's camera",
        Options(
            "Changes node and anomaly of an orbit; epoch and anomaly of an orbit with a local "
            "time; the place of an aircraft. At the epoch, in the middle of the image, the "
            "optical axis points to the place.",
            Option("scene SCENE", "scene file, or one of the catalogue (default: hsrs)", many="?"),
            SET,
            Option("--at LAT LON", "latitude and longitude of the place, degree", float),
            Option(
                "--height METRE", "height of the place above the ellipsoid (default: 0)", float, 0.0
            ),
            Option("--ascending", "on a pass to the north (default: to the south)"),
        ),
    ),
    terrain=(
        "print area and heights of height files, and the table for a scene file",
        Options(
            "",
            Option("files FILE", "height files, or a quoted pattern such as 'dem/*.tif'", many="+"),
        ),
    ),
)


def command(options: argparse.Namespace) -> int:
    """Run one part of the command."""
    run = {
        "geometry": geometry,
        "render": rendered,
        "process": processed,
        "spectrum": spectrum,
        "aim": aim,
        "air": air,
        "terrain": terrain,
    }
    return run[options.part](options)


def geometry(options: argparse.Namespace) -> int:
    """Write geometry.png and geometry.nc; print a summary."""
    path = _scene_path(options) if options.scene else shipped("scenes/mountains.toml")
    scene, motion = read_scene(path, options.set)
    turn = jitter(scene, motion, options.seed)
    lines, columns = scene.sensor.lines, scene.sensor.columns
    size = 8 * (10 + len(scene.terrain.maps)) * lines * columns
    require_memory(size, f"maps of {columns} x {lines} pixels")
    maps: dict[str, Floats] = {}
    with progress("lines", lines) as advance:
        terrain = scene.terrain.open(path.parent)
        for strip in observe_earth(scene, path.parent, turn, None, terrain):
            for name, values in _values(strip).items():
                full = maps.setdefault(name, np.full((lines, columns), math.nan))
                full[strip.first : strip.first + strip.shape[0]] = values
            advance(strip.shape[0])
    height = maps["height"]
    result: dict[str, Any] = {
        "scene": str(path),
        "lines": lines,
        "columns": columns,
        "seen": float(maps["hit"].mean()),
        "shadow": _known(np.nanmean, maps["shadow"]),
        "height_m": [_known(np.nanmin, height), _known(np.nanmax, height)],
        "beside_terrain": _beside(terrain, maps["longitude"], maps["latitude"]),
        "levels": sorted({int(level) for level in maps["level"][maps["hit"] > 0]}),
        "png": str(options.out / "geometry.png"),
        "netcdf": str(options.out / "geometry.nc"),
    }
    save_netcdf(options.out / "geometry.nc", maps, MAPS, ("line", "column"))
    plots.draw_geometry(options.out / "geometry.png", maps, path.stem)
    print_result(options, result, *_text(result))
    return Exit.DONE


def rendered(options: argparse.Namespace) -> int:
    """Write a FITS and a PNG file of each channel; print a summary."""
    path = _scene_path(options)
    with as_wrong_use():
        survey = load_earth_design(path, options.set)
        above = flight_height(survey.carrier)
        for channel in survey.channels:  # bands without air are refused before the first image
            imager.band_of(channel, survey.air, above, survey.distance_to_sun)
    first = None
    for channel in survey.channels:
        lines, columns = channel.detector.rows, channel.columns
        start = options.out / channel.name
        fits, png = start.with_suffix(".fits"), start.with_suffix(".png")
        cards = {
            "SCENE": path.name,
            "CHANNEL": channel.name,
            "SEED": options.seed,
            "CAMERA": (product.camera_id(channel), "parameters of the channel"),
            **product.scene_ids(survey),
        }
        with whole(fits) as draft, progress(channel.name, lines) as advance:
            picture = imager.open_fits(draft, lines, columns, cards)
            setting = imager.render(survey, channel, path.parent, options.seed, picture, advance)
            if options.geotiff:
                imager.write_geotiff(start.with_suffix(".tif"), picture)
        frames = {}
        if options.calibration is not None:
            saved, exposures = options.out / f"{channel.name}-calibration.fits", options.calibration
            with progress(f"{channel.name}: calibration", LEVELS) as advance, as_wrong_use():
                calibration = product.calibrate(
                    survey, channel, setting, options.seed, exposures or None, advance
                )
            product.save_calibration(saved, calibration, channel)
            frames = {"calibration": str(saved), "electrons_per_number": calibration.electrons}
        numbers, *terms = (imager.thinned(m, PANEL) for m in (picture.numbers, *picture.terms))
        small = dict(zip(picture.terms._fields, terms, strict=True))
        plots.draw_picture(png, numbers, small, f"{path.stem}: {channel.name}")
        result = _picture_values(channel, picture, setting) | {"fits": str(fits), "png": str(png)}
        terrain = setting.terrain or survey.terrain.open(path.parent)
        beside = _beside(terrain, picture.longitude, picture.latitude)
        result |= {"beside_terrain": beside}
        spots = [(spot.longitude, spot.latitude) for spot in survey.land.hot_spots]
        result["hot_spots_outside"] = _outside(spots, picture.longitude, picture.latitude)
        if survey.motion != Motion():
            result["misregistration_px"] = imager.misregistration(survey, channel, options.seed)
        first = first or (channel, setting.camera)
        if channel.optics.tabulated or survey.camera.spectrometer:
            result |= _lens_values(channel, setting, *first)
        result |= frames | _other_air(survey, channel)
        print_result(options, result, *_picture_text(result))
    return Exit.DONE


def _beside(pyramid: Pyramid, longitude: Floats, latitude: Floats) -> float:
    """Fraction of the visible ground outside all heights of a scene; places are (lines, columns)
    degree.

    At most PANEL lines and columns are used; 0 if no ground is visible.
    """
    seen = [imager.thinned(angle, PANEL).ravel() for angle in (longitude, latitude)]
    ground = np.isfinite(seen[0])
    if not ground.any():
        return 0.0
    covered = pyramid.terrain.covers(*(np.radians(x[ground]) for x in seen))
    return float(1 - covered.mean())


def _outside(
    places: Sequence[tuple[float, float]], longitude: Floats, latitude: Floats
) -> list[int]:
    """Numbers of the places (longitude, latitude; radian) outside an image, from 0.

    longitude, latitude  (lines, columns) degree, of the pixels; NaN without ground
    """
    edges = [
        np.concatenate([angle[0], angle[:, -1], angle[-1, ::-1], angle[::-1, 0]])
        for angle in (longitude, latitude)
    ]
    seen = np.isfinite(edges[0])
    if seen.sum() < 3:
        return []
    centre = float(edges[0][seen][0])

    def east(angle: Any) -> Any:
        return (angle - centre + 180) % 360 - 180

    border = np.column_stack([east(edges[0][seen]), edges[1][seen]]).astype(np.float32)
    return [
        number
        for number, place in enumerate(np.degrees(np.array(places)).tolist())
        if cv2.pointPolygonTest(border, (east(place[0]), place[1]), measureDist=False) < 0
    ]


def _beside_text(result: dict[str, Any]) -> list[str]:
    share = result["beside_terrain"]
    if not share:
        return []
    return [
        f"terrain {100 * share:.3g} % of the visible ground has no heights in the scene, and "
        "gets the height `terrain.sea`; `startrack earth aim SCENE.toml --at LAT LON` moves the "
        "camera"
    ]


def _dark_text(result: dict[str, Any]) -> list[str]:
    """The reason for an image without light."""
    if not result["seen"]:
        return ["ground    none is visible: the lines of sight miss the Earth"]
    if not sum(result["radiance"].values()):
        return ["light     none: the Sun is below the horizon, or all visible ground is in shadow"]
    return []


def _scene_path(options: argparse.Namespace) -> Path:
    """Path of a scene file, or of a scene with a camera of the catalogue."""
    scene = Path(options.scene or "hsrs")
    kind = kind_of(scene)
    if kind not in (None, SCENE, GEOMETRY):
        raise shared.WrongUse(f"{scene} must be a scene of an Earth camera, and is {kind.words}")
    if kind is None and is_tracker(scene):
        raise shared.WrongUse(
            f"{scene} must be a scene of an Earth camera, and is the design of a star tracker; "
            "startrack simulate renders its frames"
        )
    path = shipped_by_name(scene, [SCENE.folder])
    if not path.exists():
        names = [file.stem for file in shipped("scenes").glob("*.toml") if kind_of(file) is SCENE]
        raise shared.WrongUse(
            f"{scene} must be a scene file, or one of {', '.join(sorted(names))}, but there is none"
        )
    return path


def _picture_values(
    channel: imager.Channel, picture: imager.Picture, setting: imager.Setting
) -> dict[str, Any]:
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
        "radiance": {name: float(term.mean()) for name, term in picture.terms._asdict().items()},
    }


def _other_air(survey: imager.Survey, channel: imager.Channel) -> dict[str, Any]:
    """The aerosol of a scene, if the band is infrared: its air has the default aerosol instead."""
    air = survey.air
    if air is None or air.table or imager.mean_wavelength(channel) <= imager.INFRARED:
        return {}
    if (air.aerosol, air.visibility) == (Air().aerosol, Air().visibility):
        return {}
    return {"aerosol_not_used": f"{air.aerosol}, {air.visibility / 1e3:g} km"}


def _lens_values(
    channel: imager.Channel, setting: imager.Setting, first: imager.Channel, other: Camera
) -> dict[str, Any]:
    """Effect of the lens over the field of an image."""
    across, along = imager.lens_registration(channel, setting.camera, first, other)
    light = np.ones(1) if setting.light is None else setting.light
    values = {
        "lens_misregistration_px": [across, along],
        "illumination": float(light.min() / light.max()),
    }
    if isinstance(setting.psf, FieldPsf) and math.isfinite(setting.psf.error):
        values["lens_error_of_peak"] = setting.psf.error
    return values


def _picture_text(result: dict[str, Any]) -> list[str]:
    terms = ", ".join(f"{name} {value:.4g}" for name, value in result["radiance"].items())
    lines = [
        f"{result['channel']}: {result['columns']} x {result['lines']} pixel, "
        f"{100 * result['seen']:.1f} % see the ground",
        f"radiance  {terms} W / m^2 / sr / um",
        f"numbers   mean {result['number_mean']:.1f}, {100 * result['saturated']:.2f} % "
        f"saturated; {result['electrons_per_radiance']:.4g} electrons for 1 W / m^2 / sr / um",
        f"exposure  {1e3 * result['exposure_s']:.4g} ms, smear {result['smear_px']:.2f} pixel",
        *_dark_text(result),
        *_beside_text(result),
        *(
            f"outside   land.hot_spots.{number} is outside the image"
            for number in result["hot_spots_outside"]
        ),
    ]
    if "aerosol_not_used" in result:
        lines.append(
            "air rural aerosol with 23 km of visibility, as for all bands beyond 3 um, not the "
            f"scene's ({result['aerosol_not_used']})"
        )
    off = "pixel {}across and {:.3g} along off the first channel"
    if "illumination" in result:
        across, along = result["lens_misregistration_px"]
        lines.append(
            f"lens      darkest pixel {100 * result['illumination']:.1f} % of the brightest; at "
            f"most {across:.3g} {off.format('', along)}"
        )
    if "misregistration_px" in result:
        across, along = result["misregistration_px"]
        lines.append(f"motion    {across:.3g} {off.format('rms ', along)}")
    lines.append(f"wrote {result['fits']} and {result['png']}")
    if "calibration" in result:
        lines.append(f"wrote {result['calibration']}")
    return lines


def processed(options: argparse.Namespace) -> int:
    """Write a map, its quality and a picture of each channel; print a summary."""
    path = _scene_path(options)
    with as_wrong_use():
        survey = load_earth_design(path, options.set)
        settings = product.ProductSettings(
            options.projection,
            options.cell,
            options.resampling,
            options.uncertainty,
            options.restore,
        )
    products = []
    for channel in survey.channels:
        with as_wrong_use(ValueError, FileNotFoundError):
            raw = product.read_raw(options.raw / f"{channel.name}.fits", channel, survey)
            frames = product.read_calibration(
                options.raw / f"{channel.name}-calibration.fits", channel
            )
        with progress(channel.name, 1) as advance:
            mapped = product.make_product(
                survey, channel, path.parent, raw.numbers, frames, settings, advance
            )
        files = _save_product(options.out, path, channel, mapped, settings)
        result = _product_values(channel.name, mapped, settings, raw.truth) | files
        result["differs"] = list(raw.differs)
        print_result(options, result, *_product_text(result, mapped))
        picture = options.raw / f"{channel.name}.png"
        products.append(result | ({"image": picture} if picture.is_file() else {}))
    scene = path.read_text(encoding="utf-8")
    page = options.out / "earth.html"
    save_text(page, write_earth_report(survey, products, scene, f"Earth camera: {path.stem}"))
    print_result(options, {"report": str(page)}, f"wrote {page}")
    return Exit.DONE


def _save_product(
    out: Path,
    scene: Path,
    channel: imager.Channel,
    mapped: product.Product,
    settings: product.ProductSettings,
) -> dict[str, str]:
    """Write map, quality, uncertainty and picture of a channel. Returns the files by kind."""
    start, quality = out / f"{channel.name}-map", out / f"{channel.name}-quality.tif"
    tags = {
        "CHANNEL": channel.name,
        "SCENE": scene.name,
        "RESAMPLING": settings.resampling,
        "CAMERA": product.camera_id(channel),
    }
    product.write_product(
        start.with_suffix(".tif"), mapped.layers, PRODUCT_UNITS, mapped.grid, tags
    )
    product.write_quality(quality, mapped.quality, mapped.grid)
    if mapped.doubt:
        units = PRODUCT_UNITS | {"place": "m"}
        product.write_product(
            out / f"{channel.name}-uncertainty.tif",
            mapped.doubt,
            {name: units[name.partition(":")[0]] for name in mapped.doubt},
            mapped.grid,
            tags,
        )
    plots.draw_product(
        start.with_suffix(".png"),
        {name: imager.thinned(layer, PANEL) for name, layer in mapped.layers.items()},
        PRODUCT_UNITS,
        imager.thinned(mapped.quality, PANEL),
        product.QUALITY,
        f"{scene.stem}: {channel.name}, {_grid_text(mapped)}",
    )
    return {
        "map": str(start.with_suffix(".tif")),
        "quality": str(quality),
        "png": str(start.with_suffix(".png")),
    }


def spectrum(options: argparse.Namespace) -> int:
    """Write spectrum.csv and spectrum.png; print the rectangles."""
    if not 0 <= options.sun <= 85 or not 0 <= options.height <= 9000:
        raise shared.WrongUse(
            f"sun must lie in [0, 85] degrees and height in [0, 9000] m, got {options.sun:g} and "
            f"{options.height:g}"
        )
    with as_wrong_use():
        survey = load_earth_design(_scene_path(options), options.set)
        low, high = (1e-9 * end for end in (options.low, options.high))
        found = ground_spectrum(survey, low, high, options.height, math.radians(options.sun))
    table = [
        "wavelength_nm,radiance_w_m2_sr_um,path_w_m2_sr_um",
        *(
            f"{1e9 * place:.6g},{um * light:.6g},{um * path:.6g}"
            for place, light, path in zip(found.wavelength, found.radiance, found.path, strict=True)
        ),
    ]
    csv, png = options.out / "spectrum.csv", options.out / "spectrum.png"
    save_text(csv, "\n".join(table) + "\n")
    plots.draw_spectrum(
        png,
        found.wavelength,
        found.radiance * um,
        found.path * um,
        [(band.name, band.low, band.high, band.radiance * um) for band in found.bands],
    )
    bands = [
        {
            "channel": band.name,
            "low_nm": 1e9 * band.low,
            "high_nm": 1e9 * band.high,
            "radiance": um * band.radiance,
        }
        for band in found.bands
    ]
    lines = [
        f"{band['channel']}: {band['low_nm']:.1f} to {band['high_nm']:.1f} nm, "
        f"{band['radiance']:.4g} W / m^2 / sr / um"
        for band in bands
    ]
    shown = {band.name for band in found.bands}
    outside = [channel.name for channel in survey.channels if channel.name not in shown]
    if outside:
        lines.append(
            f"without a rectangle: {', '.join(outside)}, not within {options.low:g} to "
            f"{options.high:g} nm (--low, --high), or thermal"
        )
    result = {"bands": bands, "outside": outside, "csv": str(csv), "png": str(png)}
    print_result(options, result, *lines, f"wrote {csv} and {png}")
    return Exit.DONE


def air(options: argparse.Namespace) -> int:
    """Write a table of the air from two runs of MODTRAN."""
    geometry = RunGeometry(*(getattr(options, name) for name in RunGeometry._fields))
    dark, bright = options.albedo
    with as_wrong_use(ValueError, FileNotFoundError):
        wavelengths = import_tape7(
            (options.first, options.second),
            (dark, bright),
            options.out,
            geometry,
            options.unit,
            options.add,
        )
    print_result(
        options,
        {"wavelengths": len(wavelengths), "table": str(options.out)},
        f"wrote {options.out}: {len(wavelengths)} wavelengths from {wavelengths[0] / um:.4g} to "
        f'{wavelengths[-1] / um:.4g} um; name it by [air] table = "{options.out}"',
    )
    return Exit.DONE


def _product_values(
    name: str, mapped: product.Product, settings: product.ProductSettings, truth: Floats | None
) -> dict[str, Any]:
    error, rms = (math.nan, math.nan) if truth is None else product.against_truth(mapped, truth)
    grid = mapped.grid
    return {
        "channel": name,
        "projection": grid.system,
        "columns": grid.columns,
        "rows": grid.rows,
        "cell": [grid.step_x, grid.step_y],
        "resampling": settings.resampling,
        "mean": {layer: _known(np.nanmean, values) for layer, values in mapped.layers.items()},
        "flagged": {
            word: float((mapped.quality & bit > 0).mean()) for word, bit in product.QUALITY.items()
        },
        "surroundings": mapped.surroundings,
        "radiance_error": error,
        "radiance_rms": rms,
        "uncertainty": {
            layer: {cause: float(np.nanmedian(values)) for cause, values in causes.items()}
            for layer, causes in mapped.uncertainty.items()
        },
    }


def _grid_text(mapped: product.Product) -> str:
    grid = mapped.grid
    unit = "m" if not grid.system.endswith(":4326") else "deg"
    return (
        f"{grid.columns} x {grid.rows} cells of {grid.step_x:.4g} x {grid.step_y:.4g} {unit}, "
        f"{grid.system}"
    )


def _product_text(result: dict[str, Any], mapped: product.Product) -> list[str]:
    layers = ", ".join(
        f"{name} {value:.4g}{'' if PRODUCT_UNITS[name] == '1' else f' {PRODUCT_UNITS[name]}'}"
        for name, value in result["mean"].items()
        if math.isfinite(value)
    )
    flags = ", ".join(f"{word} {100 * part:.1f} %" for word, part in result["flagged"].items())
    truth = []
    if math.isfinite(result["radiance_error"]):
        truth = [
            f"truth     mean radiance {100 * result['radiance_error']:+.2f} %, pixels "
            f"{100 * result['radiance_rms']:.1f} % rms (noise and blurred edges)"
        ]
    return [
        f"{result['channel']}: {_grid_text(mapped)}, {result['resampling']}",
        f"mean      {layers or 'none: no cell has a value'}",
        f"quality   {flags}",
        *truth,
        *(
            f"OTHER {part.upper():8} the scene's {part} is not that of the raw image, and the "
            "product uses the scene's"
            for part in result["differs"]
        ),
        *(
            f"u({layer})  " + ", ".join(f"{cause} {value:.2g}" for cause, value in causes.items())
            for layer, causes in result["uncertainty"].items()
        ),
        f"wrote {result['map']}, {result['quality']} and {result['png']}",
    ]


def aim(options: argparse.Namespace) -> int:
    """Print the table of the carrier for a view of a place by a scene's camera."""
    path = _scene_path(options)
    if options.at is None:
        raise shared.WrongUse("--at LAT LON must name the place")
    scene: imager.Survey | EarthScene
    if kind_of(path) is SCENE:
        with as_wrong_use(path=path):
            scene = load_earth_design(path, options.set)
    else:
        scene = read_scene(path, options.set)[0]
    with as_wrong_use(path=path):
        latitude, longitude = options.at[0] * deg, options.at[1] * deg
        carrier = aimed(
            scene.orbit or scene.carrier,  # an orbit as given, with its local time
            scene.pointing,
            longitude,
            latitude,
            options.height,
            options.ascending,
        )
    kind = "orbit" if isinstance(carrier, Orbit) else "aircraft"
    values = to_table(carrier)
    print_result(
        options,
        {"scene": str(path), kind: values},
        f"the optical axis of {path.name} is at latitude {options.at[0]:g}, longitude "
        f"{options.at[1]:g} deg at its epoch with this table:",
        f"\n[{kind}]",
        *(f"{name} = {json.dumps(value)}" for name, value in values.items()),
    )
    return Exit.DONE


def terrain(options: argparse.Namespace) -> int:
    """Print area and heights of height files, and the table of a scene file that reads them."""
    with as_wrong_use(ValueError, OSError):
        files = {path: Raster(path, heights=True) for path in find(Path(), tuple(options.files))}
    for path, raster in files.items():
        grid, scaling = raster.grid, raster.scaling
        with as_wrong_use(ValueError, OSError), progress(path.name, grid.rows) as advance:
            extremes = raster.extremes(advance)
        lowest, highest, holes, _ = extremes
        east = grid.west + (grid.columns - 1) * grid.step_x
        narrow = math.cos((grid.north + grid.south) / 2)
        result = {
            "file": str(path),
            "west_deg": math.degrees(grid.west),
            "east_deg": math.degrees(east),
            "south_deg": math.degrees(grid.south),
            "north_deg": math.degrees(grid.north),
            "cell_m": grid.step_y * EQUATORIAL,
            "cell_across_m": grid.step_x * EQUATORIAL * narrow,
            "columns": grid.columns,
            "rows": grid.rows,
            "height_m": [lowest, highest],
            "holes": holes,
            "unit": scaling.unit,
            "above": scaling.surface,
        }
        unit = f"numbers in {scaling.unit}" if scaling.unit else "no unit declared: m is assumed"
        if (scaling.scale, scaling.offset) != (1.0, 0.0):
            unit += f"; {scaling.scale:.6g} m times the numbers, plus {scaling.offset:.6g} m"
        print_result(
            options,
            result,
            f"{path}: {result['columns']} x {result['rows']} cells of "
            f"{result['cell_across_m']:.1f} x {result['cell_m']:.1f} m, "
            f"longitude {result['west_deg']:.4f} to {result['east_deg']:.4f}, "
            f"latitude {result['south_deg']:.4f} to {result['north_deg']:.4f}",
            f" heights {lowest:.1f} to {highest:.1f} m ({unit}) above "
            f"{scaling.surface or 'a surface that the file does not name'}",
            *([f"  {100 * holes:.3g} % of the pixels have no height"] if holes else []),
            *(
                [
                    " some may not be heights of the Earth: does the file declare its number for "
                    "missing heights (nodata)?"
                ]
                if not extremes.of_the_earth
                else []
            ),
        )
    if not options.json:
        names = ", ".join(f'"{path}"' for path in files)
        print(f"\n[terrain]\nfiles = [{names}]")
        print('# geoid = "egm2008.tif"  # the grid of the geoid, if heights are above it')
        print('# holes = "0 m"  # height of holes inside the files')
    return Exit.DONE


def read_scene(path: Path, changes: Sequence[str] = ()) -> tuple[EarthScene, Motion]:
    """The scene of a file and its table [motion]; of a camera, the scene of its first channel.

    changes  values that replace the file's: "orbit.altitude=600 km"
    Raises   WrongUse if the file or a change cannot be used.
    """
    with as_wrong_use(path=path):
        if kind_of(path) is SCENE:
            survey = load_earth_design(path, changes)
            return survey.scene(survey.channels[0]), survey.motion
        table: Any = read_table(path, "a scene file")
        motion = from_table(Motion, table.pop("motion", {}), "motion")
        return with_changes(from_table(EarthScene, table), changes), motion


def jitter(scene: EarthScene, motion: Motion, seed: int) -> Callable[[Floats], Floats] | None:
    """The rotation of the camera over the time since the epoch; None without motion."""
    if motion == Motion():
        return None
    duration = scene.sensor.lines * scene.sensor.dating(scene.carrier).period
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
    # A mean of longitudes is meaningless across the date line, and so is a mean of levels.
    single = {"longitude": np.degrees(ground.longitude), "latitude": np.degrees(ground.latitude)}
    for name, angle in (single | {"level": ground.level}).items():
        values[name] = np.asarray(angle, float).reshape(strip.shape)[..., middle]
    return values | {name: strip.mean(rays) for name, rays in ground.maps.items()}


def _known(statistic: Callable[[Floats], Any], values: Floats) -> float:
    """A statistic of the known values; NaN without known values."""
    return float(statistic(values)) if np.isfinite(values).any() else math.nan


def _text(result: dict[str, Any]) -> list[str]:
    low, high = result["height_m"]
    return [
        f"image     {result['columns']} x {result['lines']} pixel, "
        f"{100 * result['seen']:.1f} % see the Earth",
        f"height    {low:.1f} to {high:.1f} m above the ellipsoid",
        f"shadow    {100 * result['shadow']:.1f} % of what is seen",
        f"levels    {', '.join(map(str, result['levels'])) or 'none'}",
        *_beside_text(result),
        f"wrote {result['png']} and {result['netcdf']}",
    ]
