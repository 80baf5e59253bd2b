"""Efforts of the simulator and of emulated robots against other implementations."""

import json

import numpy as np
import pytest
from arm_torques import by_joint, fourier

import wrenchbed as wb
from simulated import driven
from wrenchbed import multisine, registry
from wrenchbed.cli import main
from wrenchbed.errors import NotFoundError, ParameterError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.plant.realtime_robot import Body, BodyOptions
from wrenchbed.simulation.drives.drive_train import DriveTrain
from wrenchbed.simulation.drives.faults import FAULTS, Rows, active_fault

UR5, MEDRUE = (registry.load("robots", name) for name in ("ur5", "medrue"))
SIX = np.array([6.0, 6.5, 4.5, 1.4, 1.2, 1.0])
"""Coulomb friction to which typical sizes refer [N·m]."""


def simulated(tmp_path, name="a.parquet", seconds=25.0, robot=UR5, **options):
    return driven(multisine(robot, seconds, 125.0, 2), tmp_path / name, seed=3, **options)


TRUE = {"drive.coulomb.2": 9.0, "drive.viscous.3": 3.0, "drive.inertia.1": 0.25,
        "drive.offset.4": 0.4, "tool.mass": 1.7}  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["current", "torque"])
def test_a_fit_finds_the_true_drives(tmp_path, kind):
    rec = simulated(tmp_path, seconds=60.0, effort=kind, parameters=TRUE)
    prefix, gain = ("tau", np.ones(6)) if kind == "torque" else ("i", (12.6,) * 3 + (9.3,) * 3)
    assert rec.effort == prefix
    for more in ("q_target6", "qd_target6", "tau_target6", "joint_temperature6"):
        assert np.isfinite(rec.columns[more]).all()
    assert rec.columns["joint_temperature1"][0] == pytest.approx(25.0, abs=0.1)
    fit = wb.calibrate_efforts(rec)
    usual = by_joint(coulomb=SIX, viscous=(8.0, 8.5, 6.5, 1.5, 1.4, 1.2))
    for name, value in (usual | TRUE).items():
        least = 0.02 * value if name in TRUE else 0.1
        assert abs(fit[name].value - value) < max(4.0 * fit[name].std, least), name
    if kind == "current":
        for name, value in by_joint(constant=gain).items():
            assert fit[name].std is None or abs(fit[name].value - value) < 4.5 * fit[name].std


def test_the_wrench_stays_as_it_is_and_off_has_no_efforts(tmp_path):
    faults = ("drive.coulomb:joint=2,size=3", "drive.delay:joint=1,size=0.02")
    plain = simulated(tmp_path, "plain.parquet", seconds=9.0)
    faulty = simulated(tmp_path, "f.parquet", seconds=9.0, effort="torque", effects=faults)
    assert (plain.effort, faulty.effort) == (None, "tau")
    assert np.array_equal(plain.wrench, faulty.wrench) and np.array_equal(plain.q, faulty.q)
    medrue = simulated(tmp_path, seconds=5.0, robot=MEDRUE, effort="torque", noise="off")
    assert medrue.effort == "tau" and np.abs(medrue.columns["tau3"]).max() > 1.0


LAWS = {
    "coulomb": lambda r, p: p["size"] * np.sign(r["qd"]),
    "viscous": lambda r, p: p["size"] * r["qd"],
    "offset": lambda r, p: p["size"] + 0.0 * r["qd"],
    "stribeck": lambda r, p: p["size"] * np.sign(r["qd"]) * np.exp(-((r["qd"] / 0.05) ** 2)),
    "load": lambda r, p: p["size"] * abs(r["rigid"]) * np.sign(r["qd"]),
    "temperature": lambda r, p: p["size"] * 8.0 * (1 - np.exp(-r["t"] / 1800.0)) * 6.5
    * np.sign(r["qd"]),
    "asymmetry": lambda r, p: np.where(r["qd"] > 0, p["size"], 0.0),
    "inertia": lambda r, p: p["size"] * r["qdd"],
    "cogging": lambda r, p: p["size"] * np.sin(6.0 * r["q"]),
    "ripple": lambda r, p: r["before"] * p["size"] * np.sin(12.0 * r["q"]),
    "constant": lambda r, p: r["before"] / (1.0 + p["size"]) - r["before"],
    "delay": lambda r, p: np.interp(r["t"] - p["size"], r["t"], r["before"]) - r["before"],
}  # fmt: skip


