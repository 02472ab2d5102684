"""A user's problem: a photometer, whose aperture and exposure are searched."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from startrack import Streams
from startrack.core import Rows
from startrack.metrics import rms_interval
from startrack.optimise import improve
from startrack.problem import Bounds, Expectation, Judgement, Margin, Settings, Words


@dataclass(frozen=True)
class Photometer:
    """The relative error of the flux of a star of V = 12."""

    aperture: float = 0.05  # metre
    exposure: float = 1.0  # second
    columns = np.dtype([("electrons", float)])
    settings = Settings(precision=0.02)

    @property
    def variables(self) -> list[Bounds]:
        return [
            Bounds("aperture", 0.02, 0.2, self.aperture, log=True, unit="m"),
            Bounds("exposure", 0.1, 100.0, self.exposure, log=True, unit="s"),
        ]

    @property
    def star(self) -> float:  # electrons: 1e10 photons / s / m2 at magnitude 0, half are lost
        return 5e9 * 10 ** (-0.4 * 12) * np.pi / 4 * self.aperture**2 * self.exposure

    @property
    def noise(self) -> float:  # electrons: sky, and 25 pixels with 3 electrons of read noise
        return (0.3 * self.star + 25 * 3.0**2) ** 0.5

    def replaced(self, values: Mapping[str, float]) -> Photometer:
        return replace(self, **values)

    def costs(self) -> dict[str, Margin]:
        mass = Margin(0.5 + 2000 * self.aperture**3, 5.0, unit="kg")
        return {"mass": mass, "exposure": Margin(self.exposure, 30.0, unit="s")}

    def expect(self) -> Expectation:
        error = (self.star + self.noise**2) ** 0.5 / self.star
        return Expectation(error, {"full well": Margin(0.2 * self.star / 30_000, 1.0)})

    def trials(self, seed: int, numbers: range) -> Rows:
        rows = np.zeros(len(numbers), self.columns)
        for row, number in zip(rows, numbers, strict=True):
            random = Streams(seed, number)("photometer")
            row["electrons"] = random.poisson(self.star) + random.normal(0, self.noise)
        return rows

    def judge(self, rows: Rows, confidence: float = 0.95) -> Judgement:
        error = rms_interval((rows["electrons"] / self.star - 1) ** 2, confidence)
        full = Margin(0.2 * rows["electrons"].mean() / 30_000, 1.0)  # known to a part in 10,000
        return Judgement(error, {"full well": (full, full, full)})

    def described(self) -> str:
        return repr(self)

    def text(self) -> Words:
        return Words("relative error of the flux", "")


found = improve(Photometer(), seed=1)
for name, value in found.best.items():
    print(f"{name} {value:.3g}, from {found.start[name]:.3g}")
factor = found.factor
print(f"error of start over best: {factor.value:.1f} [{factor.low:.1f}, {factor.high:.1f}]")
print(found.verdicts, "limited by", *found.landscape.prices)
