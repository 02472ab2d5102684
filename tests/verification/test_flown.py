"""Windows of a flown tracker: photon transfer and steps with simulated images, files, the
command."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from astropy.io import fits
from scipy.spatial.transform import Rotation

from startrack import Streams, load_design, random_attitude, shipped
from startrack.catalog import open_sky
from startrack.cli.main import main
from startrack.core import Refused
from startrack.design import replaced
from startrack.detector import ColourMosaic, dark_frames
from startrack.io import FrameFiles, Layout, read_frames
from startrack.observation import colour_correction, psf_at
from startrack.trial import observe
from startrack.verification.figures import (
    Centroids,
    about_common,
    correlation,
    gain_in_flight,
    image_of_other,
    measure,
)
from startrack.verification.flown import _of_devices, compare_flown
from startrack.verification.prediction import SMOOTH, _paths
from startrack.verification.windows_of_flight import Windows, read_windows, windows_of_frames

GAIN, NOISE, COUNT, SIDE = 4.0, 12.0, 2000, 8


def still(background=30.0, seed=1) -> Windows:
    """A star at rest with known gain and read noise, by numpy's own distributions."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    light = 8000 * np.exp(-(x**2 + y**2) / 2 / 1.2**2) / (2 * np.pi * 1.2**2) + background
    electrons = rng.poisson(light, (COUNT, SIDE, SIDE)) + NOISE * rng.standard_normal(
        (COUNT, SIDE, SIDE)
    )
    corner = np.tile([100, 200], (COUNT, 1))
    return Windows("s1", 2.05 * np.arange(COUNT), electrons / GAIN, corner)


def test_photon_transfer_in_flight_finds_gain_and_read_noise():
    """2,000 images of 64 pixels measure the variance of each pixel to 3 %; digital numbers."""
    gain, noise = gain_in_flight(still())
    assert gain == pytest.approx(GAIN, rel=0.05)
    assert noise == pytest.approx(NOISE / GAIN, rel=0.1)


def test_motion_between_exposures_is_no_noise_of_the_photon_transfer():
    """Six stars that move together by 0.05 pixel rms, 600 exposures: mean gain within 5 %.

    Over 30 seeds the mean has a standard deviation of 1 %; with the motion as noise it is 37 % too
    small.
    """
    case, rng = load_design(shipped("designs/noise_only.toml")).case, np.random.default_rng(3)
    path, stars = 0.05 * rng.standard_normal((600, 2, 1, 1)), []
    for n in range(6):
        y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2 - rng.uniform(-0.5, 0.5, (2, 1, 1))
        spot = np.exp(-((x - path[:, 0]) ** 2 + (y - path[:, 1]) ** 2) / 2)
        electrons = rng.poisson(4000 * spot / (2 * np.pi)) + 4 * rng.standard_normal(spot.shape)
        corner = np.tile([100 * n, 200], (600, 1))
        stars.append(Windows(f"s{n}", np.arange(600.0), electrons / GAIN, corner))
    gain = [one.scalar["gain"] for one in measure(stars, case.tracker.box)]
    assert np.mean(gain) == pytest.approx(GAIN, rel=0.05)


def test_windows_are_read_from_npz_and_fits(tmp_path):
    star = still()
    columns = {
        "time": star.time,
        "number": star.number,
        "col0": star.corner[:, 0],
        "row0": star.corner[:, 1],
    }
    np.savez(tmp_path / "a.npz", **{f"s1_{name}": value for name, value in columns.items()})
    table = fits.BinTableHDU.from_columns(
        [
            fits.Column("TIME", "D", array=star.time),
            fits.Column("NUMBER", f"{SIDE**2}D", dim=f"({SIDE},{SIDE})", array=star.number),
            fits.Column("COL0", "J", array=star.corner[:, 0]),
            fits.Column("ROW0", "J", array=star.corner[:, 1]),
        ],
        name="S1",
    )
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(tmp_path / "a.fits")
    for path in (tmp_path / "a.npz", tmp_path / "a.fits"):
        (read,) = read_windows(path)
        assert read.name == "s1"
        np.testing.assert_array_equal(read.number, star.number)
        np.testing.assert_array_equal(read.corner, star.corner)
    np.savez(tmp_path / "none.npz", other=np.zeros(3))
    with pytest.raises(ValueError, match="must hold arrays or tables of a star each"):
        read_windows(tmp_path / "none.npz")
    truth = fits.BinTableHDU.from_columns([fits.Column("X", "D", array=[1.0])], name="TRUTH")
    frame = fits.PrimaryHDU(np.zeros((8, 8)))  # as `simulate` writes a whole frame
    fits.HDUList([frame, truth]).writeto(tmp_path / "frame.fits")
    with pytest.raises(Refused, match="whole frames must be two or more files"):
        read_windows(tmp_path / "frame.fits")


