"""A tracker over time: acquisition, tracking, loss and reacquisition."""

import dataclasses
import math
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from datetime import datetime, timedelta

import numpy as np
import pytest
from astropy.io import fits
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack import Estimate, Status
from startrack.attitude import CameraFilter, Mounting, State, start
from startrack.attitude.camera import Calibration
from startrack.core import Refused
from startrack.core.units import arcsec, deg
from startrack.design import Fidelity, load_design, replaced
from startrack.detector.ageing import Age, Flicker
from startrack.io import shipped, to_qtable
from startrack.montecarlo.workers import Serial
from startrack.motion import Motion, Tone
from startrack.sequence import (
    Gyro,
    Leg,
    Mode,
    Recording,
    Sequence,
    SequenceHead,
    fly_sequences,
    run,
    summarise_sequences,
)
from startrack.sequence.lasting import error_lengths
from startrack.sequence.run import FRAMES
from startrack.sequence.tracker_state import TrackerState, predict_state, update_state
from startrack.trial.chain import run_random_trial
from startrack.verification import read_windows

GYRO = Gyro(2 * arcsec, 0.05 * arcsec, 5 * arcsec)
CALM = Leg(2.0, rate_x=0.05 * deg)
WILD = Leg(1.5, rate_y=25 * deg)  # smears a star over fifty pixels
AXES = "xyz"
BOTH = Fidelity.FRAME, Fidelity.WINDOW
LOST = 2  # sequences that lose the sky


@pytest.fixture(scope="module")
def lost(small):
    """Slow, fast, slow: the tracker must lose the sky and find it again."""
    sequence = Sequence((CALM, WILD, CALM), period=0.2)
    return fly_sequences(small.case, sequence, LOST, 7, Serial())


def test_a_calm_sequence_is_acquired_once_and_then_tracked(small, tmp_path):
    table = run(small.case, Sequence((CALM,), period=0.2), 3, 0)
    short = Sequence((CALM,), period=0.8)
    plain = run(small.case, short, 3, 0)
    kept = run(small.case, short, 3, 0, Recording(tmp_path, "fits"))
    assert kept.tobytes() == plain.tobytes()
    for k, time in enumerate(plain["time"]):
        path = tmp_path / f"sequence-0001-{k + 1:05d}.fits"
        begun = datetime.fromisoformat(fits.getheader(path)["DATE-OBS"])
        middle = begun + timedelta(seconds=small.case.instrument.detector.exposure / 2)
        assert (middle - datetime(2026, 1, 1)).total_seconds() == pytest.approx(time, abs=2e-6)
    # The stars of the true table are where the frame is bright.
    truth, image = fits.getdata(path, "TRUTH"), fits.getdata(path)
    brightest = truth[np.argmin(truth["G"])]
    x, y = round(float(brightest["X"])), round(float(brightest["Y"]))
    assert image[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3].max() > 5 * np.median(image)
    assert table["mode"].tolist() == [Mode.ACQUIRED] + [Mode.TRACKED] * 9
    np.testing.assert_allclose(np.diff(table["time"]), 0.2)
    np.testing.assert_allclose(table["rate"], 0.05 * deg)


def test_images_of_stars_follow_the_dither(small, tmp_path):
    """A sinusoid of 100 arcsec rms about x, which moves each star along y, in 4 s."""
    sequence = Sequence((Leg(7.2),), period=0.2, dither=(Tone(0.25, rms_x=100 * arcsec),))
    run(small.case, sequence, 3, 0, Recording(tmp_path, None, stars=True))
    [path] = tmp_path.iterdir()
    stars = read_windows(path)
    assert len(stars) >= 3
    expected = math.sqrt(2) * 100 * arcsec * small.case.instrument.camera.focal_length_px
    with np.load(path) as file:
        for star in stars:
            place = np.column_stack([file[f"{star.name}_{axis}"] for axis in "xy"])
            phase = math.pi / 2 * star.time
            terms = np.column_stack([np.cos(phase), np.sin(phase), np.ones(len(phase))])
            x, y = np.hypot(*np.linalg.lstsq(terms, place, rcond=None)[0][:2])
            assert y == pytest.approx(expected, rel=0.1)
            assert x < 0.1 * expected
            # Each image holds its star: the brightest pixel is the one of its place.
            row, column = np.unravel_index(star.number.mean(axis=0).argmax(), (6, 6))
            mean = place.mean(axis=0) - star.corner.mean(axis=0)
            assert abs(column - mean[0]) < 1.6
            assert abs(row - mean[1]) < 1.6


