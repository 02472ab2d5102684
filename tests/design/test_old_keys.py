"""Design files, sequence files and stores with the keys of earlier versions."""

import json
import sqlite3
import tomllib
import warnings
from contextlib import closing

import pytest

from startrack.design.case import Case
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.io.tables import from_table
from startrack.montecarlo.store import Store
from startrack.sequence.parameters import Sequence

EXAMPLE = shipped("designs/noise_only.toml").read_text()
DETECTOR = "bits = 12\nnonlinearity = 0.02\nadc_inl = 1.5\nem_gain = 3.0"
NEW = (
    EXAMPLE.replace("bits = 12", DETECTOR)
    .replace("fresh_trials", "analytic_evaluations = 17\nfresh_trials")
    .replace("sky_fraction = 0.99", "sky_fraction = 0.97")
)
NAMES = {
    "nonlinearity": "bend",
    "adc_inl": "bow",
    "em_gain": "multiplication",
    "analytic_evaluations": "prospects",
    "sky_fraction": "sky_share",
}
SEQUENCE = """
max_coasted_frames = 7
angular_acceleration_psd = "2e-5 rad / s(3/2)"
initial_rate_sigma = "0.2 deg / s"
[[legs]]
duration = "10 s"
"""
SEQUENCE_NAMES = {
    "max_coasted_frames": "patience",
    "angular_acceleration_psd": "agility",
    "initial_rate_sigma": "swiftness",
}


def old(text: str, names: dict[str, str]) -> str:
    for new, earlier in names.items():
        assert text.count(f"\n{new} = ") == 1, new
        text = text.replace(f"\n{new} = ", f"\n{earlier} = ")
    return text


def messages(caught) -> list[str]:
    assert all(one.category is FutureWarning for one in caught)
    return sorted(str(one.message) for one in caught)


def test_a_design_file_with_old_keys_is_the_same_design(tmp_path):
    for name, text in (("new", NEW), ("old", old(NEW, NAMES))):
        (tmp_path / f"{name}.toml").write_text(text)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert load_design(tmp_path / "old.toml") == load_design(tmp_path / "new.toml")
    assert messages(caught) == [
        "campaign.prospects is now called analytic_evaluations",
        "campaign.requirements.sky_share is now called sky_fraction",
        "instrument.detector.bend is now called nonlinearity",
        "instrument.detector.bow is now called adc_inl",
        "instrument.detector.multiplication is now called em_gain",
    ]


def test_a_sequence_file_with_old_keys_is_the_same_sequence():
    new = from_table(Sequence, tomllib.loads(SEQUENCE))
    assert new.max_coasted_frames == 7
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert from_table(Sequence, tomllib.loads(old(SEQUENCE, SEQUENCE_NAMES))) == new
    assert messages(caught) == sorted(
        f"{earlier} is now called {name}" for name, earlier in SEQUENCE_NAMES.items()
    )


@pytest.mark.parametrize(("new", "earlier"), NAMES.items())
def test_an_old_key_beside_its_new_one_is_refused(tmp_path, new, earlier):
    path = tmp_path / "both.toml"
    line = next(line for line in NEW.splitlines() if line.startswith(f"{new} = "))
    path.write_text(NEW.replace(line, f"{line}\n{earlier} = 0.5"))
    with pytest.raises(
        ValueError, match=rf"{earlier} must be left out if {new}, its new name, is given"
    ):
        load_design(path)


def test_a_store_whose_case_has_old_keys_opens(tmp_path):
    (tmp_path / "new.toml").write_text(NEW)
    case = load_design(tmp_path / "new.toml").case
    path = tmp_path / "campaign.sqlite"
    Store(path, case, 3).close()
    with closing(sqlite3.connect(path)) as base, base:
        (text,) = base.execute("SELECT value FROM about WHERE name = 'case'").fetchone()
        for new, earlier in list(NAMES.items())[:3]:
            assert f'"{new}"' in text
            text = text.replace(f'"{new}"', f'"{earlier}"')
        assert json.loads(text)["instrument"]["detector"]["bow"] == 1.5
        base.execute("UPDATE about SET value = ? WHERE name = 'case'", (text,))
        # Stores of that time had no checksum of what they say of their trials.
        base.execute("DELETE FROM checksums WHERE first = -1")
    with pytest.warns(FutureWarning, match="is now called"), Store(path, case, 3) as store:
        assert store.case == case
    with pytest.warns(FutureWarning, match="is now called"), Store(path) as store:
        assert isinstance(store.case, Case)
