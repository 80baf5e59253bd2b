"""Pictures of an environment's robot, drawn by MuJoCo without a screen."""

import mujoco
import numpy as np

from wrenchbed.simulation import Simulation

SIZE = (480, 640)
"""Height and width [px]."""


class Picture:
    """A renderer that follows the robot."""

    def __init__(self) -> None:
        self._renderer: mujoco.Renderer | None = None
        self._model: mujoco.MjModel | None = None

    def of(
        self, simulation: Simulation, q: np.ndarray, data: mujoco.MjData | None = None
    ) -> np.ndarray:
        """The robot (H, W, 3) at joint values (J,), or in a state."""
        if data is None:
            data = mujoco.MjData(simulation.model)
            data.qpos[:] = simulation.robot.qpos(q[None], simulation.theta)[0]
            mujoco.mj_forward(simulation.model, data)
        if self._model is not simulation.model:
            self.close()
            self._renderer = mujoco.Renderer(simulation.model, *SIZE)
            self._model = simulation.model
        assert self._renderer is not None
        self._renderer.update_scene(data, camera="view")
        return np.asarray(self._renderer.render())

    def close(self) -> None:
        """Let go of it."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._model = None
