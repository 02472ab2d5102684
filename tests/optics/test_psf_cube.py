"""Images over field and wavelength, from files and from pages that Zemax saves, in a design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from startrack import Fidelity, Instrument, load_design, run_random_trial, run_trials, shipped
from startrack.budget import analytic
from startrack.cli.main import main
from startrack.core import Camera, Refused
from startrack.metrics import summarise
from startrack.observation.images import field_psf_of, psf_at
from startrack.optics import Optics, PsfFile, load_lens, load_psf_file, open_optics, save_psf_file
from startrack.optics.field_images import ColourBand
from startrack.optics.lens_psf import LensImages, lens_stars
from startrack.optics.zemax_text import psfs_of_pages

FOCAL, F_NUMBER = 0.0350, 2.8
# As many wavelengths as the chromatic focus of this lens needs: nine err by a tenth of the peak.
WAVES, ANGLES = np.linspace(400e-9, 1000e-9, 25), np.radians(np.linspace(0, 6.8, 6))
SPACING, SIDE, BLUR = 0.5e-6, 221, 2e-6


def the_instrument(optics: Optics) -> Instrument:
    instrument = load_design(shipped("designs/noise_only.toml")).case.instrument
    return replace(instrument, optics=replace(optics, transmission=instrument.optics.transmission))


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    """A file of images of the double Gauss, and its optics."""
    path = tmp_path_factory.mktemp("cube") / "cube.fits"
    optics = Optics(FOCAL, F_NUMBER, lens_file="double_gauss", blur=BLUR, psf_tolerance=0.05)
    lens = open_optics(optics)
    plan = LensImages(
        lens,
        Camera(8, 8, FOCAL / 11e-6),
        11e-6,
        ColourBand(WAVES, np.ones((1, len(WAVES)))),
        1.0,
        0.0,
    )
    plan.count, plan.spacing = SIDE, SPACING
    image, place = np.empty((len(WAVES), len(ANGLES), SIDE, SIDE)), np.empty((25, 6))
    for f, angle in enumerate(ANGLES):
        for w, star in enumerate(lens_stars(lens, WAVES, float(angle), 0.0)):
            u = star.centroid[0]
            image[w, f], place[w, f] = plan._irradiance(star, u, 0.0), u
    save_psf_file(path, PsfFile("", image, SPACING, False, None, 1.0, WAVES, ANGLES, place))
    return path, optics


def test_a_cube_of_a_lens_makes_the_stars_of_the_lens(cube):
    """Camera, places and images over frame and colour: 1.5 % of the peak, 0.01 pixel."""
    path, optics = cube
    lens, file = (
        the_instrument(optics),
        the_instrument(Optics(FOCAL, F_NUMBER, psf_file=str(path), blur=BLUR, psf_tolerance=0.05)),
    )
    assert file.camera.focal_length_px == pytest.approx(lens.camera.focal_length_px, rel=1e-5)
    wanted, made = field_psf_of(lens), field_psf_of(file)
    for x, y in ((255.5, 255.5), (430.0, 255.5), (60.0, 90.0), (300.0, 480.0)):
        pixel = np.array([[x, y]])
        for colour in wanted.colour[[0, -1]]:
            one, other = (each.image(x, y, float(colour))[0] for each in (wanted, made))
            u, v = (
                each.camera.project(lens.camera.unproject(pixel))[0]
                + images.at(pixel[:, 0], pixel[:, 1], np.array([colour]))[0, :2]
                for each, images in ((lens, wanted), (file, made))
            )
            assert np.abs(u - v).max() < 0.01
            step = np.arange(-3, 4)
            a, b = (
                psf.table[np.ix_(*2 * [len(psf.table) // 2 + step * psf.oversampling])]
                for psf in (one, other)
            )
            assert np.abs(a - b).max() < 0.015 * a.max()


@pytest.mark.slow
def test_a_trial_takes_a_cube(cube):
    path, optics = cube
    case = load_design(shipped("designs/noise_only.toml")).case
    errors = []
    for one in (optics, Optics(FOCAL, F_NUMBER, psf_file=str(path), blur=BLUR, psf_tolerance=0.05)):
        behind = replace(case, instrument=the_instrument(one))
        outcome = run_random_trial(behind, seed=3, number=1, fidelity=Fidelity.WINDOW)
        errors.append((outcome.stars, outcome.error_x, outcome.error_y))
    # The file does not say that the lens loses light towards the edge of the field.
    assert errors[0][0] == pytest.approx(errors[1][0], abs=3)
    assert np.hypot(*errors[1][1:]) < 3 * np.hypot(*errors[0][1:]) + 1e-5


@pytest.mark.slow
def test_the_budget_and_covariances_of_a_cube_are_those_of_its_lens(cube):
    """Errors within 2 %: the file does not contain the vignetting of the lens in the corners."""
    path, optics = cube
    case = load_design(shipped("designs/noise_only.toml")).case
    found = []
    for one in (optics, Optics(FOCAL, F_NUMBER, psf_file=str(path), blur=BLUR, psf_tolerance=0.05)):
        behind = replace(case, instrument=the_instrument(one))
        drawn = summarise(run_trials(behind, 1, range(300), Fidelity.COVARIANCE))
        budget = analytic(behind)
        lines = {line.name: line.across for line in budget.lines}
        found.append((budget.whole.across, budget.whole.about, drawn.across.value, lines))
    (*wanted, of_lens), (*made, of_cube) = found
    assert made == pytest.approx(wanted, rel=0.02)
    for name in ("PSF over the field", "lateral colour"):
        assert of_cube[name] == pytest.approx(of_lens[name], rel=0.1)


def page(path, data, wave, angle, kind, encoding="utf-8", extra=""):
    """Text as Zemax saves it: the first row has the largest y."""
    rows = "\n".join("\t".join(f"{one: .6E}" for one in row) for row in data[::-1])
    n = len(data)
    path.write_text(
        f"Listing of {kind} Data\n\nFile : C:\\lens.zmx\n{wave:.4f} µm at 0.0000, {angle:.4f} "
        f"(deg).\n{extra}Pupil grid size: 64 by 64\nCenter point is: row {n - n // 2}, column "
        f"{n // 2 + 1}\n\n{rows}\n",
        encoding=encoding,
    )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_huygens_pages_become_images_whose_tail_points_off_the_axis(tmp_path, encoding, capsys):
    down, across = np.indices((33, 33)) - 16.0
    images = {}
    for angle in (0.0, 4.0):
        # A tail towards +y, the direction of the field.
        images[angle] = np.exp(-(across**2) / 8 - (down - angle) ** 2 / 8)
        place = f"Center coordinates  :   0.0, {angle / 10:.4f} Millimeters\n"
        extra = f"Data spacing is 0.500 µm.\n{place}"
        page(
            tmp_path / f"{angle:.0f}.txt", images[angle], 0.6, angle, "Huygens PSF", encoding, extra
        )
    pages = [str(tmp_path / name) for name in ("0.txt", "4.txt")]
    out = tmp_path / "psf.fits"
    assert main(["lens", "import", *pages, "--out", str(out)]) == 0
    assert "psf_file" in capsys.readouterr().out
    found = load_psf_file(out)
    assert found.spacing == pytest.approx(0.5e-6)
    assert np.degrees(found.angle) == pytest.approx([0, 4])
    assert found.place is not None
    assert found.place[0] == pytest.approx([0, 0.4e-3])
    assert found.image[0, 1] == pytest.approx(images[4.0].T, abs=1e-6)
    assert (found.image[0, 1] @ np.ones(33)).argmax() == 16
    assert (np.ones(33) @ found.image[0, 1]).argmax() == 20
    assert main(["lens", "import", pages[0], str(tmp_path / "none.txt")]) == 2
    assert main(["lens", "show", str(out)]) == 0


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]
)
@pytest.mark.parametrize(
    ("wave", "field"),
    [("0.6000", "0.0000, 0.0000"), ("0.6000", "0.0000"), ("0.5000 to 0.7000", "0.0000, 0.0000")],
)
@pytest.mark.parametrize("european", [False, True])
def test_pages_of_any_locale_are_the_same(tmp_path, encoding, wave, field, european):
    down, across = np.indices((17, 17)) - 8.0
    data = np.exp(-(across**2) / 8 - (down - 1) ** 2 / 4)
    path = tmp_path / "a.txt"
    page(path, data, 0.6, 0.0, "Huygens PSF", extra="Data spacing is 0.500 µm.\n")
    text = path.read_text(encoding="utf-8").replace("0.6000", wave)
    text = text.replace("0.0000, 0.0000 (deg)", f"{field} (deg)")
    text = text.replace(".", ",") if european else text
    path.write_bytes(text.encode(encoding))
    found = psfs_of_pages([path], "a page")
    assert found.wavelength == pytest.approx([0.6e-6])
    assert found.spacing == pytest.approx(0.5e-6)
    assert found.image[0, 0] == pytest.approx(data.T, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("(deg)", "(mm)"), r"field in degree \(deg\), got mm"),
        (("0.500 µm", "0.500 mm"), "data spacing in micrometre, got mm"),
        (("0.500 µm", "0.500"), "data spacing in micrometre, got no unit"),
        (("Pupil", "Values are log intensity.\nPupil"), "must hold intensities, got log intensity"),
        (("Pupil", "Values are real part.\nPupil"), "must hold intensities, got real part"),
        (("Pupil", "Values are phase, degrees.\nPupil"), "must hold intensities, got phase"),
        (("0.6000 µm", "600.0 nm"), "with its wavelength"),
    ],
)
def test_pages_in_other_units_are_refused(tmp_path, change, words):
    path = tmp_path / "a.txt"
    page(path, np.eye(17), 0.6, 0.0, "Huygens PSF", extra="Data spacing is 0.500 µm.\n")
    path.write_text(path.read_text(encoding="utf-8").replace(*change), encoding="utf-8")
    with pytest.raises(Refused, match=words):
        psfs_of_pages([path], "a page")


def test_two_pages_of_one_place_are_refused(tmp_path):
    paths = [tmp_path / "a.txt", tmp_path / "b.txt"]
    for path in paths:
        page(path, np.eye(17), 0.6, 0.0, "Huygens PSF", extra="Data spacing is 0.500 µm.\n")
    with pytest.raises(Refused, match=r"a\.txt and .*b\.txt are both for 0\.6 um at 0 deg"):
        psfs_of_pages(paths, "pages")


def test_a_range_of_wavelengths_stands_alone(tmp_path):
    paths = [tmp_path / "a.txt", tmp_path / "b.txt"]
    for path, wave in zip(paths, ("0.5000 to 0.7000", "0.8000"), strict=True):
        page(path, np.eye(17), 0.6, 0.0, "Huygens PSF", extra="Data spacing is 0.500 µm.\n")
        text = path.read_text(encoding="utf-8").replace("0.6000", wave)
        path.write_text(text, encoding="utf-8")
    with pytest.raises(Refused, match="all of one range of wavelengths"):
        psfs_of_pages(paths, "pages")


def test_wavefront_pages_become_a_lens_table_with_their_image(tmp_path):
    """Coma and defocus over a round pupil: the image of the plain PSF with the same terms."""
    size, wave = 129, 0.6
    v, u = (np.indices((size, size)) - size // 2) / (size // 2)
    inside = np.hypot(u, v) <= 1
    rho2 = u * u + v * v
    waves = 0.12 * np.sqrt(8) * (3 * rho2 - 2) * v + 0.08 * np.sqrt(3) * (2 * rho2 - 1)
    page(tmp_path / "w.txt", np.where(inside, waves, 0.0), wave, 0.0, "Wavefront Map")
    out = tmp_path / "table.fits"
    arguments = ["lens", "import", str(tmp_path / "w.txt"), "--out", str(out)]
    assert main(arguments) == 2
    assert main([*arguments, "--focal-length", "50", "--f-number", "4"]) == 0
    table = load_lens(out)
    found = dict(zip(table.noll.tolist(), table.wavefront[0, 0, 0] / (wave * 1e-6), strict=True))
    # y of the page is x of the table, along the field.
    assert found[8] == pytest.approx(0.12, abs=1e-4)
    assert found[4] == pytest.approx(0.08, abs=1e-4)
    assert max(abs(size) for j, size in found.items() if j not in (4, 8)) < 2e-3
    assert main([*arguments, "--focal-length", "50", "--f-number", "4", "--flip"]) == 0
    assert load_lens(out).wavefront == pytest.approx(-table.wavefront)


def covariance(psf):
    """Second moments (2, 2) of a PSF, pixel^2."""
    at = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
    light = psf.table / psf.table.sum()
    across, down = light.sum(axis=0) @ at, light.sum(axis=1) @ at
    x, y = at - across, at - down
    mixed = float(y @ light @ x)
    return np.array([[light.sum(axis=0) @ x**2, mixed], [mixed, light.sum(axis=1) @ y**2]])


def test_one_image_grows_with_the_square_of_the_field_angle(tmp_path):
    """Second moments change as by a stretch along the radius; the image itself is not rotated."""
    axis = (np.arange(121) - 60) / 10
    image = np.exp(-(axis[None] ** 2) / 2 / 1.3**2 - axis[:, None] ** 2 / 2 / 0.9**2)
    path, pitch = tmp_path / "one.fits", 11e-6
    save_psf_file(path, PsfFile("", image[None, None], pitch / 10, True, pitch))
    plain = the_instrument(Optics(FOCAL, F_NUMBER, psf_file=str(path)))
    edge = float(np.arctan(250 / plain.camera.focal_length_px))
    growing = replace(plain.optics, field_edge=edge, growth_along=0.2, growth_across=-0.1)
    grown, centre = replace(plain, optics=growing), np.array(plain.camera.centre)
    wanted = covariance(psf_at(plain, *centre))
    np.testing.assert_allclose(covariance(psf_at(grown, *centre)), wanted, rtol=5e-3, atol=1e-3)
    for azimuth in np.radians([0, 90, 30, 200]):
        radial = np.array([np.cos(azimuth), np.sin(azimuth)])
        for radius in (250.0, 125.0):
            square = (radius / 250) ** 2
            outer = np.outer(radial, radial)
            stretch = (1 + 0.2 * square) * outer + (1 - 0.1 * square) * (np.eye(2) - outer)
            found = covariance(psf_at(grown, *(centre + radius * radial)))
            np.testing.assert_allclose(found, stretch @ wanted @ stretch, rtol=0.02, atol=0.015)


def test_only_one_image_grows(tmp_path, cube):
    for optics in ({}, {"psf_file": str(cube[0])}):
        with pytest.raises(Refused, match="must be left out without a psf_file of one image"):
            Optics(FOCAL, F_NUMBER, growth_along=0.1, **optics)
    chandra = load_design(shipped("trackers/chandra-aca.toml")).case.instrument
    small = replace(chandra, optics=replace(chandra.optics, growth_across=-0.6))
    with pytest.raises(Refused, match=r"must leave 0\.1 of the image"):
        psf_at(small, 0.0, 0.0)


def test_what_it_refuses(tmp_path, cube):
    path, _ = cube
    good = load_psf_file(path)
    good = replace(good, image=good.image[..., 100:121, 100:121])  # a hundredth of the file
    narrow = replace(good, image=good.image[:, :4], angle=good.angle[:4], place=good.place[:, :4])
    save_psf_file(tmp_path / "narrow.fits", narrow)
    with pytest.raises(ValueError, match="must reach the corner"):
        the_instrument(Optics(FOCAL, F_NUMBER, psf_file=str(tmp_path / "narrow.fits"))).camera  # noqa: B018
    red = replace(good, image=good.image[3:], wavelength=WAVES[3:], place=good.place[3:])
    save_psf_file(tmp_path / "red.fits", red)
    with pytest.raises(ValueError, match="must hold the wavelengths"):
        the_instrument(Optics(FOCAL, F_NUMBER, psf_file=str(tmp_path / "red.fits"))).camera  # noqa: B018
    with pytest.raises(ValueError, match="k1, k2"):
        Optics(FOCAL, F_NUMBER, psf_file=str(path), k1=0.1)
    (tmp_path / "x.txt").write_text("no page")
    assert main(["lens", "import", str(tmp_path / "x.txt")]) == 2
