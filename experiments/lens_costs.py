"""Mass and cost of lenses: the model of a family compared with nine lenses for cameras.

    python experiments/lens_costs.py [--json FILE] [--markdown docs/figures/lens-costs.md]

The double Gauss family has the focal length, f-number and field (24 by 36 mm) of each lens. Camera
lenses have focusing, diaphragms and mounts, and a third of them motors; one factor of the model
includes all of these. The factors are medians over the same lenses, so that the table shows the
spread, not an independent test. The exponents come from the prescription.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import command

from startrack import shipped
from startrack.design import cost_of
from startrack.io import save_text
from startrack.optics import open_lens, open_surfaces

LENSES = Path(__file__).parents[1] / "tests/oracle/lens_costs.json"
HALF_DIAGONAL = 21.6e-3  # metre, half diagonal of the film
COMPLEXITY = 0.5  # exponent of the number of elements over the speed: startrack.optics.lens_family


def rows() -> list[dict[str, Any]]:
    """Measured and predicted values and their ratio for each lens."""
    table, base = open_lens("double_gauss"), open_surfaces(shipped("lenses/double_gauss.fits"))
    assert base is not None
    known = json.loads(LENSES.read_text(encoding="utf-8"))
    found = []
    for lens in known["lenses"]:
        focal, speed = lens["focal_mm"] * 1e-3, table.f_number / lens["f_number"]
        wider = HALF_DIAGONAL / focal / math.tan(table.field[-1])
        elements = len(base.elements) * max(speed, 1.0) ** COMPLEXITY
        cost = cost_of(base.scaled(focal / table.focal_length, speed, wider), elements)
        row = {
            "name": lens["name"],
            "source": lens["source"],
            "elements": lens["elements"],
            "elements_predicted": cost.elements,
            "mass_g": lens["mass_g"],
            "mass_predicted_g": 1e3 * cost.mass,
            "price": lens["price"],
            "price_predicted": cost.price,
            "volume_predicted_cm3": 1e6 * cost.volume,
        }
        row["mass_ratio"] = row["mass_g"] / row["mass_predicted_g"]
        row["price_ratio"] = lens["price"] and lens["price"] / cost.price
        row["volume_cm3"] = row["volume_ratio"] = None
        if lens["diameter_mm"]:
            to_film = lens["length_mm"] + known["flange_mm"][lens["mount"]]
            row["volume_cm3"] = math.pi / 4 * lens["diameter_mm"] ** 2 * to_film * 1e-3
            row["volume_ratio"] = row["volume_cm3"] / row["volume_predicted_cm3"]
        found.append(row)
    return found


def page(found: list[dict[str, Any]], source: str) -> str:
    """The table in Markdown."""

    def three(row: dict[str, Any], name: str, unit: str = "") -> str:
        if row[name + unit] is None:
            return f"- | {row[name + '_predicted' + unit]:.0f} | -"
        measured, predicted = row[name + unit], row[name + "_predicted" + unit]
        return f"{measured:.0f} | {predicted:.0f} | {measured / predicted:.2f}"

    lines = [
        "# Mass and cost of lenses",
        "`max_mass`, `max_volume` and `max_cost` of a design with `lens_family`, or with a "
        "`lens_file` that contains its surfaces, compute the lens from its glass: "
        f"`startrack.design.requirements` has the equations. This page, written by {source}, "
        "compares the double Gauss family with nine lenses for cameras of 24 by 36 mm, at their "
        "focal length, f-number and field.",
        "",
        "The factors are medians over these lenses, so that the ratios (measured over predicted) "
        "show the spread; they are not an independent test. The factors include focusing, "
        "diaphragms, mounts and motors, which a tracker's lens does not have, but no housing for "
        "space. No lens of the other three families was compared. Volume extends to the film; "
        "prices are dollars of 2007 to 2010, in series production.",
        "",
        "| lens | elements | law | mass g | predicted | ratio | volume cm³ | predicted | ratio | "
        "price | predicted | ratio |",
        "|" + "---|" * 12,
    ]
    for row in found:
        lines.append(
            f"| {row['name']} | {row['elements']} | {row['elements_predicted']:.1f} | "
            f"{three(row, 'mass', '_g')} | {three(row, 'volume', '_cm3')} | {three(row, 'price')} |"
        )
    lines += ["", "Sources:"]
    lines += [f"- {row['name']}: {row['source']}." for row in found]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="file for the page")
    options = command.read(parser)
    found = rows()
    for row in found:
        print(f"{row['name']:34} {row['mass_g']:4.0f} g, predicted {row['mass_predicted_g']:4.0f}")
    if options.markdown:
        save_text(options.markdown, page(found, command.source("lens_costs.py --markdown FILE")))
    command.save(options, found)


if __name__ == "__main__":
    command.run(main)
