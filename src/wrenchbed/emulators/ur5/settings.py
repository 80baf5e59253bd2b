"""Settings of the UR5 emulator: which controller it is."""

from dataclasses import dataclass

from wrenchbed.emulators.base.arguments import Settings, above, flag, setting, word
from wrenchbed.emulators.ur5.packets import Version

_SERIES: dict[str, tuple[Version, float]] = {
    "cb3": ((3, 15, 8, 106339), 0.008),
    "e": ((5, 11, 1, 108318), 0.002),
}
"""Series → software and control cycle [s]."""


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Which controller it is, and what is connected to it."""

    series: str = setting(
        "cb3",
        word(_SERIES),
        "cb3 (125 Hz, software 3.15) or e (500 Hz, software 5.11); default cb3",
    )
    protective_force: float = setting(
        150.0, above(0.0), "force at the tool from which the robot stops [N]; default 150"
    )
    slow_reader: float = setting(
        10.0, above(0.0), "seconds after which a client that takes nothing is closed; default 10"
    )
    power: bool = setting(
        True, flag(), "on or off: whether the arm is on with its brakes free at first; default on"
    )
    realtime: bool = setting(
        False, flag(), "on or off: ask the system for real-time scheduling; default off"
    )
    box: bool = setting(
        True, flag(), "on or off: a Net F/T box that serves the arm's sensor; default on. Without "
        "it ft_raw_wrench reports that sensor, with it the wrench that the arm measures",
    )  # fmt: skip

    @property
    def version(self) -> Version:
        """Of the controller's software."""
        return _SERIES[self.series][0]

    @property
    def cycle(self) -> float:
        """Of its control [s]."""
        return _SERIES[self.series][1]

    @property
    def e_series(self) -> bool:
        """e-Series, else CB3."""
        return self.series == "e"
