"""CPU time and error of each stage, on work that anyone can repeat.

stage            Stage, Row, and their measurement in turns
psf, stamping, noise, frame, detection, identification, attitude, terrain, radiance, trials,
optimiser        the stages, one a file
starfield        frames of stars for several stages
table            Markdown, plain values and a picture of the results
"""

from collections.abc import Callable

from startrack.benchmark import (
    attitude,
    detection,
    frame,
    identification,
    noise,
    optimiser,
    psf,
    radiance,
    stamping,
    terrain,
    trials,
)
from startrack.benchmark.stage import Clocked, Row, Stage, Way, measure
from startrack.benchmark.table import draw_benchmark, markdown, values, versions

# In the order in which the light goes.
STAGES: dict[str, Callable[[], Stage]] = {
    "psf": psf.psf,
    "stamping": stamping.stamping,
    "noise": noise.noise,
    "frame": frame.frame,
    "detection": detection.detection,
    "centroid": detection.centroid,
    "identification": identification.identification,
    "attitude": attitude.attitude,
    "terrain": terrain.terrain,
    "radiance": radiance.radiance,
    "montecarlo": trials.montecarlo,
    "optimiser": optimiser.optimiser,
}

__all__ = [
    "STAGES",
    "Clocked",
    "Row",
    "Stage",
    "Way",
    "draw_benchmark",
    "markdown",
    "measure",
    "values",
    "versions",
]
