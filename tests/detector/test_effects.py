"""Each effect against a closed form or an invariant."""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from scipy import constants, ndimage, stats

from startrack.core.streams import Streams
from startrack.detector import Defects, Detector, Hits, Pattern, RegionOfInterest, Thermal, read_out
from startrack.detector.collect import carry, diffuse
from startrack.detector.effects import added_noise, bloom, settle
from startrack.detector.imperfections import tracks
from startrack.detector.maps import dark, read_noise, response
from startrack.io.tables import from_table, to_table

PLAIN = Detector(200, 100, 5e-6, 0.1, full_well=65535.0, bits=16, offset=1000)


def drawn(electrons, trial=0, **changes):
    """The numbers of a frame, one for each electron, above the offset."""
    one = replace(PLAIN, **changes)
    return read_out(electrons, one, Streams(1, trial)).astype(float) - 1000


def test_dark_current_doubles_and_follows_its_activation_energy():
    assert Thermal(301.15).growth == pytest.approx(2)
    assert Thermal(285.15).growth == pytest.approx(0.5)
    assert Thermal(293.15, activation=1e-19).growth == pytest.approx(1)
    hot, cold = (Thermal(t, activation=0.6 * constants.e).growth for t in (303.15, 283.15))
    # d ln I / dT = E / (k T^2) + 3 / (2 T), in the middle.
    slope = 0.6 * constants.e / constants.k / 293.15**2 + 1.5 / 293.15
    assert math.log(hot / cold) / 20 == pytest.approx(slope, rel=2e-3)


@pytest.mark.parametrize("activation", [0.0, 1e-19])
def test_temperatures_far_off(activation):
    assert Thermal(0.0, activation=activation).growth == pytest.approx(0, abs=1e-10)
    growth = Thermal(400.0, activation=activation).growth
    assert 100 < growth < 1e5


def test_reset_noise_of_a_known_capacitor():
    """10 fF at 300 K have 40 electrons, as in textbooks."""
    assert Thermal(300.0, capacitance=10e-15).reset_noise == pytest.approx(40.2, abs=0.1)
    flat = np.full((100, 200), 1000.0)
    both = drawn(flat, read_noise=5.0, thermal=Thermal(300.0, capacitance=10e-15))
    wanted = 1000 + 25 + 40.17**2
    assert both.var() == pytest.approx(wanted, rel=4 * math.sqrt(2 / both.size))


def test_crosstalk_spreads_and_keeps():
    image = np.zeros((7, 9))
    image[3, 4], image[0, 0] = 1.0, 1.0
    after = diffuse(image, 0.05)
    assert after[3, 4] == pytest.approx(0.8)
    assert after[3, 5] == after[2, 4] == pytest.approx(0.05)
    assert after.sum() == pytest.approx(2.0, rel=1e-12)
    np.testing.assert_allclose(diffuse(np.full((4, 5), 3.0), 0.2), 3.0)


def test_lag_hands_over():
    np.testing.assert_allclose(carry(np.full(2, 100.0), None, 0.1), 90)
    np.testing.assert_allclose(carry(np.full(2, 100.0), np.full(2, 100.0), 0.1), 100)


def test_maps_have_their_moments():
    one = replace(
        PLAIN,
        prnu=0.02,
        dark_current=50.0,
        read_noise=2.0,
        read_noise_spread=0.3,
        defects=Defects(5.0, 0.01, 3000.0, 0.002, 3),
    )
    gain, current = response(one), dark(one)
    assert (gain == 0).all(axis=0).sum() == 3
    alive = gain[gain > 0]
    assert 1 - len(alive) / gain.size == pytest.approx(3 / 200 + 0.002, abs=2e-3)
    assert alive.std() == pytest.approx(0.02, rel=0.03)
    assert np.median(current) == pytest.approx(50, abs=0.5)
    hot = current > 100
    assert hot.mean() == pytest.approx(0.01 * math.exp(-50 / 3000), rel=0.3)
    assert current[hot].mean() == pytest.approx(3100, rel=0.3)
    noise = read_noise(one)
    assert np.median(noise) == pytest.approx(2, rel=0.02)
    assert np.log(noise).std() == pytest.approx(0.3, rel=0.03)
    assert np.sqrt((noise**2).mean()) == pytest.approx(one.noise, rel=0.03)


