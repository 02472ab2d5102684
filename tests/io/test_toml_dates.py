"""Dates of TOML, which need no quotes, are read as the texts in quotes."""

import pytest

from startrack.design import load_design
from startrack.mission import load_mission

MISSION = "missions/sun-synchronous.toml"


@pytest.mark.parametrize("text", ["2026-03-21T12:00:00", "2026-03-21 12:00:00Z"])
def test_a_date_without_quotes_is_that_in_quotes(text, tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(f'base = "{MISSION}"\n[time]\nbegin = {text}\n')
    quoted = tmp_path / "quoted.toml"
    quoted.write_text(f'base = "{MISSION}"\n[time]\nbegin = "2026-03-21T12:00:00"\n')
    assert load_mission(path).mission.time == load_mission(quoted).mission.time


def test_a_changed_date_needs_no_quotes(tmp_path):
    path = tmp_path / "design.toml"
    path.write_text('base = "designs/noise_only.toml"\n')
    case = load_design(path, ["scene.date=2026-03-20T12:00:00"]).case
    assert case == load_design(path, ['scene.date="2026-03-20T12:00:00"']).case
