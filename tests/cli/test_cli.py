"""The machine interface: one JSON object a line, exit statuses, errors in one sentence."""

import json
import re
import subprocess
import sys
import time
import warnings

import cv2
import numpy as np
import pytest
from astropy.io import fits
from day import WORDS as DATASHEET_WORDS

from startrack.benchmark import STAGES
from startrack.cli.main import COMMANDS, GROUPS, WITHIN, main
from startrack.cli.terminal import lines_now_and_then, progress, read_design, stage, waiting
from startrack.core import Refused
from startrack.design import design_keys
from startrack.design.case import Fidelity
from startrack.design.files import load_design
from startrack.design.key_search import DATASHEET
from startrack.io import shipped
from startrack.montecarlo.resume import STATISTICS
from startrack.montecarlo.sampling import Sampling
from startrack.montecarlo.store import Store

EXAMPLE = shipped("designs/noise_only.toml")
LOW = "campaign.variables.0.low"
PARTS = ("earth geometry", "earth render", "earth process", "earth terrain")


@pytest.fixture
def call(capsys):
    """Runs a command: exit status, objects on standard output, text on standard error."""

    def run(*arguments):
        try:
            status = main([str(one) for one in arguments])
        except SystemExit as end:
            status = end.code
        out, err = capsys.readouterr()
        return status, [json.loads(line) for line in out.splitlines()], err

    return run


@pytest.fixture
def short(tmp_path):
    """The example with a campaign that takes seconds."""
    text = EXAMPLE.read_text()
    for old, new in (
        ("columns = 512", "columns = 256"),
        ("rows = 512", "rows = 256"),
        ('pixel_pitch = "11 um"', 'pixel_pitch = "22 um"'),
        ('blur = "5 um"', 'blur = "10 um"'),
        ("\ntrials = 50\nmost_trials = 200", "\ntrials = 6\nmost_trials = 6\nsample_trials = 6"),
        ("evaluations = 120", "evaluations = 3\nanalytic_evaluations = 2"),
        ("fresh_trials = 1000", "fresh_trials = 20"),
        ("min_availability = 0.99", "min_availability = 0.8"),  # what 20 trials can show
    ):
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "short.toml"
    path.write_text(text)
    return path


def test_simulate_then_solve(call, tmp_path):
    status, (made,), _ = call(
        *("simulate", "--ra", 83, "--dec", -5, "--roll", 20, "--out", tmp_path, "--json")
    )
    assert status == 0
    assert made["ra_deg"] == pytest.approx(83)
    assert made["status"] == "solved"
    # Some arcsec about the boresight, a fraction of one across.
    assert 0 < abs(made["error_x_arcsec"]) < 3
    assert 0 < abs(made["error_z_arcsec"]) < 60
    assert cv2.imread(made["png"]) is not None
    status, (found,), _ = call(
        *("solve", made["fits"], "--fov", 9.5, "--json", "--overlay", tmp_path)
    )
    assert status == 0
    assert found["status"] == "solved"
    assert found["ra_deg"] == pytest.approx(83, abs=2e-3)
    assert found["dec_deg"] == pytest.approx(-5, abs=2e-3)
    assert found["roll_deg"] == pytest.approx(20, abs=1e-2)
    assert found["fov_x_deg"] == pytest.approx(made["fov_x_deg"], rel=1e-3)
    assert found["matches"] > 10
    assert found["false_probability"] < 1e-6
    overlap = abs(np.dot(found["icrs_to_camera_xyzw"], made["icrs_to_camera_xyzw"]))
    assert overlap == pytest.approx(1, abs=1e-7)
    assert cv2.imread(found["overlay"]) is not None
    seen_from = ("--place", 40, 20, "--time", "2026-01-10T22:00")
    status, (placed,), _ = call("solve", made["fits"], "--fov", 9.5, "--json", *seen_from)
    assert (status, placed["ra_deg"]) == (0, found["ra_deg"])
    assert 0 < placed["place"]["elevation_deg"] < 60
    moved = (placed["place"]["dec_deg"] - found["dec_deg"]) * 3600
    assert 1 < abs(moved) < placed["place"]["refraction_arcsec"] + 21
    fits.setval(made["fits"], "DATE-OBS", value="2026-01-10T22:00:00")
    stamped = call("solve", made["fits"], "--fov", 9.5, "--json", "--place", 40, 20)[1][0]["place"]
    assert stamped["azimuth_deg"] == placed["place"]["azimuth_deg"]
    status, (below,), _ = call(
        *("solve", made["fits"], "--fov", 9.5, "--json", "--place", 40, 20),
        *("--time", "2026-01-10T08:00"),
    )
    assert (status, below["ra_deg"]) == (0, found["ra_deg"])
    assert "above the horizon" in below["place"]["reason"]


