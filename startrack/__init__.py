"""startrack designs star trackers and other opto-electronic space cameras before they are built.

It follows the light. From the ground up:

units, checks, shipped, seeds, streams, scratch   units, refusals, data, chance, memory
dates                                             dates by the tables that are installed
curve, turns, camera, values                      the words that all rooms share
exits, saving, sqlite, tables                     how programs end, how files are written and read

catalog          which stars are there            -> Stars
scene            what light arrives               -> Light
optics           how a point is blurred           -> Psf
motion           how it moves in an exposure      -> Path
detector         photons into numbers             -> Frame
detection        numbers into spots               -> Spots
identification   spots into catalogue stars       -> Matches
attitude         matches into an attitude         -> Estimate
error            the estimate against the truth   -> Outcome, Summary

wcs, images      attitudes and frames as files
case             Case: what is true and what the tracker believes
view             what stands before the detector
single           what the tracker makes of single stars, and how far it trusts them
sweep            images of lines that scan, and their spots as a matrix's
window           trials that render only windows of the frame
covariance       trials that draw their spots, without an image
chain            one trial, one line a room
products         detectors that a design may name
imager           the images of Earth cameras
sequence         trials in time: tracking, loss and reacquisition
variance         more knowledge from fewer trials
budget           what the error is made of, cause by cause, with trials and without
study            many trials, better designs, tolerances
campaign         many trials, on disk as they are done, until they say enough
design           designs as TOML files
draw, draw_psf, draw_earth, draw_sequence, draw_budget, draw_study   pictures
report           a campaign as one page
benchmark        how long each stage takes, and how wrong it is
commands, cli    the command `startrack`

Public is what `__init__.pyi` names, and what the packages among that list in their `__all__`
(docs/api.md). All else is the house's own and may change without notice.
"""

import lazy_loader

__version__ = "0.1.0"

# One list for type checkers and for Python, each name loaded when it is asked for.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
