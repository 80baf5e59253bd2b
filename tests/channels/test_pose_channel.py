"""A tracker's view in closed form, against MuJoCo's and against plain numpy."""

import numpy as np
import pytest

from plain_ur5 import poses
from wrenchbed import registry
from wrenchbed.channels.pose import CHANNEL
from wrenchbed.channels.response import readings
from wrenchbed.effects.chain import ActiveEffect, EffectChain
from wrenchbed.effects.scene import Scene
from wrenchbed.hardware.drivers.sim import Tracker
from wrenchbed.physics.time_derivatives import value
from wrenchbed.twin.twin import nominal

RNG = np.random.default_rng(0)


def scene_of(robot, q):
    held, t = np.ones(len(q), dtype=bool), np.arange(len(q), dtype=float)
    return Scene(robot, robot.parameters.nominal, np.array(robot.gravity), q, t, held)


@pytest.mark.parametrize("name", ["ur5", "medrue"])
@pytest.mark.parametrize("effect", ["", "joint.offset", "link.length"])
def test_the_sensor_is_where_mujoco_has_it(name, effect):
    robot = registry.load("robots", name)
    rows = scene_of(robot, robot.sample(20, RNG))
    active = []
    if effect:
        own = registry.load("effects", effect)
        sizes = {p.name: p.tolerance for p in own.parameters(robot)}
        active = [ActiveEffect.of(robot, effect, sizes)]
    pose, _ = EffectChain(active).placed(rows)
    turn, place = nominal(robot, active).place(rows)
    assert value(pose.position) == pytest.approx(place, abs=1e-12)
    assert value(pose.rotation) == pytest.approx(turn, abs=1e-12)


def test_a_simulated_tracker_is_seen_by_the_channel_to_its_noise():
    robot, q = registry.load("robots", "ur5"), poses(30, RNG)
    for std in (1e-12, 5e-5):
        tracker = Tracker(nominal(robot), std, 3)
        read = np.array([[tracker.columns(x, 1)[c][0] for c in CHANNEL.columns] for x in q])
        fitted = CHANNEL.fitted(read, scene_of(robot, q))
        left = read - readings((fitted,), scene_of(robot, q))
        assert 0.5 * std < left.std() < 1.5 * std + 1e-11
    first, again = tracker.columns(q[0], 4)["mx"], tracker.columns(q[0], 4)["mx"]
    assert np.ptp(first) > 0.0 and abs(first.mean() - again.mean()) < 3e-4
