"""What a recording states about its robot, tool and sensor: the simulator is configured with it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from wrenchbed import registry
from wrenchbed.data.parquet import FORMAT
from wrenchbed.errors import RecordingError
from wrenchbed.files.checked import Fields
from wrenchbed.physics.wrench import Tool, physical_inertia, six_of

MODES = ("static", "dynamic")
ROBOT_MODEL, SENSOR_MODEL = "robot_model", "sensor_model"
"""Metadata entries that hold the model of a user's own robot or sensor (docs/contracts.md)."""
_MODELS = {"robots": ROBOT_MODEL, "sensors": SENSOR_MODEL}
UNIT_LENGTH = 1e-3
"""Largest error of a unit quaternion's length: four digits are enough."""
_LEAST_GRAVITY, _MOST_GRAVITY = 1.0, 30.0
"""Range of a plausible gravity [m/s²]: the Moon's is inside, 1 g and 9,807 mm/s² are not."""


@dataclass(frozen=True)
class ToolInfo:
    """Stated load: mass [kg], cog (3,) [m], inertia (6,) xx yy zz xy xz yz [kg·m²], sensor axes."""

    mass: float | None = None
    cog: tuple[float, ...] | None = None
    inertia: tuple[float, ...] | None = None


@dataclass(frozen=True)
class SensorInfo:
    """Stated sensor: noise_std (6,) of a row at rest [N, N·m], own mass on its gauges [kg], pose on
    the flange x y z [m] qw qx qy qz."""

    model: str | None = None
    noise_std: tuple[float, ...] | None = None
    mass: float | None = None
    pose_flange: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Metadata:
    """Checked metadata of a recording, as docs/contracts.md defines them: gravity (3,) [m/s²] in
    the base, mode ``static`` or ``dynamic``, ``tolerance`` by parameter group; ``extra``: unknown
    fields."""

    robot: str
    mode: str
    source: str | None = None
    rate_hz: float | None = None
    tool: ToolInfo = ToolInfo()
    sensor: SensorInfo = SensorInfo()
    tolerance: Mapping[str, Any] = field(default_factory=dict)
    gravity: tuple[float, ...] | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, robot: str, mode: str, source: str, rate: float, tool: Tool, sensor: SensorInfo,
        gravity: Sequence[float],
    ) -> "Metadata":  # fmt: skip
        """Metadata that state a whole ``tool``, with the part of the sensor's own mass that loads
        its gauges, at a ``rate`` of rows [Hz]; the other arguments as above."""
        cog, inertia = (tuple(x.tolist()) for x in (tool.cog, six_of(tool.inertia)))
        load, sensor = float(tool.mass), replace(sensor, mass=float(tool.sensor_mass))
        down = tuple(float(g) for g in gravity)
        return cls(robot, mode, source, rate, ToolInfo(load, cog, inertia), sensor, gravity=down)

    def to_json(self) -> dict[str, Any]:
        """JSON object of the metadata, as docs/contracts.md defines it, without unstated fields."""
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
        stated = _stated({k: v for k, v in raw.items() if v != {}}) | dict(self.extra)
        return stated | model_field(self.robot) | model_field(self.sensor.model, "sensors")


FIELDS = {"format", ROBOT_MODEL, SENSOR_MODEL, *Metadata.__dataclass_fields__} - {"extra"}


def model_field(name: str | None, kind: str = "robots") -> dict[str, Any]:
    """Metadata entry with the model of a user's own robot, or, with ``kind`` ``sensors``, sensor of
    this name; empty for one that ships."""
    record = registry.record_of(kind, str(name))
    return {} if record is None else {_MODELS[kind]: dict(record)}


def known_name(raw: Mapping[str, Any], name: str, kind: str = "robots") -> str:
    """Registry name of the robot or sensor ``name`` (or a user's TOML) of a file with metadata
    ``raw``, which may carry its model; ``kind`` is ``robots`` or ``sensors``. A `NotFoundError` or
    `ParameterError` if the user's TOML cannot be read."""
    record = raw.get(_MODELS[kind])
    if isinstance(record, Mapping):
        registry.remember(kind, name, record)
    return registry.known_as(kind, name)


def _stated(raw: Mapping[str, Any]) -> dict[str, Any]:
    return {k: list(v) if isinstance(v, tuple) else v for k, v in raw.items() if v is not None}


def parse(raw: Mapping[str, Any], where: str) -> Metadata:
    """Check a recording's JSON metadata and make `Metadata` from it. A `RecordingError` names the
    field, what was found and what is allowed; see also `known_name`."""
    fields = Fields(raw, f"{where}: metadata ", RecordingError)
    robot = fields.stated_text("robot", "must be a name")
    mode = fields.choice("mode", MODES, "must be 'static' or 'dynamic'")
    tool, sensor = fields.part("tool"), fields.part("sensor")
    model = sensor.text("model")
    inertia = tool.numbers("inertia", 6)
    if inertia is not None and not physical_inertia(inertia):
        raise tool.error("inertia", "is not the inertia of any body")
    pose = sensor.numbers("pose_flange", 7)
    if pose is not None and abs(math.hypot(*pose[3:]) - 1.0) > UNIT_LENGTH:
        raise sensor.error("pose_flange", "must end in a unit quaternion w, x, y, z")
    gravity = fields.numbers("gravity", 3)
    if gravity is not None and not _LEAST_GRAVITY < math.hypot(*gravity) < _MOST_GRAVITY:
        raise fields.error("gravity", "must be an acceleration in m/s² (Earth: 9.8)")
    return Metadata(
        robot=known_name(raw, robot),
        mode=mode,
        source=fields.text("source"),
        rate_hz=fields.number("rate_hz", "Hz", positive=True),
        tool=ToolInfo(tool.number("mass", "kg", positive=True), tool.numbers("cog", 3), inertia),
        sensor=SensorInfo(
            model=None if model is None else known_name(raw, model, "sensors"),
            noise_std=sensor.numbers("noise_std", 6, nonnegative=True),
            mass=sensor.number("mass", "kg", nonnegative=True),
            pose_flange=pose,
        ),
        tolerance=dict(fields.part("tolerance").raw),
        gravity=gravity,
        extra={k: v for k, v in raw.items() if k not in FIELDS},
    )
