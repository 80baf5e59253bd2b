"""The compensated wrench: right in every frame; drift is followed, other changes are named."""

import json
import signal
import socket
import time
from contextlib import nullcontext

import numpy as np
import pytest

import rtde_moves
from emulator_process import running, shared
from simulated import UR5_TRUTH
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data.metadata import Metadata
from wrenchbed.effects.chain import active_effect
from wrenchbed.errors import DriverError, ParameterError, TwinError
from wrenchbed.hardware.device_base import Health
from wrenchbed.hardware.drivers.base import ArmSample
from wrenchbed.hardware.transducers.base import WrenchSample
from wrenchbed.monitoring.compensation import BAND, Compensator
from wrenchbed.monitoring.live import Datagrams, live
from wrenchbed.physics.noise import NoiseStream
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.twin.twin import Twin

ROBOT = registry.load("robots", "ur5")
MODEL = Model.of(ROBOT)
THETA = MODEL.parameters.vector(UR5_TRUTH)
OWN = THETA[: len(ROBOT.parameters)]
GAMMA = registry.load("sensors", "ati-gamma").noise
RATE = 10.0


def readings(q):
    """What the sensor reads at rest, by MuJoCo (N, 6)."""
    return MODEL.read(Simulation(ROBOT, OWN).wrench(q), THETA)


def made(*effects, frame="sensor", follow=True):
    """A compensator of the true robot with some effects."""
    active = tuple(active_effect(ROBOT, e) for e in effects)
    return Compensator(Twin(MODEL, THETA, active), GAMMA.row_std, frame, follow)


def run(compensate, q, rows, t0=0.0):
    """External wrenches of rows (N, 6) at one pose, 10 a second."""
    return [compensate(t0 + k / RATE, q, row, True) for k, row in enumerate(rows)]


def noisy(seconds, seed):
    n = round(seconds * RATE)
    stream = NoiseStream(GAMMA, seed)
    return stream.corrupt(np.arange(n) / RATE, np.zeros((n, 6)))[0]


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
def test_without_a_push_nothing_is_left_and_a_push_is_read_in_its_frame(frame):
    force = np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.3])
    for q in ROBOT.sample(5, np.random.default_rng(1)):
        plain = readings(q[None])[0]
        compensate = made(frame=frame)
        assert np.abs(compensate(0.0, q, plain, True).wrench).max() < 1e-9
        turn, at = (x[0] for x in ROBOT.sensor_pose(q[None], OWN))
        want = force
        if frame == "base":
            want = np.concatenate([turn @ force[:3], turn @ force[3:]])
        elif frame == "flange":
            flange, origin = (x[0] for x in ROBOT.flange_pose(q[None], OWN))
            f = turn @ force[:3]
            moment = turn @ force[3:] + np.cross(at - origin, f)
            want = np.concatenate([flange.T @ f, flange.T @ moment])
        assert compensate(0.02, q, plain + force, True).wrench == pytest.approx(want, abs=1e-9)


@pytest.mark.parametrize(
    "effect", ["sensor.crosstalk:x.fx.fy=0.05,x.ty.fz=0.01", "sensor.gain:gain.fz=0.2"]
)
def test_a_sensor_that_mixes_channels_is_undone(effect):
    """What the effect makes of the load is computed by its own formula, not by the inverse."""
    compensate = made(effect)
    assert compensate.not_undone == ()
    q, push = np.array(ROBOT.home), np.array([4.0, 1.0, -6.0, 0.2, -0.1, 0.3])
    load = MODEL.true_wrench(q[None], THETA)[0] + push
    mixed = load.copy()
    if "crosstalk" in effect:
        mixed[0] += 0.05 * load[1]
        mixed[4] += 0.01 * load[2]
    else:
        mixed[2] *= 1.2
    found = compensate(0.0, q, MODEL.read(mixed[None], THETA)[0], True)
    assert found.wrench == pytest.approx(push, abs=1e-9)


def test_an_effect_of_the_arm_is_in_the_expected_reading():
    tilted, q = made("base.tilt:x=0.02,y=-0.01"), np.array(ROBOT.home)
    theta = MODEL.parameters.vector({"base.tilt.x": 0.02, "base.tilt.y": -0.01}, start=THETA)
    reading = MODEL.read(Simulation(ROBOT, theta[: len(ROBOT.parameters)]).wrench(q[None]), theta)
    assert np.abs(tilted(0.0, q, reading[0], True).wrench).max() < 1e-6
    assert np.abs(made()(0.0, q, reading[0], True).wrench).max() > 0.05


