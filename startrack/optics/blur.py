"""Table of a camera -> the same, the blur of its lens a length where it is in pixel or an angle."""

from collections.abc import Mapping
from typing import Any

from startrack.core import Refused, parse, shown
from startrack.io import from_table


def with_blur_as_length(table: Mapping[str, Any], kind: type, place: str) -> Mapping[str, Any]:
    """Replace a blur in pixel or as an angle in a table with `optics` and `detector`.

        blur = pixels pitch,  blur = angle image_distance

    with the pitch and the image distance of this table. A campaign that changes these leaves the
    length as it is.

    kind    that the table is read as, with `optics` and `detector`
    Raises  ValueError with the place of a blur that is neither a length, pixels nor an angle.
    """
    match table:
        case {"optics": {"blur": str(blur)} as optics}:
            sharp = {**table, "optics": {key: optics[key] for key in optics if key != "blur"}}
        case _:
            return table
    for unit in ("m", "pixel", "rad"):
        try:
            number = parse(blur, unit)
            break
        except Refused:
            continue
    else:
        raise Refused(
            f"{place}.optics.blur must be a length, a number of pixels or an angle, such as "
            f"'5 um', '1.2 pixel' or '20 arcsec', got {shown(blur)}"
        )
    if unit == "m":
        return table
    try:
        camera: Any = from_table(kind, sharp, place)
    except Refused:
        return sharp  # what is wrong is said when all is read
    size = camera.detector.pitch if unit == "pixel" else camera.optics.image_distance
    return {**table, "optics": {**optics, "blur": f"{number * size!r} m"}}
