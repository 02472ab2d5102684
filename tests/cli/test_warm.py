import json
import sys

from startrack.cli import terminal, warm
from startrack.cli.main import main
from startrack.core import kernel


def test_every_part_runs_and_what_was_compiled_is_kept(capsys):
    assert main(["warm", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["not_kept"] == 0
    assert result["files"] > 50
    assert result["mb"] > 1


def test_code_that_cannot_be_kept_is_reported_in_one_line(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "UNKEPT", ["a kernel"])
    monkeypatch.setattr(warm, "UNKEPT", ["a kernel"])
    monkeypatch.setattr(warm, "parts", lambda case: {})
    assert main(["warm"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "NUMBA_CACHE_DIR" in lines[0]


def test_a_kernel_without_a_folder_is_counted_and_works(monkeypatch):
    def nowhere(*_):
        raise RuntimeError("no locator available")

    module = sys.modules["startrack.core.kernel"]  # whose name in the package is the function's
    monkeypatch.setattr(module, "_Cache", nowhere)
    monkeypatch.setattr(module, "UNKEPT", counted := [])
    assert kernel(lambda x: 2 * x)(3) == 6
    assert len(counted) == 1