def efforts(faults=()):
    t, q = fourier(np.random.default_rng(4), 12.0)
    train = DriveTrain(UR5, UR5.parameters.nominal, UR5.gravity, None, faults)
    return t, q, train, train.torques(t, q)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", sorted(LAWS))
def test_each_fault_is_its_law_on_one_joint(kind):
    t, q, train, before = efforts()
    name = f"drive.{kind}"
    *_, after = efforts([(name, {"joint": 2.0})])
    j, fault = 1, active_fault(name, {"joint": 2}, SIX)
    rows = {"t": t, "q": q.v[:, j], "qd": q.d[:, j], "qdd": q.dd[:, j],
            "rigid": train.rigid.of(q)[:, j], "before": before[:, j]}  # fmt: skip
    expected = LAWS[kind](rows, fault.values)
    quick = np.abs(q.d[:, j]) > 6e-3  # friction changes its sign within 1e-3 rad/s
    if kind == "delay":
        quick &= np.abs(np.gradient(before[:, j])) < 1.0
    apart = np.abs((after - before)[quick, j] - expected[quick])
    assert apart.max() < 1e-3 * max(1.0, np.abs(expected).max())
    assert np.array_equal(np.delete(after, j, axis=1), np.delete(before, j, axis=1))


def test_hysteresis_winds_up_over_its_width():
    """After a reversal: s (1 − 2 e^(−way/width)), by hand from Dahl's equation."""
    fault = active_fault("drive.hysteresis", {"joint": 1, "size": 2.0, "width": 0.1}, SIX)
    q = np.concatenate([np.linspace(0.0, 3.0, 301), np.linspace(3.0, 2.0, 101)[1:]])
    zero = np.zeros_like(q)
    got = fault.act(Rows(zero, q, zero, zero, zero, zero, 6.0), zero)
    assert got[300] == pytest.approx(2.0, abs=1e-6)
    assert got[310] == pytest.approx(-2.0 * (1.0 - 2.0 * np.exp(-1.0)), abs=1e-6)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", sorted(FAULTS))
def test_row_by_row_is_as_all_at_once(kind):
    t, q, _, together = efforts([(f"drive.{kind}", {"joint": 3})])
    train = DriveTrain(UR5, UR5.parameters.nominal, UR5.gravity, None,
                       [(f"drive.{kind}", {"joint": 3})])  # fmt: skip
    one = [
        train.torques(t[k : k + 1], Jet(q.v[k : k + 1], q.d[k : k + 1], q.dd[k : k + 1]))[0]
        for k in range(400)
    ]
    assert np.abs(np.array(one) - together[:400]).max() < 1e-9


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"parameters": {"drive.coulomb.7": 1.0}, "effort": "torque"}, "drive.coulomb.7"),
        ({"parameters": {"drive.coulomb.1": -1.0}, "effort": "torque"}, "impossible"),
        ({"parameters": {"drive.coulomb.1": 1.0}}, "--effort torque"),
        ({"effects": ("drive.coulomb:joint=2",)}, "--effort torque"),
        ({"effects": ("drive.coulomb:joint=9",), "effort": "torque"}, "1 … 6"),
        ({"effects": ("drive.coulomb:sise=1",), "effort": "torque"}, "size"),
        ({"effects": ("drive.delay:size=-1",), "effort": "torque"}, "below 0"),
        ({"effects": ("drive.constant:size=-1",), "effort": "torque"}, "above -1"),
        ({"effort": "volts"}, "torque, current or off"),
        ({"effects": ("drive.colomb:joint=2",), "effort": "torque"}, r"drive\.colomb"),
    ],
)
def test_refusals(options, text):
    with pytest.raises((ParameterError, NotFoundError), match=text):
        wb.SimDriver(wb.SimOptions("ur5", **options))


