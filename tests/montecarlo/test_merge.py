"""Parts of a campaign merged into one: stores and sketches, in any order."""

import contextlib
import json
import math
import random
import sqlite3

import numpy as np
import pytest

from startrack.cli.main import main
from startrack.design import Fidelity
from startrack.metrics import STATED_ALONE, summarise
from startrack.montecarlo import (
    Sampling,
    Serial,
    Sketch,
    Store,
    load_sketch,
    merge_sketches,
    merge_stores,
    save_sketch,
)
from startrack.montecarlo.sketch import RELATIVE, about_of, resume_sketch, sketched

DRAWN = Sampling(Fidelity.COVARIANCE)


def judged(outcomes, trials, first=0, seed=0):
    """Outcomes with stated errors, some of them not solved."""
    table = outcomes(trials, seed, first)
    for axis in "xyz":
        table[f"sigma_{axis}"] = 1e-5
    table["solved"] = np.random.default_rng([seed, first]).random(trials) < 0.99
    table["nees"], table["stars"] = 3.0, 20
    return table


@pytest.fixture
def stored(case, outcomes, tmp_path):
    """Write a store of some trials, in blocks of a given size."""

    def write(name, first, end, block=64, seed=0, spoil=0.0):
        with Store(tmp_path / name, case, seed, DRAWN) as store:
            for at in range(first, end, block):
                table = judged(outcomes, 1000)[at : min(at + block, end)]
                table["error_x"] += spoil
                store.keep(at, table)
        return tmp_path / name

    return write


def test_stores_of_parts_make_the_same_store_in_any_order(stored, outcomes, tmp_path):
    parts = [
        stored("a", 0, 300),
        stored("b", 300, 601, 50),
        stored("c", 700, 1000, 7),
        stored("d", 601, 640),
    ]
    merged = merge_stores(parts, tmp_path / "one", partial=True)
    assert merged == (940, (), ((640, 700),))
    merge_stores(parts[::-1], tmp_path / "two", partial=True)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    whole = judged(outcomes, 1000)
    with Store(tmp_path / "one") as store:
        held = store.outcomes()
        assert [one.start % 64 for one in store.done()].count(0) == 15
        assert store.sessions()
    assert held.tobytes() == whole[(whole["trial"] < 640) | (whole["trial"] >= 700)].tobytes()


def test_trials_of_several_parts_are_kept_once_and_must_be_equal(stored, tmp_path, capsys):
    parts = [stored("a", 0, 300), stored("b", 200, 500, 50), stored("c", 250, 260)]
    assert merge_stores(parts, tmp_path / "one") == (500, ((200, 300),), ())
    assert main(["merge", *map(str, parts), "--out", str(tmp_path / "two")]) == 0
    assert "trials 200 to 299 are in several parts, with equal" in capsys.readouterr().err
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    other = stored("d", 480, 600, spoil=1e-9)
    with pytest.raises(ValueError, match=r"d has other outcomes of trials 480 to 499 than another"):
        merge_stores([*parts, other], tmp_path / "three")
    with pytest.raises(ValueError, match=r"e is not of the campaign of .*a: seed is '5', not '0"):
        merge_stores([*parts, stored("e", 600, 700, seed=5)], tmp_path / "three")
    assert not (tmp_path / "three").exists()


@pytest.fixture
def about(case):
    return about_of(case, 0, DRAWN, STATED_ALONE)