@pytest.mark.slow
def test_workers_solve_what_one_process_solves(call, tmp_path):
    names = []
    for k, seed in enumerate((1, 2, 1)):
        call("simulate", "--seed", seed, "--out", tmp_path / str(k), "--json")
        names.append(tmp_path / str(k) / "frame.fits")
    for name in names[::2]:
        fits.setval(name, "BAYERPAT", value="RGGB")
    names[1].write_bytes(names[1].read_bytes()[:5000])  # cannot be read
    fits.writeto(tmp_path / "nan.fits", np.full((2, 9, 9), np.nan))  # warns, then is refused
    names.append(tmp_path / "nan.fits")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        alone = call("solve", *names, "--fov", 9.5, "--json")
        shared = call("solve", *names, "--fov", 9.5, "--json", "--workers", 2)
    assert alone == shared
    assert shared[0] == 1
    assert shared[2].count("mosaic of colours (RGGB)") == 1
    assert shared[2].count("cube of 2 planes") == 1
    assert [one["status"] for one in shared[1]] == ["solved", "failed", "solved", "failed"]


def noise(kind: str) -> np.ndarray:
    rng = np.random.default_rng(5)
    sky = rng.normal(100, 10, (480, 640)).astype(np.uint16)
    if kind == "random":
        return rng.integers(0, 65536, (480, 640), dtype=np.uint16)
    if kind == "blank":
        return np.full((480, 640), 7, np.uint16)
    if kind == "hot pixels":
        sky[rng.integers(0, 480, 300), rng.integers(0, 640, 300)] += 30000
    if kind == "false stars":
        stars = np.zeros((480, 640), np.float32)
        stars[rng.integers(0, 480, 60), rng.integers(0, 640, 60)] = 20000
        sky += cv2.GaussianBlur(stars, (0, 0), 1.2).astype(np.uint16)
    return sky


@pytest.mark.parametrize(
    "kind",
    [
        "blank",
        *(
            pytest.param(kind, marks=pytest.mark.slow)
            for kind in ("sky", "hot pixels", "random", "false stars")
        ),
    ],
)
def test_noise_gives_a_status_and_a_reason(call, tmp_path, kind):
    path = tmp_path / "noise.png"
    cv2.imwrite(str(path), noise(kind))
    status, (found,), _ = call("solve", path, "--fov", 12, "--json")
    assert status == 3
    assert found["status"] in ("no match", "too few stars", "blank image")
    assert found["icrs_to_camera_xyzw"] is None
    assert len(found["reason"]) > 10


