"""Code of one's own, named by a design: a package of its own, made of the examples of the docs."""

import os
import re
import sys
from dataclasses import replace
from importlib import invalidate_caches
from pathlib import Path

import numpy as np
import pytest

from startrack.cli.main import main
from startrack.core import code_of_command, used_code
from startrack.design import Case, Design, Fidelity, load_design, save_design
from startrack.montecarlo import Serial, Store, pool, run
from startrack.trial import run_trials

PAGE = Path(__file__).parents[2] / "docs" / "extensions.md"
EXAMPLE = re.compile(r"in `(mylab/\w+\.py)`:\n\n```python\n(.*?)```", re.S)
NAMES = {
    "centroids": ("tracker.detection.centroid", "mylab.centroids:snail"),
    "identifications": ("tracker.identification.method", "mylab.identifications:vote"),
    "charge_effects": ("instrument.detector.charge_effects", "mylab.effects:amplifier_glow"),
}
CENTROID = "tracker.detection.centroid=snail"
ALL = (CENTROID, "tracker.identification.method=vote",
       'instrument.detector.charge_effects=["amplifier_glow"]')  # fmt: skip


def write_package(folder):
    """A distribution as pip installs it, with entry points."""
    (folder / "mylab").mkdir()
    (folder / "mylab" / "__init__.py").write_text("")
    for name, code in EXAMPLE.findall(PAGE.read_text()):
        (folder / name).write_text(code)
    about = folder / "mylab-0.3.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 0.3\n")
    (about / "top_level.txt").write_text("mylab\n")
    points = (
        f"[startrack.{group}]\n{name.partition(':')[2]} = {name}\n"
        for group, (_, name) in NAMES.items()
    )
    (about / "entry_points.txt").write_text("".join(points))


def forget_package():
    for name in [one for one in sys.modules if one.partition(".")[0] == "mylab"]:
        del sys.modules[name]
    invalidate_caches()


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The folder of the package; nothing that it allows outlives the test."""
    folder = tmp_path / "site"
    folder.mkdir()
    write_package(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    with code_of_command(allow=False):
        yield folder
    forget_package()


@pytest.fixture
def plain(small, tmp_path):
    """A file with the small design, and no code."""
    path = tmp_path / "plain.toml"
    save_design(path, small)
    return path


def changed(path, *changes):
    return load_design(path, changes, allow_code=True).case


def test_code_is_refused_before_it_is_imported(installed, plain, monkeypatch, capsys):
    rule = r"tracker\.detection\.centroid names code .*'mylab\.centroids:snail': the module "
    rule += r"mylab\.centroids is imported only with --allow-code, with load_design\(\.\.\., allow"
    with pytest.raises(ValueError, match=rule):
        load_design(plain, [CENTROID])
    assert main(["simulate", str(plain), "--set", CENTROID]) == 2
    assert "--allow-code" in capsys.readouterr().err
    with pytest.raises(ValueError, match="allow-code"):
        run_trials(replaced(load_design(plain).case, "mylab.centroids:snail"), 1, range(1))
    assert "mylab" not in sys.modules
    monkeypatch.setenv("STARTRACK_ALLOW_CODE", "other, mylab.centroids")
    load_design(plain, [CENTROID])
    with pytest.raises(ValueError, match=r"STARTRACK_ALLOW_CODE=mylab\.identifications"):
        load_design(plain, ["tracker.identification.method=vote"])


def replaced(case: Case, centroid: str) -> Case:
    detection = replace(case.tracker.detection, centroid=centroid)
    return replace(case, tracker=replace(case.tracker, detection=detection))


def test_an_entry_point_is_the_function_that_it_names(installed, plain, tmp_path):
    case = changed(plain, *ALL)
    assert case.tracker.detection.centroid == "mylab.centroids:snail"
    assert {str(one) for one in used_code()} == {
        "centroid: mylab.centroids:snail 0.3, not part of startrack",
        "method: mylab.identifications:vote 0.3, not part of startrack",
        "charge_effects: mylab.effects:amplifier_glow 0.3, not part of startrack",
    }
    save_design(tmp_path / "again.toml", Design(case))
    assert load_design(tmp_path / "again.toml").case == case
    with pytest.raises(ValueError, match=r"centroid must be one of gravity, .* or code as module"):
        changed(plain, "tracker.detection.centroid=snale")


def test_an_own_centroid_is_as_accurate_as_startracks_in_every_fidelity(installed, plain):
    """Against startrack's own centroid under a Gaussian weight, which the example repeats."""
    own, built_in = changed(plain, CENTROID), changed(plain, "tracker.detection.centroid=weighted")
    frames = {case: run_trials(case, 5, range(32)) for case in (own, built_in)}
    windows = run_trials(own, 5, range(4), Fidelity.WINDOW)
    assert windows.tobytes() == frames[own][:4].tobytes()
    rms = [np.sqrt(np.mean(one["error_x"] ** 2 + one["error_y"] ** 2)) for one in frames.values()]
    assert 0.8 < rms[0] / rms[1] < 1.25  # of the same skies and noise
    nees = np.mean(frames[own]["nees"])
    assert 2 < nees < 5  # 3 where the covariance, propagated from pixels, is right
    for fidelity in (Fidelity.SPOTS, Fidelity.COVARIANCE):
        faster = run_trials(own, 5, range(100), fidelity)
        expected = np.sqrt(np.mean(faster["error_x"] ** 2 + faster["error_y"] ** 2))
        assert 0.75 < expected / rms[0] < 1.3, fidelity


