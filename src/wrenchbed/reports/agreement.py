"""Whether simulators agree with a recording, judged channel by channel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.pages import numbers
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.twin.comparison import Simulator

AGREES, NEAR = 1.25, 3.0
"""Residuals of a channel [noise of one row, rms] up to which simulator and measurement agree, or
differ slightly. 1.25 is a gap of 0.56: normal imperfections add up to 0.5 (the contracts)."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """How far one simulator is from a recording.

    Attributes:
        name: of the simulator.
        ratios: rms of the residual of each channel (6,) in units of its noise of one row.
        rms: of the residual of each channel (6,) [N, N·m].
    """

    name: str
    ratios: np.ndarray
    rms: np.ndarray

    @property
    def overall(self) -> float:
        """Rms over all channels in units of noise."""
        return float(np.sqrt(np.mean(self.ratios**2)))

    @property
    def differing(self) -> list[str]:
        """Channels that differ, the worst first; none where the simulator agrees."""
        order = np.argsort(-self.ratios, kind="stable")
        return [CHANNELS[k] for k in order if not self.ratios[k] < AGREES]

    @property
    def worst(self) -> str:
        """The largest residual in words: ``tz 1.87 × noise``."""
        k = int(np.argmax(self.ratios))
        return f"{CHANNELS[k]} {self.ratios[k]:.3g} × noise"

    @property
    def headline(self) -> str:
        """The answer in a sentence."""
        if not self.differing:
            return f"Simulator {self.name} agrees with the recording in every channel."
        much = "slightly" if self.ratios.max() < NEAR else "much"
        where = ", ".join(self.differing)
        return f"The best simulator, {self.name}, differs {much} from the recording in {where}."

    @property
    def text(self) -> str:
        """The figures behind it."""
        worst = f"Largest residual of a channel: {self.worst}, rms."
        overall = f"All channels: {self.overall:.3g} × noise."
        return numbers.minus(f"{worst} {overall} A channel agrees below {AGREES:g} × noise.")


def agreements(
    recording: Recording, simulators: Sequence[Simulator], noise: np.ndarray
) -> list[Agreement]:
    """Of each simulator with a recording, whose noise of one row is (6,) [N, N·m]."""
    residuals = [np.nanmean((recording.wrench - s.reading) ** 2, axis=0) for s in simulators]
    return [
        Agreement(s.name, np.sqrt(r) / noise, np.sqrt(r))
        for s, r in zip(simulators, residuals, strict=True)
    ]


def best(of_all: Sequence[Agreement]) -> Agreement:
    """The one with the least residual."""
    return min(of_all, key=lambda a: a.overall)