def test_a_wild_slew_loses_the_sky_and_calm_finds_it_again(lost):
    for number in range(LOST):
        one = lost[lost["sequence"] == number]
        wild = (one["time"] > 2) & (one["time"] < 3.5)
        assert (one["mode"][wild] == Mode.COASTED).sum() >= 3
        assert (one["mode"][wild] == Mode.SEARCHING).any()
        # The first calm frame finds the sky without a prediction.
        after = one[one["time"] > 3.5]
        assert after["mode"][0] == Mode.ACQUIRED
        assert (after["mode"][1:] == Mode.TRACKED).all()
    tracking = summarise_sequences(lost)
    assert tracking.losses_per_hour.value * 5.5 / 3600 == pytest.approx(1, rel=0.05)
    assert 1.4 < tracking.reacquisition.value < 2.1  # second, as long as the slew
    assert 0.6 < tracking.known.value < 0.95
    coasts = lost["mode"] == Mode.COASTED
    across = np.hypot(lost["filtered_x"], lost["filtered_y"])
    assert tracking.worst == pytest.approx(
        np.nanmax(np.hypot(across, lost["filtered_z"])), rel=1e-12
    )
    assert np.nanmax(across[~coasts]) > tracking.across.value
    assert tracking.coasted.value > 10 * tracking.across.value
    row = to_qtable(tracking)
    assert row["reacquisition"][0].to_value("s") == tracking.reacquisition.value
    assert row["across_high"][0].to_value("arcsec") * arcsec == pytest.approx(tracking.across.high)


def test_a_gyroscope_bridges_the_slew(small):
    """With rates, the prediction stays valid through the slew: no frame is searched without one."""
    sequence = Sequence((CALM, WILD, CALM), period=0.2, gyro=GYRO, max_coasted_frames=10)
    table = run(small.case, sequence, 7, 0)
    assert (table["mode"] == Mode.COASTED).sum() >= 5
    assert (table["mode"] == Mode.SEARCHING).sum() == 0
    assert (table["mode"][table["time"] > 3.5] == Mode.TRACKED).all()
    blind = table[table["mode"] == Mode.COASTED]
    assert np.abs(blind["filtered_y"]).max() < 60 * arcsec


def test_what_is_known_of_a_gyroscope_outlives_a_loss(small):
    """Ten lost frames at 3 deg/s: bias and axes stay known as well as their random walk allows."""
    gyro = dataclasses.replace(GYRO, misalignment=0.3 * deg)
    sequence = Sequence((CALM,), period=0.2, gyro=gyro, max_coasted_frames=3)
    bias, shown = np.array([1e-5, -2e-5, 3e-5]), np.array([3 * deg, 0, 0])
    covariance = np.diag([1e-12] * 3 + [1e-14] * 3 + [1e-10] * 6 + [1e-9] * 3 + [1e-8] * 3)
    state = State(
        Rotation.identity(), bias, covariance, np.zeros((3, 3)), np.array([1e-3, 0, -1e-3])
    )
    known, lengths = TrackerState(state), error_lengths(small.case)
    nothing = Estimate(Status.NO_MATCH, "clouds", None, np.full((3, 3), np.nan), math.nan, 0, 1.0)
    for frame in range(10):
        known = predict_state(known, shown, 0.2, sequence, lengths)
        known = update_state(known, [nothing], sequence, np.zeros((1, 3, 3, 3)))
        assert (known.predicted is None) == (frame >= 3)
    assert known.state is not None
    walk = 2.0 * gyro.rate_random_walk**2
    np.testing.assert_allclose(np.diag(known.state.covariance)[3:6], 1e-14 + walk, rtol=1e-6)
    where = Rotation.from_rotvec(-state.rate_of(shown) * 2.0) * state.icrs_to_camera
    found = dataclasses.replace(
        nothing, status=Status.SOLVED, icrs_to_camera=where, covariance=np.eye(3) * 1e-10
    )
    again = update_state(known, [found], sequence, np.zeros((1, 3, 3, 3)))
    assert again.fresh
    assert again.predicted is again.state
    assert again.state is not None
    np.testing.assert_allclose(again.state.bias, bias, atol=2e-6)
    np.testing.assert_allclose(again.state.misalignment, state.misalignment, atol=1e-6)


