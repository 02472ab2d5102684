"""Pictures of difficult cases: each says what it shows, and its parts do not overlap."""

import dataclasses
import itertools
import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.budget import PUBLISHED, RateSurvey, analytic, curve_steps, curves, error_curves
from startrack.core import YEAR, Camera, Frame, Psf, Spots, Stars, arcsec, deg
from startrack.design import Accuracy, Campaign, Objective, OverUnits, replaced
from startrack.metrics import ErrorLimits, Interval, summarise
from startrack.motion import Tone
from startrack.optimise import Optimum, Point, Sensitivity
from startrack.optimise.evaluate import Evaluation
from startrack.plots import (
    draw_budget,
    draw_convergence,
    draw_corner,
    draw_curves,
    draw_errors,
    draw_frame,
    draw_front,
    draw_geometry,
    draw_picture,
    draw_prediction,
    draw_psf,
    draw_sequence,
    draw_sky,
    draw_spots,
    draw_tolerance,
    draw_tornado,
    style,
)
from startrack.plots.frames import stretch
from startrack.prediction import OTHERS
from startrack.sequence import Mode
from startrack.sequence.run import FRAMES
from startrack.trial import OUTCOMES

PHONE = 400  # pixel, the width of a phone
LEGIBLE = 6.9  # pixel, of the smallest letters there


