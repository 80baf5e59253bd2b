"""What the sensors of many robots of one kind read at rest, in MuJoCo: compiled once.

To compile a model takes longer than to evaluate a hundred poses. Numbers of a model may be changed
after it is compiled: positions, orientations, masses and reference coordinates are.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.data.recording import Recording
from wrenchbed.errors import WrenchbedError
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.robots.base import INERTIA_AXES, SimulatedRobot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.twin.assembly import with_some_inertia
from wrenchbed.twin.mechanics import Mechanism
from wrenchbed.twin.replay import check_robot, holds, read_as


def simulate_each(
    model: Model, thetas: np.ndarray, recording: Recording, noise: str, seeds: Sequence[int]
) -> list[Recording | WrenchbedError]:
    """`simulate` of robots without effects at rest, thetas (R, P), with seeds (R,) of their noise.

    The error of a robot stands for its recording where it cannot take the joint values.

    Raises:
        RecordingError, ParameterError: as `simulate`.
    """
    robot = model.robot
    check_robot(robot, recording)
    poses, hold = holds(recording)
    results: list[Recording | WrenchbedError] = []
    for theta in thetas:
        own = robot.robot_theta(theta)
        try:
            if robot.infeasible(poses, own):
                robot.check(recording.q, own, recording.name)
            results.append(recording)
        except WrenchbedError as error:
            results.append(error)
    good = [k for k, result in enumerate(results) if result is recording]
    if not good:
        return results
    loads = loads_at_rest(model, thetas[good], poses)
    reading = np.stack([model.read(x, thetas[k]) for k, x in zip(good, loads, strict=True)])
    kind = noise_model(noise, registry.load("sensors", robot.sensor).noise)
    rows = np.swapaxes(np.swapaxes(reading, 1, 2)[:, :, hold], 1, 2)  # a channel lies in one piece
    streams = NoiseStream(kind, [seeds[k] for k in good])
    for k, measured, status in zip(good, *streams.corrupt(recording.t, rows), strict=True):
        results[k] = read_as(recording, measured.T, status)
    return results


def loads_at_rest(model: Model, thetas: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Loads (R, N, 6) [N, N·m] of robots thetas (R, P) without effects at joint values (N, J)."""
    robot = model.robot
    assert isinstance(robot, SimulatedRobot)
    inertia = [robot.parameters.index(f"tool.inertia.{a}") for a in INERTIA_AXES]
    still, none = np.zeros(q.shape), np.zeros((len(q), 0))
    result, mechanism = np.empty((len(thetas), len(q), 6)), None
    for k, theta in enumerate(thetas):
        own = robot.robot_theta(theta)
        if mechanism is None or (own[inertia] != mechanism.theta[inertia]).any():
            mechanism = Mechanism(robot, own, model.gravity, ())
        else:
            mechanism.theta = own
            _rewrite(mechanism.model, robot.spec(with_some_inertia(robot, own)))
        result[k] = mechanism.load(q, none, still)
    return result


def _rewrite(model: mujoco.MjModel, spec: mujoco.MjSpec) -> None:
    """Put what a spec of the same structure says into a compiled model, all but inertias."""
    free = mujoco.mjtOrientation.mjORIENTATION_QUAT
    for body in spec.bodies:
        i = model.body(body.name).id
        model.body_pos[i], model.body_mass[i], model.body_ipos[i] = body.pos, body.mass, body.ipos
        if body.alt.type == free:
            model.body_quat[i] = _unit(body.quat)
    for site in spec.sites:
        i = model.site(site.name).id
        model.site_pos[i] = site.pos
        if site.alt.type == free:
            model.site_quat[i] = _unit(site.quat)
    for joint in spec.joints:
        found = model.joint(joint.name)
        model.jnt_pos[found.id] = joint.pos
        model.qpos0[found.qposadr[0]] = joint.ref
    model.body_sameframe[:] = model.site_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE


def _unit(quaternion: np.ndarray) -> np.ndarray:
    return np.asarray(quaternion / np.linalg.norm(quaternion))