def test_a_sketch_has_the_statistics_of_its_trials(about, outcomes):
    """Against NumPy and `summarise`, which have all trials."""
    table = judged(outcomes, 20_000)
    table["error_z"] *= 30
    table["false"][5] = table["solved"][5] = True
    sketch, whole = sketched(table, STATED_ALONE, about), summarise(table)
    for which in ("across", "about"):
        found = sketch.rms(which)
        for name in ("value", "low", "high"):
            assert getattr(found, name) == pytest.approx(getattr(getattr(whole, which), name))
    assert sketch.availability == whole.availability
    assert sketch.counts["beyond"] == whole.beyond
    good = table[table["solved"] & ~table["false"]]
    assert sketch.mean("x") == pytest.approx(math.fsum(good["error_x"]) / len(good), rel=1e-15)
    across = np.hypot(good["error_x"], good["error_y"])
    for name, values in (("across", across), ("z", np.abs(good["error_z"]))):
        for fraction in (0.01, 0.5, 0.9973, 0.9999):
            exact = np.quantile(values, fraction, method="inverted_cdf")
            found = sketch.quantile(name, fraction)
            assert found.value == pytest.approx(exact, rel=RELATIVE)
            assert found.low <= exact <= found.high
    assert -sketch.worst[1] == good["trial"][across.argmax()]


def test_bounds_of_a_quantile_hold_it_as_often_as_they_say(about, outcomes):
    """For Rayleigh's law; 95 % or a little more, because ranks are whole numbers."""
    true = 1e-5 * math.sqrt(-2 * math.log(1 - 0.8))
    held = 0
    for n in range(400):
        table = judged(outcomes, 200)
        table["solved"] = True
        table["error_x"], table["error_y"] = np.random.default_rng([n, 1]).normal(0, 1e-5, (2, 200))
        found = sketched(table, STATED_ALONE, about).quantile("across", 0.8)
        held += found.low <= true <= found.high
    assert 0.93 < held / 400 < 0.985


def test_hundreds_of_sketches_make_the_same_bytes_in_any_order(about, outcomes, tmp_path):
    table = judged(outcomes, 1000)
    parts = [sketched(table[at : at + 4], STATED_ALONE, about) for at in range(0, 1000, 4)]
    save_sketch(tmp_path / "whole", sketched(table, STATED_ALONE, about))
    for order in range(2):
        random.Random(order).shuffle(parts)
        merged = Sketch(about)
        for one in parts:
            merged.add(one)
        save_sketch(tmp_path / "merged", merged)
        assert (tmp_path / "merged").read_bytes() == (tmp_path / "whole").read_bytes()
    assert load_sketch(tmp_path / "whole").ranges == [(0, 1000)]


@pytest.mark.parametrize("kind", ["store", "sketch"])
def test_a_lost_part_is_named_and_refused(stored, about, outcomes, tmp_path, capsys, kind):
    """The second and the fourth of five jobs of 100 trials, and the first; then, with --trials,
    the last."""

    def part(k):
        path = tmp_path / f"part{k}"
        if kind == "store":
            return stored(path.name, 100 * k, 100 * (k + 1))
        table = judged(outcomes, 500)[100 * k : 100 * (k + 1)]
        save_sketch(path, sketched(table, STATED_ALONE, about))
        return path

    parts = [str(part(k)) for k in range(5)]
    out = tmp_path / "out"

    def merged(numbers, *more):
        status = main(["merge", *(parts[k] for k in numbers), "--out", str(out), *more])
        return status, capsys.readouterr()

    for numbers, missing in (
        ((0, 2, 4), "100 to 199, 300 to 399 are missing"),
        ((1, 2, 3, 4), "0 to 99 are missing"),
    ):
        status, said = merged(numbers)
        assert status == 2
        assert missing in said.err
        assert "--partial" in said.err
        assert not out.exists()
    status, said = merged((0, 1, 2, 3), "--trials", "500")
    assert status == 2
    assert "400 to 499 are missing" in said.err
    status, said = merged((0, 2, 4), "--partial", "--json")
    assert status == 0
    assert json.loads(said.out)["missing"] == [[100, 200], [300, 400]]
    assert "trials 300 to 399 are missing: no part has them" in said.err
    assert merged(range(5), "--trials", "500")[0] == 0
    for more in ((), ("--partial",)):
        status, said = merged(range(5), "--trials", "450", *more)
        assert status == 2
        assert (
            "must be at least 500, as the parts have trials up to number 499, got 450" in said.err
        )


