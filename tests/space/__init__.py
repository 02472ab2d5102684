"""The folder that builds the table of electrons is not a package."""

import sys

from startrack.io import shipped

sys.path.append(str(shipped("radiation")))
