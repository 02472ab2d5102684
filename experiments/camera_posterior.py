"""Is the posterior of a camera correct, for synthetic cameras and for four images of a real one?

STARTRACK_DATA=folder python experiments/camera_posterior.py [--json FILE] [--cameras 100] [--quick]

Simulation-based calibration (Talts et al. 2018): cameras are drawn from the prior, and the
posterior of one frame of each camera is sampled. The ranks of the true values among the samples
must be uniform, for focal length, principal point, k1 and the width of the PSF. The four images
`esa_*` are of one camera: their focal lengths must agree within their intervals.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import command
import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack import Camera, Frame, Matches, Spots, Status, Tracker, lost_in_space, read_image
from startrack.calibration import CameraPosterior, Prior, sample_camera
from startrack.catalog import Selection, open_sky
from startrack.core import Floats
from startrack.detection import Detection
from startrack.identification import Identification, PatternIndexes
from startrack.optimise import Ensembles

CAMERA = Camera(1024, 1024, 2000.0)
PRIOR = Prior(0.01, 10.0, 0.1, 0.02, 0.02, 0.5, 1.5)
STARS, LONE = 40, 8  # stars with places; those of them whose pixels are drawn, too
NOISE = 0.05  # pixel, of a centroid
BINS = 10
# Some hundred independent samples are enough for a rank in ten bins, though not to be quoted.
SHORT = Ensembles(count=2, stretch=1500, most_steps=1500)
FEWEST = Ensembles(count=2, stretch=100, most_steps=100)  # under --quick
FINE = 50  # places along a pixel at which its light is summed
FIELD = 11.43  # deg, of the real images


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=100)
    options = command.read(parser, cameras=1)
    figures = calibration(options.cameras, FEWEST if options.quick else SHORT)
    if folder := command.images("the real images are"):
        figures |= real(sorted(folder.glob("esa_*.tiff")), options.quick)
    command.save(options, figures)
    print(json.dumps(figures, indent=1))


def calibration(cameras: int, ensembles: Ensembles) -> dict[str, Any]:
    """Ranks over cameras of the prior, and the p-value of their uniformity."""
    rng = np.random.default_rng(11)
    ranks, fewest = [], []
    for number in range(cameras):
        camera = drawn(rng)
        sigma = math.exp(rng.uniform(math.log(PRIOR.width_low), math.log(PRIOR.width_high)))
        frame, spots, matches = synthetic(camera, sigma, rng)
        found = sample_camera([spots], [matches], CAMERA, PRIOR, number, ensembles, images=[frame])
        truth = [getattr(camera, name) for name in found.names[:-1]] + [sigma]
        ranks.append((found.samples < truth).mean(axis=0))
        fewest.append(float(found.chains.effective.min()))
        print(number, np.round(ranks[-1], 2), f"{fewest[-1]:.0f} samples", flush=True)
    counts = [np.histogram(column, BINS, (0, 1))[0] for column in np.transpose(ranks)]
    each = stats.chisquare(counts, axis=1).pvalue
    return {
        "sbc_cameras": cameras,
        "sbc_p_values": dict(zip(found.names, each.tolist(), strict=True)),
        # Of the least of several: Sidak.
        "sbc_p_value": float(1 - (1 - each.min()) ** len(each)),
        "sbc_samples_least": min(fewest),
    }


def drawn(rng: np.random.Generator) -> Camera:
    """A camera of the prior."""
    return dataclasses.replace(
        CAMERA,
        focal_length_px=CAMERA.focal_length_px * (1 + PRIOR.focal_length * rng.standard_normal()),
        principal_x=PRIOR.principal * rng.standard_normal(),
        principal_y=PRIOR.principal * rng.standard_normal(),
        k1=PRIOR.k1 * rng.standard_normal(),
    )


def synthetic(
    camera: Camera, sigma: float, rng: np.random.Generator
) -> tuple[Frame, Spots, Matches]:
    """Stars with known noise, and the pixels of a few stars on a grid."""
    icrs_to_camera = Rotation.random(rng=rng)
    pixel = rng.uniform(0, 1023, (STARS, 2))
    pixel[:LONE] = np.stack([100.0 * np.arange(LONE) + 150, np.full(LONE, 500.0)], axis=1)
    pixel[:LONE] += rng.uniform(-0.5, 0.5, (LONE, 2))
    # The others stay away from them.
    pixel[LONE:, 1] = np.where(pixel[LONE:, 1] < 512, 0.9, 1) * pixel[LONE:, 1]
    near = np.abs(pixel[LONE:, 1] - 500) < 20
    pixel[LONE:][near, 1] += 60
    electrons = np.full((1024, 1024), 50.0)
    flux = rng.uniform(10e3, 30e3, LONE)
    for (x, y), light in zip(pixel[:LONE], flux, strict=True):
        left, top = round(x), round(y)
        fraction = np.outer(along(y - top, sigma), along(x - left, sigma))
        electrons[top - 10 : top + 11, left - 10 : left + 11] += light * fraction
    image = (rng.poisson(electrons) + rng.normal(0, 8, electrons.shape)) / 2 + 100
    frame = Frame(image, offset=100.0, electrons_per_dn=2.0, read_noise=8.0)
    x, y = (pixel + rng.normal(0, math.hypot(NOISE, PRIOR.floor_low), pixel.shape)).T
    covariance = np.tile(NOISE**2 * np.eye(2), (STARS, 1, 1))
    snr = np.where(np.arange(STARS) < LONE, 100.0, 10.0)
    spots = Spots(x, y, snr, covariance, snr, np.ones(STARS, np.int64))
    believed = Rotation.from_rotvec(rng.normal(0, 2e-4, 3)) * icrs_to_camera
    index = np.arange(STARS)
    direction = icrs_to_camera.inv().apply(camera.unproject(pixel))
    matches = Matches(Status.SOLVED, "", index, index, direction, CAMERA, believed, 0.0)
    return frame, spots, matches


def along(place: float, sigma: float) -> Floats:
    """Fraction of a star's light in each of 21 pixels of a line, by sums."""
    sub = (np.arange(FINE) + 0.5) / FINE - 0.5
    at = np.arange(-10, 11)[:, None] + sub
    return np.asarray(stats.norm.pdf(at, place, sigma).mean(axis=1))


