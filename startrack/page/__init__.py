"""The local page of a design: its contents, its searches, and its server.

form      Tables of a design, its keys -> rows of a form, and sliders of the campaign's variables.
tracker   Star tracker's file, changed values -> budget, sky, frame and margins, as by the commands.
problem   Problem's file, changed values -> forecast, margins, images and trials.
pictures  Images of a trial -> bytes, scales and marks for a browser.
search    Start, watch, stop and continue the command `optimize` in the background.
trials    Trials of a design, block after block, until they are stopped.
routes    Path and body of a request -> the answer, or the error message of a command.
server    HTTP on 127.0.0.1 for one token: pages, requests, and refusals.
"""

from startrack.page.problem import EARTH, MOVING, ProblemPage
from startrack.page.routes import Routes
from startrack.page.server import PageServer
from startrack.page.tracker import TrackerPage
