"""Question: which frame and which attitude does a unit of the example have at the end of its life?

Answer: docs/frame.png, the picture of the README.

    python experiments/frame_picture.py [--picture FILE] [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import command

from startrack import Streams, draw_solution, load_design, observe, pointing, shipped
from startrack.catalog import open_sky
from startrack.design import Moment
from startrack.population import unit_of

ORION = (83.8, -1.5, 0.0)  # degree: right ascension, declination, roll
PICTURE = Path(__file__).parents[1] / "docs" / "frame.png"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--picture",
        type=Path,
        default=PICTURE,
        help="file for the picture (default: docs/frame.png)",
    )
    options = command.read(parser)
    design = load_design(shipped("designs/nanosatellite.toml")).case
    case = unit_of(design, 1, Moment(0, 0, 0, design.end_of_life))
    record = observe(case, pointing(*ORION), Streams(seed=1, trial=0))
    error = 206265 * (record.outcome.error_x**2 + record.outcome.error_y**2) ** 0.5
    draw_solution(
        options.picture,
        record.frame,
        record.spots,
        record.matches,
        record.estimate.icrs_to_camera,
        open_sky(case.believed_catalog).stars,
        f"Orion's belt and sword in a unit of the example: {record.outcome.stars} stars matched, "
        f"{error:.2f} arcsec off the true boresight",
    )
    print(f"wrote {options.picture}")
    command.save(options, {"stars": record.outcome.stars, "error_arcsec": error})


if __name__ == "__main__":
    command.run(main)
