"""Figures of earth_sensors.py -> the page and the pictures on Earth cameras that are in orbit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from startrack.io import save_text
from startrack.plots import BLUE, GREY, RED, legend_below, picture, save_picture, styled

NEEDED = (
    "snr",
    "nedt",
    "mtf",
    "saturation",
    "gsd",
    "bands",
    "bands_between",
    "sun_band_error",
    "sun_band_error_of_all",
)
BEFORE = Path(__file__).parents[1] / "docs/figures/earth-cameras-before.json"
NAMES = {
    "sentinel2-msi": "Sentinel-2, MSI",
    "landsat8-oli": "Landsat 8, OLI",
    "landsat8-tirs": "Landsat 8, TIRS",
}
TEMPLATE = Path(__file__).with_name("earth_page.md")


def text_of(found: dict[str, Any], told: dict[str, Any], before: dict[str, Any]) -> str:
    """The page: results, outside values, and the first prediction."""
    later = [told["sentinel2-msi"]["bands"][band] for band in found["snr"]["sentinel2-msi"]]
    mine = [row[1] for row in found["snr"]["sentinel2-msi"].values()]
    between_2c = sum(
        one["snr_required"] <= value <= one["snr_measured_2c"]
        for one, value in zip(later, mine, strict=True)
    )
    first = sum(
        min(row[0], row[2]) <= before[camera][band] <= max(row[0], row[2])
        for kind in ("snr", "nedt")
        for camera, bands in found[kind].items()
        for band, row in bands.items()
    )
    return TEMPLATE.read_text(encoding="utf-8").format(
        between=found["bands_between"],
        bands=found["bands"],
        between_first=first,
        between_2c=between_2c,
        sun=100 * found["sun_band_error"],
        sun_all=100 * found["sun_band_error_of_all"],
        msi=_snr(found, told, before, "sentinel2-msi", "snr_measured_2c"),
        oli=_snr(found, told, before, "landsat8-oli"),
        tirs=_nedt(found, before),
        other=_other(found),
    )


def _snr(
    found: dict[str, Any],
    told: dict[str, Any],
    before: dict[str, Any],
    camera: str,
    later: str = "",
) -> str:
    """Rows of a camera; bold if the value is not between required and measured."""
    more = " measured, 2C |" if later else ""
    lines = [
        f"| band | radiance | required | first | predicted | measured{', 2A' * bool(later)} |"
        + more,
        "|---" * (6 + bool(later)) + "|",
    ]
    for band, (required, value, measured) in found["snr"][camera].items():
        one = told[camera]["bands"][band]
        outside = not required <= value <= measured
        shown = f"**{value:.0f}**" if outside else f"{value:.0f}"
        lines.append(
            f"| {band} | {one['radiance']:g} | {required:g} | {before[camera][band]:.0f} | {shown} "
            f"| {measured:g} |" + (f" {one[later]} |" if later else "")
        )
    return "\n".join(lines)


def _nedt(found: dict[str, Any], before: dict[str, Any]) -> str:
    lines = [
        "| band | required, mK at 300 K | first and predicted | measured |",
        "|---|---|---|---|",
    ]
    for band, (required, value, measured) in found["nedt"]["landsat8-tirs"].items():
        assert abs(value / before["landsat8-tirs"][band] - 1) < 1e-3
        lines.append(
            f"| {band} | {1e3 * required:.0f} | {1e3 * value:.0f} | {1e3 * measured:.0f} |"
        )
    return "\n".join(lines)


def _other(found: dict[str, Any]) -> str:
    lines = [
        "| band | saturation: predicted | required | measured | MTF: predicted | required "
        "| step, m: predicted | required |",
        "|---" * 8 + "|",
    ]
    for camera, bands in found["gsd"].items():
        for band, step in bands.items():
            full, mtf = (
                found[kind].get(camera, {}).get(band, [None] * 3) for kind in ("saturation", "mtf")
            )
            cells = [full[1], full[0], full[2], mtf[1], mtf[0], step[1], step[0]]
            texts = ["" if cell is None else f"{cell:.4g}" for cell in cells]
            lines.append(f"| {NAMES[camera]} {band} | {' | '.join(texts)} |")
    return "\n".join(lines)


def write_page(folder: Path, found: dict[str, Any], told: dict[str, Any]) -> None:
    """Write earth-cameras.md and earth-cameras.png."""
    before = json.loads(BEFORE.read_text(encoding="utf-8"))
    save_text(folder / "earth-cameras.md", text_of(found, told, before))
    draw(folder / "earth-cameras.png", found, before)


@styled
def draw(path: Path, found: dict[str, Any], before: dict[str, Any]) -> None:
    """SNR and NEdT of each band over the bands, with required and measured marks."""
    figure = picture(7.4, "Earth cameras: predicted beside required and measured in orbit")
    panels = figure.subplots(3, 1)
    for axes, (camera, name) in zip(panels, NAMES.items(), strict=True):
        kind, scale = ("nedt", 1e3) if camera in found["nedt"] else ("snr", 1.0)
        rows = found[kind][camera]
        _marks(axes, rows, [before[camera][band] for band in rows], scale)
        axes.set_title(name)
        axes.set_ylabel("NEdT, mK at 300 K" if kind == "nedt" else "SNR")
    legend_below(panels[-1], 4)
    save_picture(path, figure)


def _marks(axes: Axes, rows: dict[str, list[float]], first: list[float], scale: float) -> None:
    at = np.arange(len(rows))
    required, value, measured = scale * np.array(list(rows.values()), float).T
    axes.vlines(at, required, measured, color=GREY, linewidth=6, alpha=0.25)
    axes.scatter(at, required, marker="_", s=160, linewidth=2, color=RED, label="required")
    axes.scatter(
        at, scale * np.array(first), marker="x", s=28, color=GREY, label="first prediction"
    )
    axes.scatter(at, value, marker="o", s=30, color=BLUE, zorder=3, label="predicted")
    axes.scatter(at, measured, marker="_", s=160, linewidth=2, color="black", label="measured")
    axes.set_xticks(at, list(rows))
    axes.set_xlim(-0.6, len(rows) - 0.4)
    axes.set_yscale("log")
