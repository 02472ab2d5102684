"""Camera and detector from data: least squares and emcee.

camera           Identified frames of one camera -> the camera model that fits them all.
psf_width        Frames, spots -> the likelihood of each width of the PSF.
posterior        Identified spots of one camera -> samples of its camera model (emcee).
photon_transfer  Flat and dark frames -> samples of the detector's constants
                 (emcee).
"""

from startrack.calibration.camera import UNKNOWNS, Calibrated, Calibration, calibrate
from startrack.calibration.photon_transfer import DetectorPosterior, Level, sample_detector
from startrack.calibration.posterior import CameraPosterior, Prior, sample_camera

# Public; the other imports serve other rooms.
__all__ = [
    "Calibrated",
    "Calibration",
    "CameraPosterior",
    "DetectorPosterior",
    "Level",
    "Prior",
    "calibrate",
    "sample_camera",
    "sample_detector",
]
