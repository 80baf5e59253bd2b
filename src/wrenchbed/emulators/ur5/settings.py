"""Settings of the UR5 emulator: which arm and which controller it is."""

from dataclasses import dataclass

from wrenchbed import registry
from wrenchbed.emulators.base.arguments import Settings, above, flag, setting, word
from wrenchbed.emulators.ur5.packets import Version
from wrenchbed.errors import ParameterError
from wrenchbed.robots.ur_arm import URArm
from wrenchbed.robots.ur_family import NAMES, ur_arm

MODELS = tuple(sorted((*NAMES, "ur5"), key=lambda n: (n.endswith("e"), int(n.strip("ure")))))
"""Arms that the controller can have."""
_ONLY_E = (*(n for n in MODELS if n.endswith("e")), "ur20")
"""Arms that never had a CB3 controller."""
_SERIES: dict[str, tuple[Version, float]] = {
    "cb3": ((3, 15, 8, 106339), 0.008),
    "e": ((5, 11, 1, 108318), 0.002),
}
"""Series → software and control cycle [s]."""


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Which controller it is, and what is connected to it."""

    series: str = setting(
        "",
        word(_SERIES),
        "cb3 (125 Hz, software 3.15) or e (500 Hz, software 5.11); default that of the model",
    )
    model: str = setting("ur5", word(MODELS), f"the arm: {', '.join(MODELS)}; default ur5")
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

    def __post_init__(self) -> None:
        """Take the model's series where none is stated."""
        if not self.series:
            object.__setattr__(self, "series", "e" if self.model in _ONLY_E else "cb3")
        if self.series == "cb3" and self.model in _ONLY_E:
            raise ParameterError(
                f"--set model={self.model}: never had a CB3 controller; leave out series=cb3"
            )

    @property
    def arm(self) -> URArm:
        """The nominal arm."""
        found: URArm = registry.load("robots", "ur5") if self.model == "ur5" else ur_arm(self.model)
        return found

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
