"""The image of a star through focus, with coma: five PSFs, and their light in a pixel."""

import matplotlib.pyplot as plt

from startrack import load_design, shipped
from startrack.observation import psf_of

coma = 'instrument.optics.aberrations=[{noll = 8, rms = "60 nm"}]'
figure, axes = plt.subplots(1, 5, figsize=(10, 2.6), layout="constrained")
for place, defocus in zip(axes, (-60, -30, 0, 30, 60), strict=True):
    changes = [coma, f"instrument.optics.defocus={defocus} um", "instrument.optics.psf=auto"]
    changes.append("instrument.optics.blur=0 um")
    psf = psf_of(load_design(shipped("designs/noise_only.toml"), changes).case.instrument)
    print(f"{defocus:+3d} um: at most {psf.table.max():.2f} of the light in one pixel")
    half = len(psf.table) / 2 / psf.oversampling
    place.imshow(psf.table**0.5, extent=(-half, half, half, -half), cmap="magma")
    place.set(title=f"{defocus:+d} um", xlabel="x (pixel)", xlim=(-2.4, 2.4), ylim=(2.4, -2.4))
axes[0].set_ylabel("y (pixel)")
figure.savefig("psf.png", dpi=100)
