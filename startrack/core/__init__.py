"""What all rooms share: units, values, camera, rotations, random streams, checks.

units      Units as SI floats, constants with their source, and `"50 mm"` read and written at the
           border.
arrays     Types of arrays, for annotations and for kernels.
kernel     A function enters; compiled code leaves, kept in a folder named by a hash of all sources.
trust      Path of a cache -> whether this process may compute with what it holds.
refused    Refused: a value that breaks a rule, which is no fault of the program.
checks     The few ways to refuse a parameter: each names the parameter, the rule and the value.
memory     Bytes that a step needs -> refused, with the figure, where they exceed the limit.
keeping    Values that take long to compute -> kept, as long as all that are kept take a share of
           memory.
streams    Seed, trial, cause -> random generator, the same for any number of workers.
scratch    Large arrays that a plan keeps between calls: a new one costs more than a few windows
           in it.
extension  Name of a function in a design -> that function, where its code may run, and its origin.
declared   A class of parameters -> each field as it is declared: type, unit, range, meaning,
           default.
curve      A dimensionless curve over wavelength, such as a transmission or a quantum efficiency.
compiler   Kernels -> machine code, once for each kernel that Python calls; optional, for it uses
           names that numba does not publish.
interpret  Kernels that are not compiled yet -> their results by Python, for as long as it pays.
order      Order, median and place of values, within kernels.
rotations  Rotation matrices -> quaternions and scipy's Rotations, in compiled code.
field_polynomial  A place in the image plane and a temperature -> how far it is moved.
camera     Direction to pixel and pixel to direction, both ways together, with OpenCV's
           distortion.
notebook   Names and values -> a short text, and a table of HTML for notebooks.
values     The nouns that flow from room to room; every array has its shape and unit here.
field_psf  FieldPsf: the images of points over a frame and over colour, as sums of a few tables.
lagrange   Nodes and places -> weights of the values at the nodes, by polynomials through them.
displacement  Displacement: a smooth field of displacements over a frame, by values at nodes.
dates      Date as text -> astropy Time, converted with the installed tables.
variates   Random variates for compiled code: bits of a counter, normal and Poisson quantiles.
"""

from startrack.core.arrays import Floats, Ints, read_only
from startrack.core.camera import Camera, distort, plane_slopes
from startrack.core.checks import (
    LARGEST_NUMBER,
    finite,
    moderate,
    non_negative,
    one_of,
    positive,
    refusal,
    shown,
    whole,
    within,
)
from startrack.core.curve import ALL, Curve
from startrack.core.dates import installed_tables, utc
from startrack.core.declared import (
    FINITE,
    NON_NEGATIVE,
    NUMBER_OR_TEXT,
    POSITIVE,
    CarriesCode,
    Field,
    Parameters,
    Range,
    bare,
    code_in,
    fields_of,
    unit_of,
)
from startrack.core.displacement import NODES, Displacement, node_places
from startrack.core.extension import (
    POINTS,
    Code,
    allow_code,
    call_code,
    code_of_command,
    full_name,
    is_code,
    one_of_or_code,
    origin_of,
    require_code,
    returned,
    used_code,
)
from startrack.core.field_polynomial import FieldPolynomial, monomials
from startrack.core.field_psf import LEAST, FieldPsf
from startrack.core.interpret import instead_of, interpreted
from startrack.core.keeping import Kept, KeptFunction, kept
from startrack.core.kernel import (
    READY,
    compiling_reports,
    in_folder,
    is_ready,
    kernel,
    kernel_folder,
)
from startrack.core.lagrange import lagrange_weights, local_weights
from startrack.core.memory import (
    GIB,
    begin_limited,
    gib,
    limited_memory,
    machine_memory,
    memory_limit,
    require_memory,
)
from startrack.core.notebook import html_table, short_text
from startrack.core.order import first_not_below, median, order
from startrack.core.refused import Refused, WrongType
from startrack.core.rotations import quaternion, rotation_of
from startrack.core.scratch import Workspace
from startrack.core.streams import Streams
from startrack.core.trust import private_folder, trusted
from startrack.core.units import (
    BOLTZMANN,
    GALACTIC_POLE,
    GOLDEN_ANGLE,
    LIGHT_SPEED,
    PLANCK,
    ZERO_CELSIUS,
    Unit,
    arcsec,
    deg,
    fraction,
    mm,
    nm,
    parse,
    um,
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
    Spots,
    Stars,
    Status,
    StrayLightSource,
)
from startrack.core.variates import (
    GOLDEN,
    bits,
    inverse_normal,
    mixed,
    poisson_of_uniform,
    poisson_quantile,
    uniform,
)

# Public; the other imports serve other rooms.
__all__ = ["poisson_quantile"]