@pytest.mark.parametrize(("turn", "kept"), [([1, 0, 0], [1, 0]), ([0, 1, 0], [0, 1])])
def test_a_turn_renews_the_errors_of_stars_along_which_they_move(small, turn, kept):
    """For a rotation about x, stars move along y: over five pixels, errors in x stay, those in y
    do not."""
    covariance = np.diag([1e-12] * 3 + [1e-16] * 3 + [1e-10] * 9)
    state = State(Rotation.identity(), np.zeros(3), covariance, np.full((3, 3), 1e-6))
    angle = 5 / small.case.believed_camera.focal_length_px
    sequence, lengths = Sequence((CALM,), gyro=GYRO), error_lengths(small.case)
    known = predict_state(TrackerState(state), angle * np.array(turn), 1.0, sequence, lengths)
    assert known.state is not None
    np.testing.assert_allclose(known.state.lasting[:2, 0] / 1e-6, kept, atol=1e-3)
    assert (known.state.lasting[2] > 0.9e-6).all()


def test_a_gyroscope_of_other_axes_is_aligned_by_the_first_slew(small):
    """Rotations of 12 degrees about x and y, in windows; the axes are off by 0.3 degrees (1
    sigma)."""
    gyro = dataclasses.replace(GYRO, misalignment=0.3 * deg)
    legs = [Leg(2.0, rate_x=3 * deg), Leg(2.0, rate_y=3 * deg)] * 2
    table = run(
        small.case, Sequence(tuple(legs), period=0.2, gyro=gyro), 7, 0, fidelity=Fidelity.WINDOW
    )
    late = table[table["time"] > 5]
    assert (late["mode"] == Mode.TRACKED).all()
    square = sum((late[f"filtered_{axis}"] / late[f"filtered_sigma_{axis}"]) ** 2 for axis in AXES)
    assert np.mean(square) < 6


def test_the_filter_is_better_than_a_frame_and_states_its_error(small):
    """12 sequences of 12 frames; errors over stated sigmas follow chi-square, false alarm 1e-4.

    The pixels have the same effect on a star in successive frames, while the filter assumes
    independent frames: the floor is twice that for a single frame.
    """
    sequence = Sequence((Leg(2.4, rate_x=0.05 * deg),), period=0.2, gyro=GYRO)
    attitude = dataclasses.replace(small.case.tracker.attitude, centroid_floor=0.015)
    tracker = dataclasses.replace(small.case.tracker, attitude=attitude)
    table = fly_sequences(
        dataclasses.replace(small.case, tracker=tracker), sequence, 12, 5, Serial()
    )
    last = table[table["time"] > table["time"].max() - 0.01]
    assert len(last) == 12
    assert (last["mode"] == Mode.TRACKED).all()
    late = table[table["time"] > 1.5]
    assert np.mean(late["filtered_z"] ** 2) < 0.6 * np.mean(late["error_z"] ** 2)
    for axis in AXES:
        total = np.sum((last[f"filtered_{axis}"] / last[f"filtered_sigma_{axis}"]) ** 2)
        assert 1e-4 < stats.chi2.cdf(total, 12) < 1 - 1e-4, axis


