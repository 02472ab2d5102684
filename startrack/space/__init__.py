"""Positions and temperatures around the Earth: orbits, Sun, Moon, planets, the Earth's limb.

earth    Size, gravity and spin of the Earth; place and line of sight -> angle to its limb; products
         of many vectors that lie component by component.
bodies   Dates -> Sun, Moon, planets and axes of the Earth: one at a time, and as tables.
horizon  Place on the Earth -> the axes of its horizon; temperature and refraction of the air.
orbit    Elements, two-line elements or a table of states -> position and velocity over time.
heat     Orbit, Sun and surfaces -> temperatures of a platform and of heads on it.
radiation  Orbit and shielding -> particles of the belts and of the Sun behind it, their dose.
electrons  Electrons around a sphere of aluminium -> electrons and photons at its centre.
"""

from startrack.space.bodies import (
    AU,
    FIRST_YEAR,
    J2000,
    LAST_YEAR,
    PLANETS,
    Bodies,
    Body,
    barycentric,
    bodies_of,
    body_states,
    distance_to_sun,
    moon_position,
    rotation_matrices,
    seen_from,
    sun_direction,
    to_itrs,
)
from startrack.space.earth import (
    EARTH_RADIUS,
    FLATTENING,
    GM,
    POLAR_RADIUS,
    SPIN,
    SQUARED_ECCENTRICITY,
    EarthSeen,
    angle,
    cross,
    dot,
    geodetic_latitude,
    times,
    unit,
)
from startrack.space.heat import (
    STEFAN,
    Heat,
    incident,
    march,
    orbit_temperatures,
    taken_by_head,
    taken_by_platform,
)
from startrack.space.horizon import horizon_axes, refraction, standard_temperature
from startrack.space.orbit import (
    Carrier,
    Kepler,
    Sgp4,
    Tabulated,
    element_record,
    node_at,
    orbit_direction,
    propagate,
    require_perigee,
    require_two_lines,
    segment_of,
    sun_synchronous,
    two_line_record,
)
from startrack.space.radiation import (
    Protons,
    hit_map,
    solar_protons,
    trapped_electrons,
    trapped_protons,
)

# Public; the other imports serve other rooms.
__all__ = ["Heat"]
