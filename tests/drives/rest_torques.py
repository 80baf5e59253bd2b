"""Torques of arms at rest by MuJoCo, with what no fit knows: friction that stays behind anywhere
within its limits, zeros that creep, links and zeros of joints off as in real arms."""

from dataclasses import dataclass, replace
from pathlib import Path

import arm_torques as arm
import numpy as np

import wrenchbed as wb
from arm_files import CASES
from wrenchbed import registry
from wrenchbed.data.metadata import parse
from wrenchbed.physics.taylor_jets import Jet

TOOL = (0.8, (0.0, 0.0, 0.05))
"""What is stated of the tool [kg, m]."""
ROWS = 8


@dataclass(frozen=True)
class Imperfections:
    """What is wrong beside the load: friction at rest, torque zeros and their creep, over the
    largest weight on a joint; a row's noise [N·m]; links' masses, relative, and a tenth of it of
    their centres [m]; zeros of joints [rad]; gains of torque sensors. Standard deviations."""

    friction: float = 0.02
    noise: float = 0.1
    zero: float = 0.003
    creep: float = 0.001
    links: float = 0.0
    joints: float = 3e-4
    gain: float = 0.0


REAL = Imperfections(links=0.02, joints=1e-3, gain=0.005)


def ur5():
    return registry.load("robots", "ur5")


def by_file(folder: Path, file="iiwa.xml"):
    """An arm from its file, whose tool is stated."""
    case = next(c for c in CASES if c.file == file)
    stated = {"tool_mass": TOOL[0], "tool_cog": TOOL[1]}
    robot = wb.describe_robot(case.path, case.frame, folder / "my.toml", **stated).robot
    registry.remember("robots", robot.name, robot.record)
    return robot


def links_off(rng, size):
    masses, places = rng.normal(size=60), rng.normal(size=(60, 3))

    def edit(model):
        model.body_sameframe[:] = 0
        for body in range(1, model.nbody):
            if model.body(body).name not in (*arm.TOOLS, "sensor_side"):
                model.body_mass[body] *= 1.0 + size * masses[body]
                model.body_ipos[body] += 0.1 * size * places[body]

    return edit


def recording(robot, seed, load=(1.4, (0.01, -0.02, 0.07)), *, poses=50, rows=ROWS, offset=None,
              wrong=Imperfections(), at=None, prefix="tau", constants=1.0, again=0):  # fmt: skip
    """Of random poses with a load (mass [kg], centre (3,) [m]) where `TOOL` is stated.

    Args:
        offset: of the joints' zeros (J,) [rad].
        at: joint values (poses, J) [rad], random ones if None.
        again: number of a further recording of the same arm, with other noise.
    """
    rng = np.random.default_rng([seed, 91])
    q = robot.sample(poses, rng) if at is None else at
    joints = q.shape[1]
    theta = robot.theta_of_tool(robot.parameters.nominal.copy(), load[0], list(load[1]))
    true = q + wrong.joints * rng.normal(size=joints) + (0.0 if offset is None else offset)
    still = Jet(true, 0.0 * true, 0.0 * true)
    torque = arm.inverse(robot, theta, still, edit=links_off(rng, wrong.links))
    rng = np.random.default_rng([seed, 91, again]) if again else rng
    size = np.abs(torque).max(axis=0)
    size = np.maximum(size, 0.05 * size.max())
    came = np.where(np.diff(q, axis=0, prepend=q[:1]) < 0.0, -1.0, 1.0)
    came *= np.where(rng.random(q.shape) < 0.1, -1.0, 1.0)  # a joint may settle backwards
    stuck = wrong.friction * size * came * rng.uniform(0.0, 1.0, q.shape)
    zero = wrong.zero * size * rng.normal(size=joints)
    creep = wrong.creep * size * np.sqrt(np.linspace(0.0, 1.0, poses))[:, None]
    gain = 1.0 + wrong.gain * np.random.default_rng([seed, 92]).normal(size=joints)
    effort = torque * gain + stuck + zero + creep
    effort = np.repeat(effort, rows, axis=0)
    effort = (effort + wrong.noise * rng.normal(size=effort.shape)) / constants
    t = np.arange(len(effort)) * 0.01 + np.repeat(3.0 * np.arange(poses), rows)
    columns = {"t": t} | {f"q{j + 1}": np.repeat(q[:, j], rows) for j in range(joints)}
    columns |= {f"{prefix}{j + 1}": effort[:, j] for j in range(joints)}
    raw = {"format": 1, "robot": robot.name, "source": "test", "mode": "static", "rate_hz": 100.0,
           "tool": {"mass": TOOL[0], "cog": list(TOOL[1])}}  # fmt: skip
    return wb.Recording(parse(raw, "test"), columns, "rest.parquet")


def random_load(seed):
    rng = np.random.default_rng([seed, 5])
    return float(rng.uniform(0.3, 5.0)), tuple(rng.uniform([-0.08, -0.08, 0.0], [0.08, 0.08, 0.16]))


def empty_and_loaded(robot, seed):
    """Recordings of an arm with links 10 % off, one with a further load, elsewhere; that load."""
    mass, centre = load = random_load(seed)
    q, total = robot.sample(100, np.random.default_rng(seed)), TOOL[0] + mass
    both = total, (TOOL[0] * np.array(TOOL[1]) + mass * np.array(centre)) / total
    more = {"wrong": replace(REAL, links=0.1), "rows": 2}
    empty = recording(robot, seed, TOOL, at=q[:50], again=1, **more)
    return (empty, recording(robot, seed, both, at=q[50:], again=2, **more)), load
