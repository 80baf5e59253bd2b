"""What a recording states about its robot, tool and sensor: the simulator is configured with it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wrenchbed.data.parquet import FORMAT
from wrenchbed.errors import RecordingError
from wrenchbed.physics.wrench import physical_inertia

MODES = ("static", "dynamic")


@dataclass(frozen=True)
class ToolInfo:
    """Stated load: mass [kg], cog (3,) [m] in sensor axes, inertia xx yy zz xy xz yz [kg·m²]."""

    mass: float | None = None
    cog: tuple[float, ...] | None = None
    inertia: tuple[float, ...] | None = None


@dataclass(frozen=True)
class SensorInfo:
    """Stated sensor: noise_std (6,) of one row at rest, own mass on the gauges [kg], its pose on
    the flange x y z qw qx qy qz."""

    model: str | None = None
    noise_std: tuple[float, ...] | None = None
    mass: float | None = None
    pose_flange: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Metadata:
    """Checked metadata of a recording; ``extra`` keeps what this version does not know."""

    robot: str
    mode: str
    source: str | None = None
    rate_hz: float | None = None
    tool: ToolInfo = ToolInfo()
    sensor: SensorInfo = SensorInfo()
    tolerance: Mapping[str, Any] = field(default_factory=dict)
    gravity: tuple[float, ...] | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The contract's JSON object, without what is not stated."""
        raw: dict[str, Any] = {
            "format": FORMAT,
            "robot": self.robot,
            "source": self.source,
            "mode": self.mode,
            "rate_hz": self.rate_hz,
            "tool": _stated(vars(self.tool)),
            "sensor": _stated(vars(self.sensor)),
            "tolerance": dict(self.tolerance),
            "gravity": self.gravity,
        }
        return _stated({k: v for k, v in raw.items() if v != {}}) | dict(self.extra)


def _stated(raw: Mapping[str, Any]) -> dict[str, Any]:
    return {k: list(v) if isinstance(v, tuple) else v for k, v in raw.items() if v is not None}


def parse(raw: Mapping[str, Any], where: str) -> Metadata:
    """Check the JSON metadata of a recording.

    Raises:
        RecordingError: names the field, what was found and what is allowed.
    """
    reader = _Reader(raw, where)
    known = {"format", *Metadata.__dataclass_fields__} - {"extra"}
    robot = reader.text("robot", required=True)
    mode = reader.text("mode", required=True)
    if mode not in MODES:
        raise reader.error("mode", mode, "must be 'static' or 'dynamic'")
    tool, sensor = reader.part("tool"), reader.part("sensor")
    return Metadata(
        robot=str(robot),
        mode=str(mode),
        source=reader.text("source"),
        rate_hz=reader.number("rate_hz", "Hz", positive=True),
        tool=ToolInfo(
            mass=tool.number("mass", "kg", positive=True),
            cog=tool.numbers("cog", 3),
            inertia=_inertia(tool),
        ),
        sensor=SensorInfo(
            model=sensor.text("model"),
            noise_std=sensor.numbers("noise_std", 6, nonnegative=True),
            mass=sensor.number("mass", "kg", nonnegative=True),
            pose_flange=_pose(sensor),
        ),
        tolerance=dict(reader.part("tolerance").raw),
        gravity=_gravity(reader),
        extra={k: v for k, v in raw.items() if k not in known},
    )


class _Reader:
    def __init__(self, raw: Any, where: str, prefix: str = "") -> None:
        self.where, self.prefix = where, prefix
        if not isinstance(raw, Mapping):
            raise RecordingError(f"{where}: metadata {prefix.rstrip('.')} is not a JSON object")
        self.raw = raw

    def error(self, key: str, found: Any, rule: str) -> RecordingError:
        return RecordingError(f"{self.where}: metadata {self.prefix}{key} = {found!r} {rule}")

    def part(self, key: str) -> "_Reader":
        return _Reader(self.raw.get(key) or {}, self.where, f"{self.prefix}{key}.")

    def text(self, key: str, required: bool = False) -> str | None:
        found = self.raw.get(key)
        if found is None and not required:
            return None
        if not isinstance(found, str) or not found:
            raise self.error(key, found, "must be a name")
        return found

    def number(
        self, key: str, unit: str, *, positive: bool = False, nonnegative: bool = False
    ) -> float | None:
        found = self.raw.get(key)
        if found is None:
            return None
        if isinstance(found, bool) or not isinstance(found, int | float) or not np.isfinite(found):
            raise self.error(key, found, f"must be a number [{unit}]")
        if (positive and found <= 0) or (nonnegative and found < 0):
            raise self.error(key, found, f"must be {'above' if positive else 'at least'} 0 {unit}")
        return float(found)

    def numbers(self, key: str, n: int, *, nonnegative: bool = False) -> tuple[float, ...] | None:
        found = self.raw.get(key)
        if found is None:
            return None
        if not isinstance(found, list | tuple) or len(found) != n:
            raise self.error(key, found, f"must be {n} numbers")
        for x in found:
            if isinstance(x, bool) or not isinstance(x, int | float) or not np.isfinite(x):
                raise self.error(key, found, f"must be {n} finite numbers")
        if nonnegative and min(found) < 0:
            raise self.error(key, found, "must not be negative")
        return tuple(float(x) for x in found)


def _inertia(reader: _Reader) -> tuple[float, ...] | None:
    found = reader.numbers("inertia", 6)
    if found is not None and not physical_inertia(found):
        raise reader.error("inertia", list(found), "is not the inertia of any body")
    return found


def _pose(reader: _Reader) -> tuple[float, ...] | None:
    found = reader.numbers("pose_flange", 7)
    if found is not None and abs(np.linalg.norm(found[3:]) - 1.0) > 1e-3:
        raise reader.error("pose_flange", list(found), "must end in a unit quaternion w, x, y, z")
    return found


def _gravity(reader: _Reader) -> tuple[float, ...] | None:
    found = reader.numbers("gravity", 3)
    if found is not None and not 1.0 < np.linalg.norm(found) < 30.0:
        raise reader.error("gravity", list(found), "must be an acceleration in m/s² (Earth: 9.8)")
    return found
