"""Case -> effects that its analytic budget leaves out, a phrase each; check by trials."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from startrack import observation, response, trial
from startrack.budget.budget import Budget, ErrorLaw
from startrack.core import Floats, Psf, Refused, arcsec, printed
from startrack.design import Case, Fidelity
from startrack.metrics import Summary, bracketed, fraction_interval, summarise
from startrack.trial import left_out

# Limits above which an effect may change the error by more than 15 %, or the availability by more
# than 1 %. Chosen by hand from the designs of experiments/budget_against_trials.py.
UNKNOWN_SMEAR = 2.5  # pixel
LONGEST = 27.0  # pixel; the half sides of the window of a fit end at 15 pixel
IN_WINDOW = 0.65  # fraction of a star's light inside the window of its centre of gravity
ROLLED = 1.5  # pixel of smear in the corner, by rotation about the boresight
SHAKEN = 1.0  # pixel rms of jitter
FEW = 10.0  # stars in a field, below which its identification is uncertain
PART = 0.01  # fraction of the sky
FASTER = 1.2  # pixel rate over the rate at which the read noise holds
CROWDED = 0.03  # fraction of the stars that share their window with another
FAR = 0.5  # rms displacement of stars by wrong assumptions of the tracker, over the match radius
CUT = 2.0  # sigma, level of an empty pixel above zero; at 2 sigma 1/40 of the noise is cut off
HIDDEN = 0.3  # fraction of the kept spots that are hot pixels
REFUSED = 0.3  # fraction of the stars above the threshold

# Meaning of each cause, and the keys that change it.
ADVICE = {
    response.SHOT: "the light of the stars: instrument.optics.f_number, "
    "instrument.optics.focal_length, instrument.detector.exposure, tracker.detection.max_spots",
    response.READ: "instrument.detector.read_noise beside the light of the stars in their windows: "
    "less blur (instrument.optics.defocus), a longer instrument.detector.exposure",
    response.METHOD: "pixels sample the image too coarsely: more blur (instrument.optics.defocus), "
    'or tracker.detection.centroid = "likelihood"',
    "PRNU": "pixels respond unequally: instrument.detector.prnu, or more blur",
    "DSNU": "dark signal differs from pixel to pixel: instrument.detector.thermal.temperature, "
    "instrument.detector.exposure, tracker.detection.dark_map",
    "hot pixels": "pixels with large dark current near stars: tracker.detection.dark_map and its "
    "age, a colder detector (instrument.detector.thermal.temperature), more shielding",
    "read-out": "instrument.detector.settling or impulse_response, instrument.detector.lag, "
    "instrument.detector.nonlinearity, instrument.detector.adc_inl",
    "neighbours": "fainter stars in the window: a smaller tracker.detection.window, less blur",
    response.LENS_FIELD: "the image of a star varies over the field: instrument.optics.defocus, "
    "another lens, fewer tracker.detection.max_spots",
    trial.LENS_COLOUR: "the lens shifts stars of other colours: tracker.focal_length_by_colour, a "
    "narrower instrument.optics.transmission",
    trial.SHUTTER: "rows are exposed one after the other: instrument.detector.row_delay, "
    "instrument.motion.rate_x",
    "camera model": "the tracker's calibration is wrong: tracker.calibration",
    "proper motion": "the tracker's catalogue is of another year: tracker.catalog.epoch",
    "parallax": "tracker.catalog.parallax",
    "aberration": "tracker.catalog.aberration, tracker.catalog.orbital_velocity",
    "mounting": "the true mounting differs from the one that the tracker assumes: tracker.mounting",
    "mounting swing": "heat turns the mounting over an orbit: instrument.mounting.swing_x",
    "time stamp": "tracker.delay",
    trial.JITTER: "the spacecraft moves within an exposure, and the reference is the attitude at "
    "mid-exposure; all heads share this motion, which is no noise of the sensor: "
    "instrument.detector.exposure, instrument.motion.tones; for the mean attitude as reference: "
    'tracker.reference = "mean"',
    trial.JITTER_OF_HEAD: "the mount of the head moves within an exposure, and the reference is "
    "the attitude at mid-exposure: instrument.detector.exposure, instrument.motion.tones",
    trial.HITS: "particles hit pixels: instrument.detector.hits",
}
# Causes that a tracker cannot see in the spots that it weights.
UNSEEN = (
    "camera model",
    "proper motion",
    "parallax",
    "aberration",
    "mounting",
    "mounting swing",
    "time stamp",
    trial.SHUTTER,
    trial.HITS,
)


def advice(budget: Budget[Any]) -> list[str]:
    """Meaning of each cause and the keys that change it; largest error across first."""
    return [
        f"{line.name} ({line.across / arcsec:.3g} arcsec across): {ADVICE[line.name]}"
        for line in sorted(budget.lines, key=lambda line: -line.across)
        if line.name in ADVICE and (line.across or line.about)
    ]


def unseen(budget: Budget[Any]) -> str:
    """A sentence on why a stated covariance may be too small; empty if no reason is known."""
    lines = [line for line in budget.lines if line.name in UNSEEN and line.across > 0]
    parts = [f"{line.name} ({line.across / arcsec:.3g} arcsec across)" for line in lines]
    of_units = "unit", "instrument.structure"  # causes that the unit as designed does not have
    if any(not any(word in text for word in of_units) for text in budget.left_out):
        parts.append("effects that are left out")
    return f"the tracker does not know of {'; '.join(parts)}" if parts else ""


def of_the_case(case: Case) -> Iterator[str]:
    """Effects that the budget leaves out, by the parameters of the design alone."""
    yield from left_out(case)
    detector = case.instrument.detector
    rated = detector.read_noise_rate
    if rated and detector.pixel_rate > FASTER * rated:
        yield (
            f"more read noise at {detector.pixel_rate / 1e6:.3g} Mpix/s than at {rated / 1e6:.3g}, "
            "for which instrument.detector.read_noise is given"
        )
    size = response.scale(case)
    level = size.background + detector.offset * detector.electrons_per_dn
    if level < CUT * size.pixel:
        yield (
            f"that the converter cuts noise off at zero, {level / size.pixel:.1f} sigma below an "
            "empty pixel, so that errors are smaller (instrument.detector.offset)"
        )
    plan = observation.detection_plan(case)
    inside = 1.0 if plan.method.skips_dead else _in_window(plan.star.psf, plan.settings.window)
    if inside < IN_WINDOW:
        yield (
            f"shifts by noise of a window that holds only {100 * inside:.0f} % of a star's light "
            "(tracker.detection.window)"
        )
    if trial.boxed(case) and case.instrument.optics.tabulated:
        yield (
            "that the image in a box varies over the field and with its place in the pixel; only "
            "the mean displacement is counted (instrument.optics)"
        )
    yield from _of_the_motion(case)


def _of_the_motion(case: Case) -> Iterator[str]:
    instrument = case.instrument
    motion, focal = instrument.motion, instrument.camera.focal_length_px
    true = np.array(observation.smear_of(case, motion.rate_x, motion.rate_y))
    believed = np.array(observation.detection_plan(case).settings.smear)
    # The two directions of a motion make the same streak.
    unknown = min(float(np.hypot(*(true - believed))), float(np.hypot(*(true + believed))))
    if unknown > UNKNOWN_SMEAR:
        yield (
            f"{unknown:.1f} pixel of smear that the tracker does not know (tracker.motion, "
            "tracker.detection.smear_x and smear_y)"
        )
    longest = float(np.hypot(*believed))
    if longest > LONGEST:
        yield f"the ends of a streak of {longest:.0f} pixel, beyond the window of its fit"
    corner = math.tan(instrument.camera.half_diagonal) * focal
    rolled = abs(motion.rate_z) * instrument.detector.exposure * corner
    if rolled > ROLLED:
        yield f"a smear of up to {rolled:.1f} pixel in the corners (motion.rate_z)"
    rms = math.hypot(*(math.hypot(tone.rms_x, tone.rms_y) for tone in motion.tones))
    rms *= motion.jitter_factor * focal
    if rms > SHAKEN:
        yield f"that jitter of {rms:.1f} pixel rms is not a Gaussian blur (motion.tones)"


def _in_window(psf: Psf, window: int) -> float:
    """Fraction of a star's light in a window about its middle."""
    # The table holds the light of a pixel about each of its points.
    middle, half = len(psf.table) // 2, (window // 2) * psf.oversampling
    part = slice(max(middle - half, 0), middle + half + 1)
    pixels = psf.table[part, part][:: psf.oversampling, :: psf.oversampling]
    return float(pixels.sum())


