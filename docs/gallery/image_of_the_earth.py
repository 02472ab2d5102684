"""A small image of the Earth in one channel, and the radiance that a product makes of it."""

from dataclasses import replace

from startrack import shipped
from startrack.earth.imager import Picture, load_survey, render
from startrack.earth.product import calibrate, to_radiance

path = shipped("scenes/sentinel2-msi.toml")
survey = replace(load_survey(path), lines=60, columns=60)
channel = next(channel for channel in survey.channels if channel.name == "B4")
picture = Picture.blank(60, 60)
setting = render(survey, channel, path.parent, seed=1, picture=picture)
print(setting)
found = to_radiance(picture.numbers, calibrate(survey, channel, setting, seed=1))
print(f"{found.mean():.1f} of {picture.terms.total.mean():.1f} W/m2/sr/um, in the mean")
