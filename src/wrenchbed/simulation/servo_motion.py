"""A servo-driven robot in MuJoCo that moves in simulated time."""

from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import rollout

from wrenchbed.simulation.mujoco_wrench import Simulation, load_on_sensor

LONGEST_STEP = 0.002
"""Longest step of MuJoCo [s]; with its discrete integrator MedRUE's loops stay within 0.4 µm."""
_STILL = 1e-10
_THERE = 1e-12
"""Speed [rad/s, m/s] and distance to target [rad, m] below which a joint counts as at rest there.
"""
_PATIENCE_S = 4.0
_TOLERABLE = 1e-6


class Sampled(NamedTuple):
    """Joint values (J,), speeds (J,) and load on the sensor (6,) [N, N·m] at one instant."""

    q: np.ndarray
    qd: np.ndarray
    load: np.ndarray


class ServoDrivenRobot:
    """Dynamics of a robot in MuJoCo whose position servos follow joint targets.

    Args:
        simulation: the compiled robot; its MuJoCo state changes from now on.
        q: joint values (J,) at the start.
    """

    def __init__(self, simulation: Simulation, q: np.ndarray) -> None:
        self.simulation = simulation
        self.model, self.data = simulation.model, mujoco.MjData(simulation.model)
        self.model.opt.timestep = LONGEST_STEP
        joints = [self.model.joint(joint.name) for joint in simulation.robot.joints]
        self._columns = [int(joint.qposadr[0]) for joint in joints]
        self._speeds = [int(joint.dofadr[0]) for joint in joints]
        self.data.qpos[:] = simulation.robot.qpos(q[None], simulation.theta)[0]
        gain, bias = self.model.actuator_gainprm[:, 0], self.model.actuator_biasprm
        # controls with which the servos' force is 0 at rest: scale · joint values + offset
        self._scale, self._offset = -bias[:, 1] / gain, -bias[:, 0] / gain
        self._aim(q)
        mujoco.mj_forward(self.model, self.data)

    @property
    def q(self) -> np.ndarray:
        """Present joint values (J,) [rad or m]."""
        return np.array(self.data.qpos[self._columns])

    @property
    def qd(self) -> np.ndarray:
        """Present joint speeds (J,) [rad/s or m/s]."""
        return np.array(self.data.qvel[self._speeds])

    @property
    def target(self) -> np.ndarray:
        """Last joint targets of the servos (J,) [rad or m]."""
        return np.array(self._target)

    def _aim(self, target: np.ndarray) -> None:
        """Set the servos' targets such that at rest the joints stand at ``target`` (J,)."""
        self._target = np.asarray(target, dtype=float)
        self.data.ctrl[:] = self._scale * self._target + self._offset

    def advance(self, target: np.ndarray, seconds: float) -> None:
        """Simulate some seconds at constant targets (J,), in steps of at most `LONGEST_STEP`."""
        steps = steps_in(seconds)
        self.model.opt.timestep = seconds / steps
        self._aim(target)
        mujoco.mj_step(self.model, self.data, steps)

    def settle(self, target: np.ndarray) -> tuple[bool, float]:
        """Simulate until the joints rest at ``target`` (J,); return whether they do, time [s]."""
        waited, step = 0.0, 0.05
        while waited < _PATIENCE_S:
            self.advance(target, step)
            waited += step
            if np.abs(self.qd).max() < _STILL and np.abs(self.q - target).max() < _THERE:
                break
        return bool(np.abs(self.q - target).max() < _TOLERABLE), waited

    def follow(self, targets: np.ndarray, seconds: float) -> Sampled:
        """Simulate ``seconds`` in S equal steps to targets (S, J); return joint state and load at
        the start. The load is read inside MuJoCo's step: with the discrete integrator only that
        acceleration moves the robot; `mj_forward` would report the stiff servos' raw one."""
        self.model.opt.timestep = seconds / len(targets)
        q, qd = self.q, self.qd
        self._aim(targets[0])
        mujoco.mj_step(self.model, self.data)
        load = load_on_sensor(self.data)
        for target in targets[1:]:
            self._aim(target)
            mujoco.mj_step(self.model, self.data)
        return Sampled(q, qd, load)

    def follow_all(self, ways: np.ndarray, seconds: float) -> Sampled:
        """Simulate N samples of ``seconds`` each, in S steps with targets ``ways`` (N, S, J);
        return the joint states (N, J) and loads (N, 6) [N, N·m] at the start of each sample."""
        model, data, every = self.model, self.data, ways.shape[1]
        model.opt.timestep = seconds / every
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, start, kind)
        states, sensed = rollout.rollout(
            model, data, start, self._scale * ways.reshape(1, -1, ways.shape[2]) + self._offset,
            initial_warmstart=np.array(data.qacc_warmstart),
        )  # fmt: skip
        before = np.concatenate([start[None], states[0, every - 1 : -1 : every]])
        qpos = before[:, 1 : 1 + model.nq]  # after the time
        qvel = before[:, 1 + model.nq : 1 + model.nq + model.nv]
        first = [int(model.sensor(name).adr[0]) for name in ("force", "torque")]
        load = -np.concatenate([sensed[0, ::every, k : k + 3] for k in first], axis=1)
        return Sampled(qpos[:, self._columns], qvel[:, self._speeds], load)


def steps_in(seconds: float) -> int:
    """Number of equal steps of at most `LONGEST_STEP` in a duration [s]."""
    return max(1, int(np.ceil(seconds / LONGEST_STEP - 1e-9)))
