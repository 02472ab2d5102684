"""Plane-stress finite elements of a head -> structure.json: how lens and detector turn.

Squares of bilinear elements with 2 x 2 Gauss points, a millimetre or less each, of the section
through tube, base and feet: two walls joined by the lens' mount at the top and the base at the
bottom, on two feet that are clamped to a panel. Temperatures are prescribed. The turn of the
boresight is that of the line from the middle of the detector to that of the lens. Nothing of
startrack is imported. `python tests/oracle/structure.py` writes structure.json beside it.
"""

import json
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

NU = 0.33
PLANE = np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]]) / (1 - NU**2)  # over E
EDGE = 1e-7  # metre, so that rounding does not make one side thicker than the other
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def element() -> tuple[np.ndarray, np.ndarray]:
    """Stiffness (8, 8) of a square element over E, and its load (8,) by a strain 1, over E side."""
    stiffness, load = np.zeros((8, 8)), np.zeros(8)
    for x, y in CORNERS / np.sqrt(3):
        slope = np.stack(
            [
                CORNERS[:, 0] * (1 + y * CORNERS[:, 1]) / 4,
                CORNERS[:, 1] * (1 + x * CORNERS[:, 0]) / 4,
            ]
        )
        strain = np.zeros((3, 8))
        strain[0, ::2], strain[1, 1::2] = slope
        strain[2, ::2], strain[2, 1::2] = slope[::-1]
        stiffness += strain.T @ PLANE @ strain  # the Jacobian cancels for a square
        load += strain.T @ PLANE @ np.array([1.0, 1.0, 0.0]) / 2
    return stiffness, load


