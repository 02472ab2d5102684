import json

from startrack.cli import terminal, warm
from startrack.cli.main import main
from startrack.core import is_ready


def test_every_part_runs_and_what_was_compiled_is_kept(capsys):
    assert main(["warm", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["not_kept"] == 0
    assert result["files"] > 50
    assert result["mb"] > 1
    assert is_ready()


def test_code_that_cannot_be_kept_is_reported_in_one_line(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "kernel_folder", lambda: None)
    monkeypatch.setattr(warm, "kernel_folder", lambda: None)
    monkeypatch.setattr(warm, "parts", lambda case: {})
    assert main(["warm"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "NUMBA_CACHE_DIR" in lines[0]
