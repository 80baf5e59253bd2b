"""Fixtures for tests of a robot's client; put into a conftest.py:

pytest_plugins = ["robot_emulators.pytest_fixtures"]
"""

from collections.abc import Iterator

import pytest

from robot_emulators.serving import ur5


@pytest.fixture
def ur5_address() -> Iterator[str]:
    """Address of a UR5 with its controller, as long as the test runs."""
    with ur5(host="127.0.0.105") as address:
        yield address