def real(images: list[Path], quick: bool) -> dict[str, Any]:
    """The focal length of each real image, and whether they agree."""
    images, ensembles = (images[:1], FEWEST) if quick else (images, Ensembles())
    stars = open_sky(Selection.whole("bright", 2016.0)).stars
    found = {path.name: posterior(path, stars, ensembles) for path in images}
    middle, low, high = np.transpose([one.interval("focal_length_px") for one in found.values()])
    sigma = (high - low) / (2 * 1.96)
    common = float(np.average(middle, weights=sigma**-2))
    square = float((((middle - common) / sigma) ** 2).sum())
    return {
        "esa_focal_px": {name: one.interval("focal_length_px") for name, one in found.items()},
        "esa_psf_sigma_px": {name: one.interval("psf_sigma") for name, one in found.items()},
        "esa_focal_common_px": common,
        "esa_focal_p_value": float(stats.chi2.sf(square, len(found) - 1)),
        "esa_focal_consistent": bool(((low <= common) & (common <= high)).all()),
        "esa_converged": all(one.chains.converged for one in found.values()),
        "emcee_rhat_max": max(float(one.chains.split_r_hat.max()) for one in found.values()),
    }


def posterior(path: Path, stars: Any, ensembles: Ensembles) -> CameraPosterior:
    frame = read_image(path)
    rows, columns = frame.image.shape
    camera = Camera.from_field_of_view(columns, rows, math.radians(FIELD))
    tracker = Tracker(Detection(), Identification(focal_tolerance=0.02))
    spots, matches, _ = lost_in_space(frame, camera, PatternIndexes(stars), tracker)
    prior = Prior(0.05, 20.0, 0.3, 0.01, 2.0)
    found = sample_camera([spots], [matches], camera, prior, 1, ensembles, images=[frame])
    focal = found.interval("focal_length_px")
    print(path.name, len(matches), focal, found.chains.reason_unconverged)
    return found


if __name__ == "__main__":
    command.run(main)
