"""An emulator before a plant that knows neither MuJoCo nor wrenchbed, and the package alone."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from robot_emulators import Arm, Efforts, ur5
from robot_emulators.kinematic_plant import KinematicPlant, known_arm
from ur5_socket import Client

pytest_plugins = ["robot_emulators.pytest_fixtures"]


class Stiff:
    """A UR5 whose joints are where their targets were, with a constant load."""

    gauges = None
    sensor_range = np.full(6, 100.0)
    load = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])

    def __init__(self, arm: Arm, cycle: float) -> None:
        self.arm, self.cycle = arm, cycle
        self.q, self.qd, self.time = arm.home.copy(), np.zeros(6), 0.0
        self.newest = (time.monotonic(), 0.0)

    @property
    def efforts(self) -> Efforts:
        return Efforts(np.ones(6), np.ones(6), np.full(6, 25.0))

    def step(self, target: np.ndarray, due: float = 0.0) -> None:
        self.q, self.time = np.array(target), self.time + self.cycle
        self.newest = (due or time.monotonic(), self.time)

    def wrench(self) -> np.ndarray:
        return self.load

    def readings(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.tile(self.load, (len(t), 1)), np.zeros(len(t), dtype=np.uint32)

    def model_torques(self, q, qd, qdd, gravity) -> np.ndarray:
        return np.zeros(6)


def test_a_client_reads_the_joints_of_a_plant_of_ones_own():
    plant = Stiff(known_arm("ur5"), 0.008)
    with ur5(plant, "127.0.1.61", box="off") as address, Client(address) as client:
        client.stream("timestamp,actual_q,actual_current")
        state = client.until(lambda s: s[0] > 0.0)
    assert state[1:7] == pytest.approx(plant.arm.home)
    assert state[7:] == pytest.approx(np.ones(6))


def test_the_fixture_serves_the_built_in_plant(ur5_address):
    with Client(ur5_address) as client:
        client.stream("timestamp,actual_q,actual_TCP_force")
        state = client.until(lambda s: s[0] > 0.0)
    assert state[1:7] == pytest.approx(known_arm("ur5").home)
    assert state[7:10] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)  # its payload is known


def test_a_load_weighs_what_it_should_in_any_pose():
    plant = KinematicPlant(known_arm("ur10e"), 0.002)
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (5, 6)):
        plant.step(q)
        wrench = plant.wrench()
        assert np.linalg.norm(wrench[:3]) == pytest.approx(9.80665)
        assert wrench[3:] == pytest.approx(np.cross([0.0, 0.0, 0.05], wrench[:3]))


def test_it_runs_alone_and_loads_neither_mujoco_nor_wrenchbed():
    code = (
        "import sys; from robot_emulators.__main__ import main;"
        "print('alone', not {'mujoco', 'wrenchbed'} & set(sys.modules), flush=True);"
        "sys.exit(main(['netft', '--host', '127.0.1.62', '--set', 'http_port=18062']))"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as one:
        lines = [one.stdout.readline(), one.stdout.readline()]
        one.send_signal(signal.SIGTERM)
        assert one.wait(20) == 0
    assert lines[0] == "alone True\n" and lines[1].startswith("ready rdt=127.0.1.62:49152 ")


@pytest.mark.parametrize(
    "words, why",
    [(["ur5", "--host", "10.0.0.1"], "127.0.0.1"), (["ur5", "--set", "x=1"], "Known: series"),
     (["ur5", "--set", "model=ur20"], "give a plant of your own")],
)  # fmt: skip
def test_what_cannot_be_served_is_said_in_one_line(words, why):
    command = [sys.executable, "-m", "robot_emulators", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and why in done.stderr and done.stderr.count("\n") == 1
