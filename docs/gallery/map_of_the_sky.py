"""Stars in the field and the error over the sky, by the error budget of each direction."""

import numpy as np

from startrack import arcsec, load_design, shipped
from startrack.budget import survey
from startrack.plots import draw_sky

case = load_design(shipped("designs/noise_only.toml"), ["catalog.limit_g=6.0"]).case
found = survey(case, places=512)
worst = int(np.nanargmax(found.across))
print(f"{found.stars[worst]:.0f} stars, {found.across[worst] / arcsec:.2f} arcsec at worst")
draw_sky(None, found, case, "noise alone, stars to magnitude 6").savefig("sky.png", dpi=80)
