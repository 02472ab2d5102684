"""Where the table of electrons is built is no package."""

import sys

from startrack.io import shipped

sys.path.append(str(shipped("radiation")))
