"""A campaign, a mission or an Earth camera as one HTML page.

page      One self-contained HTML page from sections and figures.
sections  Sections: design, verdicts, lost trials, error budget, units, worst trials.
pictures  Distributions and sky maps of the errors of trials, single stars, slew rates.
write     The page from a campaign's store.
mission   The page of a mission.
study     The page of a study: answer, tables, pictures.
problem   The page of a problem: question, trials and formulas, verdicts, sensitivity.
earth     The page of an Earth camera: its figures, requirements, images, products and scene.
"""

from startrack.report.earth import write_earth_report
from startrack.report.mission import (
    CHECKED,
    ReportedFlight,
    beta_table,
    checks_table,
    heads_table,
    number_of_heads,
    outages_table,
    verdict_table,
    write_mission_report,
)
from startrack.report.problem import write_problem_report
from startrack.report.study import write_study_page
from startrack.report.write import Depth, repeated, write_report

# Public; the other imports serve other rooms.
__all__ = ["Depth", "write_report"]
