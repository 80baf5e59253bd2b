"""Fixtures for tests of a robot's client (README.md names them); put into a conftest.py:

pytest_plugins = ["robot_emulators.pytest_fixtures"]
"""

from collections.abc import Iterator

import pytest

from robot_emulators.serving import Device, medrue, netft, ur5


@pytest.fixture
def ur_robot() -> Iterator[Device]:
    """Fixture: address of an emulated UR5 controller that serves while the test runs."""
    with ur5(box="off") as robot:
        yield robot


@pytest.fixture
def netft_box() -> Iterator[Device]:
    """Fixture: address of an emulated Net F/T box that serves while the test runs."""
    with netft() as box:
        yield box


@pytest.fixture
def cia402_drives() -> Iterator[Device]:
    """Fixture: address of a CAN bus with six emulated CiA 402 drives, served during the test."""
    with medrue() as drives:
        yield drives
