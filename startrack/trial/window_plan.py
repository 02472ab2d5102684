"""Case -> plan of its trials in windows: law of the noise, sampled frames, images of the stars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from startrack import core, detection
from startrack.catalog import open_sky
from startrack.core import Floats, Ints, kept
from startrack.design import Case
from startrack.detection import DetectionPlan, FrameBackground, margin, peak_border
from startrack.detector import (
    Detector,
    NumberDistributions,
    ProposalRates,
    TiltedLaw,
    frame_of,
    number_distributions,
    outlier_pixels,
    proposal_rates,
    require_independent_pixels,
    tilted_law,
)
from startrack.observation import (
    as_believed,
    colours_of,
    detection_plan,
    electrons_of,
    expected_electrons,
    images_of,
    line_of_sight,
    psf_of,
    random_attitude,
    sky_electrons,
    stars_in_field,
)
from startrack.trial.effects import require_window

Smear = tuple[float, float] | None
SAMPLES = 16  # number of frames whose background and noise represent all frames
SAMPLE_SEED = 2**63 - 1
# Limits of the deviation of a pixel's mean, in sigma of its noise; pixels beyond are outliers. Each
# outlier costs a window. All other pixels raise the number of crossings, and so of proposals.
OUTLIER_LIMITS = (4.0, 2.0, 1.2, 0.6)
# Times in units of the time of a pixel in a whole frame, measured on frames of 512 and 1024 pixels
# a side.
WINDOW_PIXEL = 3.0  # time of a pixel that is rendered in a window
PROPOSAL = 300.0  # time of a proposed crossing; its windows, if it is accepted, are included


class Noise(NamedTuple):
    """The distribution of noise that exceeds the search level.

    outliers  (k,) row * columns + column of the pixels to which the distributions do not apply
    numbers   distributions of the numbers of a frame without stars
    tilt      the same distributions, given that the filtered number exceeds the level
    grounds   levels of some frames, and the rates of proposals in them
    """

    outliers: Ints
    numbers: NumberDistributions
    tilt: TiltedLaw
    grounds: tuple[tuple[FrameBackground, ProposalRates], ...]


@dataclass(frozen=True, eq=False)
class WindowPlan:
    """Values that all trials of a case share.

    detector   detector without its lag, which changes stars only, not a uniform background
    star       (n,) electron of each star of the sky; None for a scene with other lights
    colour     (n,) metre, mean wavelengths of the stars, if the image varies with colour
    sky        electron in a pixel of mean response
    psf        images of stars
    noise      law of false spots; None if whole frames take less time than windows
    threshold  sigma
    fraction   (k,) 1, fraction of a star's light in a pixel of the filtered frame, at a distance of
               0, 1, 2, ... pixel
    spread     pixel, distance over which a pixel of the filtered frame depends on others
    detection  detection plan of the tracker
    workspace  workspace of the frames
    """

    detector: Detector
    star: Floats | None
    colour: Floats | None
    sky: float
    psf: core.Psf | core.FieldPsf
    noise: Noise | None
    threshold: float
    fraction: Floats
    spread: int
    detection: DetectionPlan
    workspace: core.Workspace


@kept(8)
def plan_windows(case: Case, smear: Smear = None) -> WindowPlan:
    """Render and measure some frames of a case; cached for the last 8 cases."""
    instrument = case.instrument
    detector, psf = replace(instrument.detector, lag=0.0), psf_of(instrument)
    require_independent_pixels(detector)
    # Lights that vary over the field are refused later, at the attitudes where they vary.
    require_window(case, "instrument.ghosts", "tracker.detection.search", "tracker.rate")
    sky = sky_electrons(case)
    plan = detection_plan(case, smear=smear)
    grounds = [ground_of(case, core.Streams(SAMPLE_SEED, n), plan) for n in range(SAMPLES)]
    kernel = plan.kernel
    stars_alone = not case.scene.lights
    return WindowPlan(
        detector=detector,
        star=electrons_of(case) if stars_alone else None,
        colour=colours_of(case) if instrument.optics.tabulated and stars_alone else None,
        sky=sky,
        psf=images_of(instrument),
        noise=None if detector.flickers else noise_of(detector, sky, grounds, plan),
        threshold=plan.threshold(detector.columns * detector.rows),
        fraction=detection.star_profile(psf, kernel),
        spread=kernel.half + (plan.correction is not None),
        detection=plan,
        workspace=core.Workspace(),
    )


def noise_of(
    detector: Detector, sky: float, grounds: Sequence[FrameBackground], plan: DetectionPlan
) -> Noise | None:
    """Noise distributions, with the number of outlier pixels for which windows take least time.

    plan     plan of the detection; a hot pixel of its dark map is not an outlier
    Returns  None if whole frames take less time, or if the noise spans too many digital numbers for
             a table
    """
    level, mesh = float(np.median([ground.lowest for ground in grounds])), grounds[0].sky.mesh
    weight, border = plan.kernel.whole.astype(float), peak_border(plan.settings)
    hot, shift = None, {}
    if plan.correction is not None:
        hot, weight = plan.correction.hot, np.pad(weight, 1)
        shift["shift"] = detection.filtered(
            detection.correction_image(plan.correction), plan.kernel
        )
    far = margin(plan) + max(weight.shape) // 2
    best, least = None, float(detector.columns * detector.rows)
    for limit in OUTLIER_LIMITS:
        outliers = outlier_pixels(detector, sky, limit)
        if hot is not None:
            outliers = np.setdiff1d(outliers, hot, assume_unique=True)
        apart = cost(len(outliers) * (2 * far + 1) ** 2, 0)
        if apart >= least:
            break  # a lower limit makes more outliers
        numbers = number_distributions(detector, sky, outliers, hot)
        if numbers is None:
            continue
        tilt = tilted_law(numbers, weight, level, mesh, border, **shift)
        rates = [proposal_rates(numbers, tilt, ground.lowest) for ground in grounds]
        drawn = cost(0, float(np.mean([ground.total for ground in rates])))
        if apart + drawn < least:
            best, least = (
                Noise(outliers, numbers, tilt, tuple(zip(grounds, rates, strict=True))),
                apart + drawn,
            )
        if drawn <= apart:
            break  # a lower limit saves less time than it costs
    return best


def ground_of(case: Case, streams: core.Streams, plan: DetectionPlan) -> FrameBackground:
    """Background and noise of one frame of the design; its stars raise both a little."""
    case = replace(case, scene=replace(case.scene, lights=()))
    instrument, attitude = case.instrument, random_attitude(streams)
    in_field = stars_in_field(open_sky(case.catalog), attitude, instrument.camera)
    path = line_of_sight(instrument, streams)
    electrons = expected_electrons(case, in_field, path, attitude, streams)
    frame = as_believed(case, frame_of(electrons, instrument.detector, streams))
    return detection.measure_ground(frame, plan)


def cost(pixels: float, proposals: float) -> float:
    """Time of windows and of drawing crossings, in pixels of a whole frame."""
    return WINDOW_PIXEL * pixels + PROPOSAL * proposals
