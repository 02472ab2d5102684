"""Guide stars and patterns of a design for its flight software, and what its C code finds."""

from pathlib import Path

import numpy as np

from startrack import load_design, shipped
from startrack.onboard import CompiledGuide, GuideSettings, guide_stars, read_guide, write_guide

case = load_design(shipped("designs/noise_only.toml")).case
settings = GuideSettings(limit=5.0, epoch=2031.5, variables="omit")
files = write_guide(Path("flight"), guide_stars(case, settings))
guide = read_guide(files[0])
print(len(guide), "stars,", len(guide.triangle), "triangles,", files[0].stat().st_size, "bytes")
try:
    reader = CompiledGuide(files[0].read_bytes())
    pole = np.array([0.0, 0.0, 1.0])
    print("within 10 degrees of the pole:", reader.cone(pole, np.radians(10)))
except ValueError as error:  # no C compiler
    print(error)