def test_files_that_hold_no_images_are_named_with_the_reason(tmp_path):
    np.savez(tmp_path / "objects.npz", time=np.array([None, 1], object))
    (tmp_path / "text.npz").write_text("time, number")
    whole = (tmp_path / "objects.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.fits").write_text("time, number")
    for name, said in (
        ("objects.npz", "objects.npz must be a file of images of stars .* without Python objects"),
        ("text.npz", "text.npz must be a file of images of stars .*, whole, got: File is not"),
        ("cut.npz", "cut.npz must be a file of images of stars .*, whole, got: File is not a zip"),
        ("text.fits", "text.fits must be a whole FITS file"),
    ):
        with pytest.raises(ValueError, match=said):
            read_windows(tmp_path / name)
    with pytest.raises(FileNotFoundError, match=r"none\.npz must be a file of images"):
        read_windows(tmp_path / "none.npz")


def test_negative_places_count_from_the_middle_of_the_detector(tmp_path):
    """For all stars of a file if one of them has a negative place, also if that one is not read."""
    detector = load_design(shipped("trackers/chandra-aca.toml")).case.instrument.detector
    star = still()
    columns = {"time": star.time, "number": star.number, "col0": star.corner[:, 0]}
    for sign, place in ((1, (103.5, 203.5)), (-1, (615.5, 715.5))):
        rows = {"s1": star.corner[:, 1], "s2": sign * star.corner[:, 1]}
        named = {f"{n}_{key}": values for n in rows for key, values in columns.items()}
        path = tmp_path / f"{sign}.npz"
        np.savez(path, **named, **{f"{n}_row0": row for n, row in rows.items()})
        (read,) = read_windows(path, ["s1"])
        assert read.place_on(detector) == place


def test_the_image_of_a_device_differs_by_its_growth_over_the_field():
    """A few per cent of the peak at the edge of the field, zero without a difference."""
    case = load_design(shipped("trackers/chandra-aca.toml")).case
    other = replaced(case, "instrument.optics.growth_across", -0.2)
    psfs = [psf_at(one.instrument, 10.0, 511.5) for one in (case, other)]
    assert image_of_other(psfs[0], psfs[0], case.tracker.box) == 0
    assert 0.01 < image_of_other(psfs[1], psfs[0], case.tracker.box) < 0.1


def test_curves_that_are_alike_are_correlated():
    wave = np.sin(np.linspace(0, 2 * np.pi, 20, endpoint=False))
    assert correlation(wave, 3 * wave + 0.1) == pytest.approx(1)
    assert correlation(wave, -wave) == pytest.approx(-1)


@pytest.mark.slow
def test_the_command_compares_a_design_with_its_own_images(tmp_path, capsys):
    """Images that the design predicts agree with its predictions for other detectors."""
    np.savez(
        tmp_path / "seen.npz",
        **{
            f"s1_{name}": value
            for name, value in {
                "time": still().time,
                "number": still().number,
                "col0": still().corner[:, 0],
                "row0": still().corner[:, 1],
                "magnitude": 8.0,
            }.items()
        },
    )
    words = ["compare-flight", "trackers/chandra-aca.toml", str(tmp_path / "seen.npz")]
    assert main([*words, "--devices", "2", "--keep", "--out", str(tmp_path / "a"), "--json"]) == 0
    first = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (tmp_path / "a" / "flight.png").stat().st_size > 10_000
    assert {row["figure"] for row in first["differences"]} >= {"background", "gain", "read_noise"}
    words[2] = str(tmp_path / "a" / "predicted.npz")
    assert main([*words, "--devices", "2", "--out", str(tmp_path / "b"), "--json"]) == 0
    again = json.loads(capsys.readouterr().out.splitlines()[-1])
    ratio = {row["figure"]: row["ratio"] for row in again["differences"]}
    assert ratio["gain"] == pytest.approx(1, abs=0.1)
    assert ratio["read_noise"] == pytest.approx(1, abs=0.2)


