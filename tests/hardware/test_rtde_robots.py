"""Which robots the driver of UR robots takes."""

import pytest

from arm_files import DATA
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.drivers.rtde import RtdeOptions
from wrenchbed.robots.described import describe


def test_an_arm_from_a_file_is_driven_if_it_has_six_hinges(tmp_path):
    for file, frame, joints in (("ur10.urdf", "tool0", 6), ("iiwa.xml", "right_hand", 7)):
        made = describe(
            DATA / file, frame, tmp_path / f"{joints}.toml", tool_mass=1.0, tool_cog=(0, 0, 0.05)
        )
        made.write(tmp_path / f"{joints}.toml")
    assert RtdeOptions(robot=str(tmp_path / "6.toml")).robot.endswith("6.toml")
    for other in (str(tmp_path / "7.toml"), "medrue"):
        with pytest.raises(ParameterError, match="six hinges"):
            RtdeOptions(robot=other)
