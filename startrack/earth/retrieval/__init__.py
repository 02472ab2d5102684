"""Retrievals of Earth cameras: quantities derived from images, with errors by formula and by
trials.

texture        Texture of a land -> its power spectrum, and realisations of it.
patch          A channel's image of level ground straight below, with fires.
context        Images in two channels -> excess of each pixel over its surroundings.
fire           Excess radiance of a fire -> its radiative power, temperature and area.
hot_spots      HotSpots: detection of fires and their radiative power; a trial of both.
fire_forecast  The smallest detectable fire, and the error of its power, by formula.
minerals       Minerals: thermal spectra -> temperature, emissivity, Christiansen feature, class.
spectrum       The spectrum of level ground at the sensor, and the rectangle of each band.
stereo         Stereo: heights from two images along the track; their forecast and trials.
land_cover     LandCover: reflectance, an index and classes of land; their forecast and trials.
sea            A sea of wind waves -> the spectrum of its elevation, and its slopes.
glint          Waves of random slopes -> the brightness of their glint, and the scatter of its
squares.
waves          Waves: height and direction of waves in the glint; their forecast and trials.
views          A trial of a retrieval -> its images, truth and result beside each other, and words.
criteria       Criteria of each retrieval: names, values by formula and values by trials.
study          EarthDesign: a scene with its camera, retrieval and campaign; reads them from a file.
keys           The keys of a scene file, as a list and as a JSON Schema.
problem        EarthProblem: an Earth camera's interface for searches, samples and tests.
"""

from startrack.earth.retrieval.fire import (
    power_coefficient,
    power_of,
    radiated_power,
    temperature_and_area,
)
from startrack.earth.retrieval.fire_forecast import FireForecast, forecast_fires
from startrack.earth.retrieval.hot_spots import (
    HotSpots,
    false_alarms,
    image_of,
    measure,
    smallest_areas,
    views_of,
)
from startrack.earth.retrieval.keys import scene_keys, scene_schema
from startrack.earth.retrieval.land_cover import (
    LandCover,
    LandForecast,
    classify_land,
    forecast_land,
    index_of,
    observe_land,
)
from startrack.earth.retrieval.minerals import (
    MineralForecast,
    Minerals,
    forecast_minerals,
    identify_minerals,
    library,
    observe_minerals,
    spectrometer_of,
)
from startrack.earth.retrieval.problem import EarthProblem
from startrack.earth.retrieval.sea import (
    Sea,
    developed_sea,
    draw_sea,
    elevation_power,
    slope_variance,
)
from startrack.earth.retrieval.spectrum import GroundSpectrum, Rectangle, ground_spectrum
from startrack.earth.retrieval.stereo import (
    Stereo,
    StereoForecast,
    forecast_heights,
    match_heights,
    observe_terrain,
)
from startrack.earth.retrieval.study import (
    CameraLimits,
    EarthCampaign,
    EarthCondition,
    EarthDesign,
    Retrieval,
    load_earth_design,
    save_earth_overlay,
)
from startrack.earth.retrieval.waves import (
    WaveEstimate,
    WaveForecast,
    Waves,
    forecast_waves,
    observe_waves,
    retrieve_waves,
)

# Public; the other imports serve other rooms.
__all__ = [
    "CameraLimits",
    "EarthCampaign",
    "EarthCondition",
    "EarthDesign",
    "EarthProblem",
    "FireForecast",
    "GroundSpectrum",
    "HotSpots",
    "LandCover",
    "LandForecast",
    "MineralForecast",
    "Minerals",
    "Rectangle",
    "Retrieval",
    "Stereo",
    "StereoForecast",
    "WaveForecast",
    "Waves",
    "forecast_fires",
    "forecast_heights",
    "forecast_land",
    "forecast_minerals",
    "forecast_waves",
    "ground_spectrum",
    "load_earth_design",
    "power_coefficient",
    "power_of",
    "radiated_power",
    "scene_keys",
    "scene_schema",
    "temperature_and_area",
]
