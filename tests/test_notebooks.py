"""The notebooks run from their first to their last cell."""

import json
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[1] / "docs" / "notebooks"
SAID = {"design-a-tracker": "not counted:", "trust-it": "True", "a-mission": "swing (radian rms)"}


def cells(path: Path) -> list[str]:
    found = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(one["source"]) for one in found["cells"] if one["cell_type"] == "code"]


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SAID))
def test_a_notebook_runs(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in cells(NOTEBOOKS / f"{name}.ipynb"):
        exec(compile(cell, name, "exec"), names)
    assert SAID[name] in capsys.readouterr().out


def test_each_notebook_is_run_and_holds_no_output():
    paths = sorted(NOTEBOOKS.glob("*.ipynb"))
    assert {path.stem for path in paths} == set(SAID)
    for path in paths:
        for one in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            assert not one.get("outputs")
            assert one.get("execution_count") is None
