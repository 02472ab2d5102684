"""The folder that builds the tables of the air is not a package."""

import sys

from startrack.io import shipped

sys.path.append(str(shipped("atmosphere")))