def test_a_frame_alone_has_the_law_of_a_trial(small):
    """The first frame of a sequence is a trial: the rms values over 60 of each agree (F test,
    1e-4)."""
    rate = small.case.instrument.motion
    legs = (Leg(0.1, rate.rate_x, rate.rate_y),)
    first = fly_sequences(small.case, Sequence(legs), 60, 9, Serial())
    trials = [run_random_trial(small.case, 10, number) for number in range(60)]
    for axis in AXES:
        ours = np.sum(first[f"error_{axis}"] ** 2)
        theirs = np.sum([getattr(one, f"error_{axis}") ** 2 for one in trials])
        # Skies differ in their stars, which halves the degrees of freedom.
        assert 1e-4 < stats.f.cdf(ours / theirs, 30, 30) < 1 - 1e-4


@pytest.mark.skipif(sys.platform == "win32", reason="needs processes that fork")
@pytest.mark.parametrize("rate", [pytest.param(0.0, marks=pytest.mark.slow), 2.0])
def test_windows_of_a_sequence_are_those_of_its_frames(small, rate):
    """The same noise of the same stars; their background is measured in other frames."""
    leg = Leg(6.0, rate_x=rate * deg, rate_z=0.1 * deg)
    sequence = Sequence((leg,), period=0.2, gyro=GYRO)
    whole, parts = (run(small.case, sequence, 3, 0, fidelity=one) for one in BOTH)
    assert (parts["mode"][1:] == Mode.TRACKED).all()
    for axis in AXES:
        frame, window = whole[f"error_{axis}"], parts[f"error_{axis}"]
        assert np.std(window - frame) < 0.8 * np.std(frame)
        assert np.corrcoef(frame, window)[0, 1] > 0.7
        assert np.std(window) == pytest.approx(np.std(frame), rel=0.25)


@pytest.mark.slow
def test_a_wrong_camera_is_calibrated_in_a_sequence(small):
    """With wrong focal length and distortion, errors of frames decrease to those of a known camera.

    The principal point is fixed: it and the attitude are nearly one unknown in a field of 9
    degrees.
    """
    true = small.case.instrument.camera
    wrong = dataclasses.replace(
        true, focal_length_px=1.001 * true.focal_length_px, k1=true.k1 + 0.3
    )
    tracker = dataclasses.replace(small.case.tracker, camera=wrong)
    case = dataclasses.replace(small.case, tracker=tracker)
    leg = Leg(16.0, rate_x=0.4 * deg, rate_z=1.0 * deg)
    prior = Calibration(focal_length=0.002, principal=0.0, k1=0.5, floor=0.02)
    learning = Sequence((leg,), period=0.2, camera=CameraFilter(prior))
    plain = dataclasses.replace(learning, camera=None)
    errors = {}
    for name, one, sequence in (
        ("known", small.case, plain),
        ("wrong", case, plain),
        ("learnt", case, learning),
    ):
        table = run(one, sequence, 3, 0, fidelity=Fidelity.WINDOW)[40:]
        square = np.mean([table[f"error_{axis}"] ** 2 for axis in "xy"], axis=0)
        errors[name] = math.sqrt(np.nanmean(square))
    assert errors["wrong"] > 1.5 * errors["known"]
    assert errors["learnt"] < 1.2 * errors["known"]


def test_two_frames_tell_the_rate_of_a_tracker_that_knows_none():
    """At 3 deg/s, three times the rate that the filter assumes initially, from streaks of 13
    pixels."""
    case = load_design(shipped("designs/noise_only.toml")).case
    case = dataclasses.replace(case, tracker=dataclasses.replace(case.tracker, rate="images"))
    leg = Leg(0.6, rate_x=2.4 * deg, rate_y=1.8 * deg)
    table = run(case, Sequence((leg,), period=0.2), 5, 0)
    assert table["mode"].tolist() == [Mode.ACQUIRED] + [Mode.TRACKED] * 2
    for axis in AXES:
        assert (np.abs(table[f"filtered_{axis}"]) < 5 * table[f"filtered_sigma_{axis}"]).all()


