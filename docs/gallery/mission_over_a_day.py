"""Heads of a spacecraft over a day: what blinds them, and how long none is valid."""

from startrack import mission, shipped

loaded = mission.load_mission(shipped("missions/sun-synchronous.toml"), ["time.duration=1 d"])
plan = mission.plan_of(loaded, errors=False)  # the geometry alone; with errors it takes a minute
flown = mission.fly(plan)
print(flown)
available = mission.availability_of(flown)
print(available.none)
for count in (1, 2, 3):
    print(f"{count} heads or more: {100 * available.at_least(count):.1f} % of the time")
