"""The robot of a diagnosis as lines: what is left at the sensor as arrows, the next poses."""

import numpy as np

from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series
from wrenchbed.pages.numbers import round_down
from wrenchbed.reports.simulators import Evidence, along
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.simulation import Simulation

MOST_ARROWS, MOST_NEXT = 30, 5
"""Poses whose residual is drawn, and next poses: evenly chosen."""
LONGEST_MM = 250.0
"""Of an arrow."""
_SHORT = 1000.0
"""Length of 1 N [mm] from which the length of 1 mN is told."""
_VIEWS = (("from the side", 0, 2), ("from above", 0, 1))


def robot_chart(found: Findings, e: Evidence) -> Chart | None:
    """The robot where most is left, the residual force of some poses, and the poses to do next.

    None where the recording has no joints of a robot with a model.
    """
    p = e.prepared
    robot = p.model.robot
    if not isinstance(robot, SimulatedRobot) or not p.scene.jointed:
        return None
    simulation = Simulation(robot, robot.robot_theta(robot.parameters.nominal))
    left = p.y - (e.before if e.after is None else e.after)
    worst = int(np.argmax(((left / e.std) ** 2).sum(axis=1)))
    some = np.unique([worst, *np.linspace(0, len(left) - 1, MOST_ARROWS).astype(int)])
    joints = p.scene.joints[p.scene.held]
    sensor, turned = simulation.sensor_frames(joints[some])
    force = np.einsum("kij,kj->ki", turned, left[some, :3])
    longest = float(np.linalg.norm(force, axis=1).max())
    scale = round_down(LONGEST_MM / max(longest, 1e-12))
    arrows = _broken(np.stack([1e3 * sensor, 1e3 * sensor + scale * force], axis=1))
    body = _broken(1e3 * simulation.skeleton(joints[[worst]])[0])
    plan = proposed_poses(found)
    ahead = np.empty((0, 3))
    if plan is not None:
        chosen = np.unique(np.linspace(0, len(plan) - 1, MOST_NEXT).astype(int))
        ahead = np.concatenate([_broken(1e3 * s) for s in simulation.skeleton(plan.q[chosen])])
    at = along(p)[0][worst]
    where = f"at {at:.4g} s" if p.moving or p.averaged else f"in pose {at:.0f}"
    role: Role = "before" if e.after is None else "after"
    drawn: tuple[tuple[str, np.ndarray, Role, bool], ...] = (
        ("poses to do next", ahead, "rest", True),
        (f"the robot {where}", body, "measured", False),
        ("residual force", arrows, role, False),
    )
    panels = tuple(
        Panel(
            Axis("xyz"[i], "mm"), Axis("xyz"[j], "mm"),
            (
                *(
                    Series(name, "line", points[:, i], points[:, j], role=r, dashed=dashed)
                    for name, points, r, dashed in drawn
                    if len(points)
                ),
                Series("", "points", 1e3 * sensor[:, i], 1e3 * sensor[:, j], role=role),
            ),
            title=title, height=1.9, equal=True,
        )
        for title, i, j in _VIEWS
    )  # fmt: skip
    length = f"1 N is {scale:g} mm" if scale < _SHORT else f"1 mN is {1e-3 * scale:g} mm"
    most = float(np.abs(left[some, :3] / e.std[:3]).max())
    simulator = "the calibrated simulator" if e.after is None else "the simulator with the effects"
    caption = (
        f"The robot stands {where}, where most is left. From the dots, the sensor: measured force "
        f"minus that of {simulator}, in {len(some)} of {len(left)} {p.observed}; {length} long, "
        f"the largest component is {most:.2g} times the noise of a row."
    )
    if len(ahead):
        caption += f" Dashed: {len(chosen)} of {len(plan or ())} poses of the next experiment."
    return Chart("robot", "The robot, what is left at its sensor, and where to go next",
                 panels, columns=2, caption=caption)  # fmt: skip


def proposed_poses(found: Findings) -> Plan | None:
    """The first proposed plan of poses at rest, None where there is none."""
    plan = next(iter(found.plans.values()), None)
    return plan if plan is not None and plan.mode == "static" else None


def _broken(lines: np.ndarray) -> np.ndarray:
    """Lines (L, P, 3) as one, (L (P + 1), 3), with NaN between them."""
    gaps = np.full((len(lines), 1, 3), np.nan)
    return np.concatenate([lines, gaps], axis=1).reshape(-1, 3)
