"""CPU time and error of each stage, on work that anyone can repeat.

stage      BenchmarkStage, StageRow, their alternating measurement, and table and picture of the
results
optics     psf and stamping
frame      frame and noise
detection  detection, quick detection and centroid, on frames of stars that other stages use, too
solving    identification and attitude
earth      terrain and radiance
studies    montecarlo and optimiser
"""

from collections.abc import Callable

from startrack.benchmark import detection, earth, frame, optics, solving, studies
from startrack.benchmark.stage import (
    BenchmarkStage,
    Clocked,
    StageRow,
    Way,
    draw_benchmark,
    figure,
    markdown,
    measure,
    spent,
    values,
    versions,
)

# In the order of the light's path.
STAGES: dict[str, Callable[[], BenchmarkStage]] = {
    "psf": optics.psf,
    "stamping": optics.stamping,
    "noise": frame.noise,
    "frame": frame.frame,
    "detection": detection.detection,
    "quick-detection": detection.quick_detection,
    "centroid": detection.centroid,
    "identification": solving.identification,
    "attitude": solving.attitude,
    "terrain": earth.terrain,
    "radiance": earth.radiance,
    "montecarlo": studies.montecarlo,
    "optimiser": studies.optimiser,
}

__all__ = [
    "STAGES",
    "BenchmarkStage",
    "Clocked",
    "StageRow",
    "Way",
    "draw_benchmark",
    "markdown",
    "measure",
    "values",
    "versions",
]
