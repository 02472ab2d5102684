"""Structure of a head: against finite elements, as drawn, counted once, and its costs."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from startrack.attitude import Mounting
from startrack.budget import Term, unit_budgets
from startrack.core import Refused
from startrack.design import (
    Case,
    Choice,
    Moment,
    Requirements,
    Scope,
    Structure,
    Variation,
    branches,
    load_design,
    replaced,
    save_design,
    unit_case,
)
from startrack.design.variation import differences
from startrack.io import shipped
from startrack.optics import Optics, Residual, open_lens
from startrack.space import Heat, orbit_temperatures
from startrack.space.heat import view_of_earth

CASE = load_design(shipped("designs/noise_only.toml")).case
OPTICS = CASE.instrument.optics
WARM = Structure(
    swing=8.0,
    gradient_x=20.0,
    gradient_y=30.0,
    flux=30.0,
    offset=1e-3,
    calibration_offset=5.0,
    gradient_offset=10.0,
    detector_offset=8e-3,
    plate_expansion=10e-6,
    telecentric=0.0,
)
ORACLE = json.loads((Path(__file__).parents[1] / "oracle/structure.json").read_text())["cases"]
TURN_Y = "instrument.mounting.y"


def standing(structure: Structure | None, **changes) -> Case:
    return replace(CASE, instrument=replace(CASE.instrument, structure=structure), **changes)


@pytest.mark.parametrize("of", ORACLE, ids=lambda of: f"{of['mean']:g} {of['gradient']:g}")
def test_the_boresight_turns_as_in_finite_elements(of):
    """Within 18 %, and with the sign: the camera's axis z turns towards the body's +x."""
    head = of["head"]
    structure = Structure(
        expansion=of["expansion"],
        plate_expansion=of["panel"],
        length=head["length"],
        diameter=head["diameter"],
        wall=head["wall"],
        feet_span=head["span"],
        height=head["height"],
        feet_thickness=head["foot"],
        base=head["base"],
        offset=head["offset"],
    )
    response = structure.responses(Optics(focal_length=head["focal"], f_number=1.5), 5e-6)[TURN_Y]
    turn = float(response @ [of["mean"], of["gradient"], 0.0, of["tube"], 0.0])
    towards = Mounting(y=turn).camera_to_body().apply([0.0, 0.0, 1.0])[0]
    assert towards == pytest.approx(of["turn"], rel=0.18)


def test_a_head_turns_alike_about_both_axes():
    """The boresight turns away from the warm side for both axes."""
    for axis, name in enumerate((TURN_Y, TURN_Y[:-1] + "x")):
        turn = Structure().responses(OPTICS, 5e-6)[name]
        kelvin = np.eye(5)[1 + axis]
        mounting = Mounting(**{name[-1]: float(turn @ kelvin)})
        there = mounting.camera_to_body().apply([0.0, 0.0, 1.0])
        assert there[axis] < -1e-7
        assert there[1 - axis] == 0


def test_drawn_units_have_the_sum_of_the_variances():
    """The rms of 4000 orbits and launches is within 4 sigma; parts with the same name add up."""
    case = standing(WARM)
    want = dict.fromkeys((one.name for one in case.varying), 0.0)
    response = WARM.responses(OPTICS, case.instrument.detector.pitch)
    side = WARM.flux_gradient(OPTICS)
    quarter = 1j ** np.array([0, 1, 2, 1, 2])  # phases of mean, gradients and fluxes
    swing = np.array([8.0, 20.0, 30.0, side, side]) * quarter
    launch = np.array([5.0, 10.0, 10.0, 0.0, 0.0])
    for name, kelvin in response.items():
        want[name] = abs(kelvin @ swing) ** 2 / 2 + np.sum((kelvin * launch) ** 2)
    found = dict.fromkeys(want, 0.0)
    many = 2000
    for unit in range(many):
        total = dict.fromkeys(want, 0.0)
        for one, by in differences(case, 3, Moment(unit, 0)):
            total[one.name] += by
        for name, by in total.items():
            found[name] += by**2 / many
    for name, variance in want.items():
        assert found[name] == pytest.approx(variance, rel=4 * math.sqrt(2 / many)), name


def test_focal_length_defocus_and_residual_move_together():
    """In one orbit all three follow the mean temperature, and the truth of a unit has them."""
    case = standing(replace(WARM, calibration_offset=0.0, focus=True))
    instrument = replace(
        case.instrument, residual=Residual(rms=0.1, drift=0.01), optics=replace(OPTICS, psf="auto")
    )
    case = replace(case, instrument=instrument)
    unit = unit_case(case, 1, Moment(0, 4)).instrument
    kelvin = unit.residual.temperature
    grown = unit.optics.focal_length / OPTICS.focal_length - 1
    assert abs(kelvin) > 0.1
    assert grown == pytest.approx(23.6e-6 * kelvin, rel=1e-9)
    assert unit.optics.defocus - OPTICS.defocus == pytest.approx(
        OPTICS.focal_length * (23.6e-6 - 5e-6) * kelvin, rel=1e-9
    )
    assert unit.structure is None


def test_nothing_is_counted_twice():
    declared = Variation(TURN_Y, "sinusoid", amplitude="4 arcsec", per=Scope.ENVIRONMENT)
    with pytest.raises(Refused, match=r"left out: instrument\.structure"):
        standing(WARM, variation=(declared,))
    case = standing(WARM, variation=(replace(declared, per=Scope.UNIT),))
    assert len(case.varying) == 1 + len(standing(WARM).varying)
    assert case.without_units.varying == ()
    assert standing(Structure(material="invar")).varying == ()


def test_a_profile_stands_for_its_sinusoid():
    turn = np.linspace(0, 2 * np.pi, 721)
    plain = replace(WARM, flux=0.0, gradient_x=0.0, gradient_y=0.0, calibration_offset=0.0)
    profile = replace(plain, swing=0.0, mean_profile=tuple(map(float, 8 * np.sin(turn))))
    both = [differences(standing(one), 3, Moment(2, 5)) for one in (plain, profile)]
    for (one, by), (other, same) in zip(*both, strict=True):
        assert one.name == other.name
        assert by == pytest.approx(same, rel=1e-4)
    with pytest.raises(Refused, match="must have one common length of two or more"):
        replace(profile, gradient_x_profile=(0.0, 1.0))


def test_a_variable_of_the_structure_changes_the_budget():
    """For other materials in the same orbits, thermo-elastic errors are proportional to
    expansion."""
    case = standing(replace(WARM, offset=0.0, detector_offset=0.0, flux=0.0, gradient_offset=0.0))
    sizes = {}
    choice = Choice("instrument.structure.material", ("titanium", "aluminium"))
    for branch in branches(case, [choice]):
        budgets = unit_budgets(branch.case, 1, 2, count_fields=8)
        sizes[branch.label] = budgets.terms[Term.THERMO_ELASTIC][:, :2]
    titanium, aluminium = sizes.values()
    assert aluminium / titanium == pytest.approx(23.6 / 8.6, rel=0.02)


def test_a_design_file_holds_it(tmp_path):
    """All parts of designs load together; a written file is read back the same."""
    lines = {
        "structure": ("aluminium", "titanium", "invar", "carbon"),
        "platform": ("cubesat", "small", "controlled", "observatory"),
    }
    for made_of, platform in zip(*lines.values(), strict=True):
        parts = f'"variations/structure-{made_of}.toml", "variations/platform-{platform}.toml"'
        path = tmp_path / "design.toml"
        path.write_text(f'base = "{shipped("designs/noise_only.toml")}"\ninclude = [{parts}]\n')
        design = load_design(path)
        structure = design.case.instrument.structure
        assert structure.material == made_of
        assert structure.swing > 0
        heated = replaced(design.case, "instrument.structure.mean_profile", (0.0, 1.5, 0.0))
        save_design(path, replace(design, case=heated))
        assert load_design(path).case == heated


def test_kelvin_against_watt_and_kilogram():
    """A heater of 4 W at 0.5 W / K removes 8 K; the mass is that of the volume of tube and base."""
    needs, case = Requirements(), standing(replace(WARM, gradient_x=0.0, gradient_y=0.0))
    swing = {4.0: 0.0, 3.0: 2.0}
    for power, left in swing.items():
        heated = replaced(case, "instrument.structure.heater", power)
        assert heated.instrument.structure.uncontrolled(OPTICS) * 8 == pytest.approx(left)
        assert needs.power(heated) - needs.power(case) == pytest.approx(power)
    warm = replaced(standing(WARM), "instrument.structure.heater", 2.0)
    turns = [one.instrument.structure.swings(OPTICS)[0] for one in (standing(WARM), warm)]
    at_foot = 8.0 + math.hypot(20.0, 30.0) * WARM.size(OPTICS)[2] / 2
    assert turns[1] / turns[0] == pytest.approx(1 - 2.0 / (0.5 * at_foot), rel=0.05)
    light = replaced(case, "instrument.structure.material", "carbon")
    own = [needs.mass(one) - needs.mass(CASE) for one in (case, light)]
    assert own[1] / own[0] == pytest.approx(1650 / 2700)
    assert needs.cost(light) > needs.cost(case) > needs.cost(CASE)


def test_nodes_of_a_program_give_what_elasticity_does(tmp_path):
    """T = g x in a free body: u = a g (x^2 - y^2 - z^2, 2 x y, 2 x z) / 2, at the nodes of a head.

    Relative to feet on the panel at z = 0; exact except for the size of the parts.
    """
    structure, expansion, focal = Structure(length=60e-3), 23.6e-6, OPTICS.focal_length
    low = structure.height + structure.base / 2 + structure.length - focal
    circle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = np.stack([np.cos(circle), np.sin(circle), 0 * circle], axis=1)
    lines = ["part,load,node,x,y,z,dx,dy,dz"]
    parts = (("feet", 20e-3, 0.0), ("detector", 5e-3, low), ("lens", 8e-3, low + focal))
    for part, radius, height in parts:
        for node, (x, y, z) in enumerate(radius * ring + [0, 0, height]):
            moved = expansion / 2 * np.array([x * x - y * y - z * z, 2 * x * y, 2 * x * z])
            numbers = ",".join(repr(float(value)) for value in (x, y, z, *moved))
            lines.append(f"{part},gradient_x,{node},{numbers}")
    path = tmp_path / "moved.csv"
    path.write_text("\n".join(lines))
    by_file = replace(structure, displacements=str(path)).responses(OPTICS, 5e-6)[TURN_Y]
    assert by_file == pytest.approx(structure.responses(OPTICS, 5e-6)[TURN_Y], rel=1e-6)
    path.write_text("\n".join(lines[:3]))
    with pytest.raises(Refused, match="must have three nodes or more"):
        replace(structure, displacements=str(path)).responses(OPTICS, 5e-6)


def test_the_scale_of_a_lens_changes_as_a_traced_one():
    """The shipped Petzval lens in an aluminium barrel, 80 K apart, at a degree from its axis."""
    lens = open_lens("petzval")
    grown = lens.place[-1, 4, 1] / lens.place[0, 4, 1] - 1
    per_kelvin = grown / (lens.temperature[-1] - lens.temperature[0])
    scale = Structure().responses(OPTICS, 5e-6)["instrument.optics.focal_length"][0]
    assert scale == pytest.approx(per_kelvin, rel=0.05)


def test_heat_gives_what_another_program_does():
    """A platform of 8 l at 500 km, by missiontools 0.2.3 with the Sun alone.

    Its minimum, maximum and mean over an orbit in kelvin, local time 10:30 with 5 W.
    """
    platform = orbit_temperatures(
        Heat(
            epoch="2025-03-20T12:00:00",
            altitude=500e3,
            local_time=10.5 * 3600,
            size=(0.1, 0.2, 0.4),
            absorptance=(0.25, 0.25, 0.2, 0.2, 0.3, 0.3),
            emittance=(0.85, 0.85, 0.9, 0.9, 0.8, 0.8),
            capacity=1800.0,
            power=5.0,
            head_size=(1e-4, 1e-4),
            aperture=0.0,
            head_power=0.0,
            head_capacity=1e-3,
            conductance=1e-6,
            albedo=0.0,
            infrared=0.0,
            solar=1366.0,
        )
    ).platform
    found = platform.min(), platform.max(), platform.mean()
    assert found == pytest.approx((189.44, 208.02, 199.12), abs=0.5)


def test_heat_keeps_energy_and_sees_the_whole_earth():
    """View factors over all directions add up to the Earth's solid angle; absorbed heat is
    emitted."""
    cosine, distance = np.linspace(-1, 1, 20001), 1.1
    solid = (1 - math.sqrt(1 - 1 / distance**2)) / 2
    assert np.trapezoid(view_of_earth(cosine, distance), cosine) / 2 == pytest.approx(solid, 1e-6)
    heat = Heat(conductance=0.7)
    found = orbit_temperatures(heat)
    diameter, length = heat.head_size
    lid = math.pi / 4 * (diameter**2 - heat.aperture**2)
    shines = heat.head_emittance * (math.pi * diameter * length + lid)
    shines += math.pi / 4 * heat.aperture**2
    flow = 0.7 * (found.platform - found.head).mean()
    out = 5.670374419e-8 * shines * (found.head**4).mean()
    assert found.heat.mean() + heat.head_power + flow == pytest.approx(out, rel=1e-3)


def test_heat_drives_the_head():
    """The temperatures of the heat balance replace swing and flux."""
    heat = Heat(head_absorptance=0.05)
    case = standing(Structure(heat=heat, telecentric=0.0))
    found = orbit_temperatures(heat)
    table = {one.name: one for one in case.varying}["instrument.optics.focal_length"]
    swing = 23.6e-6 * np.ptp(found.head)
    assert np.ptp(np.array(table.values, float)) == pytest.approx(swing, rel=0.01)
    with pytest.raises(Refused, match="must be left out if swing"):
        Structure(heat=heat, swing=1.0)
