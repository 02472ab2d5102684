"""User code named by a design: a package made of the examples of the documentation."""

import os
import re
import shutil
import sys
from dataclasses import replace
from importlib import invalidate_caches
from pathlib import Path

import numpy as np
import pytest

from startrack.cli.main import main
from startrack.core import extension, used_code
from startrack.core.extension import code_of_command
from startrack.design import Case, Design, Fidelity, load_design, save_design
from startrack.io import shipped
from startrack.montecarlo import Serial, Store, pool, run
from startrack.trial import require_fidelity, run_trials

PAGE = Path(__file__).parents[2] / "docs" / "extensions.md"
EXAMPLE = re.compile(r"in `(mylab/\w+\.py)`:\n\n```python\n(.*?)```", re.S)
NAMES = {
    "centroids": ("tracker.detection.centroid", "mylab.centroids:snail"),
    "identifications": ("tracker.identification.method", "mylab.identifications:vote"),
    "charge_effects": ("instrument.detector.charge_effects", "mylab.effects:amplifier_glow"),
    "searches": ("campaign.search", "mylab.searches:compass"),
}
CENTROID = "tracker.detection.centroid=snail"
ALL = (
    CENTROID,
    "tracker.identification.method=vote",
    'instrument.detector.charge_effects=["amplifier_glow"]',
)


def write_package(folder):
    """A distribution with entry points, as pip installs it."""
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


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """One folder for all tests: for a new path, the files of all installed packages would be
    read."""
    return tmp_path_factory.mktemp("code") / "site"


@pytest.fixture
def installed(site, monkeypatch):
    """The folder of the package, made anew; no permission outlives the test."""
    shutil.rmtree(site, ignore_errors=True)
    site.mkdir()
    write_package(site)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    with code_of_command(allow=False):
        yield site
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


def test_other_code_than_that_of_the_sender_is_refused_each_time(installed, plain, monkeypatch):
    """Also by a process that ran its own code before, and by one that was refused before."""
    monkeypatch.setattr(extension, "_expected", {})
    changed(plain, CENTROID)
    run = extension.function_of("centroids", "mylab.centroids:snail")
    assert callable(run)
    extension.received({"mylab.centroids": "0" * 32})
    for _ in range(2):
        with pytest.raises(ValueError, match="whose files differ from those where the trials"):
            extension.function_of("centroids", "mylab.centroids:snail")


def test_a_process_that_only_passes_a_design_on_needs_no_code(monkeypatch):
    """Like the scheduler of Dask, which serialises designs without their code."""
    monkeypatch.setattr(extension, "_expected", {})
    monkeypatch.setattr(extension, "_allowed", set())
    sent = {"nosuch.thing": "0" * 32}
    extension.received(sent)
    assert extension.sent_with([("tracker.detection.centroid", "", "nosuch.thing:f")]) == sent


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


def across(outcomes):
    return np.sqrt(np.mean(outcomes["error_x"] ** 2 + outcomes["error_y"] ** 2))


@pytest.mark.slow
def test_windows_with_an_own_centroid_are_as_frames(installed, plain):
    case = changed(plain, CENTROID)
    windows, frames = (run_trials(case, 5, range(3), one) for one in list(Fidelity)[1::-1])
    assert windows.tobytes() == frames.tobytes()
    assert across(frames) < 2e-5


@pytest.mark.slow
def test_an_own_centroid_is_as_accurate_as_startracks_in_every_fidelity(installed, plain):
    """Against startrack's centroid with a Gaussian weight, which the example implements again."""
    own, built_in = changed(plain, CENTROID), changed(plain, "tracker.detection.centroid=weighted")
    frames = {case: run_trials(case, 5, range(60)) for case in (own, built_in)}
    assert 0.8 < across(frames[own]) / across(frames[built_in]) < 1.25  # of the same skies
    assert 2 < np.mean(frames[own]["nees"]) < 5  # 3 where the propagated covariance is right
    for fidelity in (Fidelity.SPOTS, Fidelity.COVARIANCE):
        faster = across(run_trials(own, 5, range(200), fidelity))
        assert 0.75 < faster / across(frames[own]) < 1.3, fidelity


def test_an_own_identification_finds_the_same_stars(installed, plain):
    case = changed(plain, "tracker.identification.method=vote")
    own = run_trials(case, 5, range(40), Fidelity.SPOTS)
    assert own["solved"].mean() > 0.8
    assert not own["false"].any()


def test_an_own_effect_adds_its_light_and_needs_frames(installed, plain):
    from startrack import Streams, observe
    from startrack.observation import random_attitude

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
    "exit": ("exit(7)", "raised SystemExit: 7"),
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
    with pytest.raises(ValueError, match=r"another content of \S+ mylab\.centroids:snail: digest"):
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


