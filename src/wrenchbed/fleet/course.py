"""The course of a simulated campaign: when each row is read, and at which joint values.

Moves between poses take their time but are not simulated; `wrenchbed record` steps MuJoCo through
each. At rest the joints are measured where the servos brought them, so that nothing hangs on it.
"""

import numpy as np

from wrenchbed import registry
from wrenchbed.drivers.base import Limits, duration
from wrenchbed.drivers.base.stated import as_designed
from wrenchbed.fleet.setting import Fleet
from wrenchbed.noise import noise_model
from wrenchbed.plan import Plan
from wrenchbed.planning import poses
from wrenchbed.recording import Recording, joint_columns
from wrenchbed.robots.base import SimulatedRobot

RATE_HZ = 100.0
SETTLE_S = 0.5
"""From the end of a move to the first row."""


def course(fleet: Fleet, k: int) -> Recording:
    """The recording of robot k with readings of 0."""
    robot = fleet.model_robot()
    plan = fleet.plan
    if plan is None:
        plan = poses(robot, fleet.poses, int(fleet.rng(k, "poses").integers(2**31)))
    if plan.mode == "dynamic":
        assert plan.rate_hz is not None  # `Plan` holds it
        t, rows, rate = np.arange(len(plan)) / plan.rate_hz, np.arange(len(plan)), plan.rate_hz
    else:
        t, rows, rate = *_rests(robot, plan, fleet.samples), RATE_HZ
    sensor = registry.load("sensors", robot.sensor)
    metadata = as_designed(
        robot, source="sim", mode=plan.mode, rate=rate, gravity=robot.gravity,
        sensor=sensor.name, noise_std=noise_model("real", sensor.noise).row_std,
    )  # fmt: skip
    q = plan.q[rows]
    columns = {"t": t, "segment": plan.segment[rows]}
    columns |= {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
    columns |= {c: np.zeros(len(t)) for c in ("fx", "fy", "fz", "tx", "ty", "tz")}
    assert joint_columns(columns)
    return Recording(metadata, columns, f"{fleet.robot} {k}")


def _rests(robot: SimulatedRobot, plan: Plan, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and poses of all rows (N,)."""
    here, now, begins = np.asarray(robot.home, dtype=float), 0.0, []
    speed = Limits().speed
    for q, dwell in zip(plan.q, plan.dwell, strict=True):
        now += duration(robot, here, q, speed) + SETTLE_S
        begins.append(now)
        now += max(samples / RATE_HZ, float(dwell))
        here = q
    within = np.arange(samples) / RATE_HZ
    t = (np.array(begins)[:, None] + within).ravel()
    return t, np.repeat(np.arange(len(plan)), samples)
