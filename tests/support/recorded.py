"""Columns and metadata that any recording may have, of no robot in particular."""

from pathlib import Path

import numpy as np

from wrenchbed.data import parquet
from wrenchbed.data.metadata import Metadata, SensorInfo, ToolInfo
from wrenchbed.physics.wrench import CHANNELS

METADATA = Metadata(
    robot="ur5",
    mode="static",
    source="sim",
    rate_hz=100.0,
    tool=ToolInfo(1.35, (0.004, -0.006, 0.071), (2.7e-3, 2.7e-3, 1.1e-3, 0.0, 0.0, 0.0)),
    sensor=SensorInfo("ati-gamma", (0.1,) * 6, 0.0, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)),
    tolerance={"tool.mass": 0.007},
    gravity=(0.0, 0.0, -9.80665),
    extra={"operator": "Ada"},
)


def save(path: Path, data: dict[str, np.ndarray], metadata: dict) -> Path:
    parquet.write(path, parquet.table_of(data, metadata))
    return path


def columns(n: int = 20) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    data = {"t": np.arange(n) / 100.0}
    data |= {f"q{j}": rng.normal(size=n) for j in range(1, 7)}
    data |= {c: rng.normal(size=n) for c in CHANNELS}
    return data | {"segment": np.arange(n) // 5, "status": np.zeros(n, dtype=np.uint32)}