def test_a_bad_image_does_not_stop_the_others(call, tmp_path):
    empty, blank = tmp_path / "empty.fits", tmp_path / "blank.png"
    empty.write_bytes(b"")
    cv2.imwrite(str(blank), np.zeros((50, 50), np.uint8))
    nan = tmp_path / "nan.fits"
    fits.writeto(nan, np.full((9, 9), np.nan))
    status, found, err = call("solve", empty, blank, nan, "--fov", 12, "--json")
    assert status == 1
    assert [one["status"] for one in found] == ["failed", "blank image", "failed"]
    assert f"{empty} must hold an image, but it is empty" in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve"], "IMAGE"),
        (["solve", "x.png", "--fov", "-3"], "fov must be positive"),
        (["solve", "x.png", "--time", "2026-01-01"], "need --place LAT LON"),
        (["solve", "x.png", "--place", "91", "0"], "latitude must lie in [-90, 90], got 91"),
        (["solve", "x.png", "--place", "9", "500"], "longitude must lie in [-360, 360], got 500"),
        (["solve", "x.png", "--place", "50", "8", "--time", "noon"], "must be a time such as"),
        (["solve", "x.png", "--fov", "12deg", "--camera", "c.toml"], "must not both be given"),
        (["calibrate", "x.png", "--fov", "12 m"], "an angle in degree, such as 12 or 12deg, got"),
        (["solve", "x.png", "--fov", "12", "--fov-tolerance", "2"], "must lie in"),
        (["solve", "x.png", "--fov", "12", "--catalog", "nothing.csv"], "nothing.csv"),
        (["solve", "x.png", "--fov", "12", "--dark", "none.png"], "none.png must be a file"),
        (["solve", "x.png", "--catalog", "brigt"], "--catalog must be bright or deep, or a file"),
        (["calibrate", EXAMPLE, "--fov", "9", "--principal", "-5"], "principal must not be negat"),
        (["simulate", "--ra", "nan"], "--ra: must be a finite number, got 'nan'"),
        (["simulate", "--dec", "95"], "--dec: must be a number from -90 to 90, got '95'"),
        (["simulate", "--seed", 2**63], f"--seed: must be at most {2**63 - 1}"),
        (["budget", "--workers", "5000"], "--workers: must be at most 1024, got '5000'"),
        (["budget", "--window", "0"], "--window: must be positive, got '0'"),
        (["budget", "--set", "scene"], "--set must be KEY=VALUE"),
        (["detect", EXAMPLE, "--set", "scene.background_g=1"], "--set must be given with --design"),
        (["requirements", "hsrs", "--set", "a=1"], "requirements: --set: a must be a param"),
        (
            ["requirements", "noise_only", "--set", f"{LOW}='9 m'"],
            "low must be below high, got 9 m",
        ),
        (
            ["requirements", "hsrs", "--set", f"{LOW}=9"],
            "f_number: low must be below high, got 9.0",
        ),
        (["requirements", "goals", "--set", "a=1"], "--set must be left out for a file of goals"),
        (["requirements", "waos"], "there is none; shipped are scenes/waoss.toml"),
        (["budget", "imx250"], "but it is a detector: startrack init FILE --from imx250 makes"),
        (["montecarlo", "none.toml"], "none.toml must be a design file"),
        (["montecarlo", "--precision", "0"], "--precision: must be a number from 1e-06 to 1"),
        (["montecarlo", "--statistic", "mean"], "--statistic: invalid choice: 'mean'"),
        (["montecarlo", "--confidence", "95"], "--confidence: must be a number from 0.5 to 0.99"),
        (["montecarlo", "--seconds", "-1"], "--seconds: must be positive, got '-1'"),
        (["montecarlo", "--scheduler", "here"], "--scheduler: must be tcp://host:port or mpi"),
        (["montecarlo", "--control", "--fidelity", "window"], "control needs fidelity frame"),
        (["combine", "one.sqlite"], "campaigns must be two or more, each of a different fidelity"),
        (["combine", "a.sqlite", "./a.sqlite"], "must be different files, got a.sqlite more"),
        (["what-matters", "--designs", "65"], "--designs: must be a power of two, got '65'"),
        (["pareto", "--first", "speed"], "objective must be across, about or both"),
        (["report", "x.sqlite", "--budget", "1"], "--budget: must be a whole number from 2 on"),
        (["sequence", "--profile", "none.toml"], "none.toml must be a sequence file"),
        (["earth", "render", "none"], "none must be a scene file, or one of ads40, clouds, fields"),
        (["earth", "terrain", "none.tif"], "none.tif must name files"),
        (["bench", "psff"], "must be one of psf, stamping"),
        (["montecarlo", "--trials", "0"], "--trials: must be a whole number from 1 on, got '0'"),
        (["montecarlo", "--seed", "-1", "--trials", "2"], "--seed: must be a whole number"),
        (["montecarlo", "--workers", "x"], "--workers: must be a whole number"),
        (["psf", "--out", "a/" * 600], "--out: must have at most 500 /, got 600"),
        (["nonsense"], "invalid choice"),
        ([], "COMMAND"),
    ],
)
def test_wrong_use_is_two(call, arguments, words):
    status, found, err = call(*arguments)
    assert (status, found) == (2, [])
    assert words in err.replace("\n", " ")
    assert "Traceback" not in err


def test_a_file_that_cannot_be_made_is_named(call, tmp_path):
    (tmp_path / "taken").touch()
    status, _, err = call("psf", "--out", tmp_path / "taken")
    assert status == 1
    assert f"{tmp_path / 'taken'} must be a folder or a new name, but it is a file" in err


@pytest.mark.parametrize("command", [*(name for name in COMMANDS if name != "earth"), *PARTS])
def test_every_command_documents_itself_and_its_options(capsys, command):
    """Each command has a sentence in the list, a longer one in its own help, and a text for each
    option."""
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    text = capsys.readouterr().out
    assert len(text.split("\n\n")[1]) > 15
    options = text.partition("options:")[2]
    for line in options.splitlines():
        if line.startswith("  --") and len(line.split("  ")) < 3:
            following = options.splitlines()[options.splitlines().index(line) + 1]
            assert following.startswith(" " * 10), line


