"""Instrument, Tracker, Scene and campaign: what a design file holds.

epoch         Scene, Selection -> the catalogue's epoch and orbital velocity, which must not
              contradict it.
case          Case: what is true and what the tracker believes, kept apart; how faithful a trial
              is to it.
products      Table of a design -> the same with the values of the detector product that it names.
parameter     Dotted name, case -> the value there, its unit, or a case with other values.
variables     Variable, Link, DesignSpace: named parameters of a case as points of a unit cube.
choice        Case, choices -> branches: the cases with each combination of the values of the
              choices.
objective     Outcomes of trials -> the error that is minimised, and ratios of it.
lens_cost     Optics with a lens table -> mass, volume and price of the lens, from its glass.
requirements  Requirements: what a design must meet before its accuracy counts.
conditions    Condition: a rate, a background or an age at which a design is judged, too.
variation     Variation: how a number of the truth differs between units, environments, in time.
calibration   CameraCalibration: how the camera model of each unit is measured.
campaign      Campaign: what a study of a design is asked.
keys          The keys of a design file: type, unit, range, default and meaning of each.
template      Detector product -> a design file to begin with, its values explained.
schema        These keys -> a JSON Schema, by which editors complete and check a file.
files         Design files: a case, and optionally a campaign on it, as TOML with units in
              strings.
"""

from startrack.design.calibration import CameraCalibration
from startrack.design.campaign import Campaign, fewest_trials_beyond
from startrack.design.case import Case, Fidelity, Instrument, Temperatures, Tracker
from startrack.design.choice import Choice, branches
from startrack.design.conditions import (
    MAX_RATE,
    NOMINAL,
    REST,
    Change,
    Condition,
    Judged,
    OverUnits,
    judged,
    turning,
)
from startrack.design.files import Design, load_design, save_design
from startrack.design.keys import Key, design_keys, keys_of
from startrack.design.lens_cost import LensCost, cost_of, lens_cost
from startrack.design.objective import AXES, KINDS, Objective
from startrack.design.parameter import find as found_at
from startrack.design.parameter import replaced, replaced_all, unchecked
from startrack.design.products import products
from startrack.design.requirements import Accuracy, CaseNumber, KeepOut, Requirements
from startrack.design.schema import design_schema
from startrack.design.template import template
from startrack.design.variables import DesignSpace, Link, Variable
from startrack.design.variation import (
    YEAR,
    Moment,
    Scope,
    Variation,
    aged,
    differences,
    law_of,
    middle_case,
    unit_case,
    unit_values,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Accuracy",
    "CameraCalibration",
    "Campaign",
    "CaseNumber",
    "Change",
    "Choice",
    "Condition",
    "DesignSpace",
    "Judged",
    "KeepOut",
    "Link",
    "Objective",
    "OverUnits",
    "Requirements",
    "Scope",
    "Variable",
    "Variation",
    "judged",
    "replaced",
    "replaced_all",
]
