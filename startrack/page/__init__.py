"""The local page of a design: what it shows, the searches that it runs, and its server.

form      Tables of a design, its keys -> rows of a form, and sliders of what a campaign varies.
tracker   Star tracker's file, changed values -> budget, sky, frame and margins, as commands have.
earth     The same of an Earth camera's scene: forecast and margins.
search    The command `optimize` beside the page: started, watched, stopped, continued.
trials    Trials of a design, block after block, until they are stopped.
routes    Path and body of a request -> the answer, or the sentence that a command would print.
server    HTTP on 127.0.0.1 for one token: pages, requests, and what is refused.
"""

from startrack.page.earth import EarthPage
from startrack.page.routes import Routes
from startrack.page.server import PageServer
from startrack.page.tracker import TrackerPage
