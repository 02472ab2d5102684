"""Question: how unrealistic is the optimum of a design with noise alone, and how much better is the
optimum with lens, jitter, units and age?

    python experiments/nanosatellite.py [--best FILE.toml] [--json FILE] [--quick]

Two designs are compared by the analytic budget, with effects added step by step from
catalogs/designs/noise_only.toml to nanosatellite.toml: `OLD`, the optimum of the former, and the
best design of `startrack optimize` on the latter (--best; default: `NEW`, of an earlier search).
Values that an optimum did not choose are the best of some values: the blur of an Airy PSF, the
defocus of the old lens. Errors are across, arcsec: the rms of the unit as designed, and with units
the rms that 95 % of `UNITS` units do not exceed at the end of life, also by frames (`on_units`).
A quick run has no lens.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack import Case, Fidelity, arcsec, load_design, mm, shipped, um
from startrack.budget import analytic
from startrack.design import Campaign, Objective, found_at, replaced_all
from startrack.metrics import quantile_of_few
from startrack.optimise import expected_objective
from startrack.population import Units, unit_errors, unit_trials

FOCAL, SPEED = "instrument.optics.focal_length", "instrument.optics.f_number"
DEFOCUS, BLUR = "instrument.optics.defocus", "instrument.optics.blur"
EXPOSURE, STARS = "instrument.detector.exposure", "tracker.detection.max_spots"
LENS = (FOCAL, SPEED, EXPOSURE)  # lens and exposure, common to all steps
OLD = {FOCAL: 45 * mm, SPEED: 1.4, EXPOSURE: 0.216}
NEW = {
    FOCAL: 20.98 * mm,
    SPEED: 2.08,
    DEFOCUS: 63.45 * um,
    EXPOSURE: 0.2235,
    STARS: 30,
    "tracker.calibration.map": 8,
    "instrument.structure.heater": 0.5469,
    "instrument.structure.detector_offset": 1 * mm,
}
BLURS = np.array([4.0, 5.0, 6.0]) * um
DEFOCI = np.array([-60.0, -30.0, -15.0, 0.0, 15.0, 30.0, 60.0]) * um
UNITS, EACH, ENVIRONMENTS = 20, 10, 2


def across(case: Case) -> float:
    """Rms error across of the unit as designed, arcsec."""
    instrument = replace(case.instrument, residual=None)
    return float(analytic(replace(case.without_units, instrument=instrument)).across / arcsec)


def least(case: Case, name: str, values: Any) -> Case:
    """The case with the best of some values of a parameter."""
    every = [replaced_all(case, {name: float(value)}) for value in values]
    return min(every, key=across)


def calm(case: Case) -> Case:
    """The case without jitter and without stars outside the tracker's catalogue."""
    motion = replace(case.instrument.motion, tones=())
    instrument = replace(case.instrument, motion=motion)
    tracker = replace(case.tracker, catalog=None)
    return replace(case, instrument=instrument, tracker=tracker, catalog=case.believed_catalog)


def tracking(case: Case, stars: int) -> Case:
    """The case with another number of tracked stars."""
    return replaced_all(case, {STARS: stars})


def worlds(values: dict[str, Any], quick: bool) -> dict[str, float]:
    """Errors of a design at each step, arcsec."""
    alone = load_design(shipped("designs/noise_only.toml")).case
    plain = replaced_all(alone, {name: values[name] for name in LENS} | {DEFOCUS: 0.0})
    found = {"noise alone": across(least(plain, BLUR, BLURS[: 1 if quick else 3]))}
    if quick:
        return found
    design = load_design(shipped("designs/nanosatellite.toml"))
    assert design.campaign
    real = replaced_all(design.case, values)
    many = tracking(calm(real), alone.tracker.detection.max_spots)
    if DEFOCUS not in values:
        defocus = least(many, DEFOCUS, DEFOCI).instrument.optics.defocus
        real, many = (replaced_all(one, {DEFOCUS: defocus}) for one in (real, many))
        print(f"defocus {defocus / um:.0f} um")
    found["behind the lens"] = across(many)
    found["tracking its stars"] = across(calm(real))
    found["with jitter and faint stars"] = across(real)
    campaign = replace(design.campaign, unit_count=UNITS)
    found["95 % of the units at the end of life"] = level(real, campaign)
    found["on_units"] = on_units(real, campaign)
    return found


def level(case: Case, campaign: Campaign) -> float:
    """Level by the budgets of the units, arcsec."""
    return expected_objective(case, campaign, seed=7) / arcsec


def on_units(case: Case, campaign: Campaign) -> float:
    """Level by frames of other units, arcsec."""
    order = Units(EACH, ENVIRONMENTS, case.end_of_life)
    outcomes = unit_trials(case, 11, range(UNITS * EACH), order, Fidelity.FRAME)
    errors = unit_errors(Objective.read(campaign.objective), outcomes, outcomes["unit"])
    assert campaign.units
    return float(quantile_of_few(errors, campaign.units)) / arcsec


def values_of(path: Path) -> dict[str, Any]:
    """The variables of an optimised design."""
    design = load_design(path)
    assert design.campaign
    return {one.name: found_at(design.case, one.name) for one in design.campaign.variables}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--best", type=Path, help="file of the best design of `startrack optimize`")
    options = command.read(parser)
    designs = {"old": OLD, "new": values_of(options.best) if options.best else NEW}
    found = {name: worlds(values, options.quick) for name, values in designs.items()}
    for world in found["old"]:
        print(f"{world:40}" + "".join(f"{one[world]:10.3f}" for one in found.values()))
    command.save(options, found)


if __name__ == "__main__":
    command.run(main)
