"""Camera and detector from data: least squares and emcee.

camera           Identified frames of one camera enter; the camera that explains them all leaves.
psf_width        Frames and the spots in them enter; how likely each width of the PSF is leaves.
posterior        Identified spots of one camera enter; samples of what that camera may be leave
                 (emcee).
photon_transfer  Frames of even light and of darkness enter; samples of the detector's constants
                 leave (emcee).
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
