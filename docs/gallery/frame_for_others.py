"""A rendered frame for other programs: FITS with WCS, SER, and the spots as an astropy table."""

from datetime import UTC, datetime
from pathlib import Path

from astropy.table import QTable

from startrack import Streams, load_design, observe, pointing, read_image, shipped
from startrack.detection import detect, plan_detection
from startrack.io import FrameFiles, Layout

case = load_design(shipped("designs/noise_only.toml")).case
orion = pointing(83.8, -1.2, 0.0)  # degree
record = observe(case, orion, Streams(1, 0))
for kind in ("fits", "ser"):
    files = FrameFiles(Path("frames"), "orion", kind, datetime(2026, 3, 20, tzinfo=UTC))
    files.add(record.frame, 0.0, orion, case.instrument.camera, record.stars)
    print(files.close())
frame = read_image(Path("frames/orion.ser"), Layout(plane=0))
print(frame)
spots = detect(frame, plan_detection(case.tracker.detection))
print(QTable({"x": spots.x, "y": spots.y, "flux": spots.flux})[:3])
