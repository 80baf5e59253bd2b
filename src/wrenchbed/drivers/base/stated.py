"""What a recording states about a robot as designed, whoever recorded it."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.robots.base import INERTIA_AXES, Robot


def as_designed(
    robot: Robot,
    *,
    source: str,
    mode: str,
    rate: float,
    gravity: Sequence[float],
    sensor: str,
    noise_std: np.ndarray,
) -> Metadata:
    """Metadata of the nominal robot; ``noise_std`` (6,) is of one row at rest [N, N·m]."""
    nominal = robot.parameters.nominal
    tool, values = robot.tool(nominal), robot.values(nominal)
    on_flange = "mount.position.x" in robot.parameters.names
    return Metadata(
        robot=robot.name,
        mode=mode,
        source=source,
        rate_hz=rate,
        tool=ToolInfo(
            mass=float(tool.mass),
            cog=tuple(float(c) for c in tool.cog),
            inertia=tuple(float(values[f"tool.inertia.{a}"]) for a in INERTIA_AXES),
        ),
        sensor=SensorInfo(
            model=sensor,
            noise_std=tuple(float(s) for s in noise_std),
            mass=float(values["sensor.mass"]),
            pose_flange=(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0) if on_flange else None,
        ),
        gravity=tuple(gravity),
    )
