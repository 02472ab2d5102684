"""The first sections of the page: the design in ten lines, the verdicts, the lost trials."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from startrack.core import arcsec, deg, mm, um
from startrack.design import Case
from startrack.metrics import STATED_ALONE, fraction_interval
from startrack.montecarlo import Ending, Serial, Store, endings, run
from startrack.report.page import Section, paragraph, table
from startrack.verification import (
    VERDICT_HEAD,
    Looks,
    Verdict,
    cases,
    verdict_notes,
    verdict_rows,
    verify,
)

OTHER = 2 * 10**8  # number of the first trial in the other conditions, which no command repeats


def design(case: Case) -> Section:
    """The design in ten lines."""
    instrument, tracker = case.instrument, case.tracker
    optics, detector, camera = instrument.optics, instrument.detector, instrument.camera
    field = [
        2 * math.atan(n / 2 / camera.focal_length_px) / deg for n in (camera.columns, camera.rows)
    ]
    scene, motion, identification = case.scene, instrument.motion, tracker.identification
    sky = "none" if scene.background_g is None else f"G {scene.background_g:g} per arcsec^2"
    jitter = " with jitter" if motion.tones or motion.broadband else ""
    rows = [
        ["lens", f"{optics.focal_length / mm:.4g} mm, f/{optics.f_number:.3g}, aperture "
                 f"{optics.aperture / mm:.3g} mm, blur {optics.blur / um:.3g} um"],
        ["detector", f"{detector.columns} x {detector.rows} pixels of "
                     f"{detector.pitch / um:.3g} um, {detector.bits} bit"],
        ["field", f"{field[0]:.2f} x {field[1]:.2f} deg, {1 / camera.focal_length_px / arcsec:.1f} "
                  "arcsec a pixel"],
        ["exposure", f"{1e3 * detector.exposure:.4g} ms, {detector.update_rate:.3g} frames / s"],
        ["noise", f"read {detector.read_noise:.3g} electron, dark current "
                  f"{detector.dark_current:.3g} electron / s, PRNU {100 * detector.prnu:.2g} %"],
        ["sky", f"background {sky}; lights: {', '.join(scene.lights) or 'none'}"],
        ["stars", f"{case.catalog.source} {case.catalog.extent}"],
        ["motion", f"{motion.rate / deg:.3g} deg / s{jitter}"],
        ["detection", f"threshold {tracker.detection.threshold:g}" if tracker.detection.threshold
                      else "threshold from the false spots allowed"],
        ["identification", f"{identification.min_matches} stars at least; focal length known to "
                           f"{100 * identification.focal_tolerance:.2g} %"],
    ]  # fmt: skip
    return Section("Design", table("The design in ten lines", ["part", "value"], rows))


def verdict(
    store: Store, outcomes: NDArray[np.void], trials: int, advance: Callable[[int], None]
) -> Section:
    """Each requirement of the campaign, by analysis and by trials.

    trials  in each condition but the design's own, whose trials are those of the store
    """
    campaign = store.campaign
    if campaign is None:
        return Section("Verdict", paragraph("The design names no requirement."))
    if store.sampling.attitudes != "random":
        return Section("Verdict", paragraph("A verdict needs trials at random attitudes."))

    def of(case: Case, number: int) -> NDArray[np.void]:
        if case == store.case:
            return outcomes
        fidelity = store.sampling.fidelity
        return run(case, trials, store.seed, Serial(), OTHER, progress=advance, fidelity=fidelity)

    confidence = campaign.requirements.confidence
    looks = Looks(len(outcomes), len(outcomes), 1 - confidence) if len(outcomes) > 1 else None
    if looks is None:
        return Section("Verdict", paragraph("A verdict needs two trials or more."))
    found = verify(store.case, campaign, of, store.seed, looks)
    own = found.verdicts[0].condition
    counts = [one.number if one.condition == own else trials for one in found.verdicts]
    found = replace(found, verdicts=tuple(map(_counted, found.verdicts, counts)))
    lines = verdict_notes(found)
    lines[-1] = (
        f"Tested once: the design's own condition on the {len(outcomes)} trials of the campaign, "
        f"each other one on {trials}. {lines[-1].partition('decided; ')[2]} "
        "Each end of the bounds is one-sided, as the test asks; intervals elsewhere are two-sided."
    )
    return Section(
        "Verdict",
        paragraph(f"All requirements together: {found.answer.value}.")
        + table("Requirements", VERDICT_HEAD, verdict_rows(found))
        + "".join(paragraph(line) for line in lines),
    )


def _counted(one: Verdict, number: int) -> Verdict:
    """With the number of trials that were run; those by formula have none."""
    return replace(one, number=number) if one.trials else one


def other_conditions(store: Store) -> int:
    """Number of conditions whose trials `verdict` runs."""
    campaign = store.campaign
    return len(cases(store.case, campaign)[0]) - 1 if campaign else 0


def lost(store: Store, outcomes: NDArray[np.void]) -> Section:
    """How trials ended, with counts."""
    needs = campaign.requirements if (campaign := store.campaign) else None
    attitudes = store.sampling.attitudes_of(store.seed, outcomes["trial"].tolist())
    limits, keep_out = (needs.limits, needs.min_keep_out) if needs else (STATED_ALONE, None)
    found = endings(store.case, store.seed, outcomes, attitudes, limits, keep_out)
    rows, percent = [], partial("{:.3g}".format)
    for one, count in found.count().items():
        share = fraction_interval(count, len(outcomes))
        example = next(
            (
                f"trial {outcomes['trial'][n]}: {found.reason[n]}"
                for n, each in enumerate(found.ending)
                if each is one and one is not Ending.CORRECT
            ),
            "",
        )
        each = (percent(100 * value) for value in (share.value, share.low, share.high))
        rows.append([one.value, str(count), *each, example])
    head = ["end", "trials", "%", "from", "to", "the first"]
    return Section("Lost trials", table("How the trials ended", head, rows))
