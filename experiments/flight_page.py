"""Writes and draws for chandra.py: the page on the flight of Chandra's aspect camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from startrack.io import save_text
from startrack.plots import CYCLE, LINES, MARKERS, legend_below, picture, save_picture, styled

DIGITS = (2, 2, 3, 3, 3)  # of the sizes along and across, and of three misfits
TEMPLATE = Path(__file__).with_name("flight_page.md")


def text_of(a: dict[str, Any], b: dict[str, Any]) -> str:
    """The page.

    a  present results
    b  results of the first run
    """
    table = a["acquisition_rows"]
    bounds = {(row[0], row[1]): row[2:] for row in a["raw_rows"]}
    levels = a["raw_fid_levels"]
    return TEMPLATE.read_text(encoding="utf-8").format(
        a=a,
        b=b,
        source=a["source"],
        dark_before=100 * b["dark_bins_worst"],
        dark_after=100 * a["dark_bins_worst"],
        warm_before=100 * b["warm_share_worst"],
        warm_after=100 * a["warm_share_worst"],
        psf_before=100 * b["psf_worst"],
        psf_after=100 * a["psf_worst"],
        psf_median=100 * a["psf_median"],
        acquisitions=len(table),
        bench_rows="\n".join(
            f"| {name} | {100 * a[key + '_within_0_1']:.0f} % "
            f"| {100 * a[key + '_within_0_05']:.0f} % "
            f"| {a[key + '_mean']:+.3f} | {a[key + '_rms']:.3f} |"
            for name, key in (
                ('7", as in flight', "bench_as_flown"),
                ('2", chosen on these cells', "bench"),
            )
        ),
        hits=a["hits_counted"][0],
        quarter=a["hits_counted"][1],
        hits_spread=100 * a["hits_spread"][0],
        quarter_spread=100 * a["hits_spread"][1],
        fid_clipped=" and ".join(f"{abs(row[1]):.2f}" for row in levels),
        fid_middle=" and ".join(f"{row[2]:.1f}" for row in levels),
        **_stars(bounds),
        **_images(bounds),
        total_low=bounds["s4", "total"][4] / bounds["s4", "total"][0],
        total_high=bounds["s4", "total"][5] / bounds["s4", "total"][0],
        foreseen_rows="\n".join(
            f"| {int(year)} | {celsius:.0f} | " + " | ".join(f"{one:.2f}" for one in found) + " |"
            for year, celsius, *found in a["foreseen_rows"]
        ),
        counting_0_1=100 * a["bench_counting_0_1"],
        counting_0_05=100 * a["bench_counting_0_05"],
        bench_cells=len(a["bench_rows"]),
        within_before=100 * b["acquisition_within"],
        within_after=100 * a["acquisition_within"],
        interval=100 * a["camera_interval"],
        stars=min(row[6] for row in table),
        camera_rows="\n".join(
            f'| {name} | {unknowns} | {y:.3f}" | {z:.3f}" |'
            for name, unknowns, y, z in a["camera_orders"]
        ),
        dark_rows="\n".join(
            f"| {year:.0f} | {celsius:.0f} | {100 * off:.1f} % | {100 * share:+.2f} % "
            f"| {chance:.2f} |"
            for year, celsius, off, share, chance in a["dark_rows"]
        ),
        flicker_rows="\n".join(
            f"| {low} to {high} | {off:.3f} |" if high < 1e5 else f"| above {low} | {off:.3f} |"
            for low, high, off in a["flicker_rows"]
        ),
        acquisition_tables="\n\n".join(_acquisition(table, half) for half in (60, 120)),
        centroid_rows=_centroids(a["centroid_rows"]),
        centroid_years="\n".join(_residuals(*row) for row in a["centroid_years"]),
        centroid_stars=a["centroid_years"][0][-2],
        early_rows="\n".join(
            f"| {year:.2f} | {seen} | {law:.0f} | {law / seen:.2f} |"
            for year, seen, law in a["dark_early"]
        ),
        part_rows="\n".join(
            _background(star, parts, bounds) for star, *parts in a["raw_background_parts"]
        ),
        scatter_rows=_scatter(a["raw_scatter"]),
        growth_rows="\n".join(
            f"| {star} | {angle:.2f} | "
            + " | ".join(f"{value:.{digits}f}" for value, digits in zip(fit, DIGITS, strict=True))
            + " |"
            for star, angle, *fit in a["growth_rows"]
        ),
        corner=a["growth_corner"],
        drift_rows="\n".join(
            f"| {axis} | {trend:g} | {scale:g} | {jumps} | {rms:.1f} |"
            for axis, trend, scale, jumps, rms in a["drift_rows"]
        ),
    )


def _centroids(rows: list[list[float]]) -> str:
    """A line for each magnitude: with the last map and without any, of both years."""
    lines = []
    for magnitude in sorted({row[1] for row in rows}):
        cells = [f"{row[k]:.3f}" for row in rows if row[1] == magnitude for k in (2, 3, 4)]
        lines.append(f"| {magnitude:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _residuals(
    year: float,
    calibrated: float,
    published: float,
    last: float,
    none: float,
    perfect: float,
    least: float,
    best: float,
    stars: int,
    spread: float,
) -> str:
    predicted = f'{last:.3f}" +- {spread:.3f} | {last / published:.2f}'
    return (
        f'| {year:.1f} | {calibrated:.1f} | {published:.3f}" | {predicted} | {none:.3f}" '
        f'| {perfect:.3f}" | {least:.3f}" | {best:.3f}" |'
    )


def _background(star: str, parts: list[float], bounds: dict[tuple[str, str], list[float]]) -> str:
    seen, _, _, median, low, high = bounds[star, "background"]
    rest = median - sum(parts)
    cells = " | ".join(f"{part:.1f}" for part in [*parts, rest, median])
    return f"| {star} | {cells} | {low:.0f} to {high:.0f} | {seen:.1f} |"


def _scatter(rows: list[list[Any]]) -> str:
    lines = []
    for star, *both in rows:
        for name, values in zip(("measured", "predicted"), both, strict=True):
            cells = " | ".join(f"{value:.4f}" for value in values)
            lines.append(f"| {star}, {name} | {cells} |")
    return "\n".join(lines)


def _images(bounds: dict[tuple[str, str], list[float]]) -> dict[str, str]:
    """Differences of the image of both stars, and the prediction for a further device."""
    found = {}
    for star in ("s4", "s5"):
        seen, _, _, median, _, high = bounds[star, "image"]
        found[f"{star}_image"] = f"{seen:.3f}"
        found[f"{star}_image_predicted"] = f"{median:.3f} in the median, up to {high:.3f}"
    return found


def _stars(bounds: dict[tuple[str, str], list[float]]) -> dict[str, Any]:
    """Backgrounds and offsets of both stars, in flight and with a further detector; digital
    numbers."""
    found: dict[str, Any] = {}
    for star in ("s4", "s5"):
        seen, *_, low, high = bounds[star, "background"]
        offset, _, top = bounds[star, "offset"][:3]
        found |= {
            f"{star}_background": f"{low:.0f} to {high:.0f} numbers",
            f"{star}_seen": seen,
            f"{star}_offset": offset,
            f"{star}_offset_error": top - offset,
        }
    return found


def _acquisition(rows: list[list[float]], half: int) -> str:
    mine = [row for row in rows if row[2] == half]
    magnitudes = sorted({row[0] for row in mine})
    lines = [
        f'Half width {half}", predicted (flown):',
        "",
        "| degC | " + " | ".join(f"{one:g} mag" for one in magnitudes) + " |",
        "|---" * (len(magnitudes) + 1) + "|",
    ]
    for celsius in sorted({row[1] for row in mine}):
        cells = []
        for magnitude in magnitudes:
            row = next(one for one in mine if one[0] == magnitude and one[1] == celsius)
            text = f"{row[4]:.2f} ({row[3]:.2f})"
            cells.append(f"**{text}**" if abs(row[4] - row[3]) > 0.05 else text)
        lines.append(f"| {celsius} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", "Bold: off by more than 0.05."])


def write_page(folder: Path, found: dict[str, Any]) -> None:
    """Write flight.md beside what the first run found (flight-before.json)."""
    before = Path(__file__).parents[1] / "docs/figures/flight-before.json"
    text = text_of(found, json.loads(before.read_text(encoding="utf-8")))
    save_text(folder / "flight.md", text)


@styled
def draw(path: Path, found: dict[str, Any]) -> None:
    """Predicted (lines) and measured (points): dark current, flicker, acquisition, centroids."""
    figure = picture(11.0, "Chandra's aspect camera: predicted (lines) and flown (points)")
    panels = figure.subplots(4, 1)
    _dark(panels[0], found)
    _flicker(panels[1], found)
    _probability(panels[2], found)
    _centroid(panels[3], found)
    save_picture(path, figure)


def _pair(axes: Axes, n: int, label: str, predicted: Any, flown: Any) -> None:
    """A predicted line and its flown points, in one colour, dashes and marker."""
    colour, line, marker = (each[n % len(each)] for each in (CYCLE, LINES, MARKERS))
    axes.plot(*predicted, color=colour, ls=line, label=label)
    axes.plot(*flown, ls="none", color=colour, marker=marker, markersize=3)


def _dark(axes: Axes, found: dict[str, Any]) -> None:
    for n, (row, (edges, flown, law)) in enumerate(
        zip(found["dark_rows"], found["dark_curves"], strict=True)
    ):
        _pair(axes, n, f"{row[0]:.0f}, {row[1]:.0f} °C", (edges, law), (edges[::2], flown[::2]))
    axes.set(xscale="log", yscale="log", xlabel="dark current, electron / s")
    axes.set_ylabel("pixels in a bin")
    legend_below(axes)


def _flicker(axes: Axes, found: dict[str, Any]) -> None:
    for n, (row, (step, flown, drawn)) in enumerate(
        list(zip(found["flicker_rows"], found["flicker_curves"], strict=True))[::4]
    ):
        low, high = row[0], row[1]
        name = f"{low} to {high} e-/s" if high < 1e5 else f"above {low} e-/s"
        _pair(axes, n, name, (step, drawn), (step[::3], flown[::3]))
    axes.set(xlabel="jump of a flickering pixel, decades", ylabel="cumulative probability")
    legend_below(axes)


def _probability(axes: Axes, found: dict[str, Any]) -> None:
    chosen = [(60, -11), (60, -4), (60, 0), (120, -4), (120, 0)]
    for n, (half, celsius) in enumerate(chosen):
        mine = [row for row in found["acquisition_rows"] if (row[2], row[1]) == (half, celsius)]
        if mine:
            magnitude, flown, predicted = np.array([(row[0], row[3], row[4]) for row in mine]).T
            label = f"{half} arcsec, {celsius} °C"
            _pair(axes, n, label, (magnitude, predicted), (magnitude, flown))
    axes.set(xlabel="magnitude", ylabel="probability of acquisition", ylim=(0, 1.02))
    legend_below(axes)


def _centroid(axes: Axes, found: dict[str, Any]) -> None:
    """Errors over the magnitude for both years: with the last dark map, and without a map."""
    for n, row in enumerate(found["centroid_years"]):
        year, published = row[0], row[2]
        rows = [one for one in found["centroid_rows"] if one[0] == year]
        magnitude, last, none, _ = np.array(rows).T[1:]
        for k, (values, name) in enumerate(((last, "last dark map"), (none, "no dark map"))):
            line = LINES[2 * n + k]
            axes.plot(
                magnitude, values, color=CYCLE[2 * n + k], ls=line, label=f"{year:.0f}, {name}"
            )
        axes.plot(
            magnitude.mean(),
            published,
            ls="none",
            color=CYCLE[2 * n],
            marker=MARKERS[n],
            markersize=4,
            label=f"{year:.0f}, flown mean",
        )
    axes.set(xlabel="magnitude", ylabel="centroid, arcsec rms", ylim=(0, None))
    legend_below(axes)
