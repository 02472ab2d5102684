from pathlib import Path

import pytest

from startrack.core import Refused
from startrack.design.case import Case, Fidelity
from startrack.design.files import Design, load_design, save_design
from startrack.io import shipped
from startrack.io.tables import from_table, to_table

EXAMPLE = shipped("designs/noise_only.toml")


@pytest.fixture
def edited(tmp_path):
    """The example with one line replaced, as a file."""

    def edit(old: str, new: str) -> Path:
        text = EXAMPLE.read_text()
        assert text.count(old) == 1, old
        path = tmp_path / "design.toml"
        path.write_text(text.replace(old, new))
        return path

    return edit


def test_units_become_si():
    case = load_design(EXAMPLE).case
    assert case.instrument.optics.focal_length == 0.035
    assert case.instrument.detector.exposure == 0.08
    assert case.instrument.detector.quantum_efficiency.wavelength[0] == 350e-9


def test_a_design_survives_a_file(tmp_path):
    design = load_design(EXAMPLE)
    save_design(tmp_path / "copy.toml", design, "two\nlines")
    assert load_design(tmp_path / "copy.toml") == design
    assert (tmp_path / "copy.toml").read_text().startswith("# two\n# lines\n")


def test_every_default_survives_a_table():
    case = load_design(EXAMPLE).case
    assert from_table(Case, to_table(case)) == case


def test_unknown_keys_of_the_design_and_of_its_campaign_are_named_at_once(edited):
    path = edited("[campaign]\n", "[campaign]\nobjektive = 1\n")
    with pytest.raises(ValueError, match=r"f_numbr is unknown.*; campaign\.objektive is unknown"):
        load_design(path, ["instrument.optics.f_numbr=2"])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'focal_length = "35 mm"',
            'focal_length = "35 kg"',
            "instrument.optics.focal_length must have a unit that converts to m, got '35 kg'",
        ),
        (
            'focal_length = "35 mm"',
            "focal_length = 35",
            "instrument.optics.focal_length must have a unit, such as '1 mm', got 35",
        ),
        ('focal_length = "35 mm"', "", "instrument.optics.focal_length is missing"),
        (
            "f_number = 2.4",
            "f_number = -2.4",
            "instrument.optics.f_number must lie in [0.3, 200], got -2.4",
        ),
        (
            "f_number = 2.4",
            'f_number = "fast"',
            "instrument.optics.f_number must be a number, got 'fast'",
        ),
        (
            "f_number = 2",
            "f_numbr = 2",
            "instrument.optics.f_numbr is unknown; did you mean f_number",
        ),
        (
            "[catalog]\nsource",
            "[optics]\nf_number = 2\n[catalog]\nsource",
            "optics is unknown; did you mean instrument.optics?",
        ),
        ("bits = 12", "bits = 12.5", "instrument.detector.bits must be a whole number, got 12.5"),
        ("bits = 12", "bits = true", "instrument.detector.bits must be a whole number, got True"),
        (
            '[catalog]\nsource = "bright"\nlimit_g = 7.0\nepoch = 2026.0',
            "catalog = 3",
            "catalog must be a table, got 3",
        ),
        (
            "value = [0.0, 0.75,",
            "value = [0.0, 1.75,",
            "instrument.optics.transmission.value must lie in [0, 1], got 1.75",
        ),
        (
            "value = [0.0, 0.75,",
            "value = [",
            "instrument.optics.transmission.wavelength and value must have the same length",
        ),
        (
            '"400 nm", "430 nm"',
            '"400 nm", "430 s"',
            "instrument.optics.transmission.wavelength[1] must have a unit that converts to m",
        ),
        (
            'objective = "across"',
            'objective = "along"',
            "campaign.objective must be across, about or both",
        ),
        ("[catalog]", "[catalogue]", "catalogue is unknown"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(edited, old, new, words):
    path = edited(old, new)
    with pytest.raises(ValueError) as error:
        load_design(path)
    assert str(error.value).startswith(f"{path}: {words}")
    assert "\n" not in str(error.value)


def test_files_that_are_no_toml(tmp_path):
    with pytest.raises(ValueError, match="there is none"):
        load_design(tmp_path / "nothing.toml")
    broken = tmp_path / "broken.toml"
    broken.write_bytes(b"\xff\xfe\x00 = [")
    with pytest.raises(ValueError, match=r"broken.toml must be a TOML file"):
        load_design(broken)
    broken.write_text("[instrument\n")
    with pytest.raises(ValueError, match=r"broken.toml must be a TOML file"):
        load_design(broken)


def test_a_failed_save_leaves_the_old_file(tmp_path):
    path = tmp_path / "best.toml"
    save_design(path, load_design(EXAMPLE))
    before = path.read_bytes()
    with pytest.raises(TypeError):
        save_design(path, Design(None))  # type: ignore[arg-type]
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["best.toml"]


def test_a_fidelity_is_read_by_its_name(tmp_path):
    path = tmp_path / "design.toml"
    text = shipped("designs/noise_only.toml").read_text()
    path.write_text(text.replace("trials = 50", 'trials = 50\nfidelity = "frame"', 1))
    design = load_design(path)
    assert design.campaign is not None
    assert design.campaign.fidelity is Fidelity.FRAME
    path.write_text(text.replace("trials = 50", 'trials = 50\nfidelity = "coarse"', 1))
    with pytest.raises(
        ValueError, match=r"campaign\.fidelity must be one of frame, window, spots, cov"
    ):
        load_design(path)


def test_a_design_lies_over_another_and_a_change_over_both(tmp_path):
    path = tmp_path / "faster.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\n[instrument.optics]\nf_number = 1.9\n'
        "[campaign]\ntrials = 77\n"
    )
    plain = load_design(EXAMPLE)
    design = load_design(path, ["scene.background_g=21"])
    assert design.case.instrument.optics.f_number == 1.9
    assert design.case.instrument.optics.blur == plain.case.instrument.optics.blur
    assert design.case.scene.background_g == 21
    assert (design.campaign.trials, design.campaign.variables) == (77, plain.campaign.variables)


