"""Camera and attitude as a FITS world coordinate system; a solved image as others write it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    Estimate,
    Floats,
    Matches,
    Spots,
    Stars,
    arcsec,
    finite,
    ra_dec,
    within,
)
from startrack.io.saving import whole

if TYPE_CHECKING:
    from astropy.io.fits import Header
    from astropy.wcs import WCS

SIP_ORDERS = (3, 5, 7, 9)
SIP_TOLERANCE = 5e-4  # pixel


def camera_to_wcs(camera: Camera, icrs_to_camera: Rotation) -> WCS:
    """The gnomonic (TAN) WCS of a frame; distortion goes into SIP polynomials.

    A pinhole is a gnomonic projection, so that without distortion the two are the same to
    rounding. FITS counts pixels from one; astropy's 0-based calls take that away again.

    Raises  ValueError if no polynomial of order 9 follows the distortion within 5e-4 pixel.
    """
    from astropy.wcs import WCS

    return WCS(wcs_header(camera, icrs_to_camera))


def wcs_header(camera: Camera, icrs_to_camera: Rotation) -> Header:
    """`camera_to_wcs` as the cards of a FITS header. Raises as that.

    Source: Calabretta and Greisen (2002), Astron. Astrophys. 395, 1077; Shupe et al. (2005), ASP
    Conf. Ser. 347, 491, for SIP.
    """
    from astropy.io.fits import Header  # astropy.wcs would load its coordinates and tables: 0.2 s

    ((east, north),), (sky,) = _tangent(icrs_to_camera.as_matrix()[None])
    kind = "-SIP" if camera.distorted else ""
    # The default of LONPOLE is zero where the boresight is the pole itself.
    cards: dict[str, float | str] = {"WCSAXES": 2, "RADESYS": "ICRS", "LONPOLE": 180.0}
    for axis, name, value, row in zip(
        "12", ("RA---TAN", "DEC--TAN"), sky, (east, north), strict=True
    ):
        cards[f"CTYPE{axis}"] = name + kind
        cards[f"CUNIT{axis}"] = "deg"
        cards[f"CRVAL{axis}"] = float(value)
        cards[f"CRPIX{axis}"] = float(camera.centre[int(axis) - 1] + 1)
        for column, slope in zip("12", np.degrees(row) / camera.focal_length_px, strict=True):
            cards[f"CD{axis}_{column}"] = float(slope)
    if camera.distorted:
        forward, inverse = _sip(camera)
        for letter, table in zip(("A", "B", "AP", "BP"), (*forward, *inverse), strict=True):
            cards[f"{letter}_ORDER"] = len(table) - 1
            cards |= {f"{letter}_{p}_{q}": float(table[p, q]) for p, q in np.argwhere(table)}
    return Header(cards)


def celestial(icrs_to_camera: Rotation) -> tuple[float, float, float]:
    """Right ascension and declination of the boresight, and roll, in degree.

    Roll is the angle from the image's up (-y) to celestial north, counter-clockwise, in
    [0, 360).
    """
    ra, dec, roll = celestials(icrs_to_camera.as_matrix()[None])[0].tolist()
    return ra, dec, roll


def celestials(axes: Floats) -> Floats:
    """`celestial` (n, 3) of many attitudes, given as matrices (n, 3, 3)."""
    east_north, direction = _tangent(axes)
    north_x, north_y = east_north[:, 1].T
    roll = np.degrees(np.arctan2(-north_x, -north_y)) % 360
    roll[roll >= 360] = 0.0  # to which the remainder of -1e-15 is rounded
    return np.column_stack([direction, roll])


def pointing(ra: float, dec: float, roll: float) -> Rotation:
    """The attitude icrs_to_camera of angles in degree as `celestial` gives them.

    Raises  Refused for a declination beyond a pole, or an angle that is no finite number.
    """
    finite(ra=ra, roll=roll)
    within(-90, 90, dec=dec)
    ra_, dec_ = np.radians(ra), np.radians(dec)
    boresight = np.array([np.cos(dec_) * np.cos(ra_), np.cos(dec_) * np.sin(ra_), np.sin(dec_)])
    east = np.array([-np.sin(ra_), np.cos(ra_), 0.0])
    north = np.cross(boresight, east)
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    return Rotation.from_matrix([-c * east - s * north, s * east - c * north, boresight])


def _tangent(axes: Floats) -> tuple[Floats, Floats]:
    """East and north at the boresights as rows over camera (x, y), and RA and Dec in degree.

    axes     (n, 3, 3) matrices icrs_to_camera
    Returns  (n, 2, 2), (n, 2)
    """
    x, y, z = axes[:, 2].T
    ra, dec = np.arctan2(y, x) % (2 * np.pi), np.arctan2(z, np.hypot(x, y))
    east = np.column_stack([-np.sin(ra), np.cos(ra), np.zeros(len(ra))])
    rows = np.stack([east, np.cross(axes[:, 2], east)], axis=1) @ axes[:, :2].transpose(0, 2, 1)
    return rows, np.degrees(np.column_stack([ra, dec]))


def _sip(camera: Camera) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Polynomials (A, B) from distorted to plain offsets, and (AP, BP) back."""
    x, y = np.meshgrid(
        np.linspace(-0.5, camera.columns - 0.5, 41), np.linspace(-0.5, camera.rows - 0.5, 41)
    )
    seen = np.column_stack([x.ravel(), y.ravel()])
    direction = camera.unproject(seen)
    seen = seen - camera.centre
    plain = direction[:, :2] / direction[:, 2:] * camera.focal_length_px
    return _fit(seen, plain), _fit(plain, seen)


