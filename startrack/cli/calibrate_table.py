"""Tables in `startrack calibrate`: the camera of a table of stars, and the order that it bears."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from startrack.calibration import (
    OUTLIER,
    FieldFit,
    Names,
    Order,
    StarTable,
    Unseen,
    assumed_array,
    borne,
    cross_validate_all,
    fit_field,
    orders_of,
    read_star_table,
    residuals,
)
from startrack.cli.options import Exit, WrongUse, as_wrong_use
from startrack.cli.terminal import finite, print_message, print_result, progress, save_camera
from startrack.core import arcsec
from startrack.io import save_json

ANGLES = {"yz": ("y_angle", "z_angle"), "xy": ("x_angle", "y_angle")}
WARM = {"auto": None, "none": False, "linear": True}


def calibrate_table(options: argparse.Namespace) -> int:
    """Fit cameras of the orders that are asked for, and print what stars bear them out."""
    if len(options.images) != 1 or options.posterior:
        raise WrongUse("a table of stars must be given alone, and without --posterior")
    path: Path = options.images[0]
    with as_wrong_use(ValueError, OSError):
        table = read_star_table(path, _names(options))
        columns, rows, first = _array(options, table)
        orders = orders_of(table, _model(options), WARM[options.temperature_terms])
        with progress("cross-validation", len(orders)) as advance:
            found = cross_validate_all(table, orders, columns, rows, first, options.folds, advance)
        chosen = borne(found)
        fit = fit_field(table, chosen.order, columns, rows, first)
    result = _values(path, table, found, chosen, fit, first)
    if options.out:
        save_json(options.out, finite(result))
    if options.camera:
        save_camera(options.camera, fit.camera)
    if options.size is None:
        print_message(
            f"startrack calibrate: no --size, so that an array of {columns} x {rows} pixels is "
            f"assumed, whose first pixel's centre is ({first[0]:g}, {first[1]:g}) in the table"
        )
    print_result(options, result, _text(result, found, chosen))
    return Exit.DONE


def _names(options: argparse.Namespace) -> Names:
    def listed(text: str | None) -> tuple[str, ...]:
        return tuple(one.strip() for one in text.split(",")) if text else ()

    return Names(
        listed(options.directions), options.directions_are, listed(options.pixels),
        options.temperature, options.weight,
    )  # fmt: skip


def _model(options: argparse.Namespace) -> str:
    return options.distortion or "auto"


def _array(options: argparse.Namespace, table: StarTable) -> tuple[int, int, tuple[float, float]]:
    """Columns, rows and the place of the first pixel's centre in the table."""
    if options.size is None:
        if options.first_pixel is not None:
            raise ValueError("--first-pixel must come with --size")
        return assumed_array(table)
    columns, rows = (_whole(one) for one in _pair(options.size, "--size"))
    first = (
        (0.0, 0.0) if options.first_pixel is None else _pair(options.first_pixel, "--first-pixel")
    )
    return columns, rows, first


def _pair(text: str, name: str) -> tuple[float, float]:
    try:
        first, second = (float(one) for one in text.replace("x", ",").split(","))
        if math.isfinite(first + second):
            return first, second
    except ValueError:
        pass
    raise ValueError(f"{name} must be two numbers such as 1024,1024, got {text!r}")


def _whole(number: float) -> int:
    if not (number.is_integer() and 1 <= number <= 2**20):
        raise ValueError(f"--size must be whole numbers from 1 to 1048576, got {number:g}")
    return int(number)


def _axes(table: StarTable) -> tuple[str, str]:
    return ANGLES.get(table.kind, ("ra_cos_dec", "dec"))


def _values(
    path: Path, table: StarTable, found: tuple[Unseen, ...], chosen: Unseen, fit: FieldFit,
    first: tuple[float, float],
) -> dict[str, Any]:  # fmt: skip
    camera = fit.camera
    angle, _ = residuals(fit, table, first)
    used = fit.used
    result: dict[str, Any] = {
        "status": "calibrated",
        "table": str(path),
        "stars": len(table),
        "rows_left_out": table.left_out,
        "outliers": int((~used).sum()),
        "columns_used": dict(table.columns),
        "first_pixel": list(first),
        "chosen": _order(chosen.order),
        "camera": {
            "columns": camera.columns,
            "rows": camera.rows,
            "focal_length_px": camera.focal_length_px,
            **{name: getattr(camera, name) for name in ("k1", "k2", "p1", "p2")},
            "polynomial": None,
        },
        "table_to_camera_xyzw": [float(x) for x in fit.attitude.as_quat(canonical=True)],
        "fov_x_deg": math.degrees(camera.fov_x),
        "names": list(fit.names),
        "sigma": dict(zip(fit.names, np.sqrt(fit.covariance.diagonal()).tolist(), strict=True)),
        "covariance": fit.covariance.tolist(),
        "residual_rms_px": _rms(fit.residual[used].ravel()),
        "residual_rms_arcsec": _by_axis(table, _columns_rms(angle[used])),
        "unseen_rms_px": math.sqrt(chosen.mean_square),
        "unseen_rms_arcsec": _by_axis(table, chosen.rms),
        "orders": [_unseen(table, one) for one in found],
    }
    if camera.polynomial is not None:
        shown = camera.polynomial
        result["camera"]["polynomial"] = {
            "x": list(shown.x),
            "y": list(shown.y),
            "x_per_kelvin": list(shown.x_per_kelvin),
            "y_per_kelvin": list(shown.y_per_kelvin),
            "temperature_k": shown.temperature,
            "reference_k": shown.reference,
        }
    return result


def _order(order: Order) -> dict[str, Any]:
    return {
        "name": str(order), "distortion": order.model,
        "temperature_terms": "linear" if order.warm else "none", "unknowns": order.unknowns,
    }  # fmt: skip


def _unseen(table: StarTable, one: Unseen) -> dict[str, Any]:
    return {
        **_order(one.order),
        "unseen_rms_arcsec": _by_axis(table, one.rms),
        "unseen_rms_px": math.sqrt(one.mean_square),
        "unseen_rms_px_sigma": one.standard_error / (2 * math.sqrt(one.mean_square)),
        "outliers": int((~one.inlier).sum()),
        "unseen_rms_arcsec_with_outliers": _by_axis(table, _columns_rms(one.angle)),
    }


def _by_axis(table: StarTable, values: np.ndarray) -> dict[str, float]:
    return dict(zip(_axes(table), (values / arcsec).tolist(), strict=True))


def _columns_rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _rms(values: np.ndarray) -> float:
    return math.sqrt(float(np.mean(values**2)))


def _text(result: dict[str, Any], found: tuple[Unseen, ...], chosen: Unseen) -> str:
    camera = result["camera"]
    first, second = result["unseen_rms_arcsec"]
    lines = [
        f"{result['stars']} stars, {result['outliers']} beyond {OUTLIER:g} sigma left out; "
        f"{result['chosen']['name']}: residual {result['residual_rms_px']:.4f} px",
        f"focal length {camera['focal_length_px']:.3f} px, field {result['fov_x_deg']:.4f} deg",
        "",
        f"on stars that the fit has not seen   {first:>9} arcsec {second:>11} arcsec   px",
    ]
    for one, values in zip(found, result["orders"], strict=True):
        across, down = values["unseen_rms_arcsec"].values()
        mark = "  <- borne by the stars" if one is chosen else ""
        lines.append(
            f"{values['name']:44} {across:9.3f} {down:18.3f} {values['unseen_rms_px']:8.4f}{mark}"
        )
    return "\n".join(lines)