def test_what_windows_of_a_sequence_cannot_do_is_named(small, tmp_path):
    sequence = Sequence((CALM,), period=0.8)
    with pytest.raises(ValueError, match="where frames or images of stars are kept, got window"):
        run(small.case, sequence, 3, 0, Recording(tmp_path, "fits"), Fidelity.WINDOW)
    boxes = dataclasses.replace(small.case.tracker, acquisition="box")
    with pytest.raises(ValueError, match="with search boxes"):
        run(dataclasses.replace(small.case, tracker=boxes), sequence, 3, 0, None, Fidelity.WINDOW)
    with pytest.raises(ValueError, match="must be frame or window in a sequence, got spots"):
        run(small.case, sequence, 3, 0, None, Fidelity.SPOTS)
    pair = dataclasses.replace(sequence, heads=PAIR)
    with pytest.raises(ValueError, match="heads must be left out of a sequence of a unit"):
        run(small.case.unit_of(small.case), pair, 3, 0, None, Fidelity.WINDOW)


def test_windows_of_pixels_that_flicker_are_the_whole_frame(small):
    age = Age(5 * 365.25 * 86400, family="interactions", fluence=6e4, flicker=Flicker())
    detector = dataclasses.replace(small.case.instrument.detector, age=age)
    case = dataclasses.replace(
        small.case, instrument=dataclasses.replace(small.case.instrument, detector=detector)
    )
    both = [run(case, Sequence((CALM,), period=1.0), 3, 0, fidelity=one) for one in BOTH]
    assert both[0].tobytes() == both[1].tobytes()


def test_frames_have_noise_of_their_own_and_workers_do_not_matter(small):
    still = dataclasses.replace(
        small.case, instrument=dataclasses.replace(small.case.instrument, motion=Motion())
    )
    sequence = Sequence((Leg(0.6),), period=0.2)
    alone = fly_sequences(still, sequence, 3, 2, Serial())
    assert len(np.unique(alone["error_x"])) == len(alone)
    forks = multiprocessing.get_context("forkserver")  # of one process, which imports them once
    forks.set_forkserver_preload(["startrack.sequence"])
    with ProcessPoolExecutor(2, forks) as executor:
        both = fly_sequences(still, sequence, 3, 2, executor)
    assert both.tobytes() == alone.tobytes()
    assert alone.dtype == FRAMES


def test_late_stamps_and_mountings_move_all_errors_alike(small):
    """By the rotation itself: the rate times the time-tag error, or the angle of a mounting."""
    calm = Sequence((CALM,), period=0.8)
    plain = run(small.case, calm, 1, 0)
    tracker = dataclasses.replace(small.case.tracker, delay=-0.1)
    late = run(dataclasses.replace(small.case, tracker=tracker), calm, 1, 0)
    turn = Mounting(y=20 * arcsec)
    held = dataclasses.replace(small.case.tracker, mounting=Mounting())
    instrument = dataclasses.replace(small.case.instrument, mounting=turn)
    turned = run(dataclasses.replace(small.case, tracker=held, instrument=instrument), calm, 1, 0)
    for name in ("error", "filtered"):
        moved = [(late[f"{name}_{axis}"] - plain[f"{name}_{axis}"]) / arcsec for axis in AXES]
        np.testing.assert_allclose(np.abs(moved[0]), 0.005 * 3600, rtol=1e-3)
        np.testing.assert_allclose(moved[1:], 0, atol=0.05)
        moved = [(turned[f"{name}_{axis}"] - plain[f"{name}_{axis}"]) / arcsec for axis in AXES]
        np.testing.assert_allclose(np.abs(moved[1]), 20, rtol=1e-3)
        np.testing.assert_allclose([moved[0], moved[2]], 0, atol=0.05)


def test_sequences_of_one_frame_tell_no_rate_of_losses(small):
    table = fly_sequences(small.case, Sequence((Leg(0.1),)), 2, 3, Serial())
    rate = summarise_sequences(table).losses_per_hour
    assert np.isnan(rate.value)
    assert (rate.low, rate.high) == (0, np.inf)


PAIR = (SequenceHead(x=90 * deg, alignment_sigma=60 * arcsec),)


