"""startrack designs star trackers and other opto-electronic space cameras before they are built.

The rooms, in the order of the light's path; each imports only rooms above it:

core             common parts of all rooms: units, values, camera, rotations, random streams, checks
io               design tables, images, WCS, SQLite, atomic writes, shipped data
space            orbits, Sun, Moon and planets, the Earth's limb: for scene, mission and earth

catalog          which stars are there            -> Stars
scene            Stars, bodies and sky -> arriving Light
optics           how a point is blurred           -> Psf
motion           how the line of sight moves      -> line of sight in an exposure
detector         photons into numbers             -> Frame
detection        numbers into spots               -> Spots
identification   spots into catalogue stars       -> Matches
attitude         matches into an attitude         -> Estimate
metrics          the estimate against the truth   -> Outcome, Summary

problem          interface for searches: costs, a forecast, trials, a judgement
design           Instrument, Tracker, Scene, campaign: the contents of a design file
observation      inputs of an exposure: stars, images, attitude and motion; the tracker's belief
response         how one star is measured: its errors, and its chance of being detected
trial            one trial in any fidelity: frame, window, spots, covariance
photograph       images of unknown cameras: their attitude and lens
population       units of a design: draws, calibrations, and fast trials over many
sequence         trials in time: tracking, loss, reacquisition
montecarlo       many trials: workers, store, resume, variance reduction
budget           the error, cause by cause
verification     whether a design meets its requirements, by analysis and by trials
optimise         better designs: search, Pareto front, sensitivity, tolerances
prediction       errors of a design with values that are not known, with intervals
calibration      camera and detector from data
mission          heads on a spacecraft, its orbit and attitude law, over years
onboard          guide stars and triangles of a design, for its flight software
earth            Earth cameras: terrain, geometry in flight, atmosphere, imager, products
moving           moving objects: images of one field -> objects that move
plots            pictures
report           a campaign as one page
page             the local page of a design, in a browser
benchmark        CPU time and error of every stage
cli              the command `startrack`

`trial/chain.py` has one line per room. Public are the names in `__init__.pyi`, and those that the
packages named there list in their `__all__` (docs/api.md). All else may change without notice.
"""

from pathlib import Path

import lazy_loader

__version__ = "0.1.0"

# One list for type checkers and for Python; each name is loaded when it is first used, each room,
# too, which is no name of the package itself.
__getattr__, _, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = [name for name in _names if not Path(__file__).with_name(name).is_dir()]


def __dir__() -> list[str]:
    return __all__
