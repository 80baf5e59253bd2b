"""The scene of a recording or of a plan: rows that were measured and the ways between them."""

import numpy as np

from wrenchbed.holds import Holds
from wrenchbed.jets import Value, value
from wrenchbed.model import Model
from wrenchbed.observations import Observations
from wrenchbed.recording import Recording
from wrenchbed.scene import WAY, Scene


def of_poses(
    model: Model, theta: np.ndarray, q: np.ndarray, t: np.ndarray, warmth: np.ndarray | None
) -> Scene:
    """Poses at rest (H, J) at times (H,) [s], joined by straight joint-space moves."""
    own = theta[: len(model.robot.parameters)]
    gravity = np.asarray(model.gravity)
    if not model.robot.joints or len(q) < 2:
        return Scene(model.robot, own, gravity, q, t, np.ones(len(q), dtype=bool), warmth)
    share = np.arange(WAY + 1) / (WAY + 1)

    def fill(x: np.ndarray) -> np.ndarray:
        steps = np.diff(x, axis=0)
        part = share.reshape((1, -1) + (1,) * (x.ndim - 1))
        ways = x[:-1, None] + part * steps[:, None]
        return np.concatenate([ways.reshape(-1, *x.shape[1:]), x[-1:]])

    held = np.zeros((len(q) - 1) * (WAY + 1) + 1, dtype=bool)
    held[:: WAY + 1] = True
    warm = None if warmth is None else fill(warmth)
    return Scene(model.robot, own, gravity, fill(q), fill(t), held, warm)


def of_motion(
    model: Model, theta: np.ndarray, q: Value, t: np.ndarray, warmth: np.ndarray | None
) -> Scene:
    """Samples of a motion (N, J) as jets."""
    own = theta[: len(model.robot.parameters)]
    held = np.ones(len(value(q)), dtype=bool)
    return Scene(model.robot, own, np.asarray(model.gravity), q, t, held, warmth)


def of_recording(
    recording: Recording, model: Model, theta: np.ndarray, data: Observations | Holds
) -> Scene:
    """The scene whose held rows are the observations of a recording."""
    warmth = None
    if "temperature" in recording.columns:
        temperature = recording.columns["temperature"].astype(float)
        warmth = np.interp(data.t, recording.t, temperature - temperature[0])
    make = of_motion if recording.metadata.mode == "dynamic" else of_poses
    return make(model, theta, data.q, data.t, warmth)
