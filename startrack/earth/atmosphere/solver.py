"""Radiance at sensors from particles and layers: sasktran2, wrapped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from startrack.core import Floats, nm
from startrack.earth.atmosphere.aerosol import Haze, particles, profile
from startrack.earth.atmosphere.sasktran import sasktran2
from startrack.earth.atmosphere.table import Air

TOP = 100e3  # metre, of the air
EARTH = 6371e3  # metre, mean radius
LIMB_STEP = 1e3  # metre, between the borders of spherical layers
ORBIT = 600e3  # metre, of the observer of the limb; any height above the air is equivalent
SINGLE_MOMENTS = 180  # of the phase function in single scattering, enough for its forward peak


def layers(ground: float) -> Floats:
    """Heights of the layers' borders, from the ground up, metre.

    Steps of half a kilometre give the column of molecules to 1e-4.
    """
    up = np.concatenate(
        [np.arange(0, 12e3, 500.0), np.arange(12e3, 30e3, 2e3), np.arange(30e3, TOP + 1, 5e3)]
    )
    return np.concatenate([[ground], up[up > ground + 1.0]])


def solve_radiance(
    air: Air,
    wavelength: Floats,
    ground: float,
    sun: float,
    rays: Sequence[tuple[float, float, float]],
    albedos: Sequence[float],
    streams: int = 16,
    polarised: bool = False,
) -> tuple[Floats, Floats, Floats]:
    """Radiance of scattered light over a Lambert surface, without absorption lines of gases.

    wavelength  (k,) metre
    ground      metre above the sea
    sun         1, cosine of the Sun's zenith angle
    rays        r of (cosine of the zenith angle of the sensor, azimuth from the
                Sun's, radian; height of the sensor above the sea, metre)
    albedos     a of the surface
    streams     discrete ordinates
    polarised   whether the Stokes vector is computed
    Returns     (a, k, r) 1 / sr, radiance over the Sun's irradiance; (layers,) metre and
                (k, layers) 1 / metre, extinction of air and aerosol
    Raises      ModuleNotFoundError where sasktran2 is missing.
    Accuracy    model: plane layers, good to 1 % while Sun and sensor are 15 degrees above the
                horizon. Without polarisation the light of molecules is wrong by up to 10 % at
                400 nm.
    """
    sk = sasktran2()
    heights = layers(ground)
    config = sk.Config()
    config.num_streams = streams
    config.num_stokes = 3 if polarised else 1
    config.multiple_scatter_source = sk.MultipleScatterSource.DiscreteOrdinates
    config.single_scatter_source = sk.SingleScatterSource.Exact
    config.num_singlescatter_moments = SINGLE_MOMENTS
    config.delta_m_scaling = air.aerosol != "none"
    geometry = sk.Geometry1D(
        sun,
        0.0,
        EARTH,
        heights,
        sk.InterpolationMethod.LinearInterpolation,
        sk.GeometryType.PlaneParallel,
    )
    view = sk.ViewingGeometry()
    for cosine, azimuth, height in rays:
        view.add_ray(sk.GroundViewingSolar(sun, azimuth, cosine, height))
    state = _molecules(sk, geometry, config, wavelength)
    if air.aerosol != "none":
        state["aerosol"] = _aerosol(sk, air, heights, wavelength, config.num_stokes)
    engine = sk.Engine(config, geometry, view)
    found = []
    for albedo in albedos:
        state["surface"] = sk.constituent.LambertianSurface(albedo)
        found.append(engine.calculate_radiance(state).radiance.to_numpy()[:, :, 0])
    return np.array(found), heights, np.array(state.storage.total_extinction).T


def limb_radiance(
    wavelength: Floats,
    sun: float,
    rays: Sequence[tuple[float, float]],
    albedo: float,
    aerosol: Air | Haze | None = None,
    multiple: bool = True,
) -> Floats:
    """Radiance of lines of sight through spherical layers of air, seen from space.

    wavelength  (k,) metre
    sun         1, cosine of the Sun's zenith angle where the line is nearest to the ground
    rays        r of (tangent height, metre; azimuth, radian, 0 towards the Sun)
    albedo      of the ground
    aerosol     type and visibility of Shettle and Fenn, or haze; None for molecules alone
    multiple    whether light is scattered more than once, and by the ground
    Returns     (k, r) 1 / sr, over the Sun's irradiance
    Raises      ModuleNotFoundError where sasktran2 is missing.
    Accuracy    model: multiple scattering as in a column under the tangent point, straight rays, no
                absorption by gases, no polarisation. numerical: light that is scattered once is
                within 0.5 % of an integral along the line of sight.
    """
    sk = sasktran2()
    heights = np.arange(0.0, TOP + 1, LIMB_STEP)
    config = sk.Config()
    config.num_streams = 8
    source = sk.MultipleScatterSource
    config.multiple_scatter_source = source.DiscreteOrdinates if multiple else source.NoSource
    config.single_scatter_source = sk.SingleScatterSource.Exact
    aerosol = None if aerosol == Air("none") else aerosol
    if aerosol is not None:
        config.num_singlescatter_moments = SINGLE_MOMENTS
        config.delta_m_scaling = multiple
    geometry = sk.Geometry1D(
        sun,
        0.0,
        EARTH,
        heights,
        sk.InterpolationMethod.LinearInterpolation,
        sk.GeometryType.Spherical,
    )
    view = sk.ViewingGeometry()
    for tangent, azimuth in rays:
        view.add_ray(sk.TangentAltitudeSolar(tangent, azimuth, ORBIT, sun))
    state = _molecules(sk, geometry, config, wavelength)
    if aerosol is not None:
        state["aerosol"] = _aerosol(sk, aerosol, heights, wavelength, config.num_stokes)
    state["surface"] = sk.constituent.LambertianSurface(albedo)
    found = sk.Engine(config, geometry, view).calculate_radiance(state)
    return found.radiance.to_numpy()[:, :, 0]


def _molecules(sk: Any, geometry: Any, config: Any, wavelength: Floats) -> Any:
    state = sk.Atmosphere(
        geometry, config, wavelengths_nm=wavelength / nm, calculate_derivatives=False
    )
    sk.climatology.us76.add_us76_standard_atmosphere(state)
    state["molecules"] = sk.constituent.Rayleigh()
    return state


def _aerosol(sk: Any, air: Air | Haze, heights: Floats, wavelength: Floats, stokes: int) -> Any:
    if isinstance(air, Haze):
        mixture, at_reference = air.particles(wavelength, SINGLE_MOMENTS), air.profile(heights)
    else:
        mixture = particles(air.aerosol, tuple(wavelength))
        at_reference = profile(air.visibility, heights)
    extinction = at_reference[:, None] * mixture.extinction
    shape = (SINGLE_MOMENTS, *extinction.shape)
    phase = np.broadcast_to(mixture.moments[:, :SINGLE_MOMENTS].T[:, None, :], shape)
    if stokes > 1:  # light that particles scatter is assumed to be unpolarised
        four = np.zeros((4 * SINGLE_MOMENTS, *extinction.shape))
        four[::4] = phase
        phase = four
    albedo = np.broadcast_to(mixture.albedo, extinction.shape)
    return sk.constituent.Manual(extinction, np.array(albedo), np.array(phase))
