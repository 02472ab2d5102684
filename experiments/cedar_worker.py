"""Centroids -> right ascension and declination by cedar-solve, in the interpreter that has it.

Reads and writes one JSON object a line. cedar-solve needs an older numpy than startrack.
"""

import contextlib
import json
import sys
import time

with contextlib.redirect_stdout(sys.stderr):
    from tetra3 import Tetra3

    solver = Tetra3()
for line in sys.stdin:
    asked = json.loads(line)
    began = time.process_time()
    with contextlib.redirect_stdout(sys.stderr):
        answer = solver.solve_from_centroids(
            asked["row_column"],
            asked["size"],
            fov_estimate=asked["field_deg"],
            fov_max_error=asked["field_error_deg"],
            solve_timeout=1000,
        )
    seconds = time.process_time() - began
    print(json.dumps([answer["RA"], answer["Dec"], seconds]), flush=True)
