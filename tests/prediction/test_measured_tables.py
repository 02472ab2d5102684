"""Tables of a photon transfer and of stars: from rendered frames of a hidden truth, and made
ones."""

import math

import numpy as np
import pytest

from startrack import Refused, Streams, load_design, random_attitude
from startrack.design.measured_tables import reduced_stars, reduced_transfer
from startrack.detection import detect, image_mask
from startrack.detector import frame_of
from startrack.detector.collect import background
from startrack.prediction import draw_unknowns, fit_surface, learn, save_posterior
from startrack.trial import observe
from startrack.verification import windows_of_frames, with_magnitudes
from startrack.verification.frame_figures import reduced

DETECTOR = """
base = "designs/noise_only.toml"
[instrument.detector]
full_well = { median = "50000 electron", factor = 1.4 }
read_noise = { median = "20 electron", factor = 1.5 }
prnu = { median = 0.01, factor = 1.6 }
"""
OPTICS = """
base = "designs/noise_only.toml"
[instrument.optics]
blur = { median = "5 um", factor = 1.4 }
[instrument.optics.transmission]
factor = { median = 0.9, factor = 1.25 }
[instrument.detector]
read_noise = { median = "8 electron", factor = 1.5 }
"""
FRAMES = 32


def told(path, file, figure):
    """The design of a file with a table overlaid."""
    above = path.with_name("told.toml")
    above.write_text(f'base = "{path.name}"\n[[told]]\nfigure = "{figure}"\nfile = "{file}"\n')
    return above


def learned(path, truth, narrowing):
    """The law of each unknown after a measured table is within three sigma of the truth, and
    narrower."""
    design = load_design(path)
    surface = fit_surface(draw_unknowns(path, 1, 10, 1, 0.0, middle=False))
    found = learn(surface, design.told, 1)
    for posterior in found.posteriors:
        name, law = posterior.unknown.name, posterior.unknown.law
        before = next(one for one in surface.unknowns if one.name == name)
        true = before.numbers(np.array([truth[name]]))[0]
        median = float(str(law["median"]).split()[0])
        assert posterior.narrowing < narrowing, name
        assert abs(math.log(median / true)) < 3 * math.log(law["factor"]), name
    return found


@pytest.fixture(scope="module")
def transfer(tmp_path_factory):
    """A design of a detector, the truth, and a table of levels rendered with the truth."""
    path = tmp_path_factory.mktemp("transfer") / "design.toml"
    path.write_text(DETECTOR)
    names = ("full_well", "read_noise", "prnu")
    quantiles = (0.85, 0.2, 0.75)
    truth = {f"instrument.detector.{name}": u for name, u in zip(names, quantiles, strict=True)}
    small = ["columns=160", "rows=160", "dark_current=0 electron / s"]
    small = [f"instrument.detector.{change}" for change in small]
    detector = load_design(path, small, quantile=truth.get).case.instrument.detector
    rows = ["mean,variance,spatial"]
    for number, electrons in enumerate([0, *np.geomspace(300, 1.4 * detector.full_well, 14)]):
        expected = background(detector, float(electrons))
        frames = np.array(
            [frame_of(expected, detector, Streams(number, k)).image for k in range(8)], float
        )
        variance = frames.var(axis=0, ddof=1).mean()
        between = frames.mean(axis=0).var(ddof=1) - variance / len(frames)
        rows.append(f"{frames.mean():.6f},{variance:.6f},{between:.6f}")
    path.with_name("levels.csv").write_text("\n".join(rows) + "\n")
    return path, truth, detector


def test_a_photon_transfer_tells_the_detector_that_was_rendered(transfer):
    path, truth, detector = transfer
    above = told(path, "levels.csv", "photon transfer")
    figures = {one.figure: one for one in load_design(above).told}
    assert set(figures) == {"gain", "read noise", "PRNU", "full well"}
    true = {
        "gain": detector.electrons_per_dn,
        "read noise": detector.read_noise / detector.electrons_per_dn,
        "PRNU": detector.prnu,
        "full well": min(detector.full_well, (2**12 - 1 - 64) * detector.electrons_per_dn),
    }
    for name, figure in figures.items():
        off = abs(math.log(figure.number / true[name]))
        assert off < 3 * math.log(figure.factor), name
        assert off < 0.05, name
    learned(above, truth, 0.4)


