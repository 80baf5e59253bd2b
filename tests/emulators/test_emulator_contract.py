"""One contract for every emulator that the registry knows; another plug-in is tested as it is."""

import gc
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import pytest

from emulator_process import running
from robot_emulators import Arm, Efforts, Options, serve, ur5
from robot_emulators import __main__ as alone
from robot_emulators.base import faults as timed
from robot_emulators.base import named_values as asks
from robot_emulators.base.emulator import Emulator
from robot_emulators.base.faults import Faults, TimedFault
from robot_emulators.errors import EmulatorError, FaultError, SettingError
from robot_emulators.kinematic_plant import KinematicPlant, known_arm
from unstarted import emulated
from ur5_socket import Client, ClosedError
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.errors import NotFoundError
from wrenchbed.plant.serving import EmulatorOptions

NAMES = registry.names("emulators")
HOST = "127.0.6.{}"
EFFECT = "sensor.gain:gain.fz=0.02"
Kind = type[Emulator]


def client_of(address: str) -> socket.socket:
    host, port = re.search(r"(127\.[\d.]+):(\d+)", address).groups()
    return socket.create_connection((host, int(port)), 2.0)


def answers(addresses: dict[str, str]) -> list[str]:
    """The addresses at which somebody accepts a client."""
    named = [a for a in addresses.values() if re.search(r"127\.[\d.]+:\d", a)]
    assert named and len(named) == len(addresses), addresses
    open_ = []
    for address in named:
        with suppress(OSError), client_of(address):
            open_.append(address)
    return open_


def serves_at_a_loopback_address_and_again(kind: Kind, host: str) -> None:
    for _ in range(2):
        emulator = emulated(kind, EmulatorOptions(host, noise="off"))
        try:
            addresses = emulator.start()
            assert all(host in address for address in addresses.values())
            assert answers(addresses)
            assert not emulator.failed.wait(0.3), emulator.failure
        finally:
            emulator.stop()


def refuses_other_addresses(kind: Kind, host: str) -> None:
    for other in ("0.0.0.0", "10.0.0.1", "localhost.example", ""):
        with pytest.raises(SettingError, match=r"--host .*127\.0\.0\.1"):
            emulated(kind, EmulatorOptions(other))


def refuses_a_taken_port(kind: Kind, host: str) -> None:
    with emulated(kind, EmulatorOptions(host, noise="off")):
        other = emulated(kind, EmulatorOptions(host, noise="off"))
        with pytest.raises(EmulatorError, match=re.escape(host)):
            other.start()
        other.stop()


def stops_without_a_trace(kind: Kind, host: str) -> None:
    before = set(threading.enumerate())
    emulator = emulated(kind, EmulatorOptions(host, noise="off"))
    addresses = emulator.start()
    client = client_of(answers(addresses)[0])
    emulator.stop()
    emulator.stop()
    client.close()
    end = time.monotonic() + 3.0
    while set(threading.enumerate()) - before and time.monotonic() < end:
        time.sleep(0.01)
    assert not set(threading.enumerate()) - before
    assert not answers(addresses)


def refuses_settings_by_name(kind: Kind, host: str) -> None:
    with pytest.raises(SettingError, match=r"no-such.*Known: " + next(iter(kind.settings))):
        emulated(kind, EmulatorOptions(host, setting={"no-such": "1"}))
    assert all(kind.settings.values())


def refuses_faults_by_name(kind: Kind, host: str) -> None:
    faults = emulated(kind, EmulatorOptions(host, noise="off")).faults
    with pytest.raises(FaultError, match="dance"):
        faults.inject(TimedFault("", "dance"))


def runs_with_an_effect(kind: Kind, host: str) -> None:
    with pytest.raises(NotFoundError, match=r"no\.such"):
        emulated(kind, EmulatorOptions(host, effects=("no.such",)))
    with emulated(kind, EmulatorOptions(host, effects=(EFFECT,))) as emulator:
        assert not emulator.failed.wait(0.5), emulator.failure


