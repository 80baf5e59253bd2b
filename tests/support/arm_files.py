"""Other people's robots as files, and the same files in plain MuJoCo with a tool and a sensor."""

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

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
    """The user's file itself.

    Args:
        path, frame: file and body of the sensor.
        tool: hung there instead of what the file has.
    """

    def __init__(self, path: Path, frame: str, tool: Tool) -> None:
        spec = without_meshes(path)
        body = spec.body(frame)
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

    def wrench(self, q: np.ndarray, names: list[str]) -> np.ndarray:
        """Load on the sensor (N, 6) [N, N·m] at values of the chain's joints, by their names."""
        model, data = self.model, self.data
        at = [int(model.joint(name).qposadr[0]) for name in names]
        result = np.empty((len(q), 6))
        for i, row in enumerate(q):
            data.qpos[:] = model.qpos0
            data.qpos[at] = row
            data.qvel[:] = data.qacc[:] = 0.0
            mujoco.mj_inverse(model, data)
            result[i] = -np.concatenate([data.sensor("force").data, data.sensor("torque").data])
        return result