@pytest.fixture(scope="module")
def stars(tmp_path_factory):
    """A design, the truth, and a table of the stars in frames of one attitude rendered with it."""
    path = tmp_path_factory.mktemp("stars") / "design.toml"
    path.write_text(OPTICS)
    truth = {
        "instrument.optics.blur": 0.8,
        "instrument.optics.transmission.factor": 0.12,
        "instrument.detector.read_noise": 0.85,
    }
    case, believed = load_design(path, quantile=truth.__getitem__).case, load_design(path).case
    rows = ["magnitude,electrons,snr,centroid_noise"]
    for field in range(2):
        attitude = random_attitude(Streams(field, 0))
        frames = [observe(case, attitude, Streams(3, k)).frame for k in range(FRAMES)]
        seen = [detect(frame, case.tracker.detection) for frame in frames]
        for star in with_magnitudes(windows_of_frames(frames, believed), frames[0], believed):
            place = star.corner.mean(axis=0) + (star.number.shape[1] - 1) / 2
            near = np.array([at(spots, place) for spots in seen])
            steady = (star.corner == star.corner[0]).all()
            if not (steady and np.isfinite([star.magnitude_g, *near.ravel()]).all()):
                continue
            total = reduced(star.number, case.tracker.box.size).total
            electrons = total * case.instrument.detector.electrons_per_dn
            noise = np.sqrt(near.var(axis=0, ddof=1).mean())
            # Of a known background: that of the corners is noisier than all pixels of the box.
            box = star.number[:, 1:-1, 1:-1] * image_mask(case.tracker.box.size)
            spread = box.sum(axis=(1, 2)).std(ddof=1) * case.instrument.detector.electrons_per_dn
            snr = electrons.mean() / spread
            rows.append(f"{star.magnitude_g:.3f},{electrons.mean():.1f},{snr:.3f},{noise:.5f}")
    path.with_name("stars.csv").write_text("\n".join(rows) + "\n")
    return path, truth, case


def at(spots, place):
    """The spot near a place of the frame; NaN if there is none."""
    apart = np.hypot(spots.x - place[0], spots.y - place[1])
    if not len(apart) or apart.min() > 3:
        return np.full(2, np.nan)
    return np.array([spots.x[apart.argmin()], spots.y[apart.argmin()]])


@pytest.mark.slow
def test_a_table_of_stars_tells_the_optics_that_made_its_frames(stars, tmp_path):
    path, truth, _ = stars
    above = told(path, "stars.csv", "star table")
    figures = [one.figure for one in load_design(above).told]
    assert {"star electrons", "SNR", "centroid noise"} == set(figures)
    found = learned(above, truth, 0.75)
    light = next(one for one in found.posteriors if one.unknown.name.endswith("n.factor"))
    assert light.narrowing < 0.3
    save_posterior(tmp_path / "posterior.toml", above, found)
    assert not load_design(tmp_path / "posterior.toml").told, "its laws hold the figures"


def test_a_line_without_noise_has_its_slope_and_offset(tmp_path):
    """Gain of 4 electrons, read noise of 3 numbers, PRNU of 2 %; saturation at 3,200."""
    signal = np.array([0, 100, 200, 400, 800, 1600, 2400, 3000, 3200.0])
    variance = 9 + 1 / 12 + signal / 4
    variance[-1] = 50.0
    path = tmp_path / "levels.csv"
    rows = zip(120 + signal, variance, 0.5 + (0.02 * signal) ** 2, strict=True)
    path.write_text("Mean;Variance;Spatial\n" + "".join(f"{a};{b};{c}\n" for a, b, c in rows))
    figures = {one.figure: one.number for one in reduced_transfer(path)}
    expected = {"gain": 4.0, "read noise": 3.0, "PRNU": 0.02, "full well": 12_800.0}
    assert figures == pytest.approx(expected, rel=1e-6)


def test_light_of_stars_is_that_of_magnitude_zero(tmp_path):
    path = tmp_path / "stars.csv"
    path.write_text("G,signal\n5,1000\n2.5,10000\n0,100000\n")
    (figure,) = reduced_stars(path)
    assert figure.figure == "star signal"
    assert figure.number == pytest.approx(1e5)
    assert figure.sigma < 1e-9


def test_a_dark_variance_below_a_quarter_says_nothing(tmp_path):
    path = tmp_path / "levels.csv"
    path.write_text("mean,variance\n0,0.2\n100,25.2\n200,50.2\n400,100.2\n800,200.2\n")
    assert [one.figure for one in reduced_transfer(path)] == ["gain"]


@pytest.mark.parametrize(
    ("entry", "text", "words"),
    [
        (
            'file = "x.csv"\nfigure = "gain"\nnumber = 3.0',
            "",
            "told[0].file must be left out except",
        ),
        ('figure = "photon transfer"', "", "told[0].file must be the name of a table of photon"),
        ('figure = "photon transfer"\nfile = "x.csv"', "mean\n1\n", "must have a column variance"),
        (
            'figure = "photon transfer"\nfile = "x.csv"',
            "mean,variance\n0,1\n1,2\n",
            "must have a dark level and 3 levels with light, below 70% of the light of the largest",
        ),
        ('figure = "star table"\nfile = "x.csv"', "magnitude\n1\n", "one of the columns electrons"),
        (
            'figure = "star table"\nfile = "x.csv"',
            "magnitude,snr\n1,3\n2,-1\n",
            "x.csv: snr must be positive in each row, got -1 in row 2",
        ),
        (
            'figure = "star table"\nfile = "x.csv"\naxis = "about"',
            "",
            "told[0].axis must be left out",
        ),
        ('figure = "SNR"\nvalue = 3.0', "", "told[0].value must be left out"),
        ('figure = "SNR"\nnumber = 3.0', "", "magnitude must be given for the told figure 'SNR'"),
    ],
)
def test_what_is_no_table_is_said(tmp_path, entry, text, words):
    (tmp_path / "x.csv").write_text(text)
    path = tmp_path / "design.toml"
    path.write_text(f'base = "designs/noise_only.toml"\n[[told]]\n{entry}\n')
    with pytest.raises(Refused) as error:
        load_design(path)
    assert words in str(error.value)
