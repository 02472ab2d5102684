"""The error budget over the f-number: which cause dominates, and a picture of one budget."""

from startrack import arcsec, load_design, shipped
from startrack.budget import analytic
from startrack.plots import draw_budget

for f_number in (1.4, 2.4):
    changes = [f"instrument.optics.f_number={f_number}"]
    budget = analytic(load_design(shipped("designs/noise_only.toml"), changes).case)
    worst = max(budget.lines, key=lambda line: line.across)
    print(f"f/{f_number}: {budget.across / arcsec:.3f} arcsec across, most by {worst.name}")
    print(budget)
figure = draw_budget(None, budget, None, f"f/{f_number}")  # None: a figure, and no file
figure.savefig("budget.png")
