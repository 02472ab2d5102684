"""One frame, its spots and the stars that they were matched with, as a tracker sees Orion."""

from startrack import Streams, arcsec, load_design, observe, pointing, shipped
from startrack.catalog import open_sky
from startrack.plots import draw_solution

case = load_design(shipped("designs/noise_only.toml")).case
orion, sky = pointing(83.8, -1.2, 0.0), open_sky(case.catalog)  # degree
record = observe(case, orion, Streams(1, 0))
found = record.estimate
assert found.icrs_to_camera is not None
off = (found.icrs_to_camera * orion.inv()).magnitude() / arcsec
print(f"{found.status}: {found.stars} stars, {off:.1f} arcsec off, mostly about the boresight")
seen = (record.frame, record.spots, record.matches, found.icrs_to_camera)
draw_solution(None, *seen, sky.stars, "Orion").savefig("orion.png", dpi=90)