def of_the_sky(case: Case, stars: Floats, refused: float, moved: float) -> Iterator[str]:
    """Effects that the budget leaves out because of the stars in its fields.

    stars    (m,) expected number in each field
    refused  1, fraction of the stars above the threshold that are rejected as hot pixels
    moved    pixel, rms displacement of stars by wrong assumptions of the tracker
    """
    detector, settings = case.instrument.detector, case.tracker.detection
    least = min(FEW, round(0.9 * settings.max_spots))
    few = float((stars < least).mean())
    by_search = not trial.boxed(case)  # each box has its star
    if by_search and few > PART:
        yield (
            f"wrong identification, in the {100 * few:.0f} % of the sky with fewer than "
            f"{least:.0f} stars"
        )
    elif by_search and refused > REFUSED:
        yield f"wrong identification, as {100 * refused:.0f} % of the stars are missing"
    side = settings.window + math.hypot(*observation.detection_plan(case).settings.smear)
    crowded = float(stars.mean()) * settings.window * side / (detector.columns * detector.rows)
    if crowded > CROWDED:
        yield f"wrong centroids of merged stars, {100 * crowded:.0f} % of all"
    if moved > FAR * case.tracker.identification.match_radius:
        yield (
            f"stars outside tracker.identification.match_radius: they are {moved:.2g} pixel rms off"
        )


