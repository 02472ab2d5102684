"""Words of a datasheet, keys of a design file -> the keys that the words mean."""

import re
from collections.abc import Sequence

from startrack.design.keys import Key

# Words of datasheets that are in no key's name, and the keys that set the quantity.
DATASHEET = {
    "field of view|fov": (
        "instrument.optics.focal_length",
        "instrument.detector.columns",
        "instrument.detector.rows",
        "instrument.detector.pixel_pitch",
    ),
    "aperture": (
        "instrument.optics.aperture",
        "instrument.optics.f_number",
        "instrument.optics.focal_length",
    ),
    "update rate": (
        "instrument.detector.frame_rate",
        "instrument.detector.pixel_rate",
        "campaign.requirements.min_update_rate",
    ),
    "integration time": ("instrument.detector.exposure",),
    "exclusion|sun": (
        "campaign.requirements.min_keep_out.sun",
        "instrument.baffle.angle",
        "instrument.tube.length",
    ),
    "sigma|accuracy": (
        "campaign.requirements.level",
        "campaign.requirements.max_across",
        "campaign.requirements.max_about",
    ),
    "slew|angular rate": (
        "instrument.motion.rate_x",
        "instrument.motion.rate_y",
        "instrument.motion.rate_z",
    ),
    "radiation": ("instrument.detector.age", "instrument.detector.hits"),
    "mass": ("campaign.requirements.max_mass",),
    "power": ("campaign.requirements.max_power",),
    "nea": ("campaign.requirements.max_across", "campaign.requirements.max_about"),
    "sensitivity|magnitude limit|limiting magnitude": (
        "tracker.catalog.limit_g",
        "tracker.detection.threshold",
    ),
    "distortion": (
        "instrument.optics.k1",
        "instrument.optics.k2",
        "instrument.optics.k3",
        "tracker.calibration.order",
    ),
    "spot size": ("instrument.optics.blur", "instrument.optics.defocus"),
    "latency": ("tracker.delay", "instrument.detector.exposure", "instrument.detector.pixel_rate"),
    "pixel size": ("instrument.detector.pixel_pitch", "instrument.detector.pixel_pitch_y"),
    "alignment": ("instrument.mounting", "tracker.mounting"),
}


def search_keys(words: str, keys: Sequence[Key]) -> list[Key]:
    """The keys that words of a datasheet mean, or whose name or meaning has all the words."""
    asked = words.lower().replace("_", " ").replace("-", " ")
    named = [
        name
        for terms, names in DATASHEET.items()
        for name in names
        if re.search(rf"\b({terms})\b", asked)
    ]
    if named:
        return [key for key in keys if key.name in named]
    parts = asked.split()
    texts = {key: f"{key.name} {key.meaning} {key.unit}".lower().replace("_", " ") for key in keys}
    return [key for key, text in texts.items() if parts and all(part in text for part in parts)]
