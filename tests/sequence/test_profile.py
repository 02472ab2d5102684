"""The profile, and the jitter that continues over the frames, without an image."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from startrack.core.streams import Streams
from startrack.core.units import arcsec, deg
from startrack.motion import Broadband, Motion, Tone, trace
from startrack.sequence import Gyro, Leg, Sequence, load_sequence
from startrack.sequence.flight import attitudes, flight, gyro_rates

LEGS = (Leg(2.0, 3 * deg, -1 * deg, 5 * deg), Leg(1.5, -8 * deg, 0.0, 2 * deg), Leg(4.0))
START = Rotation.from_quat([0.3, -0.2, 0.7, 0.6])


@pytest.fixture
def shaken(small):
    """The small tracker on a platform with a wheel and broadband jitter."""
    motion = Motion(
        tones=(Tone(7.0, rms_x=20 * arcsec, rms_z=60 * arcsec),),
        broadband=(Broadband("y", (0.1, 30.0), (4e-10, 4e-12)),),
    )
    return dataclasses.replace(small.case.instrument, motion=motion)


def test_the_profile_is_the_solution_of_the_kinematic_equation():
    """scipy integrates dA/dt = -[w]x A over the three legs."""
    matrix, at = START.as_matrix(), 0.0
    for leg in LEGS:
        x, y, z = leg.rate_x, leg.rate_y, leg.rate_z
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        solved = solve_ivp(
            lambda _, a, cross=cross: (-cross @ a.reshape(3, 3)).ravel(),
            (0, leg.duration),
            matrix.ravel(),
            rtol=1e-12,
            atol=1e-13,
        )
        matrix, at = solved.y[:, -1].reshape(3, 3), at + leg.duration
        ours = attitudes(LEGS, START, np.array([at])).as_matrix()[0]
        np.testing.assert_allclose(ours, matrix, atol=1e-10)


def test_frames_without_a_gap_join(shaken):
    """One exposure begins at the end of the previous one: profile and jitter do not depend on
    frames."""
    sequence = Sequence(LEGS[:1], period=shaken.detector.exposure)
    true = flight(shaken, sequence, START, Streams(1, 0))
    assert len(true.time) == 25
    paths = [trace(turn, shaken.detector.exposure, 1e-3, 0.1) for turn in true.turns]
    gaps = [
        Rotation.from_rotvec(late.rotation[0])
        * true.attitude[k + 1]
        * (Rotation.from_rotvec(early.rotation[-1]) * true.attitude[k]).inv()
        for k, (early, late) in enumerate(pairwise(paths))
    ]
    # The frame's model adds slew and jitter, off by half their product.
    slew, jitter = 6 * deg * shaken.detector.exposure, 200 * arcsec
    assert max(gap.magnitude() for gap in gaps) < slew * jitter
    assert max(path.rotation[-1].max() for path in paths) > 20 * arcsec


def test_jitter_keeps_its_covariance_between_frames(shaken):
    """Over 400 sequences, frame against frame; false alarm 1e-4 (five sigma of 1 / sqrt(400))."""
    still = Sequence((Leg(1.0),), period=0.1)
    turns = []
    for number in range(400):
        true = flight(shaken, still, START, Streams(3, number))
        turns.append((true.attitude * START.inv()).as_rotvec())
    about_x = np.array(turns)[:, :, 0]
    # A tone against its start: cov = 2 rms^2-weighted (cos w(s-t) - cos ws - cos wt + 1) / 2.
    t = true.time
    phase = 2 * np.pi * 7.0
    want = (20 * arcsec) ** 2 * (
        np.cos(phase * (t[:, None] - t)) - np.cos(phase * t[:, None]) - np.cos(phase * t) + 1
    )
    got = about_x.T @ about_x / 400
    np.testing.assert_allclose(got, want, atol=5 * 2 * (20 * arcsec) ** 2 / np.sqrt(400))


def test_the_gyroscope_integrates_to_the_turn_plus_its_noise(shaken):
    """Allan's law: the sum over a time t has variance arw^2 t + rrw^2 t^3 / 3 + bias^2 t^2."""
    still = dataclasses.replace(shaken, motion=Motion())
    gyro = Gyro(30 * arcsec, 20 * arcsec, 10 * arcsec)
    sequence = Sequence((Leg(10.0, rate_y=1 * deg),), period=0.5)
    sums = []
    for number in range(500):
        streams = Streams(4, number)
        true = flight(still, sequence, START, streams)
        rate = gyro_rates(true, gyro, streams)
        sums.append((rate - [0, 1 * deg, 0]).sum(axis=0) * 0.5)
    span = true.time[-1] - true.time[0]
    want = 900 * span + 400 * span**3 / 3 + 100 * span**2
    got = np.mean(np.square(sums)) / arcsec**2
    assert got == pytest.approx(want, rel=5 * np.sqrt(2 / 1500))  # five sigma: 6e-7


def test_a_gyroscope_of_other_axes_shows_the_turn_about_these(shaken):
    """Of 400 gyroscopes 0.6 deg off: the rms of each rotation is known to 3.5 %, five sigma."""
    gyro = Gyro(0.0, 0.0, 0.0, misalignment=0.01)
    sequence = Sequence((Leg(1.0, rate_y=1 * deg),), period=0.5)
    shown = []
    for number in range(400):
        streams = Streams(4, number)
        still = dataclasses.replace(shaken, motion=Motion())
        shown.append(gyro_rates(flight(still, sequence, START, streams), gyro, streams)[0])
    np.testing.assert_allclose(np.linalg.norm(shown, axis=1), 1 * deg, rtol=1e-12)
    across = np.array(shown)[:, ::2] / deg
    np.testing.assert_allclose(np.sqrt((across**2).mean(axis=0)), 0.01, rtol=0.18)


@pytest.mark.parametrize(
    ("legs", "period", "sentence"),
    [
        ((), None, "legs must hold at least one leg"),
        ((Leg(1.0),), 0.01, "period must be at least the exposure of 0.08 s, got 0.01 s"),
        ((Leg(0.01),), 1.0, "legs must last at least one frame of 0.08 s, got 0.01 s"),
    ],
)
def test_impossible_sequences_are_refused(shaken, legs, period, sentence):
    with pytest.raises(ValueError, match=sentence):
        flight(shaken, Sequence(legs, period), START, Streams(1, 0))


def test_a_camera_that_walks_is_read_and_slopes_over_temperature_are_refused(tmp_path):
    """A unit is written as the refusal of a number without one proposes."""
    path = tmp_path / "slew.toml"
    text = '[[legs]]\nduration = "2 s"\n[camera]\n'
    path.write_text(text + "focal_length_walk = 1e-6\n")
    with pytest.raises(ValueError, match=r"must have a unit, such as '1 s\(-1/2\)'"):
        load_sequence(path)
    path.write_text(text + 'focal_length_walk = "1e-6 s(-1/2)"\n')
    assert load_sequence(path).camera.focal_length_walk == 1e-6
    for slope in ('focal_length_slope = "5e-5 K-1"', "principal_slope = 0.05"):
        path.write_text(f"{text}{slope}\n")
        with pytest.raises(ValueError, match=r"camera\.focal_length_slope .* has one temperature"):
            load_sequence(path)