def test_maps_belong_to_the_device_and_warm_up_with_it():
    one = replace(PLAIN, prnu=0.02, dark_current=50.0, defects=Defects(5.0, 0.01, 3000.0))
    np.testing.assert_array_equal(dark(one), dark(replace(one, exposure=3.0, bits=8, offset=0)))
    assert (dark(one) != dark(replace(one, device_seed=1))).any()
    warm = replace(one, thermal=Thermal(301.15))
    np.testing.assert_allclose(dark(warm), 2 * dark(one))


def test_a_binned_pixel_is_the_sum_of_its_pixels():
    base = {"prnu": 0.1, "dark_current": 20.0, "defects": Defects(dsnu=5.0)}
    fine, coarse = replace(PLAIN, **base), replace(PLAIN, columns=100, rows=50, binning=2, **base)
    blocks = dark(fine).reshape(50, 2, 100, 2)
    np.testing.assert_allclose(dark(coarse), blocks.sum(axis=(1, 3)))
    np.testing.assert_allclose(response(coarse), response(fine).reshape(50, 2, 100, 2).mean((1, 3)))
    assert coarse.pitch == 2 * PLAIN.pixel_pitch
    assert coarse.dark_rate == 80


def test_a_region_is_cut_from_the_array():
    base = {"prnu": 0.1, "defects": Defects(dsnu=5.0)}
    fine = replace(PLAIN, **base)
    part = replace(PLAIN, columns=40, rows=30, region=RegionOfInterest(150, 60, 200, 100), **base)
    np.testing.assert_array_equal(response(part), response(fine)[60:90, 150:190])
    # The array's centre (99.5, 49.5) seen from the image's (169.5, 74.5).
    assert part.shift == (-70.0, -25.0)


@pytest.mark.slow
def test_noise_of_the_read_out_is_that_of_dark_frames_without_light():
    """The noise is that of frames without electrons, within the rounding of 1 / sqrt(12) number.

    Hits and settling are not noise: hits need an exposure, and settling filters the rest.
    """
    pattern = Pattern(row=3.0, column=2.0)
    noisy = replace(PLAIN, read_noise=8.0, pattern=pattern, hits=Hits(rate=2e8, depth=10e-6))
    noise = added_noise(noisy, Streams(1, 0))
    dark = drawn(np.zeros((100, 200)), read_noise=8.0, pattern=pattern)
    assert np.abs(noise - dark).max() <= 0.5 + 1e-9
    assert noise.std() == pytest.approx(math.sqrt(8**2 + 3**2 + 2**2), rel=0.1)


def test_blooming_keeps_the_charge():
    charge = np.random.default_rng(0).uniform(0, 50, (40, 12))
    charge[20, 5] = 900.0
    after = bloom(charge, 100.0)
    assert after.max() == 100
    assert after.sum() == pytest.approx(charge.sum(), rel=1e-12)
    np.testing.assert_array_equal(np.delete(after, 5, axis=1), np.delete(charge, 5, axis=1))
    full = np.flatnonzero(after[:, 5] >= 100)
    assert full.min() < 20 < full.max()
    assert (np.diff(full) == 1).all()


def test_blooming_runs_out_at_the_edge():
    charge = np.zeros((10, 3))
    charge[0, 1] = 1000.0
    after = bloom(charge, 100.0)
    # Half of the excess leaves at once, the other fills four pixels and a half.
    assert after[:, 1].tolist() == [100, 100, 100, 100, 100, 50, 0, 0, 0, 0]