def turning(count: int, *changes: str):
    """Frames of a design whose boresight turns by a hundredth of a pixel a frame."""
    case = load_design(shipped("designs/noise_only.toml"), changes).case
    first, pixel = random_attitude(Streams(1, 0)), 1 / case.instrument.camera.focal_length_px
    turns = [Rotation.from_rotvec([0.01 * pixel * k, 0, 0]) * first for k in range(count)]
    frames = [observe(case, turn, Streams(1, k)).frame for k, turn in enumerate(turns)]
    return case, frames


def test_stars_of_whole_frames_are_followed():
    case, frames = turning(40)
    stars = windows_of_frames(frames, case)
    assert len(stars) > 3
    for star in stars:
        row, column = np.unravel_index(star.number.mean(axis=0).argmax(), (8, 8))
        assert (row, column) in {(3, 3), (3, 4), (4, 3), (4, 4)}
        assert star.acquired.mean() > 0.9
        left, top = star.corner[7]
        seen = frames[7].image[top : top + 8, left : left + 8]
        np.testing.assert_array_equal(star.number[7] + case.instrument.detector.offset, seen)
    dark = [replace(frame, image=frame.image[:, ::-1]) for frame in frames[:20]] + frames[20:]
    lost = windows_of_frames([*frames[:20], *dark[:20]], case)
    assert all(star.acquired[:20].mean() > 0.9 > 0.5 > star.acquired[20:].mean() for star in lost)
    with pytest.raises(ValueError, match="512 x 512 pixels of the detector, got 256 x 512"):
        windows_of_frames([replace(frames[0], image=frames[0].image[:, :256])], case)


def test_a_tracker_with_a_dark_map_needs_a_dark_frame():
    """For a detector with hot pixels: stars are followed in both by the map of each."""
    hot = (
        "instrument.detector.defects.hot=0.0005",
        "instrument.detector.defects.hot_current=2000 electron / s",
    )
    case, frames = turning(40, *hot, "tracker.detection.dark_map.frames=16")
    mean, _ = dark_frames(case.instrument.detector, 16)
    dark = replace(frames[0], image=mean)
    stars = windows_of_frames(frames, case, dark_frame=dark)[:2]
    assert min(star.acquired.mean() for star in stars) > 0.9
    found = {(row.star, row.name): row for row in compare_flown(case, stars, 4).differences}
    for star in stars:
        assert found[star.name, "acquired"].predicted.value > 0.9
    unaware = replace(case.tracker.detection, dark_map=None)
    without = replace(case, tracker=replace(case.tracker, detection=unaware))
    for given, some in ((None, case), (dark, without)):
        with pytest.raises(
            ValueError, match="dark frame must be given if, and only if, the tracker has"
        ):
            windows_of_frames(frames, some, dark_frame=given)