CONTRACT = (
    serves_at_a_loopback_address_and_again, refuses_other_addresses, refuses_a_taken_port,
    stops_without_a_trace, refuses_settings_by_name, refuses_faults_by_name, runs_with_an_effect,
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("clause", CONTRACT, ids=lambda clause: clause.__name__)
def test_every_emulator(name, clause):
    clause(registry.load("emulators", name), HOST.format(1 + NAMES.index(name)))


@pytest.mark.sampled
@pytest.mark.parametrize("name", sorted(NAMES, key=lambda name: name != "netft"))
def test_a_process_says_ready_serves_and_ends_when_it_is_asked_to(name):
    with running(name, HOST.format(21 + NAMES.index(name)), "--noise", "off") as emulator:
        assert answers(emulator.addresses)
        emulator.process.send_signal(signal.SIGTERM)
        assert emulator.process.wait(10) == 0
    assert not answers(emulator.addresses)


class Gripper(Emulator):
    name, title, settings = "gripper", "a gripper", {}
    served: list[str] = []  # noqa: RUF012

    def serve(self):
        self.served.append(self.name)
        self.fail(RuntimeError("enough"))
        return {"gripper": "127.0.0.1:1"}

    def stop(self):
        self.served.append("stopped")


def test_an_emulator_of_another_package_is_served(monkeypatch, capsys):
    entry = type("Entry", (), {"load": lambda self: Gripper})()
    monkeypatch.setattr(registry, "_entry_points", lambda kind: {"gripper": entry})
    assert main(["twin", "gripper"]) == 1
    said = capsys.readouterr()
    assert "ready gripper=127.0.0.1:1" in said.out
    assert "enough" in said.err
    assert Gripper.served == ["gripper", "stopped"]


@pytest.mark.parametrize("wrong", ["ur6", "grippr"])
def test_an_unknown_emulator_is_refused_with_those_that_exist(wrong, capsys):
    assert main(["twin", wrong]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert f"there is no emulator {wrong!r}" in said
    assert "medrue, netft, ur5" in said


SCRIPT = """
[[fault]]
at = 0.05
link = "rdt"
kind = "drop"
seconds = 1.5
share = 0.3

[[fault]]
link = "rdt"
kind = "stall"
"""


def test_a_script_is_sorted_and_run_in_time(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(SCRIPT)
    script = timed.read(path)
    assert [f.kind for f in script] == ["stall", "drop"]
    assert script[1] == TimedFault("rdt", "drop", 0.05, 1.5, {"share": 0.3})
    done = []
    faults = Faults()
    faults.on("rdt", "drop", lambda f: done.append(f.kind), {"share": asks.number(0.0, 1.0)})
    faults.on("rdt", "stall", lambda f: done.append(f.kind))
    faults.start(script)
    for _ in range(100):
        if len(done) == 2:
            break
        faults._stopped.wait(0.02)
    assert done == ["stall", "drop"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[fault]]\nlink='rdt'", r"fault 1: kind = None must be a name"),
        ("[[fault]]\nlink='a'\nkind='b'\nat=-1", "at = -1 must be a number, at least 0 s"),
        ("faults = 3", r"holds \[\[fault\]\] entries and nothing else"),
        ("[[fault", "not valid TOML"),
    ],
)
def test_a_bad_script_is_refused_by_field(tmp_path, text, message):
    path = tmp_path / "f.toml"
    path.write_text(text)
    with pytest.raises(FaultError, match=message):
        timed.read(path)


ASKS = {
    "share": asks.number(0.0, 1.0, 0.1), "node": asks.integer(1, 127, 1),
    "how": asks.word(("short", "long"), "short"), "silent": asks.flag(True),
    "by": asks.above(0.0), "name": asks.text("cfgcpf"),
}  # fmt: skip


def told(**values):
    faults, got = Faults(), []
    faults.on("rdt", "drop", got.append, ASKS)
    faults.inject(TimedFault("rdt", "drop", values={"by": 2.0} | values))
    return got[0].values


def test_values_of_a_fault_have_defaults():
    assert told(node=3) == {
        "share": 0.1, "node": 3, "how": "short", "silent": True, "by": 2.0,
        "name": "cfgcpf",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"shre": 0.9}, "rdt drop knows no 'shre'. Known: at, seconds, share, node"),
        ({"share": 1.1}, "share = 1.1 must be a number 0 … 1"),
        ({"share": float("nan")}, "must be a number"),
        ({"node": 1.5}, "node = 1.5 must be a whole number 1 … 127"),
        ({"node": True}, "must be a whole number"),
        ({"how": "wide"}, "must be one of short, long"),
        ({"silent": 0}, "must be true or false"),
        ({"by": 0.0}, "must be a number above 0"),
        ({"name": 5}, "must be text"),
    ],
)
def test_values_that_a_fault_does_not_take_are_refused(values, why):
    with pytest.raises(FaultError, match=why):
        told(**values)