def test_options_that_a_help_text_names_exist(capsys):
    """Sentences name options of the command, or of another one."""
    there, named = {"--help", "--version"}, set[str]()
    parts = [f"earth {part}" for part in ("spectrum", "air", "aim")]
    parts += [f"lens {part}" for part in ("import", "measure", "show")]
    for command in (*COMMANDS, *PARTS, *parts, "export aocs", "export catalogue"):
        with pytest.raises(SystemExit):
            main([*command.split(), "--help"])
        text = capsys.readouterr().out
        there |= set(re.findall(r"^ +(--[a-z-]+)", text.partition("options:")[2], re.MULTILINE))
        named |= set(re.findall(r"--[a-z-]*[a-z]", re.sub(r"-\n +", "-", text)))
    assert named <= there


def test_the_list_of_commands_is_grouped_and_has_each_once(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    heads = [line for line in text.splitlines() if line in {f"{title}:" for title in GROUPS}]
    assert heads == [f"{title}:" for title in GROUPS]
    for sentence in COMMANDS.values():
        assert text.count(sentence) == 1


@pytest.mark.parametrize(("name", "home"), WITHIN.items())
def test_a_command_within_another_word_is_the_same_alone(capsys, name, home):
    texts = []
    for words in ([name, "--help"], [home, name, "--help"]):
        with pytest.raises(SystemExit):
            main(words)
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]
    assert texts[0].startswith(f"usage: startrack {home} {name} ")


def test_tools_alone_names_its_commands(capsys):
    for words in (["tools"], ["tools", "--help"]):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 0
        assert "startrack tools warm" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        main(["tools", "clean"])
    assert ended.value.code == 2
    assert "invalid choice: 'clean' (choose from 'warm', 'bench')" in capsys.readouterr().err


def test_an_unknown_option_shows_the_usage_of_its_command(call):
    status, _, words = call("lens", "measure", "a.fits", "--colour", "red", "--fow", "12")
    assert (status, words.startswith("usage: startrack lens measure ")) == (2, True)
    assert words.endswith("error: unrecognized arguments: --fow 12\n")


