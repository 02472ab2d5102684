"""Trials in time: a camera that flies a profile, and a tracker that follows it frame by frame.

parameters  Sequence: legs of the attitude profile, rate of frames, gyroscope, patience
profile     legs -> attitudes and rates at any time
flight      profile and jitter, which goes on over the frames -> the true motion of each frame
gyro        the true motion -> what a gyroscope shows between the frames
follow      one frame's attitude and the filter's state -> the filter's next state
run         all of it, one line a room -> a table with a row a frame
summary     many tables -> accuracy, losses and reacquisitions, with intervals
"""

from startrack.sequence.parameters import Gyro, Leg, Sequence, load_sequence
from startrack.sequence.run import FRAMES, Mode, fly, run
from startrack.sequence.summary import Tracking, summarise

__all__ = [
    "FRAMES",
    "Gyro",
    "Leg",
    "Mode",
    "Sequence",
    "Tracking",
    "fly",
    "load_sequence",
    "run",
    "summarise",
]