def test_a_fault_that_breaks_does_not_end_the_others():
    faults, answers = Faults(), []

    def broken(fault):
        raise RuntimeError("a bug")

    faults.on("rdt", "drop", broken)
    faults.on("rdt", "stall", print)
    lines = ['{"link": "rdt", "kind": "drop"}', "[", '{"link": "rdt", "kind": "stall"}']
    faults._take(lines, answers.append)
    assert [answer.split(":")[0] for answer in answers] == ["refused", "refused", "done"]


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


def test_a_plant_of_ones_own_and_the_built_in_one_are_served(ur_robot):
    plant = Stiff(known_arm("ur5"), 0.008)
    with ur5(plant, box="off") as address, Client(address) as client:
        assert address == address.host and address.addresses["rtde"] == f"{address}:30004"
        client.stream("timestamp,actual_q,actual_current")
        state = client.until(lambda s: s[0] > 0.0)
        address.protective_stop()
        with pytest.raises(FaultError, match="there is no fault"):
            address.levitate()
    assert state[1:7] == pytest.approx(plant.arm.home)
    assert state[7:] == pytest.approx(np.ones(6))
    with Client(ur_robot.host) as client:
        client.stream("timestamp,actual_q,actual_TCP_force")
        state = client.until(lambda s: s[0] > 0.0)
    assert state[1:7] == pytest.approx(known_arm("ur5").home)
    assert state[7:10] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)  # its payload is known


@pytest.mark.wire
def test_faults_of_the_fixtures_happen_by_call(ur_robot, netft_box, cia402_drives):
    with Client(ur_robot.host) as client:
        client.stream("timestamp,safety_mode")
        begun = client.until(lambda s: s[0] > 0.0)
        ur_robot.drop(0.3)
        times = [client.until(lambda s: s[0] > begun[0])[0]]
        client.until(lambda s: times.append(s[0]) or s[0] > begun[0] + 0.5)
        assert np.diff([begun[0], *times]).max() > 0.2
        ur_robot.protective_stop()
        assert client.until(lambda s: s[1] != 1)[1] == 3
        ur_robot.fin(link="rtde")
        with pytest.raises(ClosedError):
            client.until(lambda s: False)
    assert answers({"http": netft_box.addresses["http"]})
    netft_box.status(0.5, bits=1 << 20)
    cia402_drives.emcy(node=3, code=0x2310)
    assert cia402_drives.addresses["can"].startswith(f"socketcand:{cia402_drives.host}:")
    with pytest.raises(FaultError, match=r"no fault  dance.*protective_stop"):
        ur_robot.dance()
    with pytest.raises(FaultError, match="one of"):
        cia402_drives.emcy(node=99)


@pytest.mark.wire
def test_a_hundred_starts_leave_nothing_behind_and_ten_serve_at_once():
    def held() -> tuple[int, int]:
        return threading.active_count(), sum(1 for _ in Path("/proc/self/fd").iterdir())

    before, setting = held(), {"box": "off"}
    hosts = [f"127.0.1.{k}" for k in range(100, 110)]
    for _ in range(10):
        with ExitStack() as stack:
            for host in hosts:
                robot = stack.enter_context(serve("ur5", None, Options(host, setting=setting)))
            assert len(answers(robot.addresses)) == len(robot.addresses)
            assert gc.get_freeze_count() > 10_000  # what exists before is no garbage to look for
    assert held() == before and gc.get_freeze_count() == 0
    for host in hosts:
        socket.create_server((host, 30004)).close()


@pytest.mark.wire
def test_a_process_of_its_own_is_ready_soon_and_leaves_nothing_behind():
    before = sum(1 for _ in Path("/proc/self/fd").iterdir())
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    with ur5(box="off") as robot:
        assert len(answers(robot.addresses)) == len(robot.addresses)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime - used.ru_utime < 1.0  # its own time: a busy machine adds none
    socket.create_server((robot.host, 30004)).close()
    assert sum(1 for _ in Path("/proc/self/fd").iterdir()) == before
    with pytest.raises(EmulatorError, match="no such setting"), ur5(colour="red"):
        pass
    code = (
        "import os, robot_emulators\nwith robot_emulators.ur5(box='off') as robot:\n"
        " print(robot.host, flush=True)\n os.kill(os.getpid(), 9)"
    )
    killed = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    with pytest.raises(ConnectionRefusedError):
        for _ in range(100):
            socket.create_connection((killed.stdout.strip(), 30004), 1.0).close()
            time.sleep(0.1)


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
def test_what_cannot_be_served_is_said_in_one_line(monkeypatch, capsys, words, why):
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    assert alone.main(words) == 1
    said = capsys.readouterr().err
    assert why in said and said.count("\n") == 1
