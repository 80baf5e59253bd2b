"""Other people's robots as files, and the same files in plain MuJoCo with a tool and a sensor."""

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.physics.wrench import Tool

DATA = Path(__file__).parents[1] / "data" / "robots"


class ArmFileCase(NamedTuple):
    """A file, the frame of its sensor, how many joints, and whether it hangs a tool there."""

    file: str
    frame: str
    joints: int
    tool: bool

    @property
    def path(self) -> Path:
        return DATA / self.file


CASES = (
    ArmFileCase("ur5e.xml", "right_hand", 6, False),
    ArmFileCase("iiwa.xml", "right_hand", 7, False),
    ArmFileCase("panda.xml", "right_hand", 7, True),
    ArmFileCase("ur10.urdf", "tool0", 6, False),
    ArmFileCase("xarm7.urdf", "link_eef", 7, False),
    ArmFileCase("panda.urdf", "panda_link8", 7, True),
)
TOOL_MASS, TOOL_COG = 1.2, (0.01, -0.02, 0.05)


def without_meshes(path: Path) -> mujoco.MjSpec:
    """The file's tree in MuJoCo, by other code than the package's."""
    root = ElementTree.parse(path).getroot()
    for element in root.iter():
        for child in list(element):
            mesh = child.tag == "mesh" or child.get("type") == "mesh"
            if mesh or child.tag in ("visual", "collision", "asset", "actuator", "mimic"):
                element.remove(child)
    if root.tag == "robot":
        extra = ElementTree.SubElement(root, "mujoco")
        ElementTree.SubElement(extra, "compiler", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.compiler.fusestatic = False
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-12
    return spec


class PlainArm:
    """The user's file itself, its numbers changed in place as parameters say.

    Args:
        path, frame: file and body of the sensor.
        tool: hung there instead of what the file has; None keeps the file's.
    """

    def __init__(self, path: Path, frame: str, tool: Tool | None) -> None:
        spec = without_meshes(path)
        body = spec.body(frame)
        if tool is None:
            body.add_site(name="seat")
        else:
            for child in list(body.bodies):
                spec.delete(child)
            if not len(body.joints):
                body.mass, body.inertia = 0.0, [0.0, 0.0, 0.0]
            seat = body.add_body(name="seat")
            seat.mass, seat.ipos = float(tool.mass), np.asarray(tool.cog, dtype=float)
            inertia = np.asarray(tool.inertia, dtype=float)
            seat.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            seat.explicitinertial = True
            seat.add_site(name="seat")
        for kind in ("FORCE", "TORQUE"):
            spec.add_sensor(
                name=kind.lower(), type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE, objname="seat",
            )  # fmt: skip
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def change(self, values: dict[str, float], gravity: np.ndarray) -> None:
        """Write parameters by their names into the compiled file."""
        model = self.model
        turns: dict[str, np.ndarray] = {}
        for name, value in values.items():
            group, _, rest = name.partition(".")
            if group == "link":
                body, what, axis = rest.rsplit(".", 2)
                if what == "position":
                    model.body_pos[model.body(body).id]["xyz".index(axis)] = value
                else:
                    turns.setdefault(body, np.zeros(3))["xyz".index(axis)] = value
            elif group == "mount":
                what, axis = rest.split(".")
                if what == "position":
                    model.body("seat").pos["xyz".index(axis)] = value
                else:
                    turns.setdefault("seat", np.zeros(3))["xyz".index(axis)] = value
        for body, vector in turns.items():
            b = model.body(body).id
            own = Rotation.from_quat(model.body_quat[b], scalar_first=True)
            model.body_quat[b] = (own * Rotation.from_rotvec(vector)).as_quat(scalar_first=True)
        tilt = [values["base.tilt.x"], values["base.tilt.y"], 0.0]
        model.opt.gravity[:] = Rotation.from_rotvec(tilt).apply(gravity)

    def wrench(self, q: np.ndarray, zeros: dict[str, float]) -> np.ndarray:
        """Load on the sensor (N, 6) [N, N·m] at values of the chain's joints, named with zeros."""
        model, data = self.model, self.data
        at = [int(model.joint(name).qposadr[0]) for name in zeros]
        result = np.empty((len(q), 6))
        for i, row in enumerate(q):
            data.qpos[:] = model.qpos0
            data.qpos[at] = row + np.array(list(zeros.values()))
            data.qvel[:] = data.qacc[:] = 0.0
            mujoco.mj_inverse(model, data)
            result[i] = -np.concatenate([data.sensor("force").data, data.sensor("torque").data])
        return result