def test_a_part_without_a_session_is_refused(stored, tmp_path):
    parts = [stored("a", 0, 100), stored("b", 100, 200)]
    with contextlib.closing(sqlite3.connect(parts[1])) as base, base:
        base.execute("DELETE FROM sessions")
    with pytest.raises(ValueError, match=r"b is damaged.*session 1 is missing"):
        merge_stores(parts, tmp_path / "out")


def test_sketches_that_overlap_or_differ_are_refused(about, outcomes, tmp_path):
    table = judged(outcomes, 100)
    for name, low, high in (("a", 0, 60), ("b", 50, 100)):
        save_sketch(tmp_path / name, sketched(table[low:high], STATED_ALONE, about))
    with pytest.raises(ValueError, match=r"b: trials 50 to 59 are in two of them"):
        merge_sketches([tmp_path / "a", tmp_path / "b"])
    save_sketch(tmp_path / "c", sketched(table[60:], STATED_ALONE, about | {"seed": 2}))
    with pytest.raises(ValueError, match=r"c: it is of another campaign: seed is 2, not 0"):
        merge_sketches([tmp_path / "a", tmp_path / "c"])
    spoilt = json.loads((tmp_path / "a").read_text())
    spoilt["counts"]["judged"] = 3
    (tmp_path / "a").write_text(json.dumps(spoilt))
    with pytest.raises(ValueError, match=r"a must be a sketch .*its checksum is wrong"):
        load_sketch(tmp_path / "a")
    del spoilt["checksum"]
    spoilt["format"] = "startrack sketch 1"
    (tmp_path / "a").write_text(json.dumps(spoilt))
    with pytest.raises(ValueError, match=r"a must be a sketch .*its bins of .* contradict"):
        load_sketch(tmp_path / "a")
    spoilt["bins"]["across"] = [[10**30], [1]]
    (tmp_path / "a").write_text(json.dumps(spoilt))
    with pytest.raises(ValueError, match=r"a must be a sketch .*too large"):
        load_sketch(tmp_path / "a")


def test_parts_of_commands_are_the_whole(small, tmp_path, capsys):
    from startrack.design import save_design

    design = tmp_path / "design.toml"
    save_design(design, small)
    words = ["montecarlo", str(design), "--fidelity", "covariance", "--workers", "1", "--seed", "3"]

    def ran(*more):
        assert main([*words, *map(str, more)]) in (0, 3)
        return capsys.readouterr().out

    for k in range(2):
        ran("--first", 40 * k, "--trials", 40, "--sketch", tmp_path / f"{k}.json")
    shown = ran("--trials", 80, "--sketch", tmp_path / "whole.json")
    parts = [str(tmp_path / f"{k}.json") for k in (1, 0)]
    assert main(["merge", *parts, "--out", str(tmp_path / "merged.json")]) == 0
    assert capsys.readouterr().out == shown
    assert (tmp_path / "merged.json").read_bytes() == (tmp_path / "whole.json").read_bytes()
    ran("--first", 40, "--trials", 30, "--store", tmp_path / "part.sqlite")
    with Store(tmp_path / "part.sqlite") as store:
        assert store.outcomes().tobytes() == DRAWN.trials(store.case, 3, range(40, 70)).tobytes()
    assert main([*words, "--sketch", str(tmp_path / "x.json"), "--out", str(tmp_path)]) == 2
    assert "--out must be left out with --sketch" in capsys.readouterr().err


def test_an_interrupted_sketch_continues(case, tmp_path):
    given = case, 3, DRAWN

    resume_sketch(tmp_path / "whole", *given, range(96), Serial(), block=32)
    resume_sketch(tmp_path / "part", *given, range(64), Serial(), block=16)
    resume_sketch(tmp_path / "part", *given, range(96), Serial(), block=32)
    assert (tmp_path / "part").read_bytes() == (tmp_path / "whole").read_bytes()
    with pytest.raises(ValueError, match=r"part holds other trials than 0 to 9"):
        resume_sketch(tmp_path / "part", *given, range(10), Serial())
