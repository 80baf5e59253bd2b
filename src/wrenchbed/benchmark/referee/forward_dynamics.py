"""The machine on its path: the load on the sensor at every instant, by forward dynamics.

Steps are estimates: small against every time constant of the machine.
"""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from wrenchbed.benchmark.referee.path import DrivePath
from wrenchbed.benchmark.referee.true_robot import ARMATURE, Mechanics, build
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import SimulatedRobot

STEP_S = {"static": 1e-3, "dynamic": 5e-4}
"""MuJoCo's step; wrenchbed's own plant takes 2 ms."""
_SEAT_S = 1.5
"""Time to come to rest where the machine is placed at a pose [s]."""


@dataclass(frozen=True, eq=False)
class Ride:
    """What happened at each of T instants.

    Attributes:
        path: that was commanded.
        load: on the sensor, its true axes (T, 6) [N, N·m].
        rotation: R_world_sensor (T, 3, 3).
        position: of the sensor in the world (T, 3) [m].
        gravity: true gravity in the nominal world's axes (3,) [m/s²].
    """

    path: DrivePath
    load: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    gravity: np.ndarray

    def in_sensor(self, vector: np.ndarray) -> np.ndarray:
        """A vector (T, 3) or (3,) of the world in sensor axes (T, 3)."""
        each = np.broadcast_to(vector, self.position.shape)
        return np.asarray(np.einsum("tij,ti->tj", self.rotation, each))


def ride(robot: SimulatedRobot, truth: Mechanics, path: DrivePath) -> Ride:
    """Run a machine along a path.

    Raises:
        ParameterError: the simulation diverged.
    """
    h = STEP_S["dynamic" if path.moving else "static"]
    machine = build(robot, truth, h)
    model, data = machine.model, mujoco.MjData(machine.model)
    position_of, speed = machine.position, machine.velocity
    q, qd, qdd = _driven(truth, path)
    count = len(path.t)
    load, rotation, position = np.empty((count, 6)), np.empty((count, 9)), np.empty((count, 3))
    steps = np.maximum(1, np.round(np.diff(path.t, append=path.t[-1] + h) / h)).astype(int)
    push = ARMATURE * qdd
    qpos, qvel, applied = data.qpos, data.qvel, data.qfrc_applied
    site = model.site("ft").id
    of_site, at_site = data.site_xmat[site], data.site_xpos[site]
    force, torque = data.sensor("force").data, data.sensor("torque").data
    read, ignored = model.opt.disableflags, mujoco.mjtDisableBit.mjDSBL_SENSOR
    with _without_clock():
        for i, further in enumerate((steps - 1).tolist()):
            if i in path.placed:
                machine.place(data, q[i])
                applied[:] = 0.0
                mujoco.mj_step(model, data, round(_SEAT_S / h))
            qpos[position_of], qvel[speed], applied[speed] = q[i], qd[i], push[i]
            mujoco.mj_step(model, data)
            load[i, :3], load[i, 3:] = force, torque
            rotation[i], position[i] = of_site, at_site
            if further:  # nobody reads the sensors between instants
                model.opt.disableflags = read | ignored
                mujoco.mj_step(model, data, further)
                model.opt.disableflags = read
    load *= -1.0
    if not np.isfinite(load).all() or np.abs(load).max() > 1e4:
        raise ParameterError("the simulation diverged: the faults are too large for the machine")
    return Ride(path, load, rotation.reshape(-1, 3, 3), position, truth.gravity)


@contextmanager
def _without_clock() -> Iterator[None]:
    """MuJoCo's steps without its timers, which nobody reads here: they take an eighth of a step.

    ``set_mjcb_time`` takes no null pointer, so C's own variable is cleared.
    """
    clock = _clock()
    before, clock.value = clock.value, None
    try:
        yield
    finally:
        clock.value = before


@cache
def _clock() -> ctypes.c_void_p:
    """MuJoCo's pointer to the function that tells the time; a dummy where its library is not."""
    with suppress(StopIteration, OSError, ValueError):
        library = next(Path(mujoco.__file__).parent.glob("libmujoco.*"))
        return ctypes.c_void_p.in_dll(ctypes.CDLL(str(library)), "mjcb_time")
    return ctypes.c_void_p()


def _driven(truth: Mechanics, path: DrivePath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True positions, speeds and accelerations of the drives (T, J): errors vary on the path."""
    eps = 1e-4
    q0 = truth.driven(path.q)
    if not truth.drive:
        return q0, path.qd, path.qdd
    ahead = truth.driven(path.q + eps * path.qd)
    behind = truth.driven(path.q - eps * path.qd)
    qd = (ahead - behind) / (2 * eps)
    curvature = (ahead - 2 * q0 + behind) / eps**2
    slope = np.where(np.abs(path.qd) > 1e-6, qd / np.where(path.qd == 0, 1, path.qd), 1.0)
    return q0, qd, slope * path.qdd + curvature
