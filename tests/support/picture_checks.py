"""How far a picture in a file is from the truth: each check must notice its own kind of fault."""

from pathlib import Path

import mujoco
import numpy as np

import wrenchbed as wb
from rrd_file import Rrd
from wrenchbed.physics.rotations import matrix
from wrenchbed.simulation.simulation import Simulation
from wrenchbed.viewer.robot import bodies


def misplaced(path: Path, recording: wb.Recording) -> float:
    """Largest error of a body's place [m] or of its axes, against MuJoCo."""
    robot, rrd = wb.load("robots", recording.metadata.robot), Rrd(path)
    simulation = Simulation(robot, robot.parameters.nominal)
    model, data = simulation.model, mujoco.MjData(simulation.model)
    worst = 0.0
    for name, body in bodies(model).items():
        entity = f"/world/real/{name}"
        rows = rrd.times(entity, "Transform3D:translation", "row")
        place = rrd.values(entity, "Transform3D:translation", "row")[:, 0]
        turn = rrd.values(entity, "Transform3D:quaternion", "row")[:, 0]
        for k in range(0, len(rows), 7):
            data.qpos[:] = robot.qpos(recording.q[rows[k] : rows[k] + 1], simulation.theta)[0]
            mujoco.mj_kinematics(model, data)
            x, y, z, w = turn[k]
            off = matrix([w, x, y, z]) - data.xmat[body].reshape(3, 3)
            worst = max(worst, np.abs(place[k] - data.xpos[body]).max(), np.abs(off).max())
    return float(worst)
