"""What the paper's words may mean as measurement noise."""

from dataclasses import dataclass

import numpy as np

from wrenchbed import registry

SAMPLES = 100
"""Measurements a configuration, which the paper may or may not average."""


@dataclass(frozen=True, eq=False)
class Noise:
    """One reading of the paper's noise.

    Attributes:
        name: for people.
        row: standard deviation of one measurement (6,) [N, N·m].
        samples: measurements that are averaged in each configuration.
    """

    name: str
    row: np.ndarray
    samples: int

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of a configuration's mean (6,) [N, N·m]."""
        return self.row / np.sqrt(self.samples)


STATED = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
"""±1 N, ±0.2 N·m: Section 5."""
CERTIFICATE: np.ndarray = registry.load("sensors", "ati-mini40").accuracy
"""±0.25, 0.2, 0.45 N, ±0.0125, 0.0125, 0.02 N·m: the Mini40's certificate, Section 5."""

PAPER = Noise("±1 N as 3σ, 100 averaged", STATED / 3, SAMPLES)
PLAIN = Noise("±1 N as 3σ, one sample", STATED / 3, 1)
WIDE = Noise("±1 N as 1σ, 100 averaged", STATED, SAMPLES)
WIDE_PLAIN = Noise("±1 N as 1σ, one sample", STATED, 1)
MINI40 = Noise("certificate as 3σ, 100 averaged", CERTIFICATE / 3, SAMPLES)
MINI40_PLAIN = Noise("certificate as 3σ, one sample", CERTIFICATE / 3, 1)
LOWER = tuple(
    Noise(f"±{level:g} N as 3σ, 100 averaged", STATED * level / 3, SAMPLES)
    for level in (0.5, 0.25, 0.1)
)
"""For Table 6; its own levels are not in the text that we have. Torque in proportion."""
READINGS = (PAPER, PLAIN, WIDE, WIDE_PLAIN, MINI40, MINI40_PLAIN)
