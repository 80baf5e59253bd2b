"""Arms of the referee: the UR5, other arms of the family, and arms from files with inertias."""

from pathlib import Path

from wrenchbed import registry
from wrenchbed.files import write_text
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.described import describe
from wrenchbed.robots.serial_xml import mjcf_of
from wrenchbed.robots.ur_family import ur_arm

FAMILY = ("ur3e", "ur5e", "ur10e", "ur16e")
"""Arms of Universal Robots that are written as MJCF."""
FILES = (("iiwa.xml", "right_hand"), ("panda.xml", "right_hand"), ("ur10.urdf", "tool0"),
         ("xarm7.urdf", "link_eef"))  # fmt: skip
"""Files of others in a folder, with the frame of the sensor."""
_TOOL = (1.2, (0.0, 0.0, 0.05))
"""Mass [kg] and centre of gravity [m] of a first tool, which each case replaces: estimate."""


def arms(files: Path, scratch: Path) -> list[SimulatedRobot]:
    """All arms; those from files are known to the registry afterwards.

    Args:
        files: a folder with `FILES`.
        scratch: a folder where the family's MJCF files may lie.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    found: list[SimulatedRobot] = [registry.load("robots", "ur5")]
    todo = [(files / name, frame) for name, frame in FILES]
    for name in FAMILY:
        path = scratch / f"{name}.xml"
        write_text(path, mjcf_of(ur_arm(name).arm))
        todo.append((path, "flange"))
    for path, frame in todo:
        mass, cog = _TOOL
        told = describe(path, frame, scratch / f"{path.stem}.toml", tool_mass=mass, tool_cog=cog)
        assert isinstance(told.robot, SimulatedRobot)
        registry.remember("robots", told.robot.name, told.robot.record or {})
        found.append(told.robot)
    return found
