"""From a frame to a mission: heads on a spacecraft, its orbit and attitude law, over years.

parameters  Mission: orbit, attitude law, heads, time and requirements, as a mission file gives
            them.
files       Segments of orbits and attitudes; their SPICE kernels (SPK, CK).
messages    CCSDS messages (OEM, AEM) -> segments of orbits and attitudes.
instants    Mission and instants -> place and attitude of the spacecraft, Sun and Moon.
heads       Heads and instants -> angles to Sun, Moon and Earth, and causes of blindness of a head.
surrogate   Case and ranges of conditions -> the error of a head in any direction of the sky.
fusion      Errors of several heads -> covariance of their fused attitude; fusion of quaternions;
            relative alignment of two heads in time.
engine      Mission -> Flown: blindness of each head at every step; error of the fused attitude.
placement   Plan of a mission -> mountings of its heads that meet its requirements best.
rendered    Plan of a mission -> trials at its instants: scenes of heads, and a check of their
errors.
frames      Plan of a mission -> trials of all heads together beside the expected results, and
            angles between heads before and after a thermal model.
exports     Case -> HeadModel: its error as data and C code, for simulators of attitude control;
            an FMU, parameters of Basilisk's starTracker, a block of 42.
units       Plan of a mission -> temperatures of platform and heads, and errors of spacecraft with
            drawn units as heads.
store       Plan of a mission -> its flown parts on disk, so that a stopped run continues.
summary     Flown -> availability, times without an attitude, reacquisition, verdicts; a table with
            a row for each step.
"""

from startrack.mission.engine import Flown, MissionPlan, at, fly, plan_of
from startrack.mission.exports import (
    SMEARS,
    HeadModel,
    UnitChoice,
    head_model,
    write_42,
    write_basilisk,
    write_fmu,
    write_model,
)
from startrack.mission.frames import Between, agreement, between, frames_of
from startrack.mission.fusion import fuse, fused_variance, head_covariance, relative_alignment
from startrack.mission.heads import Blind
from startrack.mission.instants import motion_of, path_of
from startrack.mission.messages import read_aem
from startrack.mission.parameters import (
    Attitude,
    KeepClear,
    Loaded,
    Mission,
    MissionOrbit,
    MissionRequirements,
    load_mission,
    mounted,
    save_mission,
)
from startrack.mission.placement import angles_of, lightest, map_of, moved_plan, place, trades
from startrack.mission.rendered import Checked, scenes_at
from startrack.mission.store import flown_from
from startrack.mission.summary import (
    EDGES,
    Availability,
    MissionVerdict,
    TimeIntervals,
    availability_of,
    over_beta,
    reacquisition_of,
    save_timeline,
    timeline,
    verdicts,
    write_kernels,
)
from startrack.mission.units import Fleet, fly_units
from startrack.space import PLANETS

# Public; the other imports serve other rooms.
__all__ = [
    "Attitude",
    "Availability",
    "Blind",
    "Fleet",
    "Flown",
    "HeadModel",
    "Loaded",
    "Mission",
    "MissionOrbit",
    "MissionPlan",
    "MissionRequirements",
    "UnitChoice",
    "availability_of",
    "fly",
    "fly_units",
    "frames_of",
    "fuse",
    "head_covariance",
    "head_model",
    "load_mission",
    "motion_of",
    "mounted",
    "path_of",
    "place",
    "plan_of",
    "read_aem",
    "relative_alignment",
    "save_mission",
    "timeline",
    "verdicts",
]
