"""Pictures of frames, solutions and errors."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Frame, Matches, Spots, Stars, arcsec
from startrack.io import celestial, save_figure
from startrack.metrics import Interval, summarise

FOUND, LOST, KNOWN = "#4cc38a", "#f2a65a", "#7ab8ff"
LABELS = 12  # brightest stars that get their magnitude written beside them


def draw_frame(path: Path, frame: Frame, title: str = "") -> None:
    """The image with a non-linear scale that shows faint stars."""
    figure, axes = _image(frame)
    axes.set_title(title, fontsize=9, loc="left")
    save_figure(path, figure)


def draw_spots(path: Path, frame: Frame, spots: Spots, title: str) -> None:
    """The image with a ring about each spot, the brightest numbered as in the table."""
    figure, axes = _image(frame)
    axes.scatter(spots.x, spots.y, s=90, facecolors="none", edgecolors=FOUND, linewidths=1.0)
    for number in range(min(len(spots), LABELS)):
        place = float(spots.x[number]), float(spots.y[number])
        axes.annotate(
            str(number + 1), place, (7, 5), textcoords="offset points", color=KNOWN, fontsize=7
        )
    axes.set_title(title, fontsize=9, loc="left")
    save_figure(path, figure)


def draw_solution(
    path: Path,
    frame: Frame,
    spots: Spots,
    matches: Matches,
    icrs_to_camera: Rotation | None,
    stars: Stars,
    title: str,
) -> None:
    """The image with its spots, matched and not, and stars of the catalogue."""
    figure, axes = _image(frame)
    matched = np.zeros(len(spots), bool)
    matched[matches.spot] = True
    rings: dict[str, Any] = {"s": 90, "facecolors": "none", "linewidths": 1.0}
    axes.scatter(
        spots.x[matched], spots.y[matched], edgecolors=FOUND, label="spot, matched", **rings
    )
    axes.scatter(
        spots.x[~matched], spots.y[~matched], edgecolors=LOST, label="spot, not matched", **rings
    )
    if icrs_to_camera is not None:
        pixel, magnitude = _predicted(matches.camera, icrs_to_camera, stars, 2 * len(spots) + 10)
        axes.scatter(
            pixel[:, 0],
            pixel[:, 1],
            marker="+",
            s=25,
            c=KNOWN,
            linewidths=0.8,
            label="catalogue star",
        )
        for (x, y), g in list(zip(pixel, magnitude, strict=True))[:LABELS]:
            label = f"G {g:.1f}"
            beside: dict[str, Any] = {
                "xytext": (7, 5),
                "textcoords": "offset points",
                "clip_on": True,
            }
            axes.annotate(label, (x, y), color=KNOWN, fontsize=7, **beside)
        _north(axes, matches.camera, icrs_to_camera)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=3, frameon=False, fontsize=8)
    axes.set_title(title, fontsize=9, loc="left")
    save_figure(path, figure)


def draw_errors(path: Path, outcomes: NDArray[np.void], title: str) -> None:
    """The errors of many trials: across the boresight as points, about it as a histogram."""
    correct = outcomes[outcomes["solved"] & ~outcomes["false"]]
    summary = summarise(outcomes)
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    across, about = figure.subplots(1, 2)
    x, y, z = (correct[f"error_{axis}"] / arcsec for axis in "xyz")
    across.plot(x, y, ".", ms=3, alpha=0.5, color="#3567a8")
    if len(correct):
        turn = np.linspace(0, 2 * np.pi, 200)
        radius = summary.across.value / arcsec
        across.plot(radius * np.cos(turn), radius * np.sin(turn), color="#c0392b", lw=1,
                    label=f"rms per axis {_interval_text(summary.across)}")  # fmt: skip
        across.legend(fontsize=8)
        about.hist(z, 40, color="#3567a8", label=f"rms {_interval_text(summary.about)}")
        about.legend(fontsize=8)
    across.set_aspect("equal", "datalim")
    across.set(xlabel="error about the x axis (arcsec)", ylabel="error about the y axis (arcsec)")
    across.set_title("across the boresight", fontsize=9)
    about.set(xlabel="error about the boresight (arcsec)", ylabel="trials")
    about.set_title("about the boresight", fontsize=9)
    fraction = summary.availability
    figure.suptitle(
        f"{title}: {summary.trials} trials, availability {100 * fraction.value:.1f} % "
        f"[{100 * fraction.low:.1f}, {100 * fraction.high:.1f}]",
        fontsize=10,
    )
    save_figure(path, figure)


def _image(frame: Frame) -> tuple[Figure, Axes]:
    rows, columns = frame.image.shape
    width = 8.0
    figure = Figure(figsize=(width, width * rows / columns + 1), layout="constrained", dpi=130)
    axes = figure.subplots()
    image = frame.image.astype(float)
    finite = image[np.isfinite(image)]
    low, high = np.percentile(finite, [25, 99.9])
    scale = max(float(np.percentile(finite, 84) - np.median(finite)), 1e-3 * (high - low), 1e-9)
    lifted = np.arcsinh((image - low) / (3 * scale))
    top = max(float(np.arcsinh((high - low) / (3 * scale))), 1.0)
    axes.imshow(lifted, cmap="gray", vmin=-0.5, vmax=1.3 * top, interpolation="nearest")
    axes.set(xlabel="x, column (pixel)", ylabel="y, row (pixel)")
    axes.tick_params(labelsize=8)
    return figure, axes


def _predicted(
    camera: Camera, icrs_to_camera: Rotation, stars: Stars, most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels and magnitudes of the brightest catalogue stars in the frame."""
    direction = icrs_to_camera.apply(stars.direction)
    near = direction[:, 2] > math.cos(camera.half_diagonal)
    pixel = camera.project(direction[near])
    inside = camera.holds(pixel)
    magnitude = stars.magnitude_g[near][inside]
    order = np.argsort(magnitude)[:most]
    return pixel[inside][order], magnitude[order]


def _north(axes: Axes, camera: Camera, icrs_to_camera: Rotation) -> None:
    """An arrow to celestial north in the corner of the picture."""
    roll = math.radians(celestial(icrs_to_camera)[2])
    length = 0.06 * min(camera.rows, camera.columns)
    x, y = 2 * length, camera.rows - 2 * length
    tip = (x - length * math.sin(roll), y - length * math.cos(roll))
    axes.annotate("", tip, (x, y), arrowprops={"arrowstyle": "->", "color": KNOWN})
    beyond = (x - 1.4 * length * math.sin(roll), y - 1.4 * length * math.cos(roll))
    axes.text(*beyond, "N", color=KNOWN, fontsize=8, ha="center", va="center")


def _interval_text(interval: Interval) -> str:
    value, low, high = (x / arcsec for x in (interval.value, interval.low, interval.high))
    return f"{value:.2f} [{low:.2f}, {high:.2f}] arcsec"
