"""A plan: poses to visit, touches of known points or a motion to follow, in Parquet."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.data import parquet
from wrenchbed.data.metadata import MODES, known_name, model_field
from wrenchbed.data.recording import POINT, effort_prefix, holds_readings, joint_columns
from wrenchbed.data.text_table import read_text
from wrenchbed.errors import MapError, PlanError
from wrenchbed.files.checked import Fields

_FAR = 10.0
"""Points farther away than this are in another unit [m]: no arm here reaches so far."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan for a robot: poses to visit, or a motion to follow, as joint values (N, J).

    Attributes:
        robot: name of the robot whose joints these are.
        q: joint values [rad or m]; in a dynamic plan one row a sample at ``rate_hz``.
        segment: which hold or motion each row belongs to (N,).
        dwell: how long to stay [s] (N,), 0 for the recorder's default.
        mode: ``static`` or ``dynamic``.
        rate_hz: sample rate of a dynamic plan [Hz].
        points: known positions in the world (N, 3) [m] that the tool's tip shall touch from each
            pose; None in a plan that touches nothing.
        name: file name for messages.
    """

    robot: str
    q: np.ndarray
    segment: np.ndarray
    dwell: np.ndarray
    mode: str = "static"
    rate_hz: float | None = None
    points: np.ndarray | None = None
    name: str = "plan"

    @classmethod
    def of(
        cls,
        robot: str,
        q: np.ndarray,
        *,
        rate_hz: float | None = None,
        points: np.ndarray | None = None,
    ) -> "Plan":
        """Make a plan from joint values q (N, J): poses to hold, poses at which to touch ``points``
        (N, 3) [m], or with ``rate_hz`` a motion."""
        n = len(q)
        segment = np.arange(n) if rate_hz is None else np.zeros(n, dtype=int)
        mode = "static" if rate_hz is None else "dynamic"
        return cls(robot, np.asarray(q, dtype=float), segment, np.zeros(n), mode, rate_hz, points)

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def read(cls, path: str | Path) -> "Plan":
        """Read and check a plan from its file; a `PlanError` names the file, the field or column,
        and the row."""
        path = Path(path)
        data, raw = parquet.read(path, PlanError)
        joints, points = joint_columns(data), [c for c in POINT if c in data]
        if holds_readings(data):
            held = next((c for c in ("fx", "mx") if c in data), f"{effort_prefix(data)}1")
            raise PlanError(f"{path}: this is a recording (it holds {held}), not a plan")
        if not joints:
            raise PlanError(f"{path}: column 'q1' is missing; found {', '.join(data) or 'none'}")
        rows = len(data[joints[0]])
        if rows == 0:
            raise PlanError(f"{path}: the plan has 0 rows")
        dwell, segment = data.get("dwell", np.zeros(rows)), data.get("segment", np.arange(rows))
        for column, values in ((c, data.get(c, dwell)) for c in (*joints, *points, "dwell")):
            if values.dtype.kind not in "fiu":
                raise PlanError(f"{path}: column {column!r} holds {values.dtype}, not numbers")
            rule = np.isfinite(values) if column != "dwell" else np.isfinite(values) & (values >= 0)
            if not rule.all():
                row = int(np.argmin(rule))
                why = "s is negative" if np.isfinite(values[row]) else "is not finite"
                raise PlanError(f"{path}: column {column!r}, row {row}: {values[row]} {why}")
        if segment.dtype.kind not in "iu":
            raise PlanError(f"{path}: column 'segment' must hold whole numbers")
        fields = Fields(raw, f"{path}: metadata ", PlanError)
        mode = fields.choice("mode", MODES, "must be 'static' or 'dynamic'", default="static")
        rate = fields.number("rate_hz", "Hz", positive=True)
        robot = known_name(raw, fields.stated_text("robot", "must be a name"))
        if points and (len(points) != 3 or mode != "static"):
            raise PlanError(f"{path}: touches need all of px py pz, in a static plan")

        def stacked(names: Sequence[str]) -> np.ndarray:
            return np.stack([data[c].astype(float) for c in names], axis=-1)

        touched = stacked(POINT) if points else None
        segment, dwell = segment.astype(np.int64), dwell.astype(float)
        return cls(robot, stacked(joints), segment, dwell, mode, rate, touched, str(path))

    def write(self, path: str | Path) -> None:
        """Write the plan to a Parquet file."""
        data = {f"q{j + 1}": self.q[:, j] for j in range(self.q.shape[1])}
        data |= {"segment": self.segment.astype(np.int64)}
        if self.dwell.any():
            data["dwell"] = self.dwell
        if self.points is not None:
            data |= {c: self.points[:, k] for k, c in enumerate(POINT)}
        raw: dict[str, Any] = {"format": parquet.FORMAT, "robot": self.robot, "mode": self.mode}
        if self.rate_hz is not None:
            raw["rate_hz"] = self.rate_hz
        raw |= model_field(self.robot)
        parquet.write(Path(path), parquet.table_of(data, raw))


def is_plan(path: Path) -> bool:
    """Whether a file is a plan: Parquet with joint values, but no times and no readings."""
    names = parquet.column_names(path) or ()
    return "q1" in names and "t" not in names and not holds_readings(names)


def read(path: str | Path) -> np.ndarray:
    """Read points to touch (K, 3) [m] from a text file with the columns x, y, z; a `PlanError`
    names the file, the column and the row."""
    path = Path(path)
    try:
        table = read_text(path)
        points = np.stack([table.numbers(name) for name in "xyz"], axis=1)
    except MapError as error:
        raise PlanError(f"{error}; points to touch are rows of x, y, z in m") from error
    far = np.argwhere(np.abs(points) >= _FAR)
    if len(far):
        row, k = far[0]
        raise PlanError(
            f"{path}: row {row}: {'xyz'[k]} = {points[row, k]:g} m is not within {_FAR:g} m (is it "
            "in mm?)"
        )
    return points
