"""The page of an Earth camera: its figures, requirements, images, products and scene."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from startrack.core import um
from startrack.earth.imager import Survey, figures_of, known, margins_of
from startrack.earth.product import QUALITY, UNITS
from startrack.report.page import Section, code, embedded, page, paragraph, table


def write_earth_report(
    survey: Survey, products: Sequence[Mapping[str, Any]], scene: str, title: str
) -> str:
    """The page as HTML.

    products  for each channel the values that `startrack earth process` prints, with the path of
              the picture as `png` and, if available, of the raw image's picture as `image`
    scene     text of the scene file
    """
    lead = (
        f"{len(products)} channels of a simulated camera: performance by formulas, simulated "
        "images, and products after calibration and mapping. The products use the scene's "
        "flight, pointing and terrain; displacement by drift and jitter is not corrected."
    )
    sections = [
        Section("Camera", _camera(survey)),
        Section("Requirements", _requirements(survey)),
        Section("Images", _images(products)),
        Section("Products", _products(products)),
        Section("Inputs", code("Scene file", scene)),
    ]
    return page(title, lead, sections)


def _camera(survey: Survey) -> str:
    rows = []
    for channel, height, figures in figures_of(survey):
        rows.append(
            [
                channel.name,
                f"{height / 1e3:.4g}",
                f"{figures.gsd:.4g}",
                f"{figures.swath / 1e3:.4g}",
                f"{figures.mtf_across:.3f}",
                f"{figures.mtf_along:.3f}",
                f"{figures.snr:.4g}",
                f"{figures.radiance * um:.4g}",
                f"{figures.saturation * um:.4g}",
                f"{figures.data_rate / 1e6:.4g}",
            ]
        )
    head = (
        "channel",
        "height (km)",
        "pixel on the ground (m)",
        "swath (km)",
        "MTF across",
        "MTF along",
        "SNR",
        "at (W / m2 / sr / um)",
        "saturates at",
        "Mbit / s",
    )
    return table(
        "Figures of each channel over flat ground below; MTF at half a cycle per pixel", head, rows
    )


def _requirements(survey: Survey) -> str:
    rows = []
    for channel, _, figures in figures_of(survey):
        for name, margin in margins_of(channel, figures).items():
            limit = known(channel.required)[name] * (um if name == "saturation" else 1.0)
            met = "met" if margin >= 0 else "NOT MET"
            rows.append([channel.name, name, f"{limit:.4g}", f"{margin:+.3f}", met])
    if not rows:
        return paragraph("The camera has no requirements.")
    caption = "Margins are fractions of the required value"
    return table(caption, ("channel", "of", "required", "margin", "verdict"), rows)


def _images(products: Sequence[Mapping[str, Any]]) -> str:
    shown = [
        embedded(
            f"{product['channel']}: digital numbers, and radiance before the lens", product["image"]
        )
        for product in products
        if "image" in product
    ]
    return "".join(shown) or paragraph("The folder of the raw images has no pictures.")


def _products(products: Sequence[Mapping[str, Any]]) -> str:
    means, flags, truth = [], [], []
    for product in products:
        for layer, value in product["mean"].items():
            unit = "" if UNITS[layer] == "1" else UNITS[layer]
            means.append([product["channel"], layer, f"{value:.4g}", unit])
        flags.append(
            [product["channel"], *(f"{100 * product['flagged'][name]:.1f}" for name in QUALITY)]
        )
        if math.isfinite(product["radiance_error"]):
            truth.append(
                [
                    product["channel"],
                    f"{100 * product['radiance_error']:+.3f}",
                    f"{100 * product['radiance_rms']:.2f}",
                ]
            )
    parts = [
        table("Means over the map", ("channel", "layer", "mean", "unit"), means),
        table("Cells of each quality (%)", ("channel", *QUALITY), flags),
    ]
    if truth:
        head = ("channel", "mean radiance (%)", "rms of the pixels (%)")
        caption = "Difference from the truth; the rms includes noise and blurred edges"
        parts.append(table(caption, head, truth))
    parts += [
        paragraph(f"{product['channel']}: the raw image was rendered with another {part}.")
        for product in products
        for part in product.get("differs", ())
    ]
    for product in products:
        unit = "degree" if product["projection"].endswith(":4326") else "m"
        caption = (
            f"{product['channel']}: {product['columns']} x {product['rows']} cells of "
            f"{product['cell'][0]:.4g} x {product['cell'][1]:.4g} {unit}, "
            f"{product['projection']}, {product['resampling']}"
        )
        parts.append(embedded(caption, Path(product["png"])))
    return "".join(parts)
