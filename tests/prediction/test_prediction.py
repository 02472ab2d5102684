"""Predictions of designs with unknown values, against closed forms."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from startrack import Refused, arcsec, load_design, shipped
from startrack.budget import Term, analytic
from startrack.cli.predict import prediction_answer
from startrack.design import Told, Unknown
from startrack.prediction import (
    ACCURACY,
    MODEL_ERROR,
    OTHERS,
    Draw,
    draw_unknowns,
    fit_surface,
    learn,
    predict,
    prediction_of,
)
from startrack.verification.accuracy import limiting_magnitude as limiting

GRID = Unknown("grid", {"median": "1 um", "factor": 2.0})
STARS = Unknown("stars", {"among": [10, 40]})
LENS = Unknown("lens", {"among": ["a", "b"], "weight": [3, 1]})


def drawn(count, error, unknowns=(GRID, STARS, LENS), lost=()):
    """Draws of a design whose FOV error across is a function of quantiles, and about twice as
    large."""
    random = np.random.default_rng(5)
    draws = []
    for number in range(count):
        quantile = {unknown.name: float(random.uniform()) for unknown in unknowns}
        across = error(quantile)
        terms = {Term.FIELD: np.array([across, 2 * across])}
        refused = "no stars" if number in lost else ""
        draws.append(Draw(number, unknowns, quantile, terms, 1.0, refused))
    return draws


def product(quantile):
    """An error with a known law: 3 arcsec times the length, over the root of the stars, times
    the lens factor."""
    length = 2.0 ** norm.ppf(quantile["grid"])
    stars = 10 if quantile["stars"] < 0.5 else 40
    return 3 * arcsec * length * math.sqrt(10 / stars) * (1 if quantile["lens"] < 0.75 else 1.5)


def test_the_surface_is_that_of_a_product_of_powers():
    surface = fit_surface(drawn(20, product))
    assert surface.scatter == pytest.approx(0.0, abs=1e-9)
    slopes = [math.log(2), -0.5, math.log(1.5)]
    assert surface.slope[0] == pytest.approx(np.array([slopes, slopes]))


def test_what_all_draws_are_wrong_by_widens_each_interval():
    draws = drawn(20, lambda quantile: 3 * arcsec, (GRID,))
    wide = prediction_of(draws, 1, 3, 0.0, common=0.1).figure(ACCURACY, "across")
    assert wide.factor == pytest.approx(math.exp(0.1), rel=0.01)
    assert wide.median == pytest.approx(3 * arcsec, rel=0.01)


def test_the_error_of_the_model_widens_figures_and_leaves_the_unknowns():
    """Of one class of error; a told figure has the error that it was told, and no other."""
    draws = drawn(20, lambda quantile: 3 * arcsec, (GRID,))
    wide = prediction_of(draws, 1, 3, 0.0, model=0.2)
    assert wide.figure(ACCURACY, "across").factor == pytest.approx(math.exp(0.2), rel=0.02)
    draws = drawn(20, product)
    with_model, without = (
        prediction_of(draws, 1, 3, 0.0, [told(6.0, 1.1)], model=model).learned
        for model in (0.2, 0.0)
    )
    assert with_model.posteriors == without.posteriors


def test_quantiles_and_causes_are_those_of_the_law():
    """Against a million draws of the product itself, and the variances of its three logarithms."""
    found = prediction_of(drawn(40, product), seed=1, units=3, age=0.0)
    figure = found.figure(ACCURACY, "across")
    exact = np.random.default_rng(1)
    scores = 2.0 ** exact.standard_normal(10**6) * np.where(exact.random(10**6) < 0.5, 1, 0.5)
    scores *= np.where(exact.random(10**6) < 0.75, 1, 1.5)
    values = np.quantile(scores * 3 * arcsec, [0.5, 0.16, 0.84, 0.025, 0.975])
    assert figure[3:8] == pytest.approx(values, rel=0.05)
    variance = {
        "grid": math.log(2) ** 2,
        "stars": (math.log(4) / 2) ** 2 / 4,
        "lens": math.log(1.5) ** 2 * 0.75 * 0.25,
    }
    causes = dict(figure.causes)
    for name, part in variance.items():
        assert causes[name] == pytest.approx(part / sum(variance.values()), abs=0.03)
    assert found.figure(ACCURACY, "about").median == pytest.approx(2 * figure.median, rel=1e-9)


def test_an_even_law_leaves_nothing_over():
    """An error that is a power of a value between two ends, at quantiles of that value."""
    even = Unknown("even", {"low": 1.2, "high": 2.0})
    draws = drawn(32, lambda quantile: arcsec * (1.2 + 0.8 * quantile["even"]) ** 1.5, (even,))
    figure = prediction_of(draws, seed=1, units=3, age=0.0).figure(ACCURACY, "across")
    exact = (1.2 + 0.8 * np.array([0.5, 0.16, 0.84, 0.025, 0.975])) ** 1.5
    assert figure[3:8] == pytest.approx(exact * arcsec, rel=0.03)
    assert dict(figure.causes)["even"] > 0.98


def test_draws_without_an_attitude_are_said_and_left_out():
    found = prediction_of(drawn(40, product, lost={3, 5}), seed=1, units=3, age=0.0)
    assert found.lost == pytest.approx(0.05)
    assert found.reasons == (("no stars", 2),)
    with pytest.raises(Refused, match="draws with an attitude must be 7 or more for 3 unknowns"):
        fit_surface(drawn(6, product))


def test_too_few_draws_are_refused_before_the_first_one():
    def watch(draw):
        raise AssertionError("a draw was computed")

    with pytest.raises(Refused, match="must be 9 or more for 5 unknowns, got 8"):
        predict(shipped("trackers/st-16.toml"), draws=8, watch=watch)


def told(value, factor, axis="across"):
    return Told("accuracy", axis, value * arcsec, factor=factor)


def test_a_told_figure_narrows_what_it_depends_on():
    """For normal laws, precisions add up, and means are weighted by precision (conjugate prior)."""
    draws = drawn(20, lambda quantile: 3 * arcsec * 2 ** norm.ppf(quantile["grid"]), (GRID,))
    learned = prediction_of(draws, 1, 3, 0.0, [told(6.0, 1.5)]).learned
    (posterior,) = learned.posteriors
    before, data = math.log(2) ** -2, math.log(1.5) ** -2
    assert learned.chains.converged
    assert posterior.narrowing == pytest.approx((before / (before + data)) ** 0.5, rel=0.03)
    factor = math.exp((before + data) ** -0.5)
    assert posterior.unknown.law["factor"] == pytest.approx(factor, rel=0.02)
    median, unit = posterior.unknown.law["median"].split()
    assert float(median) == pytest.approx(2 ** (data / (before + data)), rel=0.03)
    assert unit == "um"


def test_a_figure_that_the_design_cannot_have_is_said():
    """Errors are from 1.2 to 2 arcsec; 20 arcsec within 5 % are ten times the largest of them."""
    even = Unknown("even", {"low": 1.2, "high": 2.0})
    draws = drawn(32, lambda quantile: arcsec * (1.2 + 0.8 * quantile["even"]), (even,))
    found = prediction_of(draws, 1, 3, 0.0, [told(20.0, 1.05)])
    assert found.learned.contradicted == (("accuracy across", pytest.approx(10, rel=0.05)),)
    assert "CONTRADICTED: accuracy across was told, " in prediction_answer(found)
    assert prediction_of(draws, 1, 3, 0.0, [told(1.9, 1.05)]).learned.contradicted == ()


def test_what_a_figure_says_nothing_of_keeps_its_law():
    draws = drawn(20, lambda quantile: 3 * arcsec * 2 ** norm.ppf(quantile["grid"]))
    found = prediction_of(draws, 1, 3, 0.0, [told(6.0, 1.1)])
    silent = {posterior.unknown.name for posterior in found.learned.posteriors if posterior.silent}
    assert silent == {"stars", "lens"}
    assert [posterior.unknown for posterior in found.learned.posteriors[1:]] == [STARS, LENS]
    assert found.figure(ACCURACY, "across").median == pytest.approx(6 * arcsec, rel=0.05)
    before = prediction_of(draws, 1, 3, 0.0)
    assert found.figure(ACCURACY, "across").factor < 0.6 * before.figure(ACCURACY, "across").factor


def test_a_told_choice_has_the_odds_of_its_values():
    """Bayes' rule for two lenses of 3 and 4.5 arcsec, odds 3 to 1, with a figure of 4.5 within a
    factor of 1.2."""
    draws = drawn(20, lambda quantile: (3 if quantile["lens"] < 0.75 else 4.5) * arcsec, (LENS,))
    (posterior,) = prediction_of(draws, 1, 3, 0.0, [told(4.5, 1.2)]).learned.posteriors
    odds = 3 * math.exp(-((math.log(1.5) / math.log(1.2)) ** 2) / 2)
    first, second = posterior.unknown.law["weight"]
    assert first / second == pytest.approx(odds, rel=0.15)


@pytest.mark.parametrize(("heads", "angle"), [(2, 40), (2, 90), (3, 90), (4, 60)])
def test_a_figure_of_fused_heads_is_that_of_their_best_estimate(heads, angle):
    """Against 40,000 least-squares estimates from errors that are drawn head by head."""
    rng, errors, count = np.random.default_rng(1), np.array([1.0, 6.0]), 40_000
    slope = np.arcsin(np.sin(np.radians(angle) / 2) / np.sin(np.pi / heads))
    turns = [
        Rotation.from_euler("ZY", [2 * np.pi * k / heads, slope]).as_matrix() for k in range(heads)
    ]
    boresights = np.array([turn[:, 2] for turn in turns])
    assert np.degrees(np.arccos(boresights[0] @ boresights[1])) == pytest.approx(angle)
    sigma = np.array([errors[0], errors[0], errors[1]])
    seen = [sigma * rng.standard_normal((count, 3)) for _ in turns]
    # Each head says its own components of the error, each of which is weighted by its sigma.
    rows = np.concatenate([turn.T / sigma[:, None] for turn in turns])
    values = np.concatenate([(one / sigma).T for one in seen])
    best = np.linalg.lstsq(rows, values)[0]
    rms = np.sqrt((best**2).mean(axis=1))
    for axis, expected in (("across", np.hypot(*rms[:2]) / 2**0.5), ("about", rms[2])):
        figure = Told("NEA", axis, arcsec, heads=heads, angle=np.radians(angle))
        found, weight = figure.of_heads(errors[None])
        assert found[0] == pytest.approx(expected, rel=0.01)  # 4 sigma of its chance
        assert weight.sum() == pytest.approx(1.0), "both errors twice as large make it so"
        for n in range(2):
            more = errors * np.where(np.arange(2) == n, 1 + 1e-6, 1)
            step = np.log(figure.of_heads(more[None])[0][0] / found[0]) / 1e-6
            assert weight[0, n] == pytest.approx(step, abs=1e-5)


def test_a_told_figure_of_two_heads_says_what_one_of_one_head_does():
    """Across two heads with one boresight, the error is that of one over the root of 2."""
    draws = drawn(20, lambda quantile: 3 * arcsec * 2 ** norm.ppf(quantile["grid"]), (GRID,))
    alone = prediction_of(draws, 1, 3, 0.0, [told(6.0, 1.5)]).learned.posteriors[0]
    both = Told("accuracy", "across", 6 / 2**0.5 * arcsec, factor=1.5, heads=2, angle=0.0)
    fused = prediction_of(draws, 1, 3, 0.0, [both]).learned.posteriors[0]
    median = [float(one.unknown.law["median"].split()[0]) for one in (alone, fused)]
    assert median[0] == pytest.approx(median[1], rel=0.02)
    assert alone.narrowing == pytest.approx(fused.narrowing, rel=0.03)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"heads": 2}, "angle must be given, got heads = 2"),
        ({"angle": 1.0}, "angle must be left out for one head, got heads = 1"),
        ({"heads": 3, "angle": 2.2}, "angle must be at most 120 deg between neighbours of 3 heads"),
    ],
)
def test_heads_need_the_angle_between_them(more, words):
    with pytest.raises(Refused, match=words):
        Told("accuracy", "across", arcsec, **more)


@pytest.fixture
def design(tmp_path):
    """The example with noise only and two unknowns, one of which changes only the noise."""
    path = tmp_path / "design.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\n[instrument.detector]\n'
        'exposure = { median = "100 ms", factor = 1.3 }\n'
        "[instrument.residual]\nrms = { median = 0.05, factor = 2.0 }\n"
    )
    return path


def test_noise_falls_with_the_root_of_the_light(design):
    """NEA goes as exposure^-1/2 if photon noise dominates, as exposure^-1 if read noise does."""
    found = predict(design, draws=10, units=2, age=0.0)
    nea, accuracy = found.figure("NEA", "across"), found.figure(ACCURACY, "across")
    by_light = math.sqrt(math.log(nea.factor) ** 2 - MODEL_ERROR**2)
    slope = by_light / math.log(1.3)
    assert 0.4 < slope < 1.1
    unknowns = [name for name, _ in nea.causes if name != OTHERS]
    assert unknowns[0] == "instrument.detector.exposure"
    assert accuracy.causes[0][0] == "instrument.residual.rms"
    assert accuracy.low_95 < accuracy.low_68 < accuracy.median < accuracy.high_68
    assert accuracy.middle == pytest.approx(accuracy.median, rel=0.3)


def test_draws_do_not_depend_on_workers_or_other_unknowns(design):
    alone = draw_unknowns(design, 3, 4, 1, 0.0, middle=False)
    with ThreadPoolExecutor(2) as executor:
        beside = draw_unknowns(design, 3, 4, 1, 0.0, executor=executor, middle=False)
    for one, other in zip(alone, beside, strict=True):
        assert one.quantile == other.quantile
        assert all(np.array_equal(one.terms[term], other.terms[term]) for term in one.terms)
    told = draw_unknowns(design, 3, 4, 1, 0.0, ["instrument.residual.rms=0.05"], middle=False)
    name = "instrument.detector.exposure"
    assert [one.quantile[name] for one in told] == [one.quantile[name] for one in alone]
    strata = sorted(int(4 * one.quantile[name]) for one in alone)
    assert strata == [0, 1, 2, 3], "one in each quarter"


def test_few_fields_are_corrected_to_those_of_the_budget(tmp_path):
    """The noise of 32 fields is 11 % off; the middle is corrected to the budget, and each draw
    is near its own."""
    path = tmp_path / "design.toml"
    law = 'read_noise = { median = "8 electron", factor = 1.3 }'
    path.write_text(f'base = "designs/noise_only.toml"\n[instrument.detector]\n{law}\n')
    middle, *draws = draw_unknowns(path, 1, 2, 1, 0.0)
    assert middle.terms[Term.NOISE] == pytest.approx(
        analytic(load_design(path).case).term(Term.NOISE), rel=1e-6
    )
    for draw in draws:
        own = analytic(load_design(path, quantile=draw.quantile.__getitem__).case)
        assert draw.terms[Term.NOISE] == pytest.approx(own.term(Term.NOISE), rel=0.03)


def test_the_middle_is_known_before_workers_are_asked(design):
    asked, watched = [], []

    class Workers(ThreadPoolExecutor):
        def submit(self, *arguments, **others):
            asked.append(len(watched))
            return super().submit(*arguments, **others)

    with Workers(1) as executor:
        draw_unknowns(design, 3, 2, 1, 0.0, executor=executor, watch=watched.append)
    assert [draw.number for draw in watched] == [-1]
    assert asked == [1, 1]


def test_a_star_table_and_a_limiting_magnitude_tell_of_what_they_depend_on(design):
    """The residual affects the table of its law; the exposure the limiting magnitude."""
    exposure, residual = "instrument.detector.exposure", "instrument.residual.rms"
    longer = load_design(design, [f"{exposure}=130 ms"]).case
    text = "\n[[told]]\nfigure = {!r}\nnumber = {}\nfactor = {}\n".format
    told = text("residual", 0.08, 1.05) + text("limiting magnitude", limiting(longer), 1.002)
    design.write_text(design.read_text() + told)
    draws = draw_unknowns(design, 1, 8, 2, 0.0, middle=False)
    for draw in draws:
        rms = next(u for u in draw.unknowns if u.name == residual).at(draw.quantile[residual])
        assert 0.6 * rms < draw.frames["residual"] < 1.5 * rms, "of two units each"
    posteriors = learn(fit_surface(draws), load_design(design).told, 1).posteriors
    after = {posterior.unknown.name: posterior.unknown.law for posterior in posteriors}
    assert float(after[exposure]["median"].split()[0]) == pytest.approx(130, rel=0.04)
    assert after[residual]["median"] == pytest.approx(0.08, rel=0.3)
    assert after[residual]["factor"] < 1.5


def test_a_design_without_unknowns_is_refused():
    from startrack.io import shipped

    with pytest.raises(Refused, match="must have an unknown value"):
        predict(shipped("designs/noise_only.toml"))


def test_a_value_out_of_its_limits_is_a_draw_without_an_error(design):
    wide = ["instrument.optics.f_number={ among = [2.0, 1e-3] }"]
    draws = draw_unknowns(design, 1, 4, 1, 0.0, wide, middle=False)
    refused = [draw for draw in draws if draw.refused]
    assert len(refused) == 2
    assert all("f_number" in draw.refused for draw in refused)
