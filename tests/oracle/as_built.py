"""Writes as_built.json: chief rays of lenses with an element that is off, by optiland.

    python tests/oracle/as_built.py

Elements of the shipped prescriptions are decentred by 20 um, tilted by 1 arcmin about the middle of
their vertices, or have a wedge of 1 arcmin on their last surface, towards y; the place where the
chief ray meets the detector is compared with that of the lens as designed. None of it is made by
startrack.
"""

import json
import math
from pathlib import Path

import numpy as np

LENSES = Path(__file__).parents[2] / "catalogs/lenses"
SHIFT, TURN = 0.02, math.radians(1 / 60)  # millimetre, radian
WAVELENGTH = 0.5875618  # micrometre
FIELDS = ((0.0, 0.0), (0.0, 0.8), (0.0, -0.8), (0.6, 0.5))  # of the largest, x and y
CASES = {"double_gauss": ((1, 2), (3, 5), (7, 9)), "triplet": ((1, 2), (3, 4)),
         "petzval": ((1, 2), (8, 9))}  # fmt: skip


def places(lens):
    found = []
    for x, y in FIELDS:
        rays = lens.trace_generic(x, y, 0.0, 0.0, WAVELENGTH)
        found.append([float(np.squeeze(rays.x)), float(np.squeeze(rays.y))])
    return np.array(found)


def off(name, first, last, kind):
    from optiland.fileio import load_zemax_file

    lens = load_zemax_file(str(LENSES / f"{name}.zmx"))
    lens.ray_tracer.set_aiming("robust")
    if kind:
        frames = [lens.surfaces[number].geometry.cs for number in range(first, last + 1)]
        depth = np.array([float(np.squeeze(frame.z)) for frame in frames])
        for frame, z in zip(frames, depth, strict=True):
            if kind == "decentre":
                frame.y = frame.y + SHIFT
            elif kind == "tilt":
                frame.y = frame.y + TURN * (z - depth.mean())
                frame.rx = frame.rx - TURN
        if kind == "wedge":
            frames[-1].rx = frames[-1].rx - TURN
    return lens


def main() -> None:
    import optiland
    from optiland.fileio import load_zemax_file

    result = {
        "optiland": getattr(optiland, "__version__", "0.6"),
        "shift_mm": SHIFT,
        "turn_rad": TURN,
        "cases": [],
    }
    for name, elements in CASES.items():
        lens = load_zemax_file(str(LENSES / f"{name}.zmx"))
        largest = max(field.y for field in lens.fields.fields)
        x, y = np.array(FIELDS).T
        tangent = np.tan(np.radians(largest)) * np.column_stack([x, y])
        lens = off(name, 0, 0, "")
        before = places(lens)
        for first, last in elements:
            for kind in ("decentre", "tilt", "wedge"):
                moved = places(off(name, first, last, kind)) - before
                result["cases"].append(
                    {
                        "lens": name,
                        "surfaces": [first - 1, last - 1],
                        "kind": kind,
                        "field_deg": largest,
                        "fields": FIELDS,
                        "moved_mm": moved.tolist(),
                        "before_mm": before.tolist(),
                        "tangent": tangent.tolist(),
                    }
                )
    path = Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