def solve(solid, strain, side, panel):
    """Displacements of the nodes (rows + 1, columns + 1, 2), NaN where there are none.

    solid   (rows, columns) whether a square is there; row 0 stands on the panel
    strain  (rows, columns) free expansion of each
    side    metre of a square
    panel   strain of the panel, to which the nodes of its row are clamped
    """
    rows, columns = solid.shape
    row, column = np.nonzero(solid)
    first = row * (columns + 1) + column
    node = np.stack([first, first + 1, first + columns + 2, first + columns + 1], axis=1)
    freedom = np.stack([2 * node, 2 * node + 1], axis=2).reshape(-1, 8)
    stiffness, load = element()
    size = 2 * (rows + 1) * (columns + 1)
    whole = coo_array(
        (
            np.tile(stiffness.ravel(), len(freedom)),
            (np.repeat(freedom, 8, axis=1).ravel(), np.tile(freedom, (1, 8)).ravel()),
        ),
        shape=(size, size),
    ).tocsr()
    force = np.bincount(freedom.ravel(), (strain[row, column][:, None] * side * load).ravel(), size)
    used = np.unique(freedom)
    fixed = used[used < 2 * (columns + 1)]
    moved = np.full(size, np.nan)
    place = (fixed // 2 - columns / 2) * side
    moved[fixed] = np.where(fixed % 2 == 0, panel * place, 0.0)
    free = np.setdiff1d(used, fixed)
    rest = force[free] - whole[free][:, fixed] @ moved[fixed]
    moved[free] = spsolve(whole[free][:, free].tocsc(), rest)
    return moved.reshape(rows + 1, columns + 1, 2)


def turn(head, expansion, mean, gradient, tube, panel, side):
    """Radian by which the line from detector to lens turns towards +x.

    head      metre: focal and length to the middle of the lens' mount, from the middle of the base
    expansion, panel  1 / kelvin, of the head and of the panel
    gradient  kelvin / metre, in all of the head
    tube      kelvin between the sides of the tube alone: a round mount of the lens does not move
              sideways by a gradient in itself, as that of a section would
    """
    span, foot, base, height, offset = (
        head[key] for key in ("span", "foot", "base", "height", "offset")
    )
    diameter, wall = head["diameter"], head["wall"]
    above = head["length"] - base  # from the base to the lens' mount, as thick as the base
    columns = 2 * round((span + foot + 4 * side) / 2 / side)
    level, top = height + base, height + base + above
    x = (np.arange(columns) - (columns - 1) / 2) * side
    y = (np.arange(round((top + base) / side)) + 0.5) * side
    in_foot = (np.abs(np.abs(x) - span / 2) < foot / 2 - EDGE) & (y < height)[:, None]
    in_base = (np.abs(x) < (span + foot) / 2 - EDGE) & ((y > height) & (y < level))[:, None]
    in_wall = np.abs(np.abs(x - offset) - diameter / 2) < wall / 2 - EDGE
    in_tube = in_wall & ((y > level) & (y < top))[:, None]
    in_lens = (np.abs(x - offset) < (diameter + wall) / 2 - EDGE) & (y > top)[:, None]
    warm = np.broadcast_to(mean + gradient * (x - offset), in_foot.shape).copy()
    warm += np.where(in_tube, tube * (x - offset) / diameter, 0.0)
    solid = in_foot | in_base | in_tube | in_lens
    moved = solve(solid, expansion * warm, side, panel * mean)[..., 0]
    middle = round(offset / side + columns / 2)
    lens = moved[round((top + base / 2) / side), middle]
    low = head["length"] - head["focal"]
    if low == 0:
        return (lens - moved[round((height + base / 2) / side), middle]) / head["focal"]
    row = moved[round((height + base / 2 + low) / side)]
    walls = [
        row[round((offset + half) / side + columns / 2)] for half in (-diameter / 2, diameter / 2)
    ]
    return (lens - np.mean(walls)) / head["focal"]


HEAD = {
    "focal": 40e-3, "length": 40e-3, "diameter": 28e-3, "wall": 2e-3, "span": 42e-3,
    "height": 10e-3, "foot": 5e-3, "base": 5e-3, "offset": 0.0,
}  # fmt: skip
SHAPES = [
    {}, {"height": 5e-3}, {"height": 20e-3}, {"foot": 3e-3}, {"foot": 10e-3}, {"base": 8e-3},
    {"span": 80e-3, "diameter": 60e-3}, {"length": 80e-3, "focal": 80e-3}, {"focal": 25e-3},
]  # fmt: skip
LOADS = [  # kelvin: mean, gradient per metre, tube; metre: offset of the lens
    (0.0, 30.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (10.0, 0.0, 0.0, 3e-3),
]  # fmt: skip


def random_heads(count):
    """Heads of random sizes, in whole millimetres, whose feet are not thicker than high."""
    random = np.random.default_rng(0)
    while count:
        length, diameter, wall, height, foot, base = (
            random.integers(low, high + 1) * 1e-3
            for low, high in ((30, 100), (20, 80), (1, 3), (4, 20), (2, 8), (3, 8))
        )
        span = round(diameter * random.uniform(1.15, 2) * 1e3 / 2) * 2e-3
        if height >= foot:
            count -= 1
            named = {"length": length, "focal": length, "diameter": diameter, "wall": wall}
            named |= {"height": height, "foot": foot, "base": base, "span": span}
            yield {name: round(float(value), 6) for name, value in named.items()}


def cases(side):
    for shape in (*SHAPES, *random_heads(16)):
        for mean, gradient, tube, offset in LOADS:
            head = HEAD | shape | {"offset": offset}
            expansion = 8.6e-6 if mean else 23.6e-6
            kelvin = {"mean": mean, "gradient": gradient, "tube": tube}
            found = turn(head, expansion, **kelvin, panel=23.6e-6, side=side)
            yield {
                "head": head,
                "expansion": expansion,
                "panel": 23.6e-6,
                **kelvin,
                "turn": float(f"{found:.5g}"),
            }


if __name__ == "__main__":
    fine, coarse = list(cases(0.25e-3)), list(cases(0.5e-3))
    worst = max(abs(a["turn"] / b["turn"] - 1) for a, b in zip(coarse, fine, strict=True))
    print(f"{len(fine)} cases; squares of twice the side change a turn by {worst:.2%} at most")
    path = Path(__file__).with_suffix(".json")
    about = "by tests/oracle/structure.py, squares of 0.25 mm; SI units"
    path.write_text(json.dumps({"source": about, "cases": fine}, indent=1) + "\n", encoding="utf-8")