@pytest.fixture(scope="module")
def pairs(small):
    """16 sequences of two heads with equal designs; the second is misaligned by 60 arcsec."""
    sequence = Sequence((Leg(4.0, rate_x=0.1 * deg),), period=0.2, gyro=GYRO, heads=PAIR)
    return fly_sequences(small.case, sequence, 16, 8, Serial(), fidelity=Fidelity.WINDOW)


@pytest.mark.slow
def test_two_heads_know_all_axes_and_their_alignment(pairs):
    """The mean of normalised errors squared of each sequence is 3 within 4 sigma."""
    first, second = (pairs[pairs["head"] == head] for head in (0, 1))
    assert (pairs["mode"] != Mode.SEARCHING).all()
    late = first["time"] > 2
    for rows, name in ((first, "filtered"), (second, "alignment")):
        square = sum((rows[f"{name}_{axis}"] / rows[f"{name}_sigma_{axis}"]) ** 2 for axis in AXES)
        each = square[late].reshape(16, -1).mean(axis=1)
        assert abs(each.mean() - 3) < 4 * each.std(ddof=1) / 4, name
    assert np.isnan(first["alignment_x"]).all()
    # The axis of the second head's boresight is the best known of its alignment by the first.
    sigma = [np.mean(second[f"alignment_sigma_{axis}"][late]) / arcsec for axis in AXES]
    assert sigma[0] < 2 < min(sigma[1:])
    tracking = summarise_sequences(pairs)
    rms = np.sqrt(
        np.mean([second[f"alignment_{axis}"].reshape(16, -1)[:, -1] ** 2 for axis in AXES])
    )
    assert tracking.alignment.value == pytest.approx(rms)
    assert tracking.sequences == 16


@pytest.mark.slow
def test_an_aligned_head_takes_the_place_of_the_roll_of_the_other(small, pairs):
    """With a known alignment roll is as accurate as the rest; a single head is several times
    worse."""
    known = (dataclasses.replace(PAIR[0], alignment_sigma=0.0),)
    sequence = Sequence((Leg(0.5, rate_x=0.1 * deg),), period=0.2, gyro=GYRO, heads=known)
    table = run(small.case, sequence, 8, 0, fidelity=Fidelity.WINDOW)[-2:]
    single = float(table["sigma_z"][0])
    assert table["filtered_sigma_z"][0] < 0.3 * single
    alike = run(small.case, dataclasses.replace(sequence, heads=()), 8, 0, None, Fidelity.WINDOW)
    first = pairs[(pairs["head"] == 0) & (pairs["sequence"] == 0)][: len(alike)]
    assert len(np.unique(pairs["error_x"])) == len(pairs)
    for axis in AXES:
        assert alike[f"error_{axis}"][0] == first[f"error_{axis}"][0]


def test_a_head_that_is_wrong_is_left_out_where_another_agrees():
    """Without another head, it restarts a filter without a gyroscope, or is rejected with one."""
    state = start(Rotation.identity(), np.eye(3) * arcsec**2, 1e-6, heads=[(PAIR[0].to_head, 0.0)])
    state = dataclasses.replace(state, lasting=np.zeros((6, 3)))
    covariance = np.pad(state.covariance[:6, :6], (0, 21)) + np.diag([0] * 6 + [1e-14] * 21)
    known = TrackerState(dataclasses.replace(state, covariance=covariance), np.zeros((2, 3, 3, 3)))
    right = Estimate(Status.SOLVED, "", Rotation.identity(), np.eye(3) * arcsec**2, 1.0, 9, 1.0)
    wrong = dataclasses.replace(right, icrs_to_camera=Rotation.from_rotvec([0.1, 0, 0]))
    blind = dataclasses.replace(right, status=Status.NO_MATCH, icrs_to_camera=None)
    parts = np.zeros((2, 3, 3, 3))
    for gyro in (GYRO, None):
        sequence = Sequence((CALM,), gyro=gyro, heads=PAIR)
        after = update_state(known, [right, wrong], sequence, parts)
        assert after.state is not None
        assert after.state.icrs_to_camera.magnitude() < arcsec
        assert (after.missed, after.fresh) == (0, False)
        after = update_state(known, [blind, wrong], sequence, parts)
        assert after.state is not None
        seen = (PAIR[0].to_head.inv() * wrong.icrs_to_camera).magnitude()
        want = 0.0 if gyro else seen
        assert after.state.icrs_to_camera.magnitude() == pytest.approx(want, abs=1e-9)
        assert (after.missed, after.fresh) == ((1, False) if gyro else (0, True))


