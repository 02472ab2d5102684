"""Trials in time: tracking, loss and reacquisition.

parameters  Sequence: profile of the platform, period of the frames, and settings of the filter.
flight      Profile and jitter -> true motion of each frame, and output of the gyroscope.
run         Case and sequence -> a table with a row for each frame; the filter's next state.
summary     Tables of sequences -> accuracy, losses of track and reacquisitions, with intervals.
"""

from startrack.sequence.parameters import Gyro, Leg, Sequence, SequenceHead, load_sequence
from startrack.sequence.run import Mode, Recording, fly_sequences, run
from startrack.sequence.summary import Tracking, summarise_sequences

# Public; the other imports serve other rooms.
__all__ = [
    "Gyro",
    "Leg",
    "Recording",
    "Sequence",
    "SequenceHead",
    "fly_sequences",
    "load_sequence",
    "run",
]
