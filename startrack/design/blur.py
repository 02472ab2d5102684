"""Table of a design -> its case, where the blur of the lens may be in pixel or an angle."""

from collections.abc import Mapping
from typing import Any

from startrack.core import Refused, parse
from startrack.design.case import Case
from startrack.design.parameter import replaced
from startrack.io import from_table

PLACE = "instrument.optics.blur"


def case_of_table(table: Mapping[str, Any]) -> Case:
    """The case of a design's table, its blur a length on the detector.

        blur = pixels pitch,  blur = angle image_distance

    with the pitch and the image distance of this design. A campaign that changes these leaves the
    length as it is.

    Raises  ValueError as `from_table`.
    """
    match table:
        case {"instrument": {"optics": {"blur": str(blur)} as optics} as instrument}:
            pass
        case _:
            return from_table(Case, table)
    for unit in ("pixel", "rad"):
        try:
            number = parse(blur, unit)
        except Refused:
            continue
        sharp = {name: value for name, value in optics.items() if name != "blur"}
        design = from_table(Case, {**table, "instrument": {**instrument, "optics": sharp}})
        camera = design.instrument
        size = camera.detector.pitch if unit == "pixel" else camera.optics.image_distance
        return replaced(design, PLACE, number * size)
    return from_table(Case, table)
