import json
import math
import subprocess
import sys
import time
from pathlib import Path

import pytest

from startrack.benchmark import BenchmarkStage, Clocked, markdown, measure, values
from startrack.benchmark.optics import exact
from startrack.benchmark.stage import ROUNDS, figure, spent
from startrack.cli import main


def busy(seconds: float) -> None:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def stage(ways, **more) -> BenchmarkStage:
    return BenchmarkStage("sums", "a sum", "off by", ways, lambda answer: abs(answer - 3.0), **more)


def test_ways_take_turns_and_the_first_answer_is_judged():
    calls = []

    def way(name, answer):
        def run():
            calls.append(name)
            return answer + len(calls) // 100

        return run

    rows = measure(stage({"a": way("a", 3.5)}), {"b": way("b", 3.0)})
    assert calls == ["a", "b"] * (1 + ROUNDS)
    assert [(row.way, row.peer, row.error) for row in rows] == [("a", False, 0.5), ("b", True, 0.0)]


def test_the_time_is_of_one_piece_and_the_least():
    spans = iter([0.1, 0.03, 0.01, 0.03, 0.03, 0.03])

    def way():
        busy(next(spans))
        return 3.0

    (row,) = measure(stage({"a": way}, pieces=10))
    assert 0.001 <= row.seconds < 0.0025


def test_a_way_in_another_process_keeps_its_own_time():
    (row,) = measure(stage({"a": lambda: Clocked(3.25, 7.0)}, pieces=7))
    assert row.seconds == pytest.approx(1.0)
    assert row.error == 0.25


def test_a_stage_that_there_is_not_is_wrong_use(capsys):
    assert main(["bench", "psff"]) == 2
    assert "must be one of psf" in capsys.readouterr().err


def test_the_command_writes_a_table_its_values_and_a_picture(tmp_path, capsys):
    assert main(["bench", "stamping", "attitude", "--out", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == {"stamping", "attitude"}
    assert told["stamping"]["ways"]["startrack"]["error"] < 1e-6
    assert told["attitude"]["ways"]["align"]["error"] < 1e-15
    assert "**align**" in (tmp_path / "bench.md").read_text()
    assert json.loads((tmp_path / "bench.json").read_text()) == told
    assert (tmp_path / "bench.png").read_bytes().startswith(b"\x89PNG")


def test_what_has_no_error_is_a_dash():
    one = stage({"a": lambda: math.nan})
    rows = measure(one)
    assert markdown([one], rows).splitlines()[-1].endswith("| - |")
    assert math.isnan(values([one], rows)["sums"]["ways"]["a"]["error"])


@pytest.mark.parametrize(
    ("seconds", "text"), [(2.5, "2.5 s"), (1.25e-3, "1.25 ms"), (3e-6, "3 us"), (4e-10, "0.4 ns")]
)
def test_times_have_the_unit_that_suits(seconds, text):
    assert spent(seconds) == text
    assert figure(0.0) == "0"


def test_the_reference_of_stamps_keeps_the_light():
    assert exact("gauss", 0.3, -0.2, 0.7, 15).sum() == pytest.approx(1, abs=1e-12)
    # Beyond a circle of v = pi r lies 2 / (pi v) of an Airy pattern.
    assert exact("airy", 0.3, -0.2, 1.0, 15).sum() == pytest.approx(
        1 - 2 / (math.pi**2 * 7.5), abs=0.005
    )


@pytest.mark.slow
def test_the_experiment_names_the_peers_that_are_not_there(tmp_path):
    script = Path(__file__).parents[2] / "experiments" / "speed_vs_error.py"
    code = f"import sys; sys.modules['galsim'] = None; sys.argv[1:] = ['frame', '--out', {str(tmp_path)!r}]; import runpy; runpy.run_path({str(script)!r}, run_name='__main__')"  # noqa: E501
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=script.parent, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Not installed: galsim" in (tmp_path / "speed_vs_error.md").read_text()
