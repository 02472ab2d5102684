"""The base of all rooms: units, values, camera, rotations, random streams, checks.

units      Units as SI floats, constants with their source; `"50 mm"` and dates at the border.
arrays     Types of arrays and of a progress; within kernels order, median and place of values.
kernel     A function enters; compiled code leaves, kept in a folder named by a hash of all sources.
checks     The few ways to refuse a parameter: each names the parameter, the rule and the value;
           Refused, a value that breaks a rule, which is not a fault of the program.
memory     Bytes that a step needs -> refused, with the number, if they exceed the limit; cached
           values: values that take long to compute, arrays of a plan.
streams    Seed, trial, cause -> random generator, the same for any number of workers.
extension  Name of a function in a design -> that function, if its code may run, and its origin.
declared   A class of parameters -> each field as it is declared: type, unit, range, meaning,
           default.
interpolation  Values at nodes -> values between them: on a line, over wavelength (Curve), over a
           frame (Displacement).
compiler   Kernels -> machine code, once for each kernel that Python calls; optional, because it
           uses names that numba does not publish.
interpret  Kernels that are not yet compiled -> their results by Python, while that is faster.
rotations  Rotation matrices: from pairs of directions, turned, applied, as quaternions; in
           compiled code.
camera     Direction to pixel and pixel to direction, both ways together: OpenCV's distortion, a
           polynomial over the field.
values     The nouns that flow from room to room; every array has its shape and unit here.
printing   A result -> its text, which fits one screen, and its table in a notebook; with units.
field_psf  FieldPsf: the images of points over a frame and over colour, as sums of a few tables.
variates   Random variates for compiled code: bits of a counter, normal and Poisson quantiles.
"""

from startrack.core.arrays import (
    Advance,
    Flags,
    Floats,
    Ints,
    Rows,
    Singles,
    assign,
    first_not_below,
    median,
    order,
    read_only,
)
from startrack.core.camera import Camera, FieldPolynomial, distort, monomials, plane_slopes
from startrack.core.checks import (
    LARGEST_NUMBER,
    Refused,
    finite,
    moderate,
    non_negative,
    of_file,
    one_of,
    optional_package,
    positive,
    shown,
    whole,
    within,
)
from startrack.core.declared import (
    FILE,
    FINITE,
    NON_NEGATIVE,
    NUMBER_OR_TEXT,
    POSITIVE,
    CarriesCode,
    Field,
    FileState,
    Parameters,
    Range,
    bare,
    code_in,
    described,
    fields_of,
    inputs_of,
    parameter,
    unit_of,
)
from startrack.core.extension import (
    POINTS,
    SHIPPED,
    Code,
    allow_code,
    call_code,
    code_of_command,
    file_digest,
    is_code,
    origin_of,
    require_code,
    returned,
    software,
    used_code,
)
from startrack.core.field_psf import LEAST, FieldPsf
from startrack.core.interpolation import (
    ALL,
    NODES,
    Curve,
    Displacement,
    Samples,
    bilinear,
    lagrange_weights,
    local_weights,
    map_displacement,
    map_weights,
    means_around,
    node_places,
    quadrature,
)
from startrack.core.interpret import instead_of, interpreted, interpreting
from startrack.core.kernel import (
    READY,
    compiling_reports,
    is_ready,
    kernel,
    kernel_folder,
    private_folder,
    trusted,
)
from startrack.core.memory import (
    Kept,
    Workspace,
    begin_limited,
    bytes_of,
    gib,
    kept,
    limited_memory,
    memory_limit,
    require_memory,
)
from startrack.core.printing import html_table, printed
from startrack.core.rotations import axes_of_pair, quaternion, ra_dec, rotated, rotation_of, turn_by
from startrack.core.streams import Streams
from startrack.core.units import (
    BOLTZMANN,
    DAY,
    GALACTIC_POLE,
    GOLDEN_ANGLE,
    LIGHT_SPEED,
    PLANCK,
    SIDEREAL_YEAR,
    TROPICAL_YEAR,
    YEAR,
    ZERO_CELSIUS,
    Unit,
    arcsec,
    deg,
    fraction,
    installed_tables,
    mm,
    nm,
    parse,
    um,
    utc,
    utc_text,
    write,
)
from startrack.core.values import (
    DiffuseLight,
    Estimate,
    Frame,
    Light,
    LineOfSight,
    Matches,
    Psf,
    PsfTable,
    Spots,
    Stars,
    Status,
    StrayLightSource,
)
from startrack.core.variates import GOLDEN, bits, inverse_normal, mixed, poisson_of_uniform, uniform

# Public; the other imports serve other rooms.
__all__ = [
    "Curve",
    "DiffuseLight",
    "Displacement",
    "FieldPolynomial",
    "FieldPsf",
    "LineOfSight",
    "StrayLightSource",
]