OTHERS = """
import numpy as np
from scipy import ndimage
from startrack.scene.photometry import SUN, photon_irradiance

def wahba(given):
    u, _, v = np.linalg.svd((given.seen / given.sigma[:, None] ** 2).T @ given.direction)
    return u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v

def even(given):
    sky = photon_irradiance(np.array([19.0]), np.array([SUN]))[0] / (np.pi / 648000) ** 2
    return np.tile(sky, (len(given.direction), 1))

def wheel(given):
    return [[30.0, 2e-5, 0, 0, 0, 1e-5, 0]]

def wide(given):
    return np.exp(-(given.x**2 + given.y**2) / (2 * 5e-6**2))

def maxima(given):
    smooth = ndimage.gaussian_filter(given.value, 1.0)
    middle = np.median(smooth)
    noise = 1.4826 * np.median(np.abs(smooth - middle))
    peak = (smooth == ndimage.maximum_filter(smooth, 5)) & (smooth > middle + 7 * noise)
    return np.argwhere(peak)[:, ::-1]

def price(case):
    return 10 * case.instrument.optics.f_number

def thick(case):
    return 1 - case.instrument.optics.f_number / 1.0
"""


@pytest.fixture
def others(installed, plain):
    """Read the design with keys that name functions of the module OTHERS."""
    (installed / "mylab" / "others.py").write_text(OTHERS)
    return lambda *changes: load_design(plain, changes, allow_code=True)


@pytest.mark.slow
def test_an_own_attitude_is_as_accurate_and_states_its_covariance(others):
    case = others("tracker.attitude.method=mylab.others:wahba").case
    own, built_in = (run_trials(one, 5, range(60), Fidelity.SPOTS) for one in (case, others().case))
    assert 0.9 < across(own) / across(built_in) < 1.25  # it keeps outliers
    assert 1.7 < np.median(own["nees"]) < 3.3  # 2.37 of chi-square with three degrees of freedom


def test_an_own_attitude_is_exact_for_exact_stars_and_not_for_covariance(others):
    from scipy.spatial.transform import Rotation

    from startrack.attitude.solve import AttitudeInput, attitude_by_code

    case = others("tracker.attitude.method=mylab.others:wahba").case
    rng = np.random.default_rng(1)
    true, seen = Rotation.random(random_state=rng), rng.normal([0, 0, 5], 1, (30, 3))
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    given = AttitudeInput(seen, true.inv().apply(seen), np.full(30, 1e-5))
    attitude, covariance = attitude_by_code(case.tracker.attitude.method, given)
    assert (attitude * true.inv()).magnitude() < 1e-12
    # Information of unit vectors with equal errors (Shuster and Oh 1981).
    information = (np.eye(3) - seen[:, :, None] * seen[:, None]).sum(axis=0) / 1e-5**2
    assert covariance == pytest.approx(np.linalg.inv(information), rel=0.01, abs=1e-13)
    with pytest.raises(ValueError, match=r"must not be mylab\.others:wahba; choose"):
        run_trials(case, 5, range(1), Fidelity.COVARIANCE)


def test_an_own_attitude_goes_through_a_sequence(others):
    """Its covariance is kept, with and without jitter: nothing is subtracted."""
    from startrack.sequence import Leg, Sequence
    from startrack.sequence import run as fly

    case = others(
        "tracker.attitude.method=mylab.others:wahba",
        'instrument.motion.tones=[{frequency = "20 Hz", rms_x = "20 arcsec"}]',
    ).case
    table = fly(case, Sequence((Leg(1.0),), period=0.3), 3, 0, fidelity=Fidelity.WINDOW)
    assert table["solved"].all()
    assert (table["filtered_sigma_x"] <= table["sigma_x"] * 1.001).all()


def test_an_own_light_is_as_the_uniform_background_that_it_repeats(others):
    from startrack import observe
    from startrack.core import Streams
    from startrack.observation import random_attitude

    def mean(*changes):
        case = others("scene.background_g=30", *changes).case
        return np.median(observe(case, random_attitude(Streams(1, 1)), Streams(1, 1)).frame.image)

    own, dark = mean('scene.lights=["mylab.others:even"]'), mean()
    assert own - dark == pytest.approx(mean("scene.background_g=19") - dark, rel=0.02)
    case = others('scene.lights=["mylab.others:even"]').case
    for fidelity in ("window", "spots", "covariance"):
        with pytest.raises(ValueError, match="light"):
            require_fidelity(case, Fidelity(fidelity))


def test_an_own_jitter_is_a_tone(others):
    from startrack.core import Streams
    from startrack.motion import Motion, Tone, blur, realise_motion

    motion = others('instrument.motion.jitter=["mylab.others:wheel"]').case.instrument.motion
    assert replace(motion, tones=(), broadband=()).jitters
    own = realise_motion(motion, 0.1, Streams(1, 1))
    x, y = (
        Tone(30.0, **{f"rms_{axis}": size * 2**-0.5}, phase=phase)
        for axis, size, phase in (("x", 2e-5, 0.0), ("y", 1e-5, -np.pi / 2))
    )
    time = np.linspace(-0.1, 0.2, 7)
    tones = realise_motion(Motion(tones=(x, y)), 0.1, Streams(1, 1))
    rates = others().case.instrument.motion
    slew = realise_motion(replace(rates, tones=(), broadband=()), 0.1, Streams(1, 1))
    expected = tones.at(time) + slew.at(time)
    assert own.at(time) == pytest.approx(expected, abs=1e-12)
    assert blur(motion, 0.1) == pytest.approx(blur(replace(motion, jitter=()), 0.1))  # left out


