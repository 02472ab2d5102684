"""Where the tables of the air are built is no package."""

import sys

from startrack.io import shipped

sys.path.append(str(shipped("atmosphere")))
