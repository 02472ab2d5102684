"""`startrack calibrate`: the camera model of images of stars, or of a table of them."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, WrongUse, degrees, images, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack import calibration, plots
    from startrack.cli import terminal
    from startrack.core import Camera, Frame, Matches, Spots, arcsec, within
    from startrack.design import Tracker
    from startrack.detection import Detection
    from startrack.identification import WIDEST_PINHOLE, Identification, PatternIndexes
    from startrack.io import field_hint, finite, save_json
    from startrack.optimise import Ledger, chain_text, chain_values
    from startrack.photograph import PhotographView, solve_photograph
    from startrack.trial import lost_in_space

ANGLES = {"yz": ("y_angle", "z_angle"), "xy": ("x_angle", "y_angle")}
WARM = {"auto": None, "none": False, "linear": True}
OUTSIDE = 1.0  # pixel, largest distance of a star from the centres of the array's pixels
PINHOLE = "columns", "rows", "focal_length_px", "k1", "k2", "p1", "p2"
ORDER = "name", "distortion", "temperature_terms", "unknowns"  # fields of the chosen camera
ROUNDS = 3  # rounds: a better camera model matches more stars


declare = Options(
    "Solves images, fits one camera model to all of them, and prints focal length, principal "
    "point and distortion with their sigma. The status is 3 if an image has no attitude.\n\nA "
    "table of stars (CSV with a line of names, ECSV, FITS or VOTable) takes the place of the "
    "images: a row for each star, of one camera at one attitude. Its columns are found by their "
    "names, with the unit at the end of a name (_arcsec, _arcmin, _deg, _rad, _px, _c, _k) or in "
    "the table:\n\n directions y_angle and z_angle about a boresight +x, tan(y_angle) = y / x;\n "
    "x_angle and y_angle about a boresight +z; ra and dec; or the unit\n vector ux, uy, uz (also "
    "direction_x, ...)\n pixels column and row, or x and y\n temperature temperature or "
    "camera_temperature; may be missing\n weights weight (an inverse variance) or sigma; may be "
    "missing\n\nPixels below -0.5 mean coordinates from the middle of the array. The fit is "
    "robust: beyond 2 sigma of the typical residual a star counts less, beyond 6 not at all. "
    "Cross-validation (the residual of each star to a fit without its tenth of the table) "
    "selects the order: the result is the model of fewest unknowns within a standard error of "
    "the best.\n\n startrack calibrate stars.csv --camera camera.toml\n startrack calibrate "
    "stars.fits --directions yag:arcsec,zag:arcsec --pixels col,row\n startrack calibrate "
    "later.csv --fitted camera.toml",
    *images(" images of one camera; or one table of stars"),
    Option(
        "--fov DEG",
        "images: approximate field of view across the columns, degree (default: found as by "
        "`solve`)",
        degrees,
    ),
    *shared.FIELD_AND_SKY,
    Option(
        "--principal PX",
        "images: prior sigma of the principal point, pixel; 0 fixes it at the centre",
        float,
        20.0,
    ),
    Option(
        "--distortion",
        "distortion to fit: none, k1 (radial; default of images) or k1, k2, p1, p2 (full); for a "
        "table also a polynomial over the field of order 1, 2 or 3, or auto: the best of all "
        "(default)",
        ("none", "radial", "full", "1", "2", "3", "auto"),
    ),
    shared.Group(
        "tables of stars",
        Option(
            "--fitted CAMERA",
            "camera of another table, written by --camera: only the attitude is fitted, and "
            "residuals are printed",
            Path,
        ),
        Option(
            "--temperature-terms",
            "whether boresight and scale move with temperature (default: auto, both are tried)",
            ("auto", "none", "linear"),
            "auto",
        ),
        Option("--directions NAMES", "columns of directions, such as yag:arcsec,zag:arcsec"),
        Option(
            "--directions-are",
            "meaning of these columns (default: by their names)",
            ("vectors", "radec", "yz", "xy"),
        ),
        Option("--pixels NAMES", "columns of pixels, such as col,row"),
        Option("--temperature NAME", "column of temperature, such as t:K; '' for none"),
        Option("--weight NAME", "column of weights; '' for none"),
        Option("--size COLUMNS,ROWS", "pixels of the array (default: enough for the table)"),
        Option(
            "--first-pixel X,Y",
            "coordinates of the first pixel's centre in the table (default: 0,0)",
        ),
        Option("--folds N", "number of parts of the table in the cross-validation", whole(2), 10),
    ),
    Option("--out FILE", "JSON file for the result", Path),
    Option(
        "--camera FILE",
        "TOML file for the camera: `solve --camera` reads it; its table [tracker.camera] is the "
        "camera model of a design's tracker",
        Path,
    ),
    Option(
        "--posterior DIR",
        "folder for posterior.json and corner.png: sample the posterior of "
        "focal length, principal point, k1 and PSF width",
        Path,
    ),
)


def command(options: argparse.Namespace) -> int:
    """Solve the images, fit one camera model to all, and repeat with that model."""
    with shared.as_wrong_use(ValueError, OSError):
        tables = any(calibration.is_star_table(path) for path in options.images)
    if tables:
        return _calibrate_table(options)
    if options.distortion not in (None, "none", "radial", "full"):
        raise WrongUse(
            f"--distortion of images must be none, radial or full, got {options.distortion}"
        )
    with shared.as_wrong_use(ValueError, OSError):
        if options.fov is not None:
            within(0.01, 179, fov=options.fov)
        identification = Identification(focal_tolerance=options.fov_tolerance)
        settings = calibration.Calibration(
            focal_length=options.fov_tolerance,
            principal=options.principal,
            k2=1.0 if options.distortion == "full" else 0.0,
            k1=0.0 if options.distortion == "none" else 1.0,
            tangential=0.01 if options.distortion == "full" else 0.0,
        )
        frames = [*map(terminal.image_reader(options), options.images)]
    indexes = PatternIndexes(terminal.read_stars(options.catalog, options.epoch))
    shapes = {frame.image.shape for frame in frames}
    if len(shapes) > 1:
        raise WrongUse(f"images must be of one camera, got sizes {sorted(shapes)}")
    camera = _start(options, frames, indexes, identification)
    if camera is None:
        return _unsolved(options, frames)
    fit, fitted = None, (list[Spots](), list[Matches]())
    for _ in range(ROUNDS):
        fitted = _solved(frames, camera, indexes, identification)
        if any(map(len, fitted[1])):
            fit = calibration.calibrate(*fitted, camera, settings)
            camera = fit.camera
        identification = replace(identification, focal_tolerance=shared.KNOWN)
    if fit is None:
        return _unsolved(options, frames)
    result, lines = _result(fit, len(frames))
    good = fit.frames == len(frames)
    if options.posterior:
        result["posterior"], more = _posterior(options, *fitted, frames, fit.camera)
        good, lines = good and result["posterior"]["converged"], [*lines, *more]
    _write(options, result, fit.camera)
    terminal.print_result(options, result, *lines)
    return Exit.DONE if good else Exit.UNSOLVED


def _write(options: argparse.Namespace, result: dict[str, Any], camera: Camera | None) -> None:
    """Write the files of --out and --camera."""
    if options.out:
        save_json(options.out, finite(result))
    if options.camera and camera:
        terminal.save_camera(options.camera, camera)


def _unsolved(options: argparse.Namespace, frames: list[Frame]) -> int:
    terminal.print_message("startrack calibrate: none of the images could be solved")
    terminal.print_result(options, {"status": "unsolved", "images": len(frames)}, "unsolved")
    return Exit.UNSOLVED


def _start(
    options: argparse.Namespace,
    frames: list[Frame],
    indexes: PatternIndexes,
    identification: Identification,
) -> Camera | None:
    """A camera that solves one of the images, with the given field or the field found in the
    image."""
    rows, columns = frames[0].image.shape
    if options.fov is None:
        hint = field_hint(options.images[0], (rows, columns))
    else:
        hint = math.radians(options.fov)
        if hint < WIDEST_PINHOLE:
            camera = Camera.from_field_of_view(columns, rows, hint)
            for frame in frames:
                if len(_solved([frame], camera, indexes, identification)[1][0]):
                    return camera
    for path, frame in zip(options.images, frames, strict=True):
        photo = solve_photograph(frame, indexes, identification, hint)
        if photo.axis is None:
            continue
        if photo.view != PhotographView():
            terminal.print_message(
                f"startrack calibrate: {path} is solved as {photo.view}; calibrate needs a "
                "camera of square pixels"
            )
            continue
        lens = photo.matches.camera
        if options.distortion == "none":
            lens = Camera(columns, rows, lens.focal_length_px)
        if photo.as_hinted is False:
            terminal.print_message(
                f"startrack calibrate: the field is {math.degrees(photo.field):.4g} deg, not the "
                "given one"
            )
        return replace(lens, polynomial=None)
    return None


def _solved(
    frames: list[Frame], camera: Camera, indexes: PatternIndexes, identification: Identification
) -> tuple[list[Spots], list[Matches]]:
    tracker = Tracker(Detection(), identification)
    answers = [lost_in_space(frame, camera, indexes, tracker) for frame in frames]
    return [spots for spots, _, _ in answers], [matches for _, matches, _ in answers]


def _posterior(
    options: argparse.Namespace,
    spots: list[Spots],
    matches: list[Matches],
    frames: list[Frame],
    camera: Camera,
) -> tuple[dict[str, Any], list[str]]:
    """Sample the camera; write posterior.json and corner.png if the chains converged."""
    prior = calibration.Prior(options.fov_tolerance, options.principal, 1.0, 1e-3, 3.0)
    terminal.print_message("startrack calibrate: sampling, some tens of seconds per image")
    with Ledger(options.posterior / "ledger.sqlite") as ledger:
        posterior = calibration.sample_camera(
            spots, matches, camera, prior, 0, ledger=ledger, images=frames
        )
    values, said = chain_values(posterior.chains), chain_text(posterior.chains)
    if not posterior.chains.converged:
        return values, [f"posterior: {said}"]
    values |= {
        "median_and_95": {name: posterior.interval(name) for name in posterior.names},
        "open": list(posterior.unconstrained),
        "correlation": posterior.correlation.tolist(),
    }
    save_json(options.posterior / "posterior.json", finite(values))
    labels = [
        name if name == "k1" else f"{name.removesuffix('_px')} (px)" for name in posterior.names
    ]
    title = f"camera of {len(frames)} images: {said}"
    plots.draw_corner(options.posterior / "corner.png", posterior.samples, labels, title)
    lines = ["", "posterior: median and 95 % interval"]
    for name in posterior.names:
        middle, low, high = posterior.interval(name)
        note = ", poorly constrained by these images" if name in posterior.unconstrained else ""
        lines.append(f"{name:16} {middle:12.6g} [{low:.6g}, {high:.6g}]{note}")
    return values, [*lines, said]


def _result(fit: calibration.Calibrated, images: int) -> tuple[dict[str, Any], list[str]]:
    """A camera from images: values for JSON, and lines."""
    camera, field = fit.camera, math.degrees(fit.camera.fov_x)
    sigma = dict(
        zip(calibration.UNKNOWNS, np.sqrt(fit.covariance.diagonal()).tolist(), strict=True)
    )
    fitted = {name: getattr(camera, name) for name in sigma}
    result = {
        "status": "calibrated",
        "images": images,
        "solved": fit.frames,
        "stars": fit.stars,
        "residual_rms_px": fit.residual_rms,
        "fov_x_deg": field,
        "camera": {"columns": camera.columns, "rows": camera.rows, **fitted},
        "sigma": sigma,
        "covariance": fit.covariance.tolist(),
    }
    lines = [
        f"{fit.frames} of {images} images, {fit.stars} stars, residual "
        f"{fit.residual_rms:.3f} px; field {field:.4f} deg"
    ]
    for name, value in fitted.items():
        error = f"+- {sigma[name]:.2g}" if sigma[name] else "not fitted"
        lines.append(f"{name:16} {value:12.5g} {error}")
    return result, lines


def _calibrate_table(options: argparse.Namespace) -> int:
    """Fit cameras of the requested orders, and print which order the stars support."""
    if len(options.images) != 1 or options.posterior:
        raise WrongUse("a table of stars must be given alone, and without --posterior")
    path: Path = options.images[0]
    if options.fitted:
        return _as_fitted(options, path)
    with shared.as_wrong_use(ValueError, OSError):
        table = _read(options, path)
        columns, rows, first = _array(options, table)
        orders = calibration.orders_of(
            table, options.distortion or "auto", WARM[options.temperature_terms]
        )
        with terminal.progress("cross-validation", len(orders)) as advance:
            tried = calibration.cross_validate_all(
                table, orders, columns, rows, first, options.folds, advance
            )
        chosen = calibration.supported_order(tried)
        fit = calibration.fit_field(table, chosen.order, columns, rows, first)
    unseen_by = [_unseen(table, unseen) for unseen in tried]
    best = next(row for row, unseen in zip(unseen_by, tried, strict=True) if unseen is chosen)
    result = _fit_values(path, table, fit, first) | {
        "chosen": {name: best[name] for name in ORDER},
        "unseen_rms_px": best["unseen_rms_px"],
        "unseen_rms_arcsec": best["unseen_rms_arcsec"],
        "orders": unseen_by,
    }
    _write(options, result, fit.camera)
    if options.size is None:
        terminal.print_message(
            f"startrack calibrate: without --size, an array of {columns} x {rows} pixels is "
            f"assumed; its first pixel's centre is ({first[0]:g}, {first[1]:g}) in the table"
        )
    terminal.print_result(options, result, *_table_text(result, tried, chosen))
    return Exit.DONE


def _as_fitted(options: argparse.Namespace, path: Path) -> int:
    """Residuals of a table from a camera that was fitted to another table."""
    if options.camera or options.distortion:
        raise WrongUse("--fitted must come without --camera and --distortion: it fits no camera")
    camera = terminal.read_camera(options.fitted)
    with shared.as_wrong_use(ValueError, OSError):
        table = _read(options, path)
        columns, rows, first = _array(options, table)
        if options.size is None:
            # Coordinates from the middle or from the first pixel of the camera's array.
            middle = ((1 - camera.columns) / 2, (1 - camera.rows) / 2)
            first = middle if first != (0.0, 0.0) else first
        elif (columns, rows) != (camera.columns, camera.rows):
            raise ValueError(
                f"--size must be the camera's {camera.columns},{camera.rows}, got {columns},{rows}"
            )
        fit = calibration.fit_attitude(table, camera, first)
    values = _fit_values(path, table, fit, first) | {"camera_file": str(options.fitted)}
    _write(options, values, None)
    terminal.print_result(options, values, *_residual_text(values))
    return Exit.DONE


def _residual_text(values: dict[str, Any]) -> list[str]:
    lines = [
        f"{values['stars']} stars, {values['outliers']} beyond {calibration.OUTLIER:g} sigma "
        f"left out; camera as given: residual {values['residual_rms_px']:.4f} px",
        f"{'residual, arcsec':20} {'rms':>9} {'median':>9} {'worst':>9}",
    ]
    for axis, rms in values["residual_rms_arcsec"].items():
        middle, worst = (values[f"residual_{name}_arcsec"][axis] for name in ("median", "worst"))
        lines.append(f"{axis:20} {rms:9.3f} {middle:9.3f} {worst:9.3f}")
    return lines


def _read(options: argparse.Namespace, path: Path) -> calibration.StarTable:
    """A table of stars; columns that might have been meant instead are printed."""
    table = calibration.read_star_table(path, _names(options))
    if table.unused:
        terminal.print_message(
            f"startrack calibrate: {path} is read by its columns "
            f"{', '.join(table.columns.values())}, and not by {', '.join(table.unused)}; "
            "--directions, --pixels, --temperature and --weight choose"
        )
    return table


def _names(options: argparse.Namespace) -> calibration.Names:
    def listed(text: str | None) -> tuple[str, ...]:
        return tuple(name.strip() for name in text.split(",")) if text else ()

    return calibration.Names(
        listed(options.directions),
        options.directions_are,
        listed(options.pixels),
        options.temperature,
        options.weight,
    )


def _array(
    options: argparse.Namespace, table: calibration.StarTable
) -> tuple[int, int, tuple[float, float]]:
    """Columns, rows and the place of the first pixel's centre in the table."""
    if options.size is None:
        if options.first_pixel is not None:
            raise ValueError("--first-pixel must come with --size")
        return calibration.assumed_array(table)
    size = _pair(options.size, "--size")
    for number in size:
        if not (number.is_integer() and 1 <= number <= 2**20):
            raise ValueError(f"--size must be whole numbers from 1 to 1048576, got {number:g}")
    first = _pair("0,0" if options.first_pixel is None else options.first_pixel, "--first-pixel")
    beyond = np.maximum(first - table.pixel, table.pixel - first - np.subtract(size, 1))
    star = int(beyond.max(axis=1).argmax())
    if beyond[star].max() > OUTSIDE:
        x, y = table.pixel[star]
        raise ValueError(
            f"--size must hold all stars of the table, got {options.size} with the first pixel at "
            f"{first[0]:g},{first[1]:g} and a star at {x:g},{y:g}"
        )
    return int(size[0]), int(size[1]), first


