"""Trials in time: tracking, loss and reacquisition.

parameters  Sequence: how the platform turns, how often a frame is taken, and what the filter
            leans on.
flight      A profile and jitter enter; the true motion of each frame and the gyroscope's output
            leave.
follow      One frame's attitude and the filter's state -> the filter's next state.
run         A case flies a sequence -> a table with a row a frame.
summary     Tables of sequences -> accuracy, losses of track and reacquisitions, with intervals.
"""

from startrack.sequence.parameters import Gyro, Leg, Sequence, load_sequence
from startrack.sequence.run import FRAMES, Mode, fly_sequences, run
from startrack.sequence.summary import Tracking, summarise_sequences

# Public; the other imports serve other rooms.
__all__ = [
    "FRAMES",
    "Gyro",
    "Leg",
    "Mode",
    "Sequence",
    "Tracking",
    "fly_sequences",
    "load_sequence",
    "run",
    "summarise_sequences",
]
