"""An Earth camera as a problem: parameters by path, costs, forecast, trials, judgement."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from startrack.core import Refused
from startrack.design import found_at, paths
from startrack.earth.imager import load_survey
from startrack.earth.retrieval import EarthProblem, load_earth_design

PROBLEM = EarthProblem(load_earth_design("hsrs"))


def test_paths_are_by_number_by_name_and_of_all():
    design = PROBLEM.design
    assert paths(design, "channels.tir.optics.f_number") == ["camera.channels.1.optics.f_number"]
    assert paths(design, "camera.channels.1.optics.f_number") == [
        "camera.channels.1.optics.f_number"
    ]
    every = paths(design, "channels.*.optics.f_number")
    assert every == [f"camera.channels.{n}.optics.f_number" for n in (0, 1)]
    with pytest.raises(Refused, match="but swir is none"):
        paths(design, "channels.swir.optics.f_number")
    with pytest.raises(Refused, match="must have one value in every entry"):
        found_at(design, "channels.*.detector.exposure")


def test_replaced_changes_what_the_path_means_alone():
    values = {"channels.*.optics.f_number": 3.0, "channels.mir.detector.exposure": 2e-3}
    new = PROBLEM.replaced(values | {"orbit.altitude": 500e3}).design
    assert [channel.optics.f_number for channel in new.camera.channels] == [3.0, 3.0]
    assert [channel.detector.exposure for channel in new.camera.channels] == [2e-3, 0.4e-3]
    assert new.orbit
    assert new.orbit.altitude == 500e3
    assert PROBLEM.design.camera.channels[0].optics.f_number == 2.0
    with pytest.raises(Refused, match="f_number"):
        PROBLEM.replaced({"channels.mir.optics.f_number": -1.0})


def test_changes_are_those_of_the_command():
    design = load_earth_design(
        "hsrs", ["channels.mir.optics.f_number=2.5", "orbit.altitude=500 km"]
    )
    assert design.camera.channels[0].optics.f_number == 2.5
    assert design.orbit
    assert design.orbit.altitude == 500e3
    with pytest.raises(Refused, match="must be a TOML file or one of"):
        load_earth_design("nowhere")


def test_links_follow(tmp_path: Path):
    text = """
camera = "hsrs"
[orbit]
epoch = "2026-06-21T10:00:00"
altitude = "572 km"
[terrain.fractal]
longitude = "10 deg"
latitude = "47 deg"
[retrieval.hot_spots]
[campaign]
links = [{ name = "channels.*.detector.pixel_pitch", to = "channels.mir.optics.focal_length" }]
[[campaign.variables]]
name = "channels.*.optics.focal_length"
low = "30 mm"
high = "60 mm"
"""
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    problem = EarthProblem(load_earth_design(path))
    longer = problem.replaced({"channels.*.optics.focal_length": 2 * 46.39e-3})
    pitches = [channel.detector.pixel_pitch for channel in longer.design.camera.channels]
    assert pitches == pytest.approx([60e-6, 60e-6])
    # The same file is a scene to be rendered.
    assert load_survey(path).camera == problem.design.camera


def test_a_band_may_be_given_by_its_edges():
    table = {"low": 3.4e-6, "high": 4.2e-6}
    from startrack.earth.imager import Channel, Passband

    first = PROBLEM.design.camera.channels[0]
    from startrack.core import ALL

    edges: Channel = replace(first, band=ALL, passband=Passband(**table))
    design = replace(
        PROBLEM.design,
        camera=replace(PROBLEM.design.camera, channels=(edges, PROBLEM.design.camera.channels[1])),
    )
    same, narrow = (
        EarthProblem(design),
        EarthProblem(design).replaced({"channels.mir.passband.low": 3.7e-6}),
    )
    usual = PROBLEM.expect().value
    assert same.expect().value == pytest.approx(usual, rel=0.01)
    assert narrow.expect().value != pytest.approx(usual, rel=0.01)
    with pytest.raises(Refused, match="band must be left out if passband is given"):
        replace(first, passband=Passband(**table))


def test_costs_are_those_of_the_camera():
    costs = PROBLEM.costs()
    assert costs["aperture"].value == pytest.approx(46.39e-3 / 2)
    # 512 columns of 374 m: 191 km, as DLR's table of the payload has it (190 km).
    assert costs["swath"].value == pytest.approx(191e3, rel=0.01)
    # Two channels of 1024 columns and 14 bit, each half a pixel of ground apart.
    line = 2 * 512 * 14 / 0.0267 * 2
    assert costs["data rate"].value == pytest.approx(line, rel=0.01)
    faster = PROBLEM.replaced({"channels.*.optics.f_number": 1.5}).costs()["aperture"]
    assert faster.relative == pytest.approx(1 - 46.39 / 1.5 / 30)


def test_rows_are_the_same_for_any_division_of_the_work():
    whole = PROBLEM.trials(3, range(30))
    parts = [PROBLEM.trials(3, range(first, first + 10)) for first in (0, 10, 20)]
    assert np.concatenate(parts).tobytes() == whole.tobytes()
    assert PROBLEM.trials(4, range(3)).tobytes() != whole[:3].tobytes()
    with pytest.raises(Refused, match="fidelity must be image"):
        PROBLEM.trials(1, range(2), "frame")


def test_judgement_beside_forecast():
    """100 fires: the objective scatters by 6 %; 25 % is exceeded in 1e-4 of all seeds."""
    rows = PROBLEM.trials(1, range(100))
    judged, expected = PROBLEM.judge(rows), PROBLEM.expect()
    assert judged.value.low < judged.value.value < judged.value.high
    assert judged.value.value == pytest.approx(expected.value, rel=0.25)
    assert set(judged.parts) == set(expected.parts) == set(PROBLEM.text().parts)
    margin, worst, best = judged.margins["night: power"]
    assert worst.relative <= margin.relative <= best.relative


def test_night_needs_smaller_fires_and_may_be_asked_alone():
    parts = PROBLEM.expect().parts
    assert parts["night: area 800 K"] < parts["nominal: area 800 K"]
    alone = PROBLEM.expect(["night"])
    assert set(alone.parts) == {name for name in parts if name.startswith("night")}
    with pytest.raises(Refused, match="conditions must be names of nominal, night"):
        PROBLEM.expect(["dusk"])


def test_what_results_depend_on_is_described():
    other = PROBLEM.replaced({"channels.mir.detector.exposure": 2e-3})
    assert other.described() != PROBLEM.described()
    assert EarthProblem(load_earth_design("hsrs")).described() == PROBLEM.described()


def test_fires_that_are_never_found_have_no_area():
    dark = PROBLEM.replaced({"channels.mir.detector.read_noise": 1e9})
    assert dark.expect().value == math.inf
    judged = dark.judge(dark.trials(1, range(25)))
    assert judged.value.value == math.inf


def test_a_scene_without_a_study_is_refused():
    with pytest.raises(Refused, match="must have the tables"):
        EarthProblem(replace(PROBLEM.design, retrieval=None))
