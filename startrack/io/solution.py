"""A solved image -> FITS files as astrometry.net writes them, and values by the names of tetra3."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Estimate, Floats, Matches, Spots, Stars, arcsec
from startrack.io.saving import whole
from startrack.io.wcs import celestial, wcs_header


def write_solution(
    path: Path, spots: Spots, shape: tuple[int, int], matches: Matches, stars: Stars
) -> list[Path]:
    """Write spots, matches and the WCS of an image as astrometry.net does.

    PATH.axy    spots, brightest first: X, Y, FLUX, SNR
    PATH.corr   matches: field_x, field_y, field_ra, field_dec of the spot, index_x, index_y,
                index_ra, index_dec, index_id of the star, field_id of the spot, FLUX, MAG_G
    PATH.wcs    header with the WCS; distortion as SIP
    Pixels count from (1, 1), as in FITS, angles in degree; index_id is the star's identifier in its
    catalogue, field_id the row of the spot from 0.

    path     without its ending
    shape    rows and columns of the image
    stars    the catalogue that `matches.star` is of
    Returns  the files: without an attitude, PATH.axy alone
    Raises   ValueError where no SIP polynomial follows the distortion.
    """
    from astropy.io import fits

    column = {"X": spots.x + 1, "Y": spots.y + 1, "FLUX": spots.flux, "SNR": spots.snr}
    written = [_save(path.with_name(f"{path.name}.axy"), [_table(column, shape)])]
    if matches.icrs_to_camera is None:
        return written
    attitude, camera = matches.icrs_to_camera, matches.camera
    seen = np.column_stack([spots.x, spots.y])[matches.spot]
    toward = attitude.inv().apply(camera.unproject(seen))
    place = camera.project(attitude.apply(matches.direction))
    field, index = _degrees(toward), _degrees(matches.direction)
    matched: dict[str, NDArray[Any]] = {
        "field_x": seen[:, 0] + 1,
        "field_y": seen[:, 1] + 1,
        "field_ra": field[:, 0],
        "field_dec": field[:, 1],
        "index_x": place[:, 0] + 1,
        "index_y": place[:, 1] + 1,
        "index_ra": index[:, 0],
        "index_dec": index[:, 1],
        "index_id": stars.identifier[matches.star],
        "field_id": np.asarray(matches.spot),
        "FLUX": spots.flux[matches.spot],
        "MAG_G": stars.magnitude_g[matches.star],
    }
    written.append(_save(path.with_name(f"{path.name}.corr"), [_table(matched, shape)]))
    header = wcs_header(camera, attitude)
    header["IMAGEW"], header["IMAGEH"] = shape[1], shape[0]
    written.append(_save(path.with_name(f"{path.name}.wcs"), [fits.PrimaryHDU(header=header)]))
    return written


def _table(column: dict[str, Any], shape: tuple[int, int]) -> Any:
    from astropy.io import fits

    columns = [
        fits.Column(name, "K" if np.issubdtype(one.dtype, np.integer) else "D", array=one)
        for name, one in column.items()
    ]
    table = fits.BinTableHDU.from_columns(columns)
    table.header["IMAGEW"], table.header["IMAGEH"] = shape[1], shape[0]
    return table


def _save(path: Path, parts: list[Any]) -> Path:
    from astropy.io import fits

    if not isinstance(parts[0], fits.PrimaryHDU):
        parts = [fits.PrimaryHDU(), *parts]
    with whole(path) as draft, draft.open("wb") as file:
        fits.HDUList(parts).writeto(file)
    return path


def _degrees(direction: Floats) -> Floats:
    x, y, z = direction.T
    ra = np.degrees(np.arctan2(y, x)) % 360
    return np.column_stack([ra, np.degrees(np.arctan2(z, np.hypot(x, y)))])


def tetra3_values(
    spots: Spots, matches: Matches, estimate: Estimate, axis: Rotation | None, stars: Stars
) -> dict[str, Any]:
    """The result of an image by the names that tetra3 gives it (its `solve_from_centroids`).

    RA, Dec, Roll and FOV (across the columns) are in degree, RMSE in arcsec; Roll is the angle from
    the image's up to the celestial north, counter-clockwise; Prob bounds the probability of a false
    match; matched_centroids are (row, column), where the first pixel has its centre at (0.5, 0.5);
    matched_stars are (RA, Dec, G). Without an attitude all but Matches is None.

    axis   attitude whose axis counts; None without one
    """
    names = ("RA", "Dec", "Roll", "FOV", "RMSE", "Prob")
    if axis is None or estimate.icrs_to_camera is None:
        nothing: dict[str, Any] = dict.fromkeys(names)
        lists = ("matched_centroids", "matched_stars", "matched_catID")
        return nothing | {"Matches": 0} | dict.fromkeys(lists)
    ra, dec, roll = celestial(axis)
    camera: Camera = matches.camera
    place = np.column_stack([spots.y, spots.x])[matches.spot] + 0.5
    g = stars.magnitude_g[matches.star]
    return {
        "RA": ra,
        "Dec": dec,
        "Roll": roll,
        "FOV": float(np.degrees(camera.fov_x)),
        "RMSE": float(estimate.residual_rms / camera.focal_length_px / arcsec),
        "Prob": float(estimate.false_probability),
        "Matches": int(estimate.stars),
        "matched_centroids": place.tolist(),
        "matched_stars": np.column_stack([_degrees(matches.direction), g]).tolist(),
        "matched_catID": stars.identifier[matches.star].tolist(),
    }
