"""Camera and detector from data: least squares (of `startrack.attitude`) and emcee.

star_table       Table of stars (CSV, FITS, VOTable) -> their directions, pixels and temperatures.
field            Table of stars -> fitted cameras of several orders, and the order that the stars
                 support.
psf_width        Frames, spots -> the likelihood of each width of the PSF.
posterior        Identified spots of one camera -> samples of its camera model (emcee).
photon_transfer  Flat and dark frames -> samples of the detector's constants
                 (emcee).
"""

from startrack.attitude import UNKNOWNS, Calibrated, Calibration, calibrate
from startrack.calibration.field import (
    OUTLIER,
    FieldFit,
    Order,
    Unseen,
    assumed_array,
    cross_validate_all,
    fit_attitude,
    fit_field,
    orders_of,
    residuals,
    supported_order,
)
from startrack.calibration.photon_transfer import Level, sample_detector
from startrack.calibration.posterior import CameraPosterior, Prior, sample_camera
from startrack.calibration.star_table import Names, StarTable, is_star_table, read_star_table

# Public; the other imports serve other rooms.
__all__ = [
    "Calibration",
    "Level",
    "Names",
    "Prior",
    "calibrate",
    "cross_validate_all",
    "fit_attitude",
    "fit_field",
    "read_star_table",
    "sample_camera",
    "sample_detector",
]