def test_two_overfull_pixels_fill_what_lies_between():
    """Counted by hand: 250 over in row 2, 120 over in row 5, of wells of 100 electrons.

    Downward 125 leave row 2: 90 fit into row 3, 35 into row 4; 60 leave row 5 for row 6. Upward
    60 leave row 5: row 4 takes the 45 that it still holds, 15 pass rows 3 and 2, where 125 join
    them: row 1 takes 80, row 0 the other 60.
    """
    charge = np.array([0, 20, 350, 10, 20, 220, 30, 0.0])[:, None]
    before = charge.copy()
    wanted = [60, 100, 100, 100, 100, 100, 90, 0]
    np.testing.assert_allclose(bloom(charge, 100.0)[:, 0], wanted, rtol=1e-12)
    np.testing.assert_array_equal(charge, before)


def test_settling_is_a_geometric_tail():
    level = np.zeros((2, 12))
    level[:, 4] = 100.0
    after = settle(level, 0.2)
    np.testing.assert_allclose(after[0, 4:], 80 * 0.2 ** np.arange(8))
    assert (after[:, :4] == 0).all()
    np.testing.assert_allclose(settle(np.full((2, 5), 7.0), 0.3), 7.0)


def test_settling_is_the_product_with_a_matrix_of_powers():
    """out = (1 - r) sum_j r^(i - j) in_j, before the row its first pixel for ever."""
    level = np.random.default_rng(1).uniform(0, 1000, (3, 9))
    lead = np.concatenate([np.repeat(level[:, :1], 60, axis=1), level], axis=1)
    age = np.arange(69)[:, None] - np.arange(69)
    response = np.where(age >= 0, 0.6 * 0.4 ** np.maximum(age, 0), 0.0)
    np.testing.assert_allclose(settle(level, 0.4), (lead @ response.T)[:, 60:], rtol=1e-12)


def test_rows_and_columns_share_their_noise():
    flat = np.zeros((100, 200))
    frame = drawn(flat, pattern=Pattern(8.0, 5.0, 3.0))
    again = drawn(flat, trial=1, pattern=Pattern(8.0, 5.0, 3.0))
    assert frame.mean(axis=1).std() == pytest.approx(8, rel=0.3)
    assert frame.mean(axis=0).std() == pytest.approx(math.hypot(5, 3), rel=0.2)
    assert (frame - frame.mean(axis=0) - frame.mean(axis=1)[:, None]).std() < 1
    fixed = np.mean(frame.mean(axis=0) * again.mean(axis=0)) - frame.mean() * again.mean()
    assert fixed == pytest.approx(9, rel=0.7)


def test_hits_are_as_many_and_as_bright_as_they_should():
    hits = Hits(rate=2e8, charge=80e6, depth=10e-6)
    counts, sums = [], []
    for trial in range(300):
        pixel, charge = tracks(hits, (100, 200), 5e-6, 0.1, Streams(1, trial))
        assert (np.diff(pixel) > 0).all()
        assert (charge > 0).all()
        counts.append(len(pixel) > 0)
        sums.append(charge.sum())
    # 2e8 / m^2 / s through 0.5 mm^2 in 0.1 s are ten a frame; through a layer, the mean of
    # 1 / cosine is 2, so 1600 electrons each, less what leaves over the edges.
    assert np.mean(counts) > 0.99
    assert np.mean(sums) == pytest.approx(16_000, rel=0.12)


def test_a_track_through_a_thick_layer_has_no_gaps():
    """Tracks that are tens of pixels long have no gaps."""
    thick, rows, columns = Hits(rate=1e7, charge=80e6, depth=200e-6), 300, 400
    longest = 0
    for trial in range(60):
        pixel, charge = tracks(thick, (rows, columns), 5e-6, 1 / 30, Streams(5, trial))
        frame = np.zeros(rows * columns)
        frame[pixel] = charge
        pieces, many = ndimage.label(frame.reshape(rows, columns), np.ones((3, 3)))
        hits = Streams(5, trial)("hits").poisson(1e7 / 30 * rows * columns * 25e-12)
        assert many <= hits
        for piece in ndimage.find_objects(pieces):
            longest = max(longest, *(side.stop - side.start for side in piece))
    assert longest > 40


