"""From a frame to a mission: heads on a spacecraft, its orbit and attitude law, over years.

parameters  Mission: orbit, attitude law, heads, time and requirements, as a mission file gives
            them.
ccsds       CCSDS orbit and attitude ephemeris messages, read and written as text.
spice       SPICE kernels of orbit (SPK) and attitude (CK), written and read.
law         Attitude -> Law: place of the spacecraft -> its axes at every instant.
instants    Mission and instants -> where the spacecraft is, how it points, Sun and Moon.
structure   Structure of the spacecraft and instants -> its angle from a head's line of sight.
heads       Heads and instants -> angles to Sun, Moon and Earth, and what makes each head blind.
surrogate   Case and ranges of conditions -> the error of a head in any direction of the sky.
fusion      Errors of several heads -> covariance of their fused attitude; fusion of quaternions.
alignment   Attitudes of two heads in time -> their relative alignment, and how it drifts.
engine      Mission -> Flown: what blinds each head at every step; error of the fused attitude.
placement   Plan of a mission -> mountings of its heads that meet its requirements best.
rendered    Plan of a mission -> trials at its instants: what heads see, and their errors checked.
aocs        Case -> HeadModel: its error as data and C code, for simulators of attitude control.
simulators  HeadModel -> an FMU, parameters of Basilisk's starTracker, a block of 42.
timeline    Plan of a mission, some of its steps -> a table with a row for each step.
store       Plan of a mission -> its flown parts on disk; a run that was stopped goes on.
summary     Flown -> availability by number of heads, times without an attitude, reacquisition,
            verdicts.
"""

from startrack.mission.alignment import RelativeAlignment, relative_alignment
from startrack.mission.aocs import HeadModel, head_model, write_model
from startrack.mission.ccsds import read_aem, read_oem, write_aem, write_oem
from startrack.mission.engine import Flown, Plan, fly, plan_of
from startrack.mission.fusion import fuse, fused_variance, head_covariance
from startrack.mission.heads import Blind
from startrack.mission.parameters import KeepClear, Loaded, Mission, load_mission, save_mission
from startrack.mission.placement import (
    Placement,
    Trade,
    angles_of,
    map_of,
    moved_plan,
    place,
    trades,
)
from startrack.mission.rendered import Checked, checked, scenes_at
from startrack.mission.simulators import write_42, write_basilisk, write_fmu
from startrack.mission.spice import read_ck, read_spk, write_ck, write_spk
from startrack.mission.store import flown_from, key_of
from startrack.mission.summary import (
    EDGES,
    Availability,
    OfBeta,
    Reacquisition,
    Spells,
    Verdict,
    availability_of,
    over_beta,
    reacquisition_of,
    verdicts,
)
from startrack.mission.timeline import save_timeline, timeline, write_kernels
from startrack.space import PLANETS
