"""Pictures of an environment's robot, rendered by MuJoCo without a screen."""

import mujoco
import numpy as np

from wrenchbed.plant.contact_surface import Limb
from wrenchbed.simulation.simulation import Simulation

SIZE = (480, 640)
"""Height and width [px]."""
_HALF_M = 0.2
"""Half of the length of a limb in pictures [m]."""
_SKIN = np.array([0.87, 0.67, 0.56, 1.0])
"""Colour of a limb."""


class Rendered:
    """Part of an environment that renders its robot.

    Attributes:
        render_mode: ``rgb_array`` or None.
    """

    render_mode: str | None
    _renderer: mujoco.Renderer | None = None
    _model: mujoco.MjModel | None = None

    def picture(
        self, simulation: Simulation, q: np.ndarray, limb: Limb | None = None
    ) -> np.ndarray:
        """The robot (H, W, 3) at joint values (J,), and the limb that it probes."""
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
            _add(self._renderer.scene, limb)
        return np.asarray(self._renderer.render())

    def close(self) -> None:
        """Release the renderer."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._model = None


def _add(scene: mujoco.MjvScene, limb: Limb) -> None:
    """One more cylinder in a scene."""
    geom = scene.geoms[scene.ngeom]
    kind = mujoco.mjtGeom.mjGEOM_CYLINDER
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), _SKIN.astype(np.float32))
    ends = (limb.point - _HALF_M * limb.axis, limb.point + _HALF_M * limb.axis)
    mujoco.mjv_connector(geom, kind, limb.radius, *ends)
    scene.ngeom += 1