def test_examples_of_a_help_text_have_their_own_lines(capsys):
    with pytest.raises(SystemExit):
        main(["sweep", "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert "  startrack sweep nanosatellite instrument.optics.f_number=1.2..2.4" in lines


def test_a_design_with_an_error_is_wrong_use(call, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(EXAMPLE.read_text().replace('"35 mm"', '"35 kg"'))
    for command in ("simulate", "montecarlo", "optimize", "sample"):
        status, _, err = call(command, path, "--out", tmp_path / "out")
        assert status == 2
        assert "instrument.optics.focal_length must have a unit that converts to m" in err
    assert not (tmp_path / "out").exists()


ON_DESIGNS = (
    "simulate",
    "psf",
    "budget",
    "montecarlo",
    "compare",
    "sequence",
    "requirements",
    "verify",
    "optimize",
    "sample",
    "pareto",
    "what-matters",
    "detect --design",
)


@pytest.mark.parametrize("command", ON_DESIGNS)
def test_every_command_on_a_design_takes_single_values(call, command, tmp_path):
    second = {"detect --design": [tmp_path / "none.png"], "compare": [EXAMPLE]}
    design = [EXAMPLE, *second.get(command, [])]
    status, _, err = call(*command.split(), *design, "--set", "instrument.optics.f_number=-3")
    assert status == 2
    assert "--set: instrument.optics.f_number must lie in [0.3, 200], got -3" in err


MISSPELLED = "trackers/chandra-aca.tml", "chandra", "trackers/Chandra_ACA.toml"


@pytest.mark.parametrize("command", [*ON_DESIGNS, "export aocs", "compare-flight", "predict"])
def test_every_command_suggests_a_shipped_design(call, command, tmp_path, monkeypatch):
    """From any folder. The refused value shows that a shipped design is read by its name."""
    monkeypatch.chdir(tmp_path)
    second = {"detect --design": ["none.png"], "compare": [EXAMPLE], "compare-flight": ["a.npz"]}
    for name in MISSPELLED:
        status, _, err = call(*command.split(), name, *second.get(command, []))
        assert status == 2
        assert err.endswith("there is none; shipped are trackers/chandra-aca.toml\n"), err
    for name in ("trackers/chandra-aca.toml", "chandra-aca"):
        changed = "--set", "instrument.optics.f_number=-3"
        status, _, err = call(*command.split(), name, *second.get(command, []), *changed)
        assert status == 2
        assert "f_number must lie in [0.3, 200], got -3" in err


@pytest.mark.slow
def test_a_shipped_profile_is_read_by_its_name(call, tmp_path, monkeypatch):
    """From any folder. The profile's heads are loaded and appear in the output."""
    monkeypatch.chdir(tmp_path)
    status, _, err = call("sequence", EXAMPLE, "--profile", "two_head")
    assert status == 2
    assert err.endswith("there is none; shipped are sequences/two_heads.toml\n")
    for name in ("two_heads", "sequences/two_heads.toml"):
        status, out, _ = call(
            "sequence",
            EXAMPLE,
            "--profile",
            name,
            "--fidelity",
            "window",
            "--sequences",
            1,
            "--json",
        )
        assert status == 0
        assert out[0]["alignment_rms_arcsec"] > 0


def test_no_design_is_suggested_where_none_is_close(call):
    assert call("psf", "nosuch.toml")[2].endswith("must be a design file, but there is none\n")


def test_a_value_changes_the_design_and_stands_in_the_result(call):
    plain, faster = (
        call("requirements", EXAMPLE, *more, "--json")[1][0]
        for more in ([], ["--set", "instrument.optics.f_number=1.9"])
    )
    assert faster["mass_kg"] > plain["mass_kg"]
    assert faster["set"] == ["instrument.optics.f_number=1.9"]
    assert "set" not in plain


def test_a_condition_without_a_forecast_has_no_value(capsys):
    """Twilight saturates the pixels."""
    bright = '[{name="bright", background_g=8.0, weight=0.0, max_across="2 arcsec"}]'
    assert main(["requirements", str(EXAMPLE), "--set", f"campaign.conditions={bright}"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert any(
        line.startswith("no forecast in the condition bright: ") and "saturates" in line
        for line in lines
    )
    rows = [line.split() for line in lines if "(bright)" in line]
    assert [(row[0], *row[2:]) for row in rows] == [
        ("across", "no", "forecast", "2", "arcsec", "NOT", "MET"),
        ("availability", "no", "forecast", "0.99", "NOT", "MET"),
    ]
    assert not any("nan" in line.split() for line in lines)


def test_a_design_without_a_forecast_has_its_costs_and_the_reason(call, capsys):
    changes = ["--set", "scene.background_g=8"]
    status, (found,), _ = call("requirements", EXAMPLE, *changes, "--json")
    assert (status, found["met"]) == (3, False)
    assert "saturates" in found["refused"]["nominal"]
    assert found["margins"]["mass"] > 0
    assert main(["requirements", str(EXAMPLE), *changes]) == 3
    assert capsys.readouterr().out.splitlines()[2].startswith("no forecast: ")


def test_stars_of_the_sky_have_a_value_and_a_limit(capsys):
    """If the camera detects fainter stars than the catalogue has, the catalogue's limit is the
    value."""
    assert main(["requirements", str(EXAMPLE), "--set", "catalog.limit_g=4.5"]) == 3
    row = next(one for one in capsys.readouterr().out.splitlines() if one.startswith("stars"))
    value, limit, margin = map(float, re.findall(r"[+-]?\d+\.\d+", row))
    assert value == 4.5
    assert margin == pytest.approx(value - limit, abs=0.01)


def test_why_stars_are_refused_comes_after_costs_and_before_errors(capsys):
    assert main(["requirements", str(EXAMPLE), "--set", "instrument.optics.blur=1 um"]) == 3
    lines = capsys.readouterr().out.splitlines()
    table = next(n for n, line in enumerate(lines) if line.startswith("requirement "))
    assert lines[0].startswith("3 of 3 limits on costs met: mass ")
    assert "arcsec, by formula; " in lines[2]
    assert lines[2].endswith("requirements met")
    assert "stars above the threshold are rejected as hot pixels" in lines[table - 2]
    assert sum("rejected as hot pixels" in line for line in lines) == 1


def test_keys_of_a_table(call):
    status, found, err = call("keys", "scene.orbit", "--json")
    assert (status, err) == (0, "")
    assert [one["name"] for one in found][:2] == ["scene.orbit", "scene.orbit.altitude"]
    assert found[1]["unit"] == "km"
    status, found, err = call("keys", "instrument.optic")
    assert (status, found) == (2, [])
    assert "similar are instrument.optics" in err


def test_keys_of_other_kinds_of_files(call, capsys):
    assert main(["keys", "ozone"]) == 0
    assert capsys.readouterr().out.startswith("a scene file of an Earth camera has (--scene):\nair")
    status, found, err = call("keys", "--mission", "orbit", "--json")
    assert (status, err, found[1]["name"]) == (0, "", "orbit.altitude")
    assert call("keys", "--profile", "gyro", "--json")[1][1]["name"] == "gyro.angle_random_walk"
    assert call("keys", "ozone", "--json")[1][0]["name"] == "air.ozone"
    assert "--scene and" not in call("keys", "--scene", "quark")[2]
    assert "got scene and mission" in call("keys", "--scene", "--mission")[2]
    assert "of a design or a scene" in call("keys", "--mission", "--schema")[2]


def test_keys_are_found_by_the_words_of_datasheets(call):
    keys = {key.name for key in design_keys()}
    for words, names in DATASHEET.items():
        assert set(names) <= keys, words
        found = call("keys", *words.split(), "--json")[1]
        assert {one["name"] for one in found} == set(names), words
    for words in ("frame rate", "read noise", "full well", "quantum efficiency", "lifetime"):
        found = call("keys", *words.split(), "--json")[1]
        assert any(words.replace(" ", "_") in one["name"] for one in found), words
    for words in DATASHEET_WORDS:
        assert call("keys", *words.split(), "--json")[1], words


def test_an_old_key_is_one_line_on_standard_error(capsys, tmp_path):
    path = tmp_path / "old.toml"
    path.write_text(EXAMPLE.read_text().replace("sky_fraction", "sky_share"))
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(["requirements", str(path)]) == 0
    found = capsys.readouterr()
    assert found.err == "startrack: campaign.requirements.sky_share is now called sky_fraction\n"
    assert main(["requirements", str(EXAMPLE)]) == 0
    assert found.out == capsys.readouterr().out


def test_a_design_without_a_campaign_cannot_be_optimised(call, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(EXAMPLE.read_text().split("[campaign]")[0])
    status, _, err = call("optimize", path, "--out", tmp_path / "out")
    assert status == 2
    assert "[campaign]" in err


def test_montecarlo(call, short, tmp_path):
    arguments = ("montecarlo", short, "--trials", 12, "--seed", 3, "--workers", 1, "--json")
    status, (one,), _ = call(*arguments, "--out", tmp_path / "a")
    call(*arguments, "--out", tmp_path / "b")
    assert status == 0
    assert one["trials"] == 12
    low, high = one["across_rms_arcsec_95"]
    assert low < one["across_rms_arcsec"] < high
    assert one["availability"] == 1
    assert one["trials_per_s"] > 0
    tables = [(tmp_path / name / "trials.csv").read_bytes() for name in "ab"]
    assert tables[0] == tables[1]
    assert len(tables[0].splitlines()) == 13
    assert cv2.imread(str(tmp_path / "a" / "errors.png")) is not None
    assert json.loads((tmp_path / "a" / "summary.json").read_text())["seed"] == 3


def test_where_a_covariance_is_too_small_the_second_line_says_where_to_look(capsys):
    arguments = ["montecarlo", str(EXAMPLE), "--trials", "100", "--fidelity", "spots"]
    floor = ["--set", "tracker.attitude.centroid_floor=0.0001"]
    for changes, doubted in (([], False), (floor, True)):
        assert main([*arguments, "--workers", "1", *changes]) == 0
        answer, second, *_ = capsys.readouterr().out.splitlines()
        assert re.match(r"error \S+ \[.*\] arcsec across .* correct in \S+ % of 100 trials", answer)
        assert second.startswith("covariance not trustworthy") == doubted
        assert (
            second.endswith("`startrack budget` names effects that the tracker does not know")
            == doubted
        )


def test_combine_narrows_the_interval_of_frames(call, tmp_path):
    made = {}
    for kind, trials in (("frame", 32), ("window", 64), ("covariance", 2000)):
        path = made[kind] = tmp_path / f"{kind}.sqlite"
        control = ["--control"] * (kind == "frame")
        status, (one,), _ = call(
            *("montecarlo", EXAMPLE, "--trials", trials, "--fidelity", kind, "--store", path),
            *("--workers", 1, "--json", *control),
        )
        assert status == 0
        assert ("helped" in one) == bool(control)
    status, (together,), err = call("combine", made["covariance"], made["frame"], "--json")
    assert (status, err) == (0, "")
    assert together["trials"] == {"frame": 32, "covariance": 2000}
    low, high = together["across_rms_arcsec_95"]
    alone = together["across_alone_rms_arcsec_95"]
    assert low < together["across_rms_arcsec"] < high
    assert high - low < alone[1] - alone[0]
    assert call("combine", *made.values(), "--json")[0] == 0
    other, even = tmp_path / "other.sqlite", tmp_path / "even.sqlite"
    Store(other, load_design(EXAMPLE).case, 5, Sampling(Fidelity.WINDOW)).close()
    Store(even, load_design(EXAMPLE).case, 1, Sampling(Fidelity.WINDOW, "sobol")).close()
    for wrong, sentence in (
        ([made["frame"], even], "make it again without --sobol"),
        ([made["frame"], other], "must have the design and the seed of"),
        ([made["frame"], tmp_path / "none"], "must be a campaign store, but there is none"),
    ):
        status, out, err = call("combine", *wrong, "--json")
        assert (status, out) == (2, [])
        assert sentence in err


def test_optimize_writes_a_design_that_other_commands_accept(call, short, tmp_path):
    out = tmp_path / "opt"
    status, (result,), err = call(
        *("optimize", short, "--out", out, "--seed", 2, "--workers", 1, "--json")
    )
    assert status in (0, 3)
    assert "Traceback" not in err
    assert 2 <= result["evaluations"] <= 3
    assert result["start"]["trials"] == result["best"]["trials"] == 20
    low, high = result["factor_95"]
    assert low <= result["factor"] <= high
    assert (out / "ledger.sqlite").is_file()
    assert len((out / "evaluations.csv").read_text().splitlines()) == result["evaluations"] + 1
    text = (out / "comparison.md").read_text()
    assert text.startswith(("Better by a factor of ", "No design that was found is better"))
    assert ("NOT MET, the worst first" in text.splitlines()[0]) == (status == 3)
    assert "| start | best |" in text
    assert cv2.imread(str(out / "convergence.png")) is not None
    best = load_design(out / "best.toml")
    assert best.campaign == load_design(short).campaign
    command = ("montecarlo", out / "best.toml", "--trials", 2, "--workers", 1, "--json")
    status, (again,), _ = call(*command)
    assert again["trials"] == 2
    status, _, _ = call("simulate", out / "best.toml", "--out", tmp_path / "s", "--json")
    assert status == 0


@pytest.mark.parametrize(("command", "expected"), [("optimize", 3), ("pareto", 2), ("sample", 2)])
def test_a_power_that_no_design_meets_is_said_before_any_forecast(
    call, short, tmp_path, monkeypatch, command, expected
):
    """The example needs 1.3 W or more for all values of its variables; no design is forecast or
    tried."""
    monkeypatch.setattr("startrack.cli.campaign.open_workers", None)
    words = (command, short, "--set", 'campaign.requirements.max_power="1 mW"', "--workers", 1)
    status, results, err = call(*words, "--out", tmp_path / "out", "--json")
    said = results[0]["ending"] if results else err
    assert status == expected
    assert re.search(r"power \S+ W at best, limit 0.001 W", said)
    if command == "optimize":
        assert (results[0]["feasible"], results[0]["start_stays"]) == (False, True)
        assert load_design(tmp_path / "out" / "best.toml").case == load_design(short).case


@pytest.mark.slow
def test_sample_writes_tolerances(call, short, tmp_path):
    text = short.read_text()
    variables = text.split("[[campaign.variables]]")
    short.write_text("[[campaign.variables]]".join(variables[:3]))  # two variables suffice
    out = tmp_path / "sam"
    status, (result,), _ = call(
        *("sample", short, "--out", out, "--seed", 2, "--workers", 1, "--json")
    )
    assert status == 0
    assert result["converged"]
    assert set(result["values_si"]) == {
        "instrument.optics.focal_length",
        "instrument.optics.f_number",
    }
    assert all(values == sorted(values) for values in result["values_si"].values())
    assert cv2.imread(str(out / "corner.png")) is not None
    assert (out / "samples.csv").read_text().startswith("instrument.optics.focal_length,")


def test_help_imports_nothing_that_computes():
    """The help of `startrack` and of each command: loading numpy would take longer than all the
    rest."""
    code = (
        "import sys\nfrom startrack.cli.main import COMMANDS, main\n"
        "for name in ('', *COMMANDS):\n"
        "    sys.argv = ['startrack', *name.split(), '--help']\n"
        "    try:\n        main()\n"
        "    except SystemExit:\n        pass\n"
        "heavy = {'numpy', 'scipy', 'cv2', 'astropy', 'numba', 'matplotlib', 'startrack.core'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    for word in ("optimize", "exit status", "startrack solve photo.jpg"):
        assert word in done.stdout


def test_choices_in_the_help_are_those_of_the_rooms(capsys):
    """The parser names the choices without an import of the room."""
    for command, names in (
        ("montecarlo --help", STATISTICS),
        ("montecarlo --help", tuple(fidelity.value for fidelity in Fidelity)),
        ("bench --help", STAGES),
    ):
        with pytest.raises(SystemExit):
            main(command.split())
        words = re.findall(r"[\w.-]+", capsys.readouterr().out)
        assert set(names) <= set(words)


@pytest.mark.slow  # the process of test_stopping shows it for another command
def test_what_a_command_imports_late_is_there_when_it_runs(tmp_path):
    """In a process that a shell starts, which postpones the imports."""
    code = "import sys\nfrom startrack.cli.main import main\nsys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", code, "combine", "one"], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 2
    assert "campaigns must be two or more" in done.stderr


def test_long_work_says_so_without_a_terminal(capsys, monkeypatch):
    """A step that runs long prints a line now and then, whether or not it reports its progress."""
    now = [0.0]
    monkeypatch.setattr("startrack.cli.terminal.time.monotonic", lambda: now[0])
    monkeypatch.setattr("startrack.cli.terminal.SILENT", 0.01)
    shown = []

    def wait_for(line):
        for _ in range(1000):
            shown.extend(capsys.readouterr().err.splitlines())
            if line in shown:
                return
            time.sleep(0.01)
        pytest.fail(f"{line!r} not in {shown[-3:]}")

    with lines_now_and_then():
        with progress("trials", 3) as advance:
            now[0] = 60.0
            advance(1, "best 4.2")
            wait_for("startrack: trials: 1 of 3, some 120 s left, best 4.2; 60 s so far")
        with progress("trials", 8000) as advance:
            advance(1)  # which says nothing of the others
            wait_for("startrack: trials: 1 of 8000; 60 s so far")
        with stage("error budget"):
            wait_for("startrack: error budget; 60 s so far")
        with waiting():
            shown.clear()
            time.sleep(0.05)
            assert not [line for line in capsys.readouterr().err.splitlines() if "at work" in line]
        wait_for("startrack: at work; 60 s so far")
    capsys.readouterr()
    time.sleep(0.05)
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["instrument.optics.focal_length=1e9 km", "instrument.motion="], "too few stars are in"),
        (["instrument.optics.focal_length=-35 mm"], "must be positive, got -0.035 m"),
        (["instrument.detector.thermal.temperature=-300 degC"], "[0, 500], got -26.85 K"),
        (["instrument.optics.focal_length=1e-9 mm"], "must be at most 88.8 deg, got 90 deg"),
    ],
)
def test_a_refusal_names_its_unit(arguments, sentence, capsys):
    main(["budget", "noise_only", *(word for one in arguments for word in ("--set", one))])
    assert sentence in capsys.readouterr().err


def test_a_refusal_names_its_file_once(tmp_path, capsys):
    path = tmp_path / "broken.toml"
    path.write_text("[instrument\n")
    main(["budget", str(path)])
    assert capsys.readouterr().err.count("broken.toml") == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("bits=16", "less than half of the largest number of 16 bits, 65535"),
        ("bits=10", "above the largest number of 10 bits, 1023: no pixel counts as saturated"),
        ("bits=12", ""),
    ],
)
def test_a_saturation_that_is_not_of_the_converter_is_said(change, message, capsys):
    read_design(EXAMPLE, [f"instrument.detector.{change}"])
    said = capsys.readouterr().err
    assert message in said if message else not said


def test_a_saturation_of_empty_pixels_is_refused():
    with pytest.raises(
        Refused, match=r"saturation must be above instrument.detector.offset \(64\)"
    ):
        load_design(EXAMPLE, ["tracker.detection.saturation=64"])


def test_a_saturated_frame_is_called_so(capsys, tmp_path):
    """Twilight fills the pixels of `noise_only`."""
    bright = ["--set", "scene.background_g=5", "--out", str(tmp_path)]
    assert main(["simulate", "noise_only", *bright]) == 0
    assert "all pixels have the number" in capsys.readouterr().out.splitlines()[0]


def test_a_design_without_an_attitude_is_not_sampled_and_the_reason_is_told(call, tmp_path):
    bright = "--set", "scene.background_g=5"
    status, _, err = call("sample", "noise_only", *bright, "--out", tmp_path, "--workers", 1)
    assert status == 1
    assert "must work to be sampled around" in err
    assert "saturates the pixels" in err


def test_two_trials_do_not_tell_how_many_decide(capsys):
    design = ["noise_only", "--set", "campaign.requirements.max_across=5 arcsec"]
    assert main(["verify", *design, "--fidelity", "covariance", "--trials", "2"]) == 3
    out = capsys.readouterr().out
    assert "these trials do not tell how many would do" in out
    assert "tested at 2 trials; " in out