def test_an_own_psf_has_its_width_with_blur_and_pixel(others):
    from startrack.observation import psf_of

    instrument = others("instrument.optics.psf=mylab.others:wide").case.instrument
    psf, pitch = psf_of(instrument), instrument.detector.pitch
    place = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
    variance = psf.table.sum(axis=0) @ place**2 / psf.table.sum()
    blur = np.hypot(instrument.optics.total_blur, instrument.detector.diffusion)
    side = instrument.detector.fill_factor
    assert variance == pytest.approx((5e-6**2 + blur**2) / pitch**2 + side / 12, rel=0.01)
    assert psf.energy == pytest.approx(1, abs=0.01)


def test_an_own_search_finds_the_stars_of_frames(others):
    case = others("tracker.detection.search=mylab.others:maxima").case
    own, built_in = (run_trials(one, 5, range(6)) for one in (case, others().case))
    assert own["solved"].all()
    assert own["stars"].mean() > 0.7 * built_in["stars"].mean()
    for fidelity in ("window", "spots", "covariance"):
        with pytest.raises(ValueError, match=r"mylab\.others:maxima"):
            require_fidelity(case, Fidelity(fidelity))


def test_own_requirements_and_costs_are_judged(others):
    from startrack.verification import margins

    design = others(
        "campaign.requirements.cost_model=mylab.others:price",
        "campaign.requirements.max_cost=40",
        'campaign.requirements.checks=["mylab.others:thick"]',
    )
    f_number = design.case.instrument.optics.f_number
    found = margins(design.campaign.requirements, design.case)
    assert found["cost"] == pytest.approx(1 - 10 * f_number / 40)
    assert found["mylab.others:thick"] == 1 - f_number


def test_an_own_search_by_its_entry_point_chooses_the_designs_that_are_forecast(installed):
    from startrack.design import DesignSpace
    from startrack.optimise import Search, minimise
    from startrack.optimise.explorer import Explorer
    from startrack.optimise.source import TrackerSource
    from startrack.optimise.steps import explore

    changes = ["campaign.search=compass", "campaign.analytic_evaluations=3"]
    design = load_design(shipped("designs/noise_only.toml"), changes, allow_code=True)
    campaign = design.campaign
    assert campaign.search == "mylab.searches:compass"
    space = DesignSpace(design.case, campaign.variables)
    explorer = Explorer(TrackerSource(space, campaign))
    explore({"": explorer}, {"": space.start}, campaign)
    assert len(explorer.points) == 3
    assert explorer.ending == "all evaluations were used"
    np.testing.assert_array_equal(explorer.points[0], space.start)
    # Each other is a step of a quarter along one axis from the best of those before.
    assert np.abs(explorer.points[1] - space.start).max() == pytest.approx(0.25)
    found = minimise(
        lambda at: float(((at - 0.3) ** 2).sum()), np.full(4, 0.9), Search(campaign.search, 500)
    )
    np.testing.assert_allclose(found.coordinates, 0.3, atol=2e-3)
    assert found.ending == "mylab.searches:compass converged"


@pytest.mark.slow
def test_processes_and_dask_do_the_same_trials(installed, plain):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    from startrack.montecarlo.workers import dask_pool

    case = changed(plain, *ALL)
    alone = run(case, 24, 3, Serial())
    with pool(2) as executor:
        assert run(case, 24, 3, executor, workers=2).tobytes() == alone.tobytes()
    workers = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with workers as cluster, dask_pool(cluster.scheduler_address) as executor:
        assert run(case, 24, 3, executor, workers=2).tobytes() == alone.tobytes()


@pytest.mark.slow
def test_optimize_is_the_same_with_two_processes_and_with_dask(installed, plain):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    from startrack.montecarlo import dask_pool
    from startrack.optimise import TrialRunner, optimize

    sizes = ("trials=4", "most_trials=4", "analytic_evaluations=4", "evaluations=4")
    changes = [f"campaign.{one}" for one in (*sizes, "fresh_trials=12", "fidelity=frame")]
    design = load_design(plain, [*ALL, *changes], allow_code=True)
    workers = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with pool(2) as processes, workers as cluster, dask_pool(cluster.scheduler_address) as dask:
        alone, *others = (
            optimize(design.case, design.campaign, TrialRunner(1, executor, count))
            for executor, count in ((Serial(), 1), (processes, 2), (dask, 2))
        )
    for other in others:
        assert (other.best, other.fresh) == (alone.best, alone.fresh)
