"""A tracker in time as an xarray dataset with units, and a figure of it."""

from startrack import deg, load_design, shipped, to_xarray
from startrack.plots import draw_sequence
from startrack.sequence import Leg, Sequence, run, summarise_sequences

case = load_design(shipped("designs/noise_only.toml")).case
slow = Sequence((Leg(duration=1.0, rate_x=0.06 * deg),), period=0.25)
table = run(case, slow, seed=1, number=0)
print(summarise_sequences(table))
flight = to_xarray(table, "frame").set_coords("time")
print(flight.filtered_x)
draw_sequence(None, table, "one second of slow motion").savefig("sequence.png")
