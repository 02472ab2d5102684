"""Intersections of rays and terrain by orekit's Rugged: Duvenhage's algorithm over a min/max tree.

Separate from startrack, because it needs Java: python terrain_rugged.py CELLS.npz, with
orekit-jpype. CELLS.npz holds `heights` (rows, columns) from the north, `grid` (west, south, step)
in radian, and `origin`, `direction` (n, 3). Prints a JSON object: CPU time for all rays in second,
with a Java call for each ray, and longitude, latitude and height of each point.
"""

from __future__ import annotations

import json
import sys
import time
from importlib import import_module
from typing import Any

import numpy as np


def main() -> None:
    import_module("orekit_jpype").initVM()
    jpype = import_module("jpype")
    space, frames, utils = (
        import_module(f"org.{name}")
        for name in ("hipparchus.geometry.euclidean.threed", "orekit.frames", "orekit.rugged.utils")
    )
    duvenhage = import_module("org.orekit.rugged.intersection.duvenhage")
    given = np.load(sys.argv[1])
    heights = given["heights"][::-1].astype(float)  # Rugged counts rows from the south
    west, south, step = map(float, given["grid"])

    def fill(_: Any, latitude: float, longitude: float, tile: Any) -> None:
        tile.setGeometry(south, west, step, step, *heights.shape)
        for (j, i), height in np.ndenumerate(heights):
            tile.setElevation(j, i, float(height))

    updater = jpype.JImplements("org.orekit.rugged.raster.TileUpdater")(
        type("Updater", (), {"updateTile": jpype.JOverride(fill)})
    )
    fixed = frames.Frame(
        frames.FramesFactory.getGCRF(), frames.Transform.IDENTITY, "Earth-fixed", True
    )
    ellipsoid = utils.ExtendedEllipsoid(6378137.0, 1 / 298.257223563, fixed)
    algorithm = duvenhage.DuvenhageAlgorithm(updater(), 2, False, True)
    origin, direction = (
        [space.Vector3D(*map(float, one)) for one in given[name]]
        for name in ("origin", "direction")
    )

    def run() -> list[list[float]]:
        places = []
        for position, sight in zip(origin, direction, strict=True):
            near = algorithm.intersection(ellipsoid, position, sight)
            at = algorithm.refineIntersection(ellipsoid, position, sight, near)
            places.append([at.getLongitude(), at.getLatitude(), at.getAltitude()])
        return places

    run()  # Java compiles frequent code
    begin = time.process_time()
    places = run()
    print(json.dumps({"seconds": time.process_time() - begin, "place": places}))


if __name__ == "__main__":
    main()
