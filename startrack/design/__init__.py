"""Instrument, Tracker, Scene and campaign: the contents of a design file.

epoch         Scene, Selection -> the catalogue's epoch and orbital velocity, which must not
              contradict the scene.
case          Case: true values and values that the tracker assumes, kept apart; Fidelity of a
              trial.
products      Table of a design -> the same table with the values of its detector product.
measured_tables  Tables of a photon transfer or of stars -> measured figures of a design.
spectrum      Table of a design -> the same table with power spectra of jitter from its files.
parameter     Dotted name, case -> the value at this name, its unit, or a case with other values.
variables     Variable, Link, DesignSpace, Choice: the parameters of a case that a campaign may
              change.
objective     Outcomes of trials -> the error that is minimised, and ratios of it.
requirements  Requirements: limits of a design besides accuracy, with the cost of its lens.
conditions    Condition: a further rate, background or age at which a design is judged.
variation     Variation: differences of a true value between units, environments and in time.
structure     Structure: the carrier of lens and detector, and their motion with temperature.
campaign      Campaign: objective, limits, conditions and variables of a study.
told          Told: a figure of a design that somebody measured or published.
unknown       Laws of unknown values of a design file, and draws from them.
keys          The keys of a design file, as a list, a template with values, and a JSON Schema.
key_search    Words of a datasheet, keys of a design file -> the keys that they mean.
overlay       Design files that refer to a base file and contain only the differences.
files         Design files: a case, and optionally a campaign on it, as TOML with units in strings.
"""

from startrack.design.campaign import Campaign, fewest_trials_beyond
from startrack.design.case import (
    CameraCalibration,
    Case,
    Fidelity,
    Instrument,
    Temperatures,
    Tracker,
)
from startrack.design.conditions import NOMINAL, Change, Condition, Judged, OverUnits, turning
from startrack.design.files import Design, load_design, save_design
from startrack.design.key_search import search_keys
from startrack.design.keys import (
    DRAFT,
    OF_FILES,
    Key,
    changed_limits,
    design_keys,
    design_schema,
    item_of,
    keys_of,
    plain_schema,
    range_of,
    table_schema,
    template,
)
from startrack.design.objective import AXES, Objective
from startrack.design.overlay import differences, save_over, save_overlay
from startrack.design.parameter import find as found_at
from startrack.design.parameter import number as number_at
from startrack.design.parameter import (
    paths,
    quantity,
    replaced,
    replaced_all,
    unchecked,
    unit_at,
    with_changes,
    with_values,
)
from startrack.design.parameter import text as value_text
from startrack.design.products import KEPT, OPERATED, products, with_product
from startrack.design.requirements import COSTS, Accuracy, KeepOut, Requirements, cost_of
from startrack.design.structure import TURNS, Structure
from startrack.design.told import ERROR_FIGURES, FRAME_FIGURES, Told
from startrack.design.unknown import INCLUDE, Unknown, stratified
from startrack.design.variables import (
    OF_IMAGES,
    Choice,
    DesignSpace,
    Link,
    Variable,
    bounds_of,
    branches,
    followed,
)
from startrack.design.variation import (
    Moment,
    Scope,
    Variation,
    aged,
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
    "Change",
    "Choice",
    "Condition",
    "DesignSpace",
    "KeepOut",
    "Link",
    "Objective",
    "OverUnits",
    "Requirements",
    "Scope",
    "Structure",
    "Temperatures",
    "Told",
    "Unknown",
    "Variable",
    "Variation",
    "replaced",
]
