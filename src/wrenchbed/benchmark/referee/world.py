"""A robot with its faults: what its sensor would read without noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchbed.benchmark.referee.equivalence import Usual
from wrenchbed.benchmark.referee.fault import RefereeFault, mechanics, signal
from wrenchbed.benchmark.referee.machine import Mechanics
from wrenchbed.benchmark.referee.noise import held, shaken
from wrenchbed.benchmark.referee.ride import Ride, ride
from wrenchbed.benchmark.referee.setting import SAMPLES, RefereeSetting
from wrenchbed.benchmark.referee.signatures import stride, thin


@dataclass(frozen=True, eq=False)
class FaultyRobot:
    """A setting with all faults around a cause.

    Attributes:
        setting: what is stated and commanded.
        around: its faults.
        way: its ride.
        usual: what every fit removes.
    """

    setting: RefereeSetting
    around: tuple[RefereeFault, ...]
    way: Ride
    usual: Usual

    @classmethod
    def of(
        cls, setting: RefereeSetting, around: Sequence[RefereeFault], usual: Usual
    ) -> "FaultyRobot":
        """A robot of a setting with some faults."""
        return cls(setting, tuple(around), _ride(setting, around), usual)

    @property
    def stride(self) -> int:
        """Of rows that are compared."""
        return stride(self.setting)

    @cached_property
    def clean(self) -> np.ndarray:
        """Reading at every instant (T, 6) without noise and limits [N, N·m]."""
        return signal(self.way, self.around)

    @cached_property
    def base(self) -> np.ndarray:
        """Clean reading where readings are compared (n, 6) [N, N·m]."""
        y = thin(self.setting, self.clean)
        for fault in self.around:
            if fault.rows is not None:
                y = np.clip(y, -fault.rows.limit, fault.rows.limit)
        return y

    def with_(self, fault: RefereeFault) -> "FaultyRobot":
        """The same with a further fault; a fault of the machine needs another ride."""
        around = (*self.around, fault)
        way = self.way if fault.body is None else _ride(self.setting, around)
        return replace(self, around=around, way=way)

    def compared(self, wrench: np.ndarray) -> np.ndarray:
        """Recorded rows (N, 6) minus what is stated, where readings are compared (n, 6)."""
        every = np.zeros((len(self.setting.path.t), 6))
        every[self.setting.path.rows] = wrench
        return thin(self.setting, every) - self.setting.nominal[:: self.stride]

    def risen(self, fault: RefereeFault) -> np.ndarray:
        """Rise of a row's variance over stated noise (6,) by a fault between rows."""
        r = fault.rows
        assert r is not None
        path, noise = self.setting.path, self.setting.noise
        rise = r.gain**2 - 1.0 + (r.step / noise) ** 2 / 12.0  # of rounding, by definition
        if r.shake is not None:
            shaken_rows = shaken(self.setting, self.way, r.shake(path.t[path.rows]))
            rise = rise + ((shaken_rows / noise) ** 2).mean(axis=0)
        if r.stale[0] > 0.0:
            y = self.clean[path.rows]
            shown = held(len(y), r, np.random.default_rng(len(y)))
            rise = rise + (((y[shown] - y) / noise) ** 2).mean(axis=0)
        return np.asarray(rise)

    @property
    def row_noise(self) -> float:
        """Gap of noise alone where readings are compared."""
        return 1.0 if self.setting.mode == "dynamic" else 1.0 / SAMPLES


def _ride(setting: RefereeSetting, faults: Sequence[RefereeFault]) -> Ride:
    start = Mechanics(
        setting.theta,
        np.array(setting.robot.gravity, dtype=float),
        np.zeros(len(setting.robot.joints)),
    )
    return ride(setting.robot, mechanics(start, faults), setting.path)
