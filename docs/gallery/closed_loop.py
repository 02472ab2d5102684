"""A spacecraft that is pointed by what its star tracker sees, in a closed loop."""

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import arcsec, deg, load_design, shipped
from startrack.io import pointing
from startrack.sequence import CameraLoop

STEP = 0.2  # second, from frame to frame
STIFFNESS, DAMPING = 0.5, 1.0  # of the controller: 1 / second^2, 1 / second

loop = CameraLoop(load_design(shipped("designs/noise_only.toml")).case, seed=1)
target = pointing(83.0, -5.0, 0.0)
attitude = Rotation.from_rotvec([0.3 * deg, -0.2 * deg, 0.0]) * target  # icrs_to_camera
rate = np.zeros(3)  # radian / second, about the axes of the camera; a gyroscope measures it

off = []
for _ in range(150):
    estimate = loop.see(attitude, rate).estimate
    seen = (estimate.icrs_to_camera * target.inv()).as_rotvec()
    rate += STEP * (STIFFNESS * seen - DAMPING * rate)
    # A camera that turns at the rate w sees the sky turn back.
    attitude = Rotation.from_rotvec(-rate * STEP) * attitude
    off.append((attitude * target.inv()).as_rotvec() / arcsec)

time, settled = STEP * np.arange(1, len(off) + 1), np.array(off[100:])
x, y, z = np.sqrt((settled**2).mean(axis=0))
print(f"pointing after 20 s, rms: {x:.2f} and {y:.2f} arcsec across, {z:.2f} about the boresight")

figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
for axis, values, line in zip("xyz", np.array(off).T, ("-", "--", ":"), strict=True):
    axes.plot(time, values, line, label=f"about {axis}")
axes.set(xlabel="time (s)", ylabel="off the target (arcsec)", yscale="symlog")
axes.legend()
figure.savefig("closed_loop.png", dpi=100)
