"""`python -m startrack.cli` is the command `startrack`."""

import sys

from startrack.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