def test_every_pixel_is_hit_as_often_as_the_next():
    """Chi-square over a dozen pixels and 400 frames; the layer is so thin that a hit is one
    pixel."""
    thin, frames = Hits(rate=1.4e11, depth=1e-9), 400
    counts = np.zeros(12)
    for trial in range(frames):
        pixel, _ = tracks(thin, (3, 4), 5e-6, 0.2, Streams(2, trial))
        counts[pixel] += 1
    fraction = 1 - math.exp(-1.4e11 * 0.2 * 25e-12)  # of the frames in which a pixel is hit
    deviation = (counts - frames * fraction) / math.sqrt(frames * fraction * (1 - fraction))
    assert stats.chi2.sf((deviation**2).sum(), 12) > 1e-4


def test_hits_show_in_both_ways_of_reading():
    """A frame in one step and in single steps has the same tracks on the same sky."""
    flat = np.full((100, 200), 20.0)
    quiet = drawn(flat)
    for more in ({}, {"blooming": True}):
        hit = drawn(flat, hits=Hits(2e8), **more)
        pixel, charge = tracks(Hits(2e8), flat.shape, 5e-6, 0.1, Streams(1, 0))
        np.testing.assert_allclose((hit - quiet).ravel()[pixel], charge, atol=2)
        changed = np.flatnonzero(hit != quiet)
        assert np.isin(changed, pixel).all()


def test_steps_and_shortcut_draw_the_same_frame():
    """With each effect too weak to matter, the frame in steps equals the frame without it."""
    mean = np.random.default_rng(0).uniform(5, 4000, (100, 200))
    for weak in ({"settling": 1e-12}, {"blooming": True}, {"read_noise_spread": 1e-9}):
        np.testing.assert_array_equal(
            drawn(mean, read_noise=3.0, **weak), drawn(mean, read_noise=3.0)
        )


def test_a_bent_response_falls_short_by_its_share():
    flat = np.full((100, 200), 30_000.0)
    short = drawn(flat, nonlinearity=0.05)
    fraction = 0.05 * 30_000 / 65_535
    assert short.mean() == pytest.approx(30_000 * (1 - fraction), abs=8)


def test_a_bowed_converter_is_off_at_half_scale():
    for level, wanted in ((0.0, 0.0), (31_767.0, 40.0)):
        flat = np.full((100, 200), level)
        rise = drawn(flat, adc_inl=40.0).mean() - drawn(flat).mean()
        assert rise == pytest.approx(wanted, abs=2.5)


def test_gain_spends_the_range_on_fewer_electrons():
    one = replace(PLAIN, gain=4.0)
    assert one.electrons_per_dn == pytest.approx(0.25)
    assert drawn(np.full((100, 200), 500.0), gain=4.0).mean() == pytest.approx(2000, abs=4)


def test_a_design_with_all_effects_survives_a_file():
    one = replace(
        PLAIN,
        thermal=Thermal(300.0, activation=1.1e-19, capacitance=2e-15),
        hits=Hits(2.5e4),
        defects=Defects(3.0, 1e-4, 500.0, 1e-5, 2),
        pattern=Pattern(1.0, 0.5, 2.0),
        region=RegionOfInterest(3, 4, 400, 300),
        row_delay=1.5e-5,
        blooming=True,
        em_gain=20.0,
        crosstalk=0.01,
        lag=0.001,
        settling=0.02,
        nonlinearity=0.01,
        adc_inl=0.5,
        gain=2.0,
        binning=1,
    )
    text = tomli_w.dumps(to_table(one))
    assert from_table(Detector, tomllib.loads(text)) == one


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("crosstalk", 0.3),
        ("lag", 1.0),
        ("settling", -0.1),
        ("em_gain", 0.5),
        ("nonlinearity", 0.6),
        ("adc_inl", 20_000.0),
        ("binning", 0),
        ("row_delay", -1e-6),
        ("region", RegionOfInterest(190, 0, 200, 100)),
    ],
)
def test_impossible_effects_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        replace(PLAIN, **{name: value})


def test_impossible_parameters_are_refused():
    for kind, bad in (
        (Thermal, {"temperature": -1.0}),
        (Hits, {"rate": -1.0}),
        (Defects, {"hot": 1.5}),
        (Pattern, {"row": float("nan")}),
    ):
        with pytest.raises(ValueError, match=next(iter(bad))):
            kind(**bad)