def _fit(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    scale = np.abs(source).max()
    u, v = (source / scale).T
    for order in SIP_ORDERS:
        powers = [(p, q) for p in range(order + 1) for q in range(order + 1 - p) if p + q > 0]
        terms = np.column_stack([u**p * v**q for p, q in powers])
        solution, *_ = np.linalg.lstsq(terms, target - source, rcond=None)
        worst = np.abs(terms @ solution - (target - source)).max()
        if worst < SIP_TOLERANCE:
            break
    else:
        raise ValueError(
            f"the distortion must follow a polynomial of order {SIP_ORDERS[-1]} within "
            f"{SIP_TOLERANCE} pixel to be written to FITS, it is off by {worst:.2g} pixel"
        )
    result = np.zeros((2, order + 1, order + 1))
    for (p, q), pair in zip(powers, solution, strict=True):
        result[:, p, q] = pair / scale ** (p + q)
    return result[0], result[1]


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
    Raises   ValueError if no SIP polynomial follows the distortion.
    """
    from astropy.io import fits

    written = list[Path]()

    def save(kind: str, *parts: Any) -> None:
        header = parts[-1].header
        header["IMAGEW"], header["IMAGEH"] = shape[1], shape[0]
        written.append(path.with_name(f"{path.name}.{kind}"))
        with whole(written[-1]) as draft, draft.open("wb") as file:
            fits.HDUList(list(parts)).writeto(file)

    column = {"X": spots.x + 1, "Y": spots.y + 1, "FLUX": spots.flux, "SNR": spots.snr}
    save("axy", fits.PrimaryHDU(), _table(column))
    if matches.icrs_to_camera is None:
        return written
    attitude, camera = matches.icrs_to_camera, matches.camera
    seen = np.column_stack([spots.x, spots.y])[matches.spot]
    toward = attitude.inv().apply(camera.unproject(seen))
    place = camera.project(attitude.apply(matches.direction))
    field, index = ra_dec(toward), ra_dec(matches.direction)
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
    save("corr", fits.PrimaryHDU(), _table(matched))
    save("wcs", fits.PrimaryHDU(header=wcs_header(camera, attitude)))
    return written


def _table(column: dict[str, Any]) -> Any:
    from astropy.io import fits

    columns = [
        fits.Column(name, "K" if np.issubdtype(values.dtype, np.integer) else "D", array=values)
        for name, values in column.items()
    ]
    return fits.BinTableHDU.from_columns(columns)


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
    if axis is None or estimate.icrs_to_camera is None:
        names = ("RA", "Dec", "Roll", "FOV", "RMSE", "Prob", "Matches")
        lists = ("matched_centroids", "matched_stars", "matched_catID")
        return dict.fromkeys((*names, *lists)) | {"Matches": 0}
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
        "matched_stars": np.column_stack([ra_dec(matches.direction), g]).tolist(),
        "matched_catID": stars.identifier[matches.star].tolist(),
    }