def test_a_wrong_value_is_told_with_the_file_that_it_is_from(tmp_path):
    ground, path = tmp_path / "ground.toml", tmp_path / "top.toml"
    ground.write_text('base = "designs/noise_only.toml"\n[instrument.optics]\nf_number = -2\n')
    path.write_text('base = "ground.toml"\n')
    with pytest.raises(ValueError, match=f"^{ground}: instrument.optics.f_number must lie"):
        load_design(path)
    with pytest.raises(ValueError, match=r"^--set: instrument\.optics\.blur"):
        load_design(path, ["instrument.optics.f_number=2", "instrument.optics.blur=4 parsnips"])


def test_a_percentage_may_stand_for_a_fraction(tmp_path):
    path = tmp_path / "percent.toml"
    text = 'base = "designs/noise_only.toml"\n[instrument.detector]\nprnu = "{}"\n'
    path.write_text(text.format("1.5 %"))
    assert load_design(path).case.instrument.detector.prnu == 0.015
    path.write_text(text.format("1.5"))
    with pytest.raises(ValueError, match=r"instrument\.detector\.prnu must be a number"):
        load_design(path)


def test_a_tracker_that_keeps_fewer_spots_than_it_must_match_is_refused_when_it_is_read():
    changes = ["tracker.detection.max_spots=4", "tracker.identification.min_matches=5"]
    with pytest.raises(
        Refused, match=r"min_matches must be at most detection\.max_spots \(4\), got 5"
    ):
        load_design(shipped("designs/noise_only.toml"), changes)
    load_design(
        shipped("designs/noise_only.toml"), ["tracker.detection.max_spots=4", changes[1][:-1] + "4"]
    )
