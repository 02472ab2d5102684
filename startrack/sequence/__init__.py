"""Trials in time: tracking, loss and reacquisition.

parameters  Sequence: profile of the platform, period of the frames, and settings of the filter.
flight      Profile and jitter -> true motion of each frame, and output of the gyroscope.
recording   Frames of a sequence, and images of its stars -> files.
frames      True flight of a head -> its frames, as the flight software gets them.
lasting     Camera and attitude -> the part of the attitude's error that lasts from frame to frame.
tracker_state  Attitudes of the heads -> the state of the tracker between two frames.
head        One head in a sequence: the attitude of each of its frames.
camera_loop  Attitude and rate -> a frame and the tracker's attitude, one after the other.
run         Case and sequence -> a table with a row for each frame.
summary     Tables of sequences -> accuracy, losses of track and reacquisitions, with intervals.
"""

from startrack.sequence.camera_loop import CameraLoop, SeenFrame
from startrack.sequence.parameters import Gyro, Leg, Sequence, SequenceHead, load_sequence
from startrack.sequence.recording import Recording
from startrack.sequence.run import Mode, fly_sequences, run
from startrack.sequence.summary import Tracking, summarise_sequences

__all__ = [
    "CameraLoop",
    "Gyro",
    "Leg",
    "Mode",
    "Recording",
    "SeenFrame",
    "Sequence",
    "SequenceHead",
    "Tracking",
    "fly_sequences",
    "load_sequence",
    "run",
    "summarise_sequences",
]
