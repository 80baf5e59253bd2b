"""What this twin alone can be told."""

from collections.abc import Mapping
from dataclasses import dataclass

from wrenchbed.errors import ParameterError
from wrenchbed.serving import netft
from wrenchbed.twins.ur5.fields import Version

_SERIES: dict[str, tuple[Version, float]] = {
    "cb3": ((3, 15, 8, 106339), 0.008),
    "e": ((5, 11, 1, 108318), 0.002),
}
_SWITCH = {"on": True, "off": False}


@dataclass(frozen=True)
class Settings:
    """Version and control cycle [s], and the settings below as numbers."""

    version: Version
    cycle: float
    protective_force: float
    slow_reader: float
    powered: bool
    realtime: bool
    box: netft.Settings | None


def described() -> dict[str, str]:
    """Name of each setting → what it does and its default."""
    return {
        "series": "cb3 (125 Hz, software 3.15) or e (500 Hz, software 5.11); default cb3",
        "protective_force": "force at the tool from which the robot stops [N]; default 150",
        "slow_reader": "seconds after which a client that takes nothing is closed; default 10",
        "power": "on or off: whether the arm is on with its brakes free at the start; default on",
        "realtime": "on or off: ask the system for real-time scheduling; default off",
        "box": "on or off: a Net F/T box that shows the arm's sensor; default on. Without it "
        "ft_raw_wrench shows that sensor, with it the arm's own",
        **netft.HELP,
    }


def parse(given: Mapping[str, str]) -> Settings:
    """Check settings.

    Raises:
        ParameterError: an unknown name or an impossible value; lists what exists.
    """
    known = described()
    for name in given:
        if name not in known:
            listed = "; ".join(f"{key}: {text}" for key, text in known.items())
            raise ParameterError(f"twin ur5 has no setting {name!r}. Known: {listed}")
    series = given.get("series", "cb3")
    if series not in _SERIES:
        raise ParameterError(f"setting series={series}: give cb3 or e")
    version, cycle = _SERIES[series]
    return Settings(
        version,
        cycle,
        _positive(given, "protective_force", 150.0),
        _positive(given, "slow_reader", 10.0),
        _switch(given, "power", True),
        _switch(given, "realtime", False),
        _box(given),
    )


def _box(given: Mapping[str, str]) -> netft.Settings | None:
    words = {name: text for name, text in given.items() if name in netft.HELP}
    return netft.Settings.from_words(words) if _switch(given, "box", True) else None


def _positive(given: Mapping[str, str], name: str, default: float) -> float:
    try:
        value = float(given.get(name, default))
    except ValueError:
        value = float("nan")
    if not value > 0.0:
        raise ParameterError(f"setting {name}={given[name]}: give a number above 0")
    return value


def _switch(given: Mapping[str, str], name: str, default: bool) -> bool:
    if name not in given:
        return default
    if given[name] not in _SWITCH:
        raise ParameterError(f"setting {name}={given[name]}: give on or off")
    return _SWITCH[given[name]]
