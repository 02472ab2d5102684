"""The catalogue of detectors, and designs that name one of them."""

import math

import numpy as np
import pytest

from startrack.core import Refused
from startrack.design.files import load_design, save_design
from startrack.design.products import products, with_product
from startrack.design.variables import branches
from startrack.detector import Detector
from startrack.io import from_table, shipped

DESIGN = """
[instrument.optics]
focal_length = "50 mm"
f_number = 2.0
[instrument.detector]
product = "{}"
exposure = "100 ms"
"""


@pytest.fixture
def case(tmp_path):
    """The case of a design that names a detector, with more lines in its table."""

    def build(product: str, more: str = ""):
        path = tmp_path / "design.toml"
        path.write_text(DESIGN.format(product) + more)
        return load_design(path).case

    return build


def test_there_are_detectors_of_each_kind():
    assert len(products()) >= 8
    assert {"star250", "has2", "cmv4000", "ccd47-20", "ccd201-20", "gsense400bsi"} <= set(
        products()
    )


@pytest.mark.parametrize("product", products())
def test_each_detector_is_whole(case, product):
    """Each has light and noise, and the file states a source for every value."""
    detector = case(product).instrument.detector
    peak = max(detector.quantum_efficiency.value)
    assert 0.2 < peak <= 0.95
    assert detector.noise > 0.4
    assert detector.dark_rate > 0
    for line in shipped(f"detectors/{product}.toml").read_text().splitlines():
        name = line.split("=")[0].strip()
        if line and not line.startswith(("#", "[")) and name not in ("wavelength", "temperature"):
            assert "#" in line or name == "value", line


def test_values_agree_with_what_was_published(oracle):
    """Compared with datasheets and measurements; dynamic range and SNR are computed here."""
    for product, known in oracle("detectors.json").items():
        detector = _detector(product)
        if "pixels" in known:
            assert [detector.columns, detector.rows] == known["pixels"]
        if "pitch_um" in known:
            assert detector.pixel_pitch == pytest.approx(known["pitch_um"] * 1e-6)
        noise = known.get("read_e", known.get("kTC_noise_e"))
        if noise:
            assert detector.read_noise == noise
        if "DR_dB" in known:
            wanted = known["DR_dB"]
            assert 20 * math.log10(detector.full_well / detector.read_noise) == pytest.approx(
                wanted, abs=0.7
            )
        if "SNRmax_dB" in known:
            assert 10 * math.log10(detector.full_well) == pytest.approx(
                known["SNRmax_dB"], abs=0.01
            )
        if "full_well_e" in known:
            assert detector.full_well == known["full_well_e"]
        for key, wavelength in (("QE_525", 525e-9), ("QE_656nm", 656e-9)):
            if key in known:
                assert detector.quantum_efficiency(np.array(wavelength)) == known[key]


def _detector(product: str) -> Detector:
    table = with_product({"instrument": {"detector": {"product": product, "exposure": "1 s"}}})
    return from_table(Detector, table["instrument"]["detector"])


def test_what_a_design_names_overrides_the_catalogue(case):
    plain = case("has2").instrument.detector
    changed = case("has2", 'rows = 512\nthermal = { temperature = "273.15 K" }').instrument.detector
    assert (changed.columns, changed.rows) == (1024, 512)
    assert changed.thermal.reference == plain.thermal.reference  # tables are merged
    # Twenty-five kelvin colder, at a doubling of 8 K.
    assert plain.dark_rate / changed.dark_rate == pytest.approx(2 ** (25 / 8))


def test_a_saved_design_reproduces_the_case(case, tmp_path):
    design = case("ccd47-20", "rows = 100")
    path = tmp_path / "design.toml"
    loaded = load_design(path)
    save_design(tmp_path / "copy.toml", loaded)
    assert load_design(tmp_path / "copy.toml").case == design
    assert "product" not in (tmp_path / "copy.toml").read_text()


def test_an_unknown_product_is_named_with_those_there_are(case):
    with pytest.raises(ValueError) as error:
        case("cmv400")
    assert "instrument.detector.product must be one of ccd201-20, " in str(error.value)
    assert "cmv4000, " in str(error.value)
    assert str(error.value).endswith("got 'cmv400'")


def test_an_unknown_key_beside_a_product_is_named(case):
    with pytest.raises(ValueError, match=r"instrument.detector.reed_noise is unknown"):
        case("has2", 'reed_noise = "3 electron"')