def _pair(text: str, name: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.replace("x", ",").split(","))
        if math.isfinite(first + second):
            return first, second
    except ValueError:
        pass
    raise ValueError(f"{name} must be two numbers such as 1024,1024, got {text!r}")


def _fit_values(
    path: Path, table: calibration.StarTable, fit: calibration.FieldFit, first: tuple[float, float]
) -> dict[str, Any]:
    camera, used = fit.camera, fit.used
    shown = asdict(camera.polynomial) if camera.polynomial else None
    if shown:
        shown |= {f"{name}_k": shown.pop(name) for name in ("temperature", "reference")}
    angle = calibration.residuals(fit, table, first)[0][used]
    return {
        "status": "calibrated",
        "table": str(path),
        "stars": len(table),
        "rows_left_out": table.left_out,
        "outliers": int((~used).sum()),
        "columns_used": dict(table.columns),
        "columns_unused": list(table.unused),
        "first_pixel": list(first),
        "camera": {name: getattr(camera, name) for name in PINHOLE} | {"polynomial": shown},
        "table_to_camera_xyzw": [float(x) for x in fit.attitude.as_quat(canonical=True)],
        "fov_x_deg": math.degrees(camera.fov_x),
        "names": list(fit.names),
        "sigma": dict(zip(fit.names, np.sqrt(fit.covariance.diagonal()).tolist(), strict=True)),
        "covariance": fit.covariance.tolist(),
        "residual_rms_px": float(_rms(fit.residual[used].ravel())),
        "residual_rms_arcsec": _by_axis(table, _rms(angle)),
        "residual_median_arcsec": _by_axis(table, np.median(np.abs(angle), axis=0)),
        "residual_worst_arcsec": _by_axis(table, np.abs(angle).max(axis=0)),
    }