def test_an_own_identification_finds_the_same_stars(installed, plain):
    own = run_trials(changed(plain, "tracker.identification.method=vote"), 5, range(100), "spots")
    assert own["solved"].mean() > 0.9
    assert not own["false"].any()


def test_an_own_effect_adds_its_light_and_needs_frames(installed, plain):
    from startrack import Streams, observe
    from startrack.trial import random_attitude

    case = changed(plain, ALL[2])
    detector = case.instrument.detector
    streams = Streams(1, 1)
    images = [
        observe(one, random_attitude(streams), streams).frame.image.astype(float)
        for one in (case, changed(plain))
    ]
    more = (images[0] - images[1])[:20, :20].sum() * detector.electrons_per_dn
    rows, columns = np.indices((20, 20))
    asked = 100 * np.exp(-np.hypot(rows, columns) / 50).sum() * detector.exposure
    assert abs(more - asked) < 6 * np.sqrt(400 * 2 * detector.noise**2 + 2 * more)
    for fidelity in (Fidelity.WINDOW, Fidelity.SPOTS, Fidelity.COVARIANCE):
        with pytest.raises(ValueError, match=r"charge_effects mylab\.effects:amplifier_glow"):
            run_trials(case, 1, range(1), fidelity)


BAD = {
    "shape": ("given.signal", "must return an array of shape"),
    "text": ("'abc'", "must return an array .* of numbers"),
    "error": ("1 / 0", "raised ZeroDivisionError: division by zero"),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_code_must_not_return_names_the_code(kind, installed, plain):
    text, rule = BAD[kind]
    (installed / "mylab" / "bad.py").write_text(f"def bad(given):\n    return {text}\n")
    case = changed(plain, "tracker.detection.centroid=mylab.bad:bad")
    with pytest.raises(ValueError, match=rf"tracker\.detection\.centroid mylab\.bad:bad {rule}"):
        run_trials(case, 1, range(1))


def test_a_store_knows_the_files_of_its_code(installed, plain, tmp_path, monkeypatch):
    case, path = changed(plain, CENTROID), tmp_path / "store.sqlite"
    with Store(path, case, 1) as store:
        store.keep(0, run(case, 2, 1, Serial()))
    with Store(path, case, 1) as store:
        assert store.code[0].package == "mylab 0.3"
    forget_package()
    with (installed / "mylab" / "effects.py").open("a") as file:
        file.write("# another one\n")
    with pytest.raises(ValueError, match=r"other files of mylab\.centroids:snail: digest"):
        Store(path, changed(plain, CENTROID), 1)
    with Store(path) as store:  # to be read, which runs nothing
        assert store.code[0].name == "mylab.centroids:snail"
        assert len(store.outcomes()) == 2


def test_a_command_says_what_is_not_part_of_startrack(installed, plain, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["simulate", str(plain), "--set", CENTROID, "--allow-code", "--json"]
    assert main([*words, "--out", str(out)]) == 0
    said = "centroid: mylab.centroids:snail 0.3, not part of startrack"
    shown = capsys.readouterr()
    assert f"startrack: {said}" in shown.err
    assert f'"code": ["{said}"]' in shown.out
    with pytest.raises(ValueError, match="allow-code"):  # the permission was the command's
        load_design(plain, [CENTROID])


@pytest.mark.slow
def test_processes_and_dask_do_the_same_trials(installed, plain):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    from startrack.montecarlo.workers import dask_pool

    case = changed(plain, *ALL)
    alone = run(case, 24, 3, Serial())
    with pool(2) as executor:
        assert run(case, 24, 3, executor, workers=2).tobytes() == alone.tobytes()
    workers = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with workers as cluster, dask_pool(cluster.scheduler_address) as executor:
        assert run(case, 24, 3, executor, workers=2).tobytes() == alone.tobytes()


@pytest.mark.slow
def test_optimize_is_the_same_with_two_processes(installed, plain):
    from startrack.optimise import TrialRunner, optimize

    design = load_design(plain, ALL, allow_code=True)
    alone = optimize(design.case, design.campaign, TrialRunner(1))
    with pool(2) as executor:
        both = optimize(design.case, design.campaign, TrialRunner(1, executor, 2))
    assert alone.best == both.best
    assert alone.fresh == both.fresh
