"""A campaign as one HTML page.

page           Sections and figures enter; one self-contained HTML page leaves.
causes         A case -> what its error is made of, expected and measured, as a part of the page.
stars          Some trials again, star by star -> error against magnitude, field position and slew
               rate.
fidelities     The same trials at each fidelity -> speed against error.
distributions  Errors of many trials enter; their distributions, quantiles and sky maps leave.
worst          The trials that went worst, with their frames.
write          A campaign's store -> the page.
"""

from startrack.report.write import Depth, write_report

# Public; the other imports serve other rooms.
__all__ = ["Depth", "write_report"]
