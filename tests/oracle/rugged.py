"""rugged.json: where rays meet the hills of `hills` by orekit's Rugged 4.0.1 (orekit-jpype 13.1.9).

    python rugged.py PYTHON_WITH_OREKIT

The rays are seen from 600 km at 85, 60 and 30 degrees; heights, rays and grid are those of the test
that reads the file.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

from tests.earth.terrain.scenes import hills, ray  # noqa: E402


def main() -> None:
    grid, heights = hills()
    random, cases = np.random.default_rng(7), []
    for elevation in (85, 60, 30):
        u, v, azimuth = random.random((3, 40))
        rays = ray(
            grid.west + (110 + 36 * u) * grid.step_x,
            grid.north - (110 + 36 * v) * grid.step_y,
            500.0,
            elevation,
            2 * np.pi * azimuth,
            6e5,
        )
        with tempfile.NamedTemporaryFile(suffix=".npz") as file:
            np.savez(
                file.name,
                heights=heights,
                grid=[grid.west, grid.south, grid.step_x],
                origin=rays.origin,
                direction=rays.direction,
            )
            told = subprocess.run(
                [sys.argv[1], str(HERE.parents[1] / "experiments/terrain_rugged.py"), file.name],
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        places = json.loads(told.splitlines()[-1])["place"]
        cases.append(
            {
                "elevation_deg": elevation,
                "origin": rays.origin.tolist(),
                "direction": rays.direction.tolist(),
                "place": places,
            }
        )
    (HERE / "rugged.json").write_text(json.dumps(cases) + "\n")


main()
