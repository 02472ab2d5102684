"""Optics: the image of a star. Optics become a Psf.

parameters    Optics: focal length, aperture, aberrations, blur, transmission, choice of the PSF.
pupil         Shape of the aperture, and the Zernike polynomials of wavefront errors in it.
diffraction   Diffraction of any pupil by fast transforms; closed forms of an ideal lens, a blur, a
              pixel.
choose        Optics -> the complex pupil of each diffraction model; the cheapest model within a
              tolerance.
aperture_transfer  Optics -> MTF of an aperture of any shape and phase; the Wiener filter.
pixel_psf     Optics -> Psf: the fraction of the light in each pixel, for any sub-pixel position.
lens_family   Family, focal length, f-number -> the LensTable of a lens of that family.
measured_psf  Images of stars -> their common oversampled Psf.
psf_file      PsfFile: measured or exported images of a point, over field and wavelength; their
              file.
quality       Psf -> figures of merit: transfer at Nyquist, energies, widths.
lens_table    LensTable: wavefront, place, pupil and area of a lens over temperature, wavelength and
              field; its file.
field_images  Images at places and wavelengths -> the FieldPsf of a frame, and the camera of places.
zemax_text    Text that Zemax saves -> a PsfFile of Huygens PSFs, a LensTable of wavefront maps.
lens_psf      Optics with a lens table -> the camera that fits it, and the FieldPsf of a detector.
surfaces      Surfaces: radii, spaces, glasses and clear apertures of a lens, in the file of its
              table.
prescription  File of Zemax, CODE V or optiland -> the lens of optiland, in millimetre.
ray_trace     Lens of optiland -> its LensTable, by rays of the program optiland (extra `lens`).
ghosts        Light -> Light: ghosts of bright sources by two reflections in the lens, as diffuse
              light.
as_built      Surfaces of a lens -> displacements of stars by small alignment errors of its
              elements.
residual      Residual: displacements of stars that no camera model describes, by their causes.
baffle        Light -> Light: stray light of Sun, Moon and Earth past the baffle, as diffuse light;
              geometry of a baffle with vanes -> its point-source transmittance, mass and size.
"""

from startrack.optics.aperture_transfer import aperture_transfer, wiener_filter
from startrack.optics.baffle import Baffle, BaffleTube, stray_light, transmittance_of
from startrack.optics.choose import PsfChoice, choose, path_defect
from startrack.optics.diffraction import (
    airy,
    blur_transfer,
    intensity,
    pixel_transfer,
    pupil_samples,
    pupil_transfer,
)
from startrack.optics.field_images import COARSE, camera_of_cube, cube_psf, grown_psf, mirrored
from startrack.optics.ghosts import (
    Ghosts,
    add_ghosts,
    full_surfaces,
    ghost_map,
    lens_surfaces,
    pairs,
    reflectances,
    save_ghosts,
)
from startrack.optics.lens_family import element_count
from startrack.optics.lens_psf import (
    ROOM,
    ColourBand,
    LensImages,
    band_of,
    field_psf,
    fit_camera,
    lens_stars,
    open_optics,
)
from startrack.optics.lens_table import (
    LensTable,
    interpolation_error,
    lens_path,
    load_lens,
    open_lens,
    save_lens,
)
from startrack.optics.measured_psf import brightest, file_of, lone_stars, reconstruct
from startrack.optics.parameters import Optics, with_plain_optics
from startrack.optics.pixel_psf import PsfInput, over_field, pixel_psf
from startrack.optics.prescription import parse_prescription, read_prescription
from startrack.optics.psf_file import PsfFile, load_psf_file, open_psf_file, save_psf_file
from startrack.optics.pupil import Aberration, Pupil, Segment, area_weights, pupil_grid, zernike
from startrack.optics.quality import BLOCKS, POINT, RADII, Quality, modulation, quality
from startrack.optics.ray_trace import Tracing, surfaces_of, trace_lens
from startrack.optics.residual import Residual
from startrack.optics.surfaces import Surfaces, open_surfaces, save_surfaces
from startrack.optics.zemax_text import holds_wavefronts, psfs_of_pages, table_of_pages

# Public; the other imports serve other rooms.
__all__ = [
    "Aberration",
    "Baffle",
    "BaffleTube",
    "Ghosts",
    "LensTable",
    "Optics",
    "PsfFile",
    "PsfInput",
    "Pupil",
    "Residual",
    "Segment",
    "aperture_transfer",
    "choose",
    "over_field",
    "pixel_psf",
    "wiener_filter",
]