def test_the_motion_of_the_platform_is_one_error_of_all_heads(small):
    """First attitudes and further ones: no update has a smaller variance than the shared motion."""
    moved = np.full(3, 2 * arcsec) ** 2
    seen = Estimate(
        Status.SOLVED, "", Rotation.identity(), np.eye(3) * arcsec**2 + np.diag(moved), 1.0, 9, 1.0
    )
    other = dataclasses.replace(seen, icrs_to_camera=PAIR[0].to_head)
    known = (dataclasses.replace(PAIR[0], alignment_sigma=0.0),)
    sequence = Sequence((CALM,), gyro=GYRO, heads=known)
    parts = np.zeros((2, 3, 3, 3))
    first = update_state(TrackerState(), [seen, other], sequence, parts, moved)
    vague = first.state.covariance.copy()
    vague[:3, :3] += np.eye(3) * (1000 * arcsec) ** 2
    vague = dataclasses.replace(first, state=dataclasses.replace(first.state, covariance=vague))
    later = update_state(vague, [seen, other], sequence, parts, moved)
    for after in (first, later):
        assert after.state.covariance[:3, :3] == pytest.approx(
            np.eye(3) * arcsec**2 / 2 + np.diag(moved), rel=1e-4, abs=1e-4 * arcsec**2
        )
    motion = Motion(tones=(Tone(20.0, arcsec),), jitter_of="head")
    case = replaced(small.case, "instrument.motion", motion)
    with pytest.raises(Refused, match="jitter_of must be platform in a sequence of several heads"):
        run(case, sequence, 1, 0)


def test_frames_of_all_heads_are_kept(small, tmp_path):
    """All see the sky of one date, although each sequence draws its own within 300 days."""
    sequence = Sequence((Leg(0.4),), period=0.2, heads=PAIR)
    scene = dataclasses.replace(small.case.scene, date="2026-03-20T12:00:00", days=300.0)
    case = dataclasses.replace(small.case, scene=scene)
    table = run(case, sequence, 8, 0, Recording(tmp_path, "fits", stars=True))
    assert table["head"].tolist() == [0, 1, 0, 1]
    names = sorted(path.name for path in tmp_path.iterdir())
    for name in ("sequence-0001", "sequence-0001-head-2"):
        assert f"{name}-00002.fits" in names
        assert f"{name}-stars.npz" in names
        assert f"{name}.csv" in names
    first, second = (
        fits.getheader(tmp_path / f"sequence-0001{part}-00001.fits") for part in ("", "-head-2")
    )
    assert first["CRVAL1"] != second["CRVAL1"]
    assert first["DATE-OBS"] == second["DATE-OBS"]
    assert first["DATE-OBS"][:10] != "2026-03-20"


def test_without_an_attitude_nothing_is_lost_and_no_error_is_the_worst(lost):
    blind = lost.copy()
    blind["mode"] = Mode.SEARCHING
    for axis in AXES:
        blind[f"filtered_{axis}"] = blind[f"error_{axis}"] = math.nan
    tracking = summarise_sequences(blind)
    assert math.isnan(tracking.worst)
    assert math.isnan(tracking.losses_per_hour.value)
    assert tracking.known.value == tracking.beyond.value == 0


def test_equal_sequences_do_not_bound_a_fraction_exactly(lost):
    """Of two sequences, both with three quarters of their frames."""
    pair = np.concatenate([lost[lost["sequence"] == 0]] * 2)
    pair["sequence"] = np.repeat([0, 1], len(pair) // 2)
    known = summarise_sequences(pair).known
    assert 0 < known.low < known.value < known.high < 1
    assert known.low == pytest.approx(known.value * 0.025**0.5)