def test_a_product_stands_for_the_detector_of_the_files_below(tmp_path):
    """The product keeps the mission's exposure and the keys beside it, in any order."""
    shipped_one = shipped("designs/nanosatellite.toml")
    product = 'instrument.detector.product="cmv4000"'
    noise = "instrument.detector.read_noise=3 electron"
    for changes in ([product, noise], [noise, product]):
        found = load_design(shipped_one, changes).case.instrument.detector
        want = _detector("cmv4000")
        assert (found.columns, found.pitch, found.full_well) == (
            want.columns,
            want.pitch,
            want.full_well,
        )
        assert (found.read_noise, found.exposure) == (3.0, 0.08)
    below = tmp_path / "below.toml"
    below.write_text(DESIGN.format("cmv4000") + 'read_noise = "5 electron"\n')
    above = tmp_path / "above.toml"
    above.write_text('base = "below.toml"\n[instrument.detector]\nproduct = "star1000"\n')
    found = load_design(above).case.instrument.detector
    assert found.read_noise == _detector("star1000").read_noise != 5.0


MINE = 'columns = 640\nrows = 480\npixel_pitch = "5 um"\nread_noise = "3 electron"\n'


@pytest.mark.parametrize("head", ["", "[instrument.detector]\n"])
def test_a_file_beside_the_design_is_a_product(tmp_path, monkeypatch, head):
    """Alone or as a table of a design; from any folder, in a base, by --set and as a choice."""
    folder = tmp_path / "design"
    folder.mkdir()
    (folder / "mine.toml").write_text(head + MINE)
    base = folder / "base.toml"
    base.write_text(DESIGN.format("mine.toml"))
    above = tmp_path / "above.toml"
    above.write_text('base = "design/base.toml"\n')
    monkeypatch.chdir("/")
    for path in (base, above):
        detector = load_design(path).case.instrument.detector
        assert (detector.columns, detector.read_noise, detector.exposure) == (640, 3, 0.1)
    changed = load_design(base, ["instrument.detector.product=has2"]).case.instrument.detector
    assert changed.columns == 1024
    other = folder / "other.toml"
    choice = '[[campaign.choices]]\nname = "instrument.detector"\nvalues = ["mine.toml", "star250"]'
    other.write_text(DESIGN.format("has2") + choice)
    design = load_design(other, ["instrument.detector.frame_rate=4 Hz"])
    first, second = branches(design.case, design.campaign.choices)
    assert first.label == "detector mine.toml"
    assert first.case.instrument.detector.columns == 640
    assert first.case.instrument.detector.frame_rate == 4  # as the one in its place
    assert second.case.instrument.detector.columns == 512


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (MINE.replace("480", "-5"), r"^\S*mine\.toml: instrument\.detector\.rows must .* got -5"),
        (MINE + "rwos = 7", r"^\S*mine\.toml: instrument\.detector\.rwos is unknown"),
        (MINE + "[thermal]\nreference = -1", r"^\S*mine\.toml: instrument\.detector\.thermal"),
    ],
)
def test_a_wrong_value_of_a_product_is_said_with_its_file(tmp_path, wrong, words):
    (tmp_path / "mine.toml").write_text(wrong)
    path = tmp_path / "design.toml"
    path.write_text(DESIGN.format("mine.toml"))
    with pytest.raises(Refused, match=words):
        load_design(path)
    (tmp_path / "mine.toml").write_text(MINE)
    path.write_text(DESIGN.format("mine.toml") + "rows = -6")
    with pytest.raises(Refused, match=r"^\S*design\.toml: instrument\.detector\.rows"):
        load_design(path)


def test_a_file_that_is_no_detector_is_refused(case, tmp_path):
    with pytest.raises(ValueError, match=r"none\.toml"):
        case("none.toml")
    (tmp_path / "optics.toml").write_text("[instrument.optics]\nf_number = 2")
    with pytest.raises(ValueError, match=r"optics\.toml must have the keys of a detector"):
        case("optics.toml")
    (tmp_path / "odd.toml").write_text("colums = 2")
    with pytest.raises(ValueError, match=r"detector\.colums"):
        case("odd.toml")


def test_a_file_of_a_detector_without_its_depth_says_the_default(tmp_path):
    age = '[instrument.detector.age]\ntime = "5 yr"\ninclination = "97.6 deg"\nshielding = "3 mm"\n'
    (tmp_path / "mine.toml").write_text(MINE)
    path = tmp_path / "design.toml"
    path.write_text(DESIGN.format("mine.toml") + age)
    with pytest.warns(UserWarning, match=r"mine\.toml gives no age\.depleted.* of 10 um holds"):
        load_design(path)
    (tmp_path / "mine.toml").write_text(MINE + '[age]\ndepleted = "0.5 um"\n')
    assert load_design(path).case.instrument.detector.age.depleted == pytest.approx(0.5e-6)
