"""Comparison with other methods: Sobol indices (SALib), a rare probability (OpenTURNS), a posterior
(a grid).

The problems are small, so that other methods can compute them completely: indices and posterior of
the least error of a centroid, and the fraction of the sky with too few bright stars.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import command
import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from startrack import Streams, load_design, shipped
from startrack.catalog import open_sky
from startrack.core import Floats
from startrack.metrics import Star, centroid_bound
from startrack.montecarlo import Regions, chances, probability, where_likely
from startrack.observation import rotations_from_cube
from startrack.optimise import Ensembles, draw, fit_surface, region_of, sobol_indices

DESIGNS = 128  # as in `startrack what-matters`
SMALLEST_FLUX, LARGEST_FLUX = 500.0, 50_000.0  # electron
RADIUS = math.radians(9.0)  # radius of the field around the boresight
FAINTEST = 5.0  # magnitude G
FEW = 3  # stars
# distance of the last star within the field for which it is still likely outside
NEAR = math.radians(2.0)
LIMIT = 0.02  # pixel
BLOCK = 20_000  # trials of OpenTURNS at once
GRID = 1000  # points along each axis


def oracles(quick: bool) -> dict[str, Any]:
    """Differences of startrack's results from other results; missing packages are left out."""
    figures: dict[str, Any] = {"posterior_error": posterior_error(150 if quick else 1000)}
    if not command.missing("Sobol indices beside SALib", "SALib"):
        figures["sobol_error"] = sobol_error(64 if quick else 1024)
    if not command.missing("a rare probability beside OpenTURNS", "openturns"):
        figures |= rare_probability(500 if quick else 40_000)
    return figures


def log_bound(points: Floats) -> Floats:
    """Logarithm of the least error of a centroid (pixel), at points (n, 3) of the unit cube.

    The coordinates are flux (logarithmic scale), width and noise of a pixel.
    """
    flux = SMALLEST_FLUX * (LARGEST_FLUX / SMALLEST_FLUX) ** points[:, 0]
    sigma, noise = 0.5 + points[:, 1], 2 + 28 * points[:, 2]
    rows = zip(flux, sigma, noise, strict=True)
    return np.array([math.log(centroid_bound(Star(f, s, 0.0, n))[0]) for f, s, n in rows])


def sobol_error(base: int) -> float:
    """Largest difference between startrack's indices by an emulator and SALib's by the function
    itself.

    base  base designs of SALib, a power of two; each needs d + 2 evaluations
    """
    from SALib.analyze import sobol
    from SALib.sample import sobol as sampled

    points = np.asarray(scipy.stats.qmc.Sobol(3, rng=Streams(1, 0)("oracle")).random(DESIGNS))
    ours = sobol_indices(points, log_bound(points))
    problem = {"num_vars": 3, "names": ["flux", "sigma", "noise"], "bounds": [[0, 1]] * 3}
    theirs = sobol.analyze(
        problem, log_bound(sampled.sample(problem, base, calc_second_order=False, seed=1)), False
    )
    apart = [
        (first.value - theirs["S1"][k], total.value - theirs["ST"][k])
        for k, (first, total) in enumerate(ours)
    ]
    return float(np.abs(apart).max())


def rare_probability(trials: int) -> dict[str, float]:
    """Fraction of the sky with too few stars by importance sampling of attitudes, over the fraction
    by plain trials of OpenTURNS; and the relative standard error of this ratio.

    The field has fewer than FEW stars if the last of them is farther away than its radius.
    """
    import openturns as ot

    stars = open_sky(load_design(shipped("designs/noise_only.toml")).case.believed_catalog).stars
    tree = scipy.spatial.KDTree(stars.direction[stars.magnitude_g <= FAINTEST])

    def last(boresight: Floats) -> Floats:
        chord = np.asarray(tree.query(boresight, FEW)[0])[:, -1]
        return np.asarray(2 * np.arcsin(chord / 2))

    regions = Regions(24, 48)
    middle = regions.place(np.arange(len(regions)), np.full((len(regions), 2), 0.5))
    likely = np.exp(-((np.maximum(RADIUS - last(middle), 0) / NEAR) ** 2))
    attitudes, weight = where_likely(1, range(trials), regions, chances(likely))
    ours = probability(last(_boresights(attitudes)) > RADIUS, weight)

    ot.RandomGenerator.SetSeed(1)
    function = ot.PythonFunction(
        3,
        1,
        func_sample=lambda cube: last(_boresights(rotations_from_cube(np.array(cube))))[:, None],
    )
    cube = ot.JointDistribution([ot.Uniform(0.0, 1.0)] * 3)
    output = ot.CompositeRandomVector(function, ot.RandomVector(cube))
    # Subset simulation would stay in the few holes of the sky that its first designs find.
    event = ot.ThresholdEvent(output, ot.Greater(), RADIUS)
    simulation = ot.ProbabilitySimulationAlgorithm(event, ot.MonteCarloExperiment())
    simulation.setMaximumCoefficientOfVariation(0.02)
    simulation.setBlockSize(BLOCK)
    simulation.setMaximumOuterSampling(1 + 50 * trials // BLOCK)
    simulation.run()
    result = simulation.getResult()
    theirs, sigma = result.getProbabilityEstimate(), result.getStandardDeviation()
    return {
        "rare_probability": ours.value,
        "rare_ratio": ours.value / theirs,
        "rare_ratio_sigma": math.hypot(ours.error / ours.value, sigma / theirs),
    }


def _boresights(icrs_to_camera: Rotation) -> Floats:
    return np.asarray(icrs_to_camera.inv().apply([0.0, 0.0, 1.0]))


def posterior_error(stretch: int) -> float:
    """Largest difference of means, and of deviations, between a sampled region and a grid, in
    standard deviations: designs whose least error is at most LIMIT, as in `startrack sample`.

    stretch  steps of the chains between checks of convergence
    """
    cube = scipy.stats.qmc.LatinHypercube(2, rng=Streams(1, 0)("oracle")).random(16)
    points = np.column_stack([cube, np.full(len(cube), 0.3)])
    result = np.column_stack([log_bound(points), 0.6 - points[:, 1]])  # a margin of the width
    density = region_of(fit_surface(2 * cube - 1, result), math.log(LIMIT))
    chains = draw(
        density,
        lambda rng, n: 0.2 * rng.uniform(-1, 1, (n, 2)) + [0.3, -0.3],
        seed=1,
        settings=Ensembles(stretch=stretch),
    )
    mean, deviation = of_grid(density)
    apart = [chains.flat.mean(axis=0) - mean, chains.flat.std(axis=0) - deviation]
    return float(np.abs(np.array(apart) / deviation).max())


def of_grid(density: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Means and deviations of two variables in [-1, 1], by a sum over a fine grid."""
    axis = (np.arange(GRID) + 0.5) / GRID * 2 - 1
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    log = density(points)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ points
    return mean, np.sqrt(weight @ (points - mean) ** 2)