def test_the_list_says_in_which_channels_an_effect_shows(capsys):
    assert main(["list", "effects"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    shown = {row[0]: row[1] for row in rows if len(row) > 2}
    assert shown["drive.coulomb"] == "effort" and shown["sensor.gain"] == "wrench"
    assert main(["list", "effects", "--json"]) == 0
    assert {f"drive.{kind}" for kind in FAULTS} < set(json.loads(capsys.readouterr().out))


def settled(robot, cycle, q, **more):
    body = Body(BodyOptions(robot.name, noise="off", **more), cycle, drives=True)
    for k in range(900):
        body.step(robot.home + min(1.0, k / 600) * (q - robot.home))
    return body


@pytest.mark.parametrize(("robot", "cycle"), [(UR5, 0.002), (MEDRUE, 0.004)])
def test_at_rest_the_drives_hold_the_weight(robot, cycle):
    """By gravity's torque of the closed form, another implementation."""
    q = robot.sample(1, np.random.default_rng(3))[0]
    torque = settled(robot, cycle, q).drives.now.torque
    theta = robot.parameters.nominal
    weight = -robot.gravity_torque(q[None], theta, np.asarray(robot.gravity))[0]
    assert np.abs(torque - weight).max() < 1e-3 * max(1.0, np.abs(weight).max())
    assert np.abs(weight).max() > 1.0


@pytest.mark.sampled
@pytest.mark.parametrize(("robot", "cycle"), [(UR5, 0.002), (MEDRUE, 0.004)])
def test_a_motion_needs_the_torques_of_inverse_dynamics_and_faults(robot, cycle):
    """Servos' forces and the weight at rest, against inverse dynamics of the same motion."""

    fault = "drive.viscous:joint=2,size=4"
    bodies = [Body(BodyOptions(robot.name, noise="off", effects=e), cycle, drives=True)
              for e in ((), (fault,))]  # fmt: skip
    swing, rows = np.full(len(robot.joints), 0.05), []
    for k in range(600):
        t = k * cycle
        for body in bodies:
            body.step(robot.home + swing * (1.0 - np.cos(4.0 * t)))
        rows.append((bodies[0].q, *(b.drives.now.torque for b in bodies)))
    q, plain, faulty = (np.array(part) for part in zip(*rows, strict=True))
    speed = np.gradient(q, cycle, axis=0, edge_order=2)
    moving = Jet(q, speed, np.gradient(speed, cycle, axis=0, edge_order=2))
    train = DriveTrain(robot, robot.parameters.nominal, robot.gravity)
    expected = train.torques(np.arange(len(q)) * cycle, moving)
    late = slice(300, 580)
    quick = (np.abs(speed) > 0.02)[late]
    off = np.abs(plain - expected)[late]
    assert np.where(quick, off, 0.0).max() < 0.02 * np.abs(expected[late]).max()
    extra = (faulty - plain)[late]
    assert np.abs(extra[:, 1] - 4.0 * speed[late, 1]).max() < 0.02
    assert np.abs(np.delete(extra, 1, axis=1)).max() < 1e-9


def test_currents_have_noise_and_warm_up():
    body = settled(UR5, 0.002, UR5.home)
    quiet = body.drives.now.current
    noisy = Body(BodyOptions("ur5"), 0.002, drives=True)
    rows = []
    for _ in range(600):
        noisy.step(UR5.home)
        rows.append(noisy.drives.now.current)
    seen, ripple = np.array(rows), 0.006 * noisy.drives.train.level()
    assert 0.01 < seen[:, 1].std() < 0.2 and abs(seen[:, 1].mean() - quiet[1]) < ripple[1]
    assert np.abs(seen / 0.001 - np.rint(seen / 0.001)).max() < 1e-6
    assert 25.0 < noisy.drives.temperatures[0] < 25.1