def test_frames_of_files_have_their_times(tmp_path):
    """A recording with time stamps has their times, one without has the update rate."""
    case, frames = turning(34)
    rate, begin = case.instrument.detector.update_rate, datetime(2026, 3, 1, tzinfo=UTC)
    at = 0.5 * np.arange(34) + 0.25 * (np.arange(34) > 9)
    made = {}
    for kind in ("ser", "raw", "mkv", "fits"):
        files = FrameFiles(tmp_path, kind, kind, begin)
        for frame, time in zip(frames, at, strict=True):
            files.add(frame, time, Rotation.identity())
        made[kind] = files.close()[:-1]
    for kind, times in {"ser": at, "fits": at, "raw": None, "mkv": None}.items():
        layout = Layout(raw="512x512:uint16" if kind == "raw" else None)
        read = [frame for path in made[kind] for frame in read_frames(path, layout)]
        np.testing.assert_array_equal(read[33].image, frames[33].image)
        expected = np.arange(34) / rate if times is None else times
        star = windows_of_frames(read, case)[0]
        np.testing.assert_allclose(star.time, expected, atol=2e-6)
    stamped = [replace(frame, time=2.0 * k) for k, frame in enumerate(read)]
    with pytest.raises(ValueError, match=r"got 2000-01-01T00:00:06\.0+ of number 4 after 2000-"):
        windows_of_frames([*stamped[:2], *stamped[4:2:-1], *stamped[5:]], case)
    with pytest.raises(ValueError, match="in all frames or in none, got none in frame 34"):
        windows_of_frames([*stamped[:33], replace(stamped[33], time=np.nan)], case)


def test_times_of_a_star_rise():
    star = still()
    with pytest.raises(ValueError, match=r"time of s1 must rise, got .* of number 2"):
        replace(star, time=star.time[::-1] - star.time[-1])


@pytest.mark.slow
def test_frames_of_a_design_are_as_it_predicts_them():
    """Eight stars, 160 frames: scatters within 10 % by their number of degrees of freedom."""
    case, frames = turning(160)
    flown = compare_flown(case, windows_of_frames(frames, case), 4, 1)
    for name in ("temporal", "total", "brightness", "background", "acquired"):
        ratio = [row.ratio for row in flown.differences if row.name == name]
        assert np.mean(ratio) == pytest.approx(1, abs=0.1), name


def seen_at(time, place):
    """Centroids of an image at rest."""
    corner = np.zeros((len(time), 2), np.int64)
    windows = Windows("one", time, np.zeros((len(time), 8, 8)), corner)
    return Centroids(windows, place, np.ones(len(time)))


def test_stars_of_other_time_spans_have_the_scatter_of_their_noise():
    """0.01 pixel about a common random walk of pixels: 400 exposures measure it to 2.5 %, so 12 %
    is 5 sigma.

    One star is seen in the first half only, one with a gap, and one after all others.
    """
    rng, time = np.random.default_rng(4), np.arange(800.0)
    path = np.cumsum(0.1 * rng.standard_normal((800, 2)), axis=0)
    spans = [
        time < 400,
        time < 400,
        time < 200,
        (time < 400) & ~((time > 100) & (time < 150)),
        time >= 500,
    ]
    stars = [
        seen_at(time[span], path[span] + 0.01 * rng.standard_normal((span.sum(), 2)))
        for span in spans
    ]
    residual = [own.off * own.scale for own in about_common(stars)]
    for off in residual[:4]:
        known = np.isfinite(off[:, 0])
        assert known.sum() > 0.4 * len(off)
        assert np.sqrt((off[known] ** 2).mean()) == pytest.approx(0.01, rel=0.12)
    assert np.isnan(residual[4]).all()
    assert not np.isnan(residual[0][:3]).any()


def test_predicted_paths_have_no_errors_of_single_stars():
    """Two stars on a common dither, each with an error of 0.1 pixel as it would have in flight.

    Their paths differ by a constant within a tenth of this error. A single star keeps its error.
    """
    time = np.arange(2000.0)
    dither = 1.6 * np.column_stack([np.sin(time / 160), np.sin(time / 113)])
    errors = [0.1 * np.column_stack([np.sin(time / k), np.cos(time / k)]) for k in (17.0, 29.0)]
    stars = [seen_at(time, dither + error) for error in errors]
    first, second = _paths(stars)
    inner = slice(SMOOTH, -SMOOTH)
    own = (first - second)[inner]
    assert own.std(axis=0).max() < 0.01
    alone = _paths(stars[:1])[0] - dither
    assert alone[inner].std(axis=0) == pytest.approx(0.1 / np.sqrt(2), rel=0.2)


