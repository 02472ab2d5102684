"""A campaign's store enters; one HTML page that needs nothing else leaves.

write      the page, section by section
page       sections -> HTML: style, contents, tables; text is escaped here
inline     a matplotlib figure -> SVG to put into a page
causes     the error budget, by formula and by trials
skymap     trials over the sky, in an equal-area projection
spread     distributions of errors with the intervals of their quantiles
look       some trials again, star by star: error against magnitude, field position, slew rate
worst      the trials that went worst, with their frames
rungs      speed against error of the fidelities
"""

from startrack.report.write import Depth, write_report

__all__ = ["Depth", "write_report"]