@pytest.fixture(autouse=True)
def _fine(monkeypatch):
    """Pictures with the pixels that users get."""
    monkeypatch.setattr(style, "DPI", 200)


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Draw a picture; return its figure after a check, and its file if one is written."""
    kept, save = [], style.save_figure

    def draw(function, *given, written=False, **named):
        def keep(path, figure):
            if written:
                save(path, figure)
            check(figure)
            kept.append(figure)

        monkeypatch.setattr(style, "save_figure", keep)
        path = tmp_path / "picture.png"
        function(path, *given, **named)
        return kept[-1], path

    return draw


def check(figure):
    """Checks for every picture."""
    figure.draw_without_rendering()
    bounds, scale = figure.bbox.padded(2), PHONE / figure.bbox.width
    for axes in figure.axes:
        if not axes.axison:
            continue
        for axis in (axes.xaxis, axes.yaxis):
            assert axis.get_offset_text().get_text() == ""
            texts = [one.get_text() for one in axis.get_ticklabels() if one.get_visible()]
            assert not re.search(r"\de[+-]?\d|times|\^", " ".join(texts)), texts
            # Names of causes need no unit, and degrees have it.
            if axis.get_visible() and re.search(r"\d", " ".join(texts)) and "°" not in texts[0]:
                assert re.search(r"\(.+\)|number|magnitude G", axis.get_label_text()), texts
    letters = [text for text in figure.findobj(is_text) if text.get_visible() and text.get_text()]
    for text in letters:
        box = text.get_window_extent()
        if not text.get_clip_on() and box.width:
            assert bounds.contains(box.x0, box.y0), text.get_text()
            assert bounds.contains(box.x1, box.y1), text.get_text()
        assert text.get_fontsize() / 72 * figure.dpi * scale >= LEGIBLE, text.get_text()


def is_text(artist):
    return hasattr(artist, "get_fontsize") and hasattr(artist, "get_text")


def texts(figure):
    """All readable text of a picture, in one line."""
    return " ".join(
        text.get_text() for text in figure.findobj(is_text) if text.get_visible()
    ).replace("\n", " ")


def test_errors_have_the_availability_of_their_summary(drawn):
    """The availability of attitudes within the required error, as in the table beside the
    picture."""
    few = outcomes(40)
    few["error_x"][:10] = 100 * arcsec
    for axis in "xyz":
        few[f"sigma_{axis}"] = 50 * arcsec
    required = summarise(few, ErrorLimits(20 * arcsec, None))
    assert "availability 75.0 %" in texts(drawn(draw_errors, few, "few", required)[0])
    assert "availability 100.0 %" in texts(drawn(draw_errors, few, "few")[0])


def outcomes(count, seed=1):
    """Correct attitudes with normal errors of an arcsecond."""
    rows, random = np.zeros(count, OUTCOMES), np.random.default_rng(seed)
    rows["solved"] = True
    for axis in "xyz":
        rows[f"error_{axis}"] = random.normal(0, arcsec, count)
    return rows


def starry(columns, rows, signals, noise=5.0, seed=1):
    """A frame with stars of these peaks, in order on a grid of places."""
    random = np.random.default_rng(seed)
    image = random.normal(100, noise, (rows, columns))
    places = [(columns * (k + 1) // (len(signals) + 1), rows // 2) for k in range(len(signals))]
    v, u = np.arange(rows)[:, None], np.arange(columns)
    for (x, y), signal in zip(places, signals, strict=True):
        image += (
            signal * np.exp(-((v - y) ** 2) / 2 / 0.7**2) * np.exp(-((u - x) ** 2) / 2 / 0.7**2)
        )
    return Frame(image), np.array(places)


@pytest.mark.parametrize(
    "size", [*(pytest.param(size, marks=pytest.mark.slow) for size in (256, 1024)), 2048]
)
def test_faint_stars_are_seen_on_a_phone(drawn, size):
    """A star of eight times the noise beside one of a thousand times; in frames of any size."""
    frame, places = starry(size, size, [40.0, 5000.0, 40.0, 40.0])
    figure, path = drawn(draw_frame, frame, "a frame", written=True)
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture.shape[1] == 1280
    height = round(picture.shape[0] * PHONE / 1280)
    small = cv2.resize(picture, (PHONE, height), interpolation=cv2.INTER_AREA)
    at = figure.axes[0].transData.transform(places) * PHONE / 1280
    ground = np.median(small[height // 4 : height // 2, 60:390])
    for x, y in at:
        v, u = round(height - y), round(x)
        assert small[v - 2 : v + 3, u - 2 : u + 3].max() > ground + 50
    assert ground < 40


@pytest.mark.parametrize("noise", [0.4, 5.0])
@pytest.mark.parametrize("size", [512, 1024])
def test_stars_are_drawn_wider_than_hot_pixels(size, noise):
    """Peaks of twenty times the noise, in whole numbers whose noise may be below one."""
    line = np.arange(48, size - 48, 48)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    hot = np.arange(len(x)) % 2 == 0
    image = np.random.default_rng(1).normal(100, noise, (size, size))
    near = np.arange(-3, 4)
    star = np.exp(-(near**2 + near[:, None] ** 2) / 2 / 0.8**2)
    for column, row, spot in zip(x, y, ~hot, strict=True):
        image[row - 3 : row + 4, column - 3 : column + 4] += spot * 20 * noise * star
    image[y[hot], x[hot]] += 20 * noise
    image[7::48, 7::48] += 20 * noise  # more of them, with none beside
    shown = stretch(np.round(image).astype(np.int32), 1e9)
    columns, rows = x // shown.block, y // shown.block
    sides = [shown.image[rows, columns + side] for side in (-1, 1)]
    wide = np.minimum(*sides) > 100 + 10 * noise
    assert shown.wider
    assert wide[~hot].mean() > 0.9
    assert wide[hot].mean() < 0.03


def test_a_stretch_and_its_inverse_agree():
    shown = stretch(starry(64, 64, [500.0])[0].image)
    numbers = np.array([shown.black - 20, shown.black, shown.black + 3, shown.white])
    np.testing.assert_allclose(shown.number(shown.level(numbers)), numbers)
    assert shown.level(np.array([shown.white])) == pytest.approx(1)


@pytest.mark.parametrize(
    ("value", "saturation", "bright"),
    [
        (4095, 4095.0, True),
        (0, 4095.0, False),
        pytest.param(255, None, True, marks=pytest.mark.slow),
    ],
)
def test_a_frame_of_one_value_says_so(drawn, value, saturation, bright):
    """A saturated frame is not drawn like a dark one."""
    image = np.full((64, 64), value, np.uint8 if value == 255 else np.uint16)
    figure, path = drawn(draw_frame, Frame(image), "constant", saturation=saturation, written=True)
    assert f"all pixels have the digital number {value}" in texts(figure)
    picture = cv2.imread(str(path))
    middle = picture[picture.shape[0] // 4, 640]
    assert (middle.max() > 150) == bright


def test_bright_stars_have_names_and_the_sky_has_a_scale(drawn):
    camera = Camera(512, 512, 3182.0)
    ra, dec = np.radians([10.68, 13.0]), np.radians([41.27, 41.3])
    direction = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    attitude, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], direction[:1])
    stars = Stars(np.array([-32349, 7]), direction, np.array([-1.2, 3.0]), np.zeros(2))
    frame, _ = starry(512, 512, [40.0])
    figure, _ = drawn(draw_frame, frame, "Sirius elsewhere", camera, attitude, stars)
    read = texts(figure)
    for word in ("Sirius, G -1.2", "G 3.0", "N", "E", "1°"):
        assert word in read, word


def test_numbers_of_spots_stay_in_the_frame(drawn):
    """With spots in all four corners."""
    frame, _ = starry(300, 200, [40.0])
    x, y = np.array([1.0, 298.0, 1.0, 298.0]), np.array([1.0, 1.0, 198.0, 198.0])
    one = np.ones(4)
    spots = Spots(x, y, one, np.tile(np.eye(2), (4, 1, 1)), one, np.ones(4, int))
    figure, _ = drawn(draw_spots, frame, spots, "corners")
    axes = figure.axes[0]
    inside = axes.get_window_extent().padded(2)
    named = [text for text in axes.texts if text.get_text() in "1234"]
    assert len(named) == 4
    for text in named:
        box = text.get_window_extent()
        assert inside.contains(box.x0, box.y0)
        assert inside.contains(box.x1, box.y1)


def test_an_outlier_is_counted_and_squashes_nothing(drawn):
    rows = outcomes(200)
    rows["error_x"][7], rows["error_z"][9] = 265 * arcsec, -400 * arcsec
    figure, _ = drawn(draw_errors, rows, "an outlier")
    across, about = figure.axes
    assert across.get_xlim()[1] < 10
    assert about.get_xlim()[1] < 10
    read = texts(figure)
    assert "1 beyond the axes, to 265 arcsec" in read
    assert "1 beyond the axis, to 400 arcsec" in read
    shown = sum(len(line.get_xdata()) for line in across.lines if line.get_label() == "trial")
    assert shown == 199


def test_no_attitude_makes_a_picture_all_the_same(drawn):
    rows = outcomes(5)
    rows["solved"] = False
    assert "no attitude" in texts(drawn(draw_errors, rows, "blind")[0])


def test_all_errors_of_a_sequence_are_within_the_axes(drawn):
    """Also on the y axis, with an error of 265 arcsec."""
    table = np.zeros(30, FRAMES)
    table["time"], table["mode"], table["solved"] = np.arange(30), Mode.TRACKED, True
    random = np.random.default_rng(1)
    for axis in "xyz":
        table[f"error_{axis}"] = random.normal(0, arcsec, 30)
        table[f"filtered_{axis}"] = random.normal(0, arcsec, 30)
        table[f"filtered_sigma_{axis}"] = arcsec
    table["error_y"][11] = 265 * arcsec
    figure, _ = drawn(draw_sequence, table, "a slew")
    panels = figure.axes[1:]
    assert [axes.get_ylabel() for axes in panels] == [
        "error about x (arcsec)",
        "error about y (arcsec)",
        "error about the boresight (arcsec)",
    ]
    for axes, axis in zip(panels, "xyz", strict=True):
        low, high = axes.get_ylim()
        assert low < table[f"error_{axis}"].min() / arcsec
        assert table[f"error_{axis}"].max() / arcsec < high
    assert "logarithmic beyond" in panels[1].get_title(loc="left")


def test_a_sky_that_is_alike_everywhere_has_no_offset(drawn, small):
    """A map with a few bad directions has an arrow at its colour bar; blind directions are grey."""
    random = np.random.default_rng(1)
    direction = random.normal(size=(400, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    across = np.full(400, arcsec)
    across[:3] = 50 * arcsec
    about = np.where(np.arange(400) < 40, np.nan, 5 * arcsec)
    alike = 99.9999 + 1e-6 * random.random(400)
    found = RateSurvey(direction, alike, np.ones(400), across, about, alike)
    figure, _ = drawn(draw_sky, found, small.case, "alike")
    bars = [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]
    extends = [axes._colorbar.extend for axes in bars]
    assert extends == ["neither", "max", "neither"]
    assert "grey: no attitude, 10.0 % of the sky" in texts(figure)


def test_a_budget_shows_values_from_zero_and_its_requirement(drawn, small):
    budget = analytic(small.case)
    required = [
        Accuracy(Objective("across"), 2 * budget.across),
        Accuracy(Objective("about", 0.9973), budget.about),
    ]
    figure, _ = drawn(draw_budget, budget, None, "small", required)
    across, about = figure.axes
    for axes, value in ((across, budget.across), (about, budget.about)):
        assert axes.get_xlim()[0] == 0
        written = [text.get_text() for text in axes.texts]
        assert len(written) == len(budget.lines) + 1
        assert written[-1] == style.number(value / arcsec)
    lines = [line.get_xdata()[0] for line in across.lines if line.get_linestyle() == "--"]
    assert lines == [pytest.approx(2 * budget.across / arcsec)]
    assert across.get_xlim()[1] > lines[0]
    assert "no line" in texts(figure)


def test_effects_that_a_formula_leaves_out_are_named(drawn, small, monkeypatch):
    """The shaded range of rates; trials with few stars appear beside the lines."""
    monkeypatch.setattr(curves, "SMEARS", (0.0, 1.0))
    monkeypatch.setattr(curves, "BETWEEN", 0)
    lagging = dataclasses.replace(small.case.instrument.detector, lag=0.01)
    instrument = dataclasses.replace(small.case.instrument, detector=lagging)
    case = dataclasses.replace(small.case, instrument=instrument)
    figure, _ = drawn(draw_curves, error_curves(case, 1, trials=4), case, "small")
    rates = figure.axes[0]
    labels = rates.get_legend_handles_labels()[1]
    assert any("across, analytic" in one for one in labels)
    assert any("trials each" in one for one in labels)
    shaded = next(one for one in labels if one.startswith("shaded: analytic without"))
    assert "residual charge" in shaded


@pytest.mark.slow
def test_what_moves_stars_beyond_the_causes_that_are_drawn_is_named(drawn, small, monkeypatch):
    """Jitter displaces all stars of a frame equally; the names of small causes have room, too."""
    monkeypatch.setattr(curves, "SMEARS", (0.0, 1.0))
    monkeypatch.setattr(curves, "BETWEEN", 0)
    shaken = replaced(small.case, "instrument.motion.tones", (Tone(20.0, 1e-5, 1e-5),))
    steps = []
    found = error_curves(shaken, 1, trials=12, advance=steps.append)
    assert sum(steps) == pytest.approx(curve_steps(shaken))
    random = dict(found.stars.random)
    total = sum(random.values())
    random["centroid method"] = total * np.geomspace(1e-6, 1e-3, len(total))[:, None, None]
    figure, _ = drawn(
        draw_curves, found._replace(stars=found.stars._replace(random=random)), shaken, "s"
    )
    title = figure.axes[1].get_title(loc="left")
    assert "trials have" in title
    assert "jitter" in title
    assert "shot noise" not in title
    labels = figure.axes[1].get_legend_handles_labels()[1]
    assert any(one.startswith("centroid method (above") for one in labels)


def optimum(count):
    """A search with a changing number of trials, in which some designs have none."""
    random = np.random.default_rng(1)
    evaluations = [
        Evaluation(
            tuple(random.random(3)),
            {},
            arcsec * (5 - 4 * k / count) if k % 4 else np.nan,
            0.0,
            0.0,
            {"mass": 1.0 - (k % 3)},
            SimpleNamespace(trials=20 if k < count // 2 else 60) if k % 4 else None,
            "",
        )
        for k in range(count)
    ]
    names = [SimpleNamespace(name=f"instrument.{one}") for one in ("first", "second", "third")]
    fresh = (SimpleNamespace(trials=100),) * 2
    factor = Interval(1.5, 1.4, 1.6)
    return Optimum(
        space=space_of(names),
        branch="",
        start=None,
        best=None,
        evaluations=tuple(evaluations),
        fresh=fresh,
        errors={},
        factor=factor,
        tuning_error=0.0,
        optimism=factor,
        availability=factor,
        margins={},
        rounds=1,
        ending="",
        trials={},
    )


def space_of(variables):
    """A design space with lengths from 0 to 1 m."""

    def values(point):
        return {one.name: u for one, u in zip(variables, point, strict=True)}

    def shown(name, value, digits):
        return f"{value:g} m"

    return SimpleNamespace(variables=variables, values=values, shown=shown)


def test_the_lines_of_a_search_are_explained(drawn):
    found = optimum(40)
    figure, _ = drawn(draw_convergence, found, Campaign())
    error, *variables = figure.axes
    dotted = [line for line in error.lines if line.get_linestyle() == ":"]
    assert len(dotted) == 1
    explained = error.get_legend_handles_labels()[1]
    assert any("another number of trials" in one for one in explained)
    assert any("(10)" in one for one in explained)  # the designs without an error are counted
    assert {text.get_text() for text in error.texts} == {"20", "60"}
    assert [axes.get_title("left") for axes in variables] == ["first", "second", "third"]
    assert [tick.get_text() for tick in variables[0].get_yticklabels()] == ["0", "0.5", "1"]
    assert variables[0].get_ylabel() == "(m)"


def test_the_path_of_a_variable_is_that_of_the_best_so_far_each_in_a_panel(drawn):
    """Forecasts 2, 1 and 3 arcsec, of which the second misses a limit and the third is worse; then
    designs without trials, that miss a limit, of 4.9 and of 4.8 arcsec."""
    names = [SimpleNamespace(name=f"instrument.{number}") for number in range(9)]
    points = np.random.default_rng(2).random((8, 9))
    landscape = SimpleNamespace(
        forecasts=tuple(map(tuple, points[:3])),
        expected=tuple(np.log([2.0, 1.0, 3.0])),
        met=(True, False, True),
        spans={one.name: SimpleNamespace(low=0, high=1) for one in names},
    )
    found = optimum(8)
    evaluations = [
        dataclasses.replace(
            one,
            coordinates=tuple(point),
            error=error * arcsec,
            margins={"mass": margin},
            summary=summary,
        )
        for one, point, error, margin, summary in zip(
            found.evaluations,
            points[3:],
            (np.nan, 1.0, 4.9, 4.8, 5.0),
            (1, -1, 1, 1, 1),
            (None, *[SimpleNamespace(trials=20)] * 4),
            strict=False,
        )
    ]
    found = dataclasses.replace(
        found, space=space_of(names), evaluations=tuple(evaluations), landscape=landscape
    )
    figure, _ = drawn(draw_convergence, found, Campaign())
    history, *panels = figure.axes
    assert len(panels) == 9
    expected = points[[0, 0, 0, 0, 0, 5, 6, 6], 4]
    _, path = panels[4].lines
    assert np.array_equal(path.get_ydata(), expected)
    [best] = [line for line in history.lines if line.get_label() == "best forecast that meets"]
    assert np.allclose(best.get_ydata(), [2, 2, 2])


def test_a_search_over_units_says_so_and_explains_its_bars(drawn):
    spans = {f"instrument.{one}": SimpleNamespace(low=0.2, high=0.8) for one in ("first", "second")}
    spans["instrument.third"] = SimpleNamespace(low=0.0, high=1.0)
    landscape = SimpleNamespace(
        forecasts=((0.1, 0.2, 0.3),), expected=(1.6,), met=(True,), spans=spans
    )
    over = OverUnits(fraction=0.95, age=5 * YEAR, count=2, trials=2)
    found = dataclasses.replace(optimum(40), landscape=landscape, units=SimpleNamespace(over=over))
    figure, _ = drawn(draw_convergence, found, Campaign())
    error, *variables = figure.axes
    assert "that 95 % of units at 5 yr do not exceed" in error.get_ylabel()
    assert "the band the range that keeps the objective" in " ".join(figure.get_suptitle().split())
    [band] = variables[0].patches
    assert (band.get_y(), band.get_y() + band.get_height()) == (0.2, 0.8)


def test_a_front_has_the_intervals_of_its_trials(drawn):
    points = [
        Point(
            (0.5,),
            {},
            (0.5 + k, 0.35 - 0.01 * k),
            (0.6 + k, 0.35 - 0.01 * k),
            (Interval(0.6 + k, 0.5 + k, 0.7 + k), Interval(*[0.35 - 0.01 * k] * 3)),
        )
        for k in range(4)
    ]
    figure, _ = drawn(draw_front, points, ("across (arcsec)", "mass (kg)"), 60)
    (axes,) = figure.axes
    spans = {
        round(float(np.ptp(part.get_segments()[0][:, 0])), 6) for part in axes.collections[::2]
    }
    assert spans == {0.2}
    assert len([text for text in axes.get_yticklabels() if text.get_text()]) >= 2


def test_a_bound_without_an_attitude_is_named(drawn):
    index = Interval(0.4, 0.3, 0.5)
    found = [
        Sensitivity("instrument.optics.blur", 0.5, 0.4, 0.9, 1.0, index, index),
        Sensitivity("instrument.detector.exposure", 0.5, np.nan, 0.7, 1.0, index, index),
    ]
    read = texts(drawn(draw_tornado, found, "rms error across")[0])
    for word in ("low: 0.400", "high: 0.900", "no forecast at its low bound", "95 %"):
        assert word in read, word


def test_an_index_below_zero_by_rounding_is_zero(drawn):
    index = Interval(-0.001, -0.004, 0.002)
    found = [Sensitivity("instrument.optics.blur", 0.5, 0.4, 0.9, 1.0, index, index)] * 2
    assert "-0.00" not in texts(drawn(draw_tornado, found, "rms error across")[0])


def test_two_bounds_on_one_side_of_the_design_are_written_beside_each_other(drawn):
    index = Interval(0.4, 0.3, 0.5)
    found = [
        Sensitivity("instrument.optics.f_number", 5.25, 5.54, 5.69, 0.0, index, index),
        Sensitivity("tracker.detection.max_spots", 5.25, 5.0, 4.9, 0.0, index, index),
    ]
    figure, _ = drawn(draw_tornado, found, "rms error across")
    at = {text.get_text(): text.xy[0] for text in figure.axes[0].texts}
    assert at == {"low: 5.54, high: 5.69": 5.69, "low: 5.00, high: 4.90": 4.9}


def test_a_narrow_distribution_has_no_offset(drawn):
    """A focal length with a relative uncertainty of 1e-6."""
    random = np.random.default_rng(1)
    samples = np.column_stack([1816.2 + 2e-3 * random.normal(size=500), random.random(500)])
    drawn(draw_corner, samples, ["focal length (pixel)", "k1 (1)"], "posterior")


def test_a_corner_of_tolerances_names_the_quantiles_of_all_samples(drawn):
    """Those of the table, although one sample in ten is drawn."""
    samples = np.random.default_rng(1).normal(5, 1, (20_000, 1))
    source = SimpleNamespace(
        names=["instrument.detector.exposure"],
        unit=SimpleNamespace(size=1.0, name=""),
        shown=lambda point: {"exposure": f"{point[0]:.6g} ms"},
    )
    chains = SimpleNamespace(effective=np.array([20_000]))
    tolerance = SimpleNamespace(
        source=source, samples=samples, limit=1.0, chains=chains, check_error=0.1, checks=12
    )
    figure, _ = drawn(draw_tolerance, tolerance)
    low, middle, high = np.quantile(samples, (0.025, 0.5, 0.975))
    said = figure.axes[0].get_title(loc="left")
    assert said == f"{middle:.2f}\n[{low:.2f}, {high:.2f}]"


def test_a_prediction_draws_every_share_of_its_width(drawn):
    """Its legend covers no interval."""
    causes = ((OTHERS, 0.85), ("instrument.detector.read_noise", 0.15))
    figures = [
        SimpleNamespace(
            figure=name, axis=axis, low_95=4e-6, low_68=5e-6, median=6e-6, high_68=7e-6,
            high_95=8e-6, causes=causes,
        )
        for name in PUBLISHED
        for axis in ("across", "about")
    ]  # fmt: skip
    found = SimpleNamespace(
        unknowns={"read noise": ""}, figures=figures, figure=lambda name, axis: figures[0]
    )
    figure, _ = drawn(draw_prediction, found, "tracker")
    top, below = figure.axes
    assert [label.get_text() for label in below.get_yticklabels()][-1].startswith("the model")
    assert below.patches[0].get_width() == pytest.approx(85)
    lowest = min(line.get_ydata()[0] for line in top.lines)
    box = top.get_legend().get_window_extent().transformed(top.transData.inverted())
    assert box.y1 < lowest


def test_a_term_that_is_zero_everywhere_says_so(drawn):
    lines = {"height": 5.0, "shadow": 0.0, "incidence": 45.0, "hit": 1.0, "level": 2.0}
    maps = {name: np.full((20, 30), value) for name, value in lines.items()}
    assert "0 everywhere" in texts(drawn(draw_geometry, maps, "flat")[0])
    names = ("direct", "diffuse", "reflected", "path", "adjacent")
    terms = {name: np.full((20, 30), float(k)) for k, name in enumerate(names)}
    figure, _ = drawn(draw_picture, np.arange(600).reshape(20, 30), terms, "flat")
    assert "0 everywhere" in texts(figure)
    assert "4 everywhere" in texts(figure)


def test_a_modulation_that_depends_on_direction_has_both(drawn):
    table = np.exp(-(np.add.outer(np.linspace(-3, 3, 63) ** 2, np.linspace(-3, 3, 63) ** 2)))
    frequency = np.linspace(0, 0.5, 50)
    one = {"optics": 1 - frequency, "motion": 1 - frequency / 2, "total": (1 - frequency) ** 2}
    other = {name: values**2 for name, values in one.items()}
    image = Psf(table / table.sum(), 9, 1.0)
    same, _ = drawn(draw_psf, image, frequency, (one, one), "alike")
    both, _ = drawn(draw_psf, image, frequency, (one, other), "smeared")
    assert "the same along x and y" in texts(same)
    assert "dashed: along y" in texts(both)
    assert len(both.axes[1].lines) > len(same.axes[1].lines)


def test_colours_differ_for_readers_who_confuse_red_and_green():
    """Lightness or hue differs in a simulation of deuteranopia (Machado et al. 2009)."""
    machado = np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                        [-0.011820, 0.042940, 0.968881]])  # fmt: skip
    lab = {}
    for name in ("BLACK", "BLUE", "SKY", "GREEN", "RED", "ORANGE", "YELLOW", "PURPLE"):
        code = getattr(style, name).lstrip("#")
        encoded = np.array([int(code[k : k + 2], 16) / 255 for k in (0, 2, 4)])
        linear = np.where(encoded < 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
        seen = np.clip(machado @ linear, 0, 1) ** (1 / 2.2)
        lab[name] = cv2.cvtColor(seen.astype(np.float32)[None, None], cv2.COLOR_RGB2Lab)[0, 0]
    for first, second in itertools.combinations(lab, 2):
        assert np.linalg.norm(lab[first] - lab[second]) > 12, (first, second)


def test_the_look_does_not_leak_into_a_caller_s_pictures(tmp_path):
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw_errors(tmp_path / "errors.png", outcomes(5), "few")
    assert dict(matplotlib.rcParams) == before


def test_limits_of_colours_hold_a_part_of_the_values():
    assert style.colour_limits([1.0, 2.0, 3.0, np.nan]) == (1.0, 3.0)
    low, high = style.colour_limits(99.9999 + 1e-6 * np.arange(5))
    assert high - low > 1
    assert style.colour_limits([]) == (0.0, 1.0)
    assert style.colour_limits(np.zeros(3)) == (0.0, 1.0)


def test_case_at_another_rate_keeps_all_else(small):
    turned = curves.slewing(small.case, 2 * deg)
    assert turned.instrument.motion.rate == pytest.approx(2 * deg)
    still = dataclasses.replace(turned.instrument, motion=small.case.instrument.motion)
    assert dataclasses.replace(turned, instrument=still) == small.case
