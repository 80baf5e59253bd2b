"""Robots with closed loops as plain MuJoCo has them: its own constraints close them."""

from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

_STRIDE = 0.02


class PlainLoops:
    """A file in MuJoCo, with a sensor between the frame and the tool's body.

    Args:
        path: MJCF.
        frame: site of the sensor; the tool's body stands there, unturned in its parent.
        tool: that body.
        driven: joints in the order of q.
    """

    def __init__(self, path: Path, frame: str, tool: str, driven: tuple[str, ...]) -> None:
        plain = mujoco.MjModel.from_xml_path(str(path))
        spec = mujoco.MjSpec.from_file(str(path))
        spec.body(tool).add_site(name="seat", quat=plain.site(frame).quat)
        for kind in ("FORCE", "TORQUE"):
            spec.add_sensor(
                name=kind.lower(), type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE, objname="seat",
            )  # fmt: skip
        self.model = spec.compile()
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)
        self.tool = tool
        self.at = [int(self.model.joint(n).qposadr[0]) for n in driven]
        self.passive = [k for k in range(self.model.nv) if k not in self.at]
        self.home = self.model.key_qpos[0].copy() if self.model.nkey else self.model.qpos0.copy()

    def change(self, moved: dict[str, float], gravity: np.ndarray) -> None:
        """Add to the file's numbers what parameters by name add; links are called by their bodies.

        The first of several joints in a body goes by ``<body>_<joint>``.
        """
        model = self.model
        bodies = {model.body(b).name: b for b in range(1, model.nbody)}
        for j in range(model.njnt):
            body = int(model.jnt_bodyid[j])
            if model.body_jntnum[body] > 1 and j == model.body_jntadr[body]:
                bodies[f"{model.body(body).name}_{model.joint(j).name}"] = body
        turns: dict[int, np.ndarray] = {}
        for name, value in moved.items():
            group, *rest, axis = name.split(".")
            k = "xyz".find(axis)
            if group == "link":
                if rest[1] == "position":
                    model.body_pos[bodies[rest[0]]][k] += value
                else:
                    turns.setdefault(bodies[rest[0]], np.zeros(3))[k] = value
            elif group == "loop":
                self._move(rest[0], rest[1], k, value)
        for b, vector in turns.items():
            own = Rotation.from_quat(model.body_quat[b], scalar_first=True)
            model.body_quat[b] = (own * Rotation.from_rotvec(vector)).as_quat(scalar_first=True)
        tilt = [moved.get("base.tilt.x", 0.0), moved.get("base.tilt.y", 0.0), 0.0]
        model.opt.gravity[:] = Rotation.from_rotvec(tilt).apply(gravity)

    def _move(self, loop: str, body: str, k: int, value: float) -> None:
        model, e = self.model, self.model.equality(loop).id
        for n, one in enumerate((int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))):
            if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
                if model.body(model.site_bodyid[one]).name == body:
                    model.site_pos[one][k] += value
            elif model.body(one).name == body:
                model.eq_data[e][3 * n + k] += value

    def wrench(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Load on the sensor (N, 6) [N, N·m], and its place in the world (N, 3) [m]."""
        model, data = self.model, self.data
        loads, places = np.empty((len(q), 6)), np.empty((len(q), 3))
        for i, goal in enumerate(q):
            data.qpos[:] = self.home
            start = self.home[self.at]
            steps = max(1, int(np.ceil(np.abs(goal - start).max() / _STRIDE)))
            for share in np.arange(0, steps + 1) / steps:
                data.qpos[self.at] = start + share * (goal - start)
                self._close(3)
            self._close(6)
            data.qvel[:] = data.qacc[:] = 0.0
            mujoco.mj_inverse(model, data)
            loads[i] = -np.concatenate([data.sensor("force").data, data.sensor("torque").data])
            places[i] = data.site("seat").xpos
        return loads, places

    def _close(self, times: int) -> None:
        model, data = self.model, self.data
        for _ in range(times):
            mujoco.mj_fwdPosition(model, data)
            rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
            slopes = data.efc_J.reshape(-1, model.nv)[: data.nefc][rows][:, self.passive]
            data.qpos[self.passive] -= (
                np.linalg.pinv(slopes, 1e-9) @ data.efc_pos[: data.nefc][rows]
            )
