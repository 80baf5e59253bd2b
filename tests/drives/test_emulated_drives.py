"""Efforts of the emulated robots: weight, motion, faults; a changed friction is found."""

import arm_torques as arm
import loop_torques as loops
import numpy as np
import pytest

from wrenchbed import multisine, registry
from wrenchbed.diagnosis.efforts.diagnose_efforts import diagnose_efforts
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.physics.time_derivatives import Jet
from wrenchbed.plant.body import Body, BodyOptions
from wrenchbed.simulation.drives.drive_train import DriveTrain

UR5, MEDRUE = (registry.load("robots", name) for name in ("ur5", "medrue"))
SECONDS = 25.0


def emulated(robot, effects, seed, kind):
    """What the emulator would report at 125 Hz, without a wire and in no real time."""
    cycle, warm = (0.008, 200) if robot is UR5 else (0.004, 400)
    body = Body(BodyOptions(robot.name, seed=seed, effects=effects), cycle, drives=True)
    plan, rows = multisine(robot, SECONDS, 1.0 / cycle, seed).q, []
    for k in range(warm):
        body.step(robot.home + min(1.0, k / (0.75 * warm)) * (plan[0] - robot.home))
    for q in plan:
        body.step(q)
        rows.append((body.time, body.q, getattr(body.drives.now, kind)))
    t, q, effort = (np.array(part)[:: round(0.008 / cycle)] for part in zip(*rows, strict=True))
    prefix = {"torque": "tau", "current": "i"}[kind]
    if robot is UR5:
        return arm.recording(t - t[0], q, effort, prefix)
    return loops.recording(t - t[0], Jet(q, q, q), effort, prefix, tool=loops.PROBE)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "joint", "seed"), [("torque", 1, 0), ("current", 4, 3)])
def test_half_more_friction_of_medrue_is_diagnosed_beside_a_healthy_fit(
    tmp_path, kind, joint, seed
):
    healthy = calibrate_efforts(emulated(MEDRUE, (), 100, kind))
    healthy.write(tmp_path / "healthy.json")
    size = 0.5 * healthy[f"drive.coulomb.{joint}"].value
    fault = (f"drive.coulomb:joint={joint},size={size}",)
    later = emulated(MEDRUE, fault, seed, kind)
    d = diagnose_efforts(later, drives=tmp_path / "healthy.json", loops=True).diagnosis
    assert d.verdict == "identified" and [w["effect"] for w in d.which] == ["drive.coulomb"]
    told = d.which[0]["parameters"]
    assert told["joint"]["value"] == joint
    assert told["coulomb"]["value"] == pytest.approx(size, rel=0.06)


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

    fault = ("drive.viscous:joint=2,size=4", "tool.mass")
    bodies = [Body(BodyOptions(robot.name, noise="off", effects=e), cycle, drives=True)
              for e in ((), fault[:1])]  # fmt: skip
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