def test_colour_filters_are_refused():
    case = load_design(shipped("designs/noise_only.toml")).case
    coloured = replaced(case, "instrument.detector.mosaic", ColourMosaic())
    with pytest.raises(Refused, match="mosaic must be left out"):
        compare_flown(coloured, [still()])


@pytest.mark.slow
def test_an_offset_that_is_not_the_designs_is_told_and_no_background_compared():
    case = load_design(shipped("designs/noise_only.toml")).case
    electrons = case.instrument.detector.electrons_per_dn
    detector = replace(case.instrument.detector, read_noise=NOISE / GAIN * electrons)
    case = replace(case, instrument=replace(case.instrument, detector=detector))
    rows = {}
    for pedestal in (0.0, 60.0):
        star = replace(still(), number=still().number + pedestal)
        found = compare_flown(case, [star], 2).differences
        rows[pedestal] = {row.name: row for row in found}
    assert abs(rows[0.0]["offset"].seen.value) < 15
    assert not rows[0.0]["background"].untested
    assert rows[60.0]["offset"].seen.value - rows[0.0]["offset"].seen.value == pytest.approx(60)
    assert rows[60.0]["background"].untested.startswith("the offset of the numbers is not")
    assert not rows[60.0]["background"].differs


def test_brightness_tests_throughput_only_by_a_magnitude():
    case, frames = turning(40)
    lens = case.instrument.optics
    lens = replace(lens, transmission=lens.transmission.scaled(0.5))
    dimmer = replace(case, instrument=replace(case.instrument, optics=lens))
    stars = windows_of_frames(frames, case)[:1]
    (unknown,) = [r for r in compare_flown(dimmer, stars, 2).differences if r.name == "brightness"]
    assert not unknown.differs
    assert "magnitude_g" in unknown.untested
    # The star of that place.
    sky = open_sky(case.catalog).stars
    seen = case.instrument.camera.project(random_attitude(Streams(1, 0)).apply(sky.direction))
    middle = stars[0].corner[0] + 3.5
    near = np.flatnonzero(np.hypot(*(seen - middle).T) < 2)
    star = sky[near[np.argmin(sky.magnitude_g[near])][None]]
    sunlike = float(star.magnitude_g[0] + colour_correction(case, star.colour)[0])
    given = [replace(stars[0], magnitude_g=sunlike)]
    for design, ratio in ((case, 1.0), (dimmer, 0.5)):
        rows = compare_flown(design, given, 2).differences
        (row,) = [r for r in rows if r.name == "brightness"]
        assert row.ratio == pytest.approx(ratio, rel=0.05)
        assert not row.untested
    assert row.differs
    assert "transmission" in row.key


def test_an_offset_that_is_not_known_is_in_the_interval_of_the_background():
    """Images with 20 numbers more than the design has without light."""
    case = load_design(shipped("designs/noise_only.toml"), ["instrument.detector.offset=50"]).case
    image = replace(still().of(slice(160)), background=None)
    star = replace(image, number=image.number + 20)
    others = [replaced(case, "instrument.detector.offset", value) for value in (25, 45, 60, 80)]
    rows = {
        name: {row.name: row for row in compare_flown(case, [star], 4, unknown=unknown).differences}
        for name, unknown in (("known", ()), ("unknown", others))
    }
    known, unknown = rows["known"]["background"], rows["unknown"]["background"]
    assert known.differs or known.untested
    assert not unknown.differs
    assert not unknown.untested
    width = [row.predicted.high - row.predicted.low for row in (known, unknown)]
    assert width[1] > 40 > width[0]
    with pytest.raises(Refused, match="unknown must be one case for each device, got 4"):
        compare_flown(case, [star], 5, unknown=others)


@pytest.mark.parametrize("law", ["normal", "lognormal"])
def test_the_interval_of_devices_holds_a_further_one(law):
    """16,000 times eight devices; a false alarm once in 10,000 (four standard deviations)."""
    drawn = getattr(np.random.default_rng(1), law)(size=(16_000, 9))
    held = 0
    for values in drawn:
        interval = _of_devices(values[:8])
        held += interval.low <= values[8] <= interval.high
    assert held / 16_000 == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 16_000))