def of_the_catalog(case: Case, likely: float, available: float) -> Iterator[str]:
    """Stars that are left out because the camera sees fainter stars than the catalogue has.

    likely     1, probability that a star at the catalogue's limit is detected
    available  1, of the sky
    """
    if likely > 0.5 and available < 1 - PART:
        yield (
            f"stars beyond G {case.believed_catalog.limit_g:g}, at which the tracker's catalogue "
            "ends though the camera sees fainter ones (catalog.source, catalog.limit_g)"
        )


def of_false_spots(case: Case, brighter: float) -> Iterator[str]:
    """Effects left out if hot pixels make many spots that are brighter than stars."""
    most = case.tracker.detection.max_spots
    if brighter > HIDDEN * most:
        yield (
            f"wrong identification, as {brighter:.0f} of {most} spots are hot pixels "
            "(tracker.detection.dark_map, max_spots)"
        )


def caveats(case: Case, left_out: tuple[str, ...]) -> list[str]:
    """Sentences on the limits of a budget, besides `refusal`; `left_out` as for `Budget`."""
    what = "; ".join(left_out) or "no effect of the design"
    whose = " of the unit as designed" if case.varying else ""
    sentences = [f"not counted{whose}: {what}"]
    return sentences if case.differs else [*sentences, noise_only(case)]


def noise_only(case: Case) -> str:
    """One sentence on the effects that a budget of the unit as designed leaves out."""
    if case.differs:
        return "noise only: what differs between units is left out (--units N)"
    return (
        "noise only: a perfect unit on its first day; the design has no [[variation]], "
        "[instrument.residual] or [instrument.detector.age]"
    )


def refusal(case: Case, refused: float) -> list[str]:
    """Why many stars are rejected as hot pixels, which may enlarge errors; empty if few are.

    refused  1, rejected fraction of the stars above the threshold
    """
    if refused < PART:
        return []
    return [
        f"{100 * refused:.0f} % of the stars above the threshold are rejected as hot pixels: they "
        "are sharper than tracker.detection.sharpest_sigma = "
        f"{case.tracker.detection.sharpest_sigma:g} pixel; more blur, or a smaller limit, keeps "
        "them"
    ]


# Numbers of trials in each fidelity; chosen by hand for one or two seconds on one core.
WINDOWS, FRAMES, DRAWN = 60, 24, 200
LARGEST = 2**20  # pixel, largest frame that is rendered more than a few times
FEWEST = 6  # frames, least number for any size of detector
AGREEING = 1.15  # ratio of formula and trials up to which they agree outside the interval
SURE = 0.99  # confidence level of the interval of the availability


@printed
@dataclass(frozen=True)
class TrialCheck:
    """Comparison of a design's analytic budget with trials.

    fidelity  fidelity of the trials
    summary   summary of the trials
    differs   sentences, one for each value of the formula outside the trials' interval
    """

    fidelity: Fidelity
    summary: Summary
    differs: tuple[str, ...]


def check(case: Case, budget: Budget[ErrorLaw], seed: int) -> TrialCheck:
    """Compare a budget with some trials, in fidelity `window` if possible.

    Large detectors are compared by drawn spots. If the motion has effects that both the formula and
    drawn spots leave out, windows are used. If neither supports the design, a few frames are used.

    Raises    ValueError if no fidelity supports the design.
    Accuracy  statistical: 60 trials give an rms within 9 %, and detect a loss of 5 % of the trials
              with a probability of 95 %.
    """
    detector = case.instrument.detector
    pixels = detector.columns * detector.rows
    small = pixels <= LARGEST
    windows = small or any(_of_the_motion(case))
    fidelity, count = (Fidelity.WINDOW, WINDOWS) if windows else (Fidelity.SPOTS, DRAWN)
    try:
        outcomes = trial.run_trials(case, seed, range(count), fidelity)
    except Refused:
        fidelity = Fidelity.FRAME
        count = FRAMES if small else max(FEWEST, FRAMES * LARGEST // pixels)
        outcomes = trial.run_trials(case, seed, range(count), fidelity)
    summary = summarise(outcomes)
    return TrialCheck(fidelity, summary, tuple(differences(budget, summary)))


def differences(budget: Budget[Any], summary: Summary) -> Iterator[str]:
    """Errors of a budget that differ from the trials by more than 15 % and lie outside the
    interval."""
    trials = summary.trials
    if not summary.availability.value > 0:
        yield (
            f"the availability is {100 * budget.availability:.1f} % by formula, and none of "
            f"{trials} trials has a correct attitude"
        )
        return
    for name in ("across", "about"):
        formula, error = getattr(budget, name), getattr(summary, name)
        low, high = error.low / AGREEING, error.high * AGREEING
        if formula < low or formula > high or not error.value > 0:
            yield (
                f"the error {name} the boresight is {formula / arcsec:.3g} arcsec by formula and "
                f"{bracketed(error, '.3g', arcsec)} arcsec by {trials} trials"
            )
    correct = round(trials * summary.availability.value)
    available = fraction_interval(correct, trials, SURE)
    if not available.low <= budget.availability <= available.high:
        yield (
            f"the availability is {100 * budget.availability:.1f} % by formula and "
            f"{bracketed(available, '.3g', 0.01)} % by {trials} trials"
        )