def test_what_needs_a_history_or_touches_is_named_and_not_undone():
    named = ("sensor.hysteresis", "sensor.creep", "tool.leak", "timing.lowpass", "timing.delay")
    plain = ("sensor.gain", "joint.compliance", "environment.contact")
    assert set(made(*named, *plain).not_undone) == set(named)
    pushed, plain, rows = made("environment.contact"), made(), np.arange(6.0)
    for q in ROBOT.sample(8, np.random.default_rng(3)):
        here = [c(0.0, q, rows, True).wrench for c in (pushed, plain)]
        assert np.array_equal(*here)


def test_real_noise_raises_no_alarm_in_ten_minutes_and_the_residual_is_the_noise():
    q = np.array(ROBOT.home)
    found = run(made(), q, readings(q[None]) + noisy(600.0, 11))
    assert not [x.alarm for x in found if x.alarm]
    rms = np.sqrt(np.mean([x.wrench**2 for x in found], axis=0))
    assert (rms < 1.1 * GAMMA.row_std).all()


def test_a_drift_of_a_newton_an_hour_is_followed():
    q, n = np.array(ROBOT.home), round(600.0 * RATE)
    drift = np.arange(n)[:, None] / RATE / 3600.0 * np.eye(6)[0]
    white = np.random.default_rng(3).standard_normal((n, 6)) * [1, 1, 1, 0.05, 0.05, 0.05]
    rows = readings(q[None]) + drift + 0.02 * white
    followed = run(made(), q, rows)
    assert followed[-1].zero[0] == pytest.approx(600.0 / 3600.0, abs=0.03)
    last = np.mean([x.wrench[0] for x in followed[-100:]])
    assert abs(last) < 0.02 and not followed[-1].alarm
    left = run(made(follow=False), q, rows)
    assert np.mean([x.wrench[0] for x in left[-100:]]) == pytest.approx(1.0 / 6.0, abs=0.02)


