"""Settings of the UR5 emulator: arm and controller. Their texts are the help of ``--set``."""

from dataclasses import dataclass
from pathlib import Path

from robot_emulators.base import named_values as rules
from robot_emulators.base.named_values import Settings, flag, setting, word
from robot_emulators.errors import SettingError
from robot_emulators.ur.rtde_packets import Version

_CB3 = ("ur3", "ur5", "ur10")
"""Models of arms that had a CB3 controller."""
MODELS = (
    *_CB3, "ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur16e", "ur8long", "ur15", "ur18", "ur20",
    "ur30",
)  # fmt: skip
"""Models of arms that the emulated controller can have."""
_SAME_TYPE = {"ur7e": "ur5", "ur12e": "ur10"}
"""Models that report an older one's name: the maker's client library has no type for them."""
_SERIES: dict[str, tuple[Version, float]] = {
    "cb3": ((3, 15, 8, 106339), 0.008),
    "e": ((5, 11, 1, 108318), 0.002),
    "x": ((10, 10, 0, 0), 0.002),
}
"""Series → software version and control cycle [s]."""
_VERSION = rules.text("", r"(\d{1,2}(\.\d{1,3}){2})?", "a version of three numbers, as 5.23.0")
_COMPUTER = rules.text(
    "", r"\d{1,3}(\.\d{1,3}){3}:\d{1,5}", "an IPv4 address and a port, as 127.0.0.1:50002"
)


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Settings of the emulated controller: series, software, and what is connected to it."""

    series: str = setting(
        "",
        word(_SERIES),
        "cb3 (125 Hz, software 3.15), e (500 Hz, software 5.11) or x (500 Hz, PolyScope X 10.10); "
        "default that of the model",
    )
    software: str = setting(
        "", _VERSION, "another version of the series' software, as 5.23.0; default as above"
    )
    model: str = setting("ur5", word(MODELS), f"the arm: {', '.join(MODELS)}; default ur5")
    protective_force: float = setting(
        150.0, rules.above(0.0), "force at the tool from which the robot stops [N]; default 150"
    )
    power: bool = setting(
        True, flag(), "on or off: whether the arm is on with its brakes free at first; default on"
    )
    box: bool = setting(
        True, flag(), "on or off: a Net F/T box that serves the arm's sensor; default on. Without "
        "it ft_raw_wrench reports that sensor, with it the wrench that the arm measures",
    )  # fmt: skip
    programs: str = setting(
        "",
        rules.text(),
        "folder of .urp and .script files that the dashboard can load; default none",
    )
    remote: bool = setting(
        True, flag(), "on (default, for ur_rtde) or off: the answer to 'is in remote control'"
    )
    external_control: str = setting(
        "127.0.0.1:50002", _COMPUTER, "computer that external_control.urp asks for its program, "
        "as the External Control URCap does; default 127.0.0.1:50002",
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Derive the controller series from the arm's model where it is not given."""
        if not self.series:
            object.__setattr__(self, "series", "cb3" if self.model in _CB3 else "e")
        if self.series == "cb3" and self.model not in _CB3:
            raise SettingError(
                f"--set model={self.model}: never had a CB3 controller; leave out series=cb3"
            )
        if self.software and self.version[0] != _SERIES[self.series][0][0]:
            raise SettingError(
                f"--set software={self.software}: not of series {self.series}, whose versions "
                f"begin with {_SERIES[self.series][0][0]}"
            )
        if self.programs and not Path(self.programs).is_dir():
            raise SettingError(f"--set programs={self.programs}: there is no such folder")

    @property
    def reported_model(self) -> str:
        """Model name that the dashboard reports; for UR7e, UR12e and UR8 Long an assumption."""
        return _SAME_TYPE.get(self.model, self.model).removesuffix("e").upper()

    @property
    def version(self) -> Version:
        if not self.software:
            return _SERIES[self.series][0]
        major, minor, bugfix = (int(word) for word in self.software.split("."))
        return (major, minor, bugfix, 0)

    @property
    def computer(self) -> tuple[str, int]:
        """Host and port from which the program external_control.urp fetches its URScript."""
        host, _, port = self.external_control.rpartition(":")
        return host, int(port)

    @property
    def cycle(self) -> float:
        """Duration of a control cycle [s]."""
        return _SERIES[self.series][1]

    @property
    def wrench_error(self) -> tuple[float, float]:
        """Three standard deviations of the wrench that the arm measures: force [N], torque [N·m].
        A CB3 infers it from motor currents; source: reports in Universal Robots' forum. An e-Series
        has a sensor in its flange; source: precision in UR5e's data sheet."""
        return (3.5, 0.2) if self.e_series else (10.0, 5.0)

    @property
    def e_series(self) -> bool:
        """Whether the controller is an e-Series or newer; False for a CB3."""
        return self.series != "cb3"
