"""Pictures of an environment's robot, rendered by MuJoCo without a screen."""

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.plant.contact_surface import Limb
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.mujoco_wrench import Simulation

SIZE = (480, 640)
"""Height and width [px]."""
_HALF_M = 0.2
"""Half of the length of the limb that is drawn [m]."""
_SKIN = np.array([0.87, 0.67, 0.56, 1.0], dtype=np.float32)
"""Colour of a limb [RGBA]."""


def simulated(name: str) -> SimulatedRobot:
    """Load a robot that can be simulated by its registry name; a `NotFoundError` for no such name,
    a `ParameterError` for a robot without a model."""
    robot = registry.load("robots", name)
    if not isinstance(robot, SimulatedRobot):
        raise ParameterError(f"robot {name!r} has no model to simulate")
    return robot


class Rendered:
    """Base of environments that show their robot; ``render_mode`` is ``rgb_array`` or None."""

    render_mode: str | None
    _renderer: mujoco.Renderer | None = None
    _model: mujoco.MjModel | None = None

    def picture(
        self, simulation: Simulation, q: np.ndarray, limb: Limb | None = None
    ) -> np.ndarray:
        """RGB picture (H, W, 3) of the robot at joint values (J,), and of the limb if any."""
        data = mujoco.MjData(simulation.model)
        data.qpos[:] = simulation.robot.qpos(q[None], simulation.theta)[0]
        mujoco.mj_forward(simulation.model, data)
        if self._model is not simulation.model:
            self.close()
            self._renderer = mujoco.Renderer(simulation.model, *SIZE)
            self._model = simulation.model
        assert self._renderer is not None
        self._renderer.update_scene(data, camera="view")
        if limb is not None:
            scene, kind = self._renderer.scene, mujoco.mjtGeom.mjGEOM_CYLINDER
            geom, zero = scene.geoms[scene.ngeom], np.zeros(3)
            mujoco.mjv_initGeom(geom, kind, zero, zero, np.zeros(9), _SKIN)
            ends = (limb.point + side * _HALF_M * limb.axis for side in (-1, 1))
            mujoco.mjv_connector(geom, kind, limb.radius, *ends)
            scene.ngeom += 1
        return np.asarray(self._renderer.render())

    def close(self) -> None:
        """Release MuJoCo's renderer."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._model = None