def test_a_push_is_no_drift():
    """It raises an alarm within two seconds, and none of it goes into the zero."""
    q, n = np.array(ROBOT.home), round(60.0 * RATE)
    push = 2.0 * (np.arange(n) >= n // 2)[:, None] * np.eye(6)[1]
    found = run(made(), q, readings(q[None]) + push)
    first = next(k for k, x in enumerate(found) if x.alarm)
    assert n // 2 <= first < n // 2 + 2.0 * RATE
    assert found[-1].alarm.startswith(f"fy beyond {BAND:g} × noise at rest: a push, another load")
    assert abs(found[-1].zero[1]) < 0.01
    assert found[-1].wrench[1] == pytest.approx(2.0, abs=0.02)


def test_robots_without_joints_or_flange_are_refused():
    model = Model.of(registry.load("robots", "oriented"))
    with pytest.raises(TwinError, match="no model of its joints"):
        Compensator(Twin(model, model.parameters.nominal), GAMMA.row_std)
    medrue = Model.of(registry.load("robots", "medrue"))
    with pytest.raises(TwinError, match="knows no flange"):
        Compensator(Twin(medrue, medrue.parameters.nominal), GAMMA.row_std, "flange")


class Still:
    """A driver that stands still and reads the same; only what `live` uses."""

    def __init__(self, n):
        self.n, self.left, self.wrench = n, n, readings(np.array(ROBOT.home)[None])[0]
        self.extra = {}

    def metadata(self, mode, rate):
        return Metadata("ur5", mode, extra=self.extra)

    def read(self):
        return ArmSample(time.monotonic(), None, 0.0, np.array(ROBOT.home), np.zeros(6))

    def health(self):
        k = self.n - self.left
        return Health("ok", "", {"wrench readings": k + 10 * (k >= 20)})  # ten came unread

    def read_wrench(self):
        self.left -= 1
        t = time.monotonic()
        return WrenchSample(t, None, self.n - self.left, 0.0, True, self.wrench, lost=3)


def test_datagrams_reach_a_listener():
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", 0))
    listener.settimeout(5.0)
    seen = []
    driver, address = Still(40), f"127.0.0.1:{listener.getsockname()[1]}"
    with Datagrams(address) as datagrams:
        done = live(driver, made(), [datagrams, seen.append], stopped=lambda: driver.left <= 0)
    datagram = json.loads(listener.recv(65536))
    listener.close()
    assert done.readings == len(seen) == 40 and done.lost == 3 and done.alarms == 0
    assert done.skipped == 10
    assert 0.0 < done.p50 <= done.p99 < 0.5
    assert np.abs(datagram["wrench"]).max() < 1e-9 and datagram["at_rest"] is True
    assert datagram["alarm"] == "" and set(datagram) == set(seen[0].to_json())


def test_readings_are_paced():
    driver = Still(10**9)
    begun = time.monotonic()
    done = live(driver, made(), [], rate=50.0, seconds=1.0)
    assert 10 <= done.readings <= 50 * (time.monotonic() - begun) + 1
    assert live(driver, made(), [], rate=1e-3, seconds=0.5).seconds < 60.0  # not a whole period


@pytest.mark.parametrize("payload, what", [({"mass": 1.2}, "a payload of 1.2 kg"), (None, "its")])
def test_a_wrench_that_lacks_the_payload_is_refused(payload, what):
    driver = Still(10)
    driver.extra = {"wrench": {"compensated": True, "payload": payload}}
    compensate = made()
    with pytest.raises(DriverError, match=f"subtracts {what}"):
        live(driver, compensate, [], seconds=0.1)
    driver.extra = {"wrench": {"compensated": True, "payload": {"mass": 0.0}}}
    assert live(driver, compensate, [], stopped=lambda: driver.left <= 0).readings > 0


@pytest.mark.parametrize(
    "option", ["--rate=nan", "--rate=0", "--rate=1e-300", "--seconds=nan", "--seconds=-3"]
)
def test_a_time_that_never_ends_or_begins_is_refused(option, tmp_path, capsys):
    file = tmp_path / "fit.json"
    file.write_text('{"robot": "ur5"}')
    assert main(["live", str(file), option]) == 1
    assert "wrenchbed: error: --" in capsys.readouterr().err


def test_an_interrupt_ends_the_wait_for_a_robot_that_does_not_answer(tmp_path, monkeypatch):
    Twin(MODEL, MODEL.parameters.nominal).write(tmp_path / "twin.json")
    rtde = registry.load("drivers", "rtde")
    monkeypatch.setattr(rtde, "connect", lambda _: signal.raise_signal(signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs ignore it
    try:
        assert main(["live", str(tmp_path / "twin.json"), "--host", "127.0.1.42"]) == 130
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("address", ["here", "127.0.0.1", "127.0.0.1:0", ":80", "h:99999", "h:x"])
def test_addresses_are_checked_and_unknown_hosts_refused_before_anything_is_lost(address):
    with pytest.raises(ParameterError, match="give HOST:PORT"):
        Datagrams(address)
    with pytest.raises(ParameterError, match="no such host, nothing is sent"):
        Datagrams(f"{'n' * 70}:9")  # longer than a name may be: nobody is asked for it


@pytest.mark.sampled
@pytest.mark.wire
@pytest.mark.parametrize("rate", [125, 500])
def test_the_ur5_emulator_is_compensated_in_real_time(tmp_path, capfd, rate):
    """As JSON lines: no weight left, half of them within a period of a CB3."""
    nominal = Twin(MODEL, MODEL.parameters.nominal)
    nominal.write(tmp_path / "twin.json")
    fast = running("ur5", "127.0.1.41", "--set", "series=e")
    with fast if rate == 500 else nullcontext(shared("ur5", rtde_moves.HOST)) as emulator:
        host = emulator.addresses["rtde"].split(":")[0]
        line = ["live", str(tmp_path / "twin.json"), "--driver", "rtde", "--host", host]
        assert main([*line, "--seconds", "1", "--json"]) == 0
        assert emulator.process.poll() is None
    *rows, last = map(json.loads, capfd.readouterr().out.splitlines())
    wrench = np.array([r["wrench"] for r in rows])
    weight = np.linalg.norm(MODEL.predict(np.array(ROBOT.home)[None], nominal.theta)[0, :3])
    assert all(r["at_rest"] and not r["alarm"] for r in rows) and weight > 10.0
    assert np.abs(wrench.mean(axis=0)[:3]).max() < 0.15
    assert (np.std(wrench, axis=0) < 1.3 * GAMMA.row_std).all()
    summary = last["summary"]
    assert summary["readings"] == len(rows)
    assert summary["skipped"] > len(rows)  # of 7,000 a second
    assert summary["p50"] < 1.0 / 125.0