def _unseen(table: calibration.StarTable, unseen: calibration.Unseen) -> dict[str, Any]:
    order, rms = unseen.order, math.sqrt(unseen.mean_square)
    return {
        "name": str(order),
        "distortion": order.model,
        "temperature_terms": "linear" if order.warm else "none",
        "unknowns": order.unknowns,
        "unseen_rms_arcsec": _by_axis(table, unseen.rms),
        "unseen_rms_px": rms,
        "unseen_rms_px_sigma": unseen.standard_error / (2 * rms),
        "outliers": int((~unseen.inlier).sum()),
        "unseen_rms_arcsec_with_outliers": _by_axis(table, _rms(unseen.angle)),
    }


def _by_axis(table: calibration.StarTable, values: np.ndarray) -> dict[str, float]:
    axes = ANGLES.get(table.kind, ("ra_cos_dec", "dec"))
    return dict(zip(axes, (values / arcsec).tolist(), strict=True))


def _rms(values: np.ndarray) -> np.ndarray:
    """Root mean square of each column."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _table_text(
    result: dict[str, Any], tried: tuple[calibration.Unseen, ...], chosen: calibration.Unseen
) -> list[str]:
    camera = result["camera"]
    first, second = result["unseen_rms_arcsec"]
    lines = [
        f"{result['stars']} stars, {result['outliers']} beyond {calibration.OUTLIER:g} sigma left "
        f"out; {result['chosen']['name']}: residual {result['residual_rms_px']:.4f} px",
        f"focal length {camera['focal_length_px']:.3f} px, field {result['fov_x_deg']:.4f} deg",
        "",
        f"on stars outside the fit   {first:>9} arcsec {second:>11} arcsec   px",
    ]
    for unseen, values in zip(tried, result["orders"], strict=True):
        across, down = values["unseen_rms_arcsec"].values()
        mark = "  <- selected" if unseen is chosen else ""
        lines.append(
            f"{values['name']:44} {across:9.3f} {down:18.3f} {values['unseen_rms_px']:8.4f}{mark}"
        )
    return lines
