"""A tool that leaks or slides, against weights and levers by hand, and against MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from effect_scenes import added, at, change, scene_of

from wrenchbed.effects.chain import respond
from wrenchbed.effects.scene import Scene
from wrenchbed.simulation.simulation import Simulation

G = 9.80665


def test_mass_lost_beside_the_cog_takes_its_torque_along():
    """The sensor's z is up: 0.1 kg at x = 50 mm turned the tool by +0.05·0.1·g about y."""
    upright = at("oriented", np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
    scene = replace(upright, t=np.array([0.0, 100.0]))
    found = added(scene, "tool.leak", rate=1e-3, place__x=0.05)
    assert found[1] == pytest.approx([0.0, 0.0, 0.1 * G, 0.0, -0.05 * 0.1 * G, 0.0])


LEAK = {"rate": 1e-4, "wave.1": 5e-3, "wave.3": -1e-3, "duration": 200.0}
SLIDE = {"rate.x": 1e-5, "rate.z": -4e-6, "wave.y.2": 5e-4, "duration": 200.0}


@pytest.mark.parametrize("label", ["ur5 static", "medrue static", "ur5 motion"])
def test_each_row_is_that_of_a_robot_with_the_tool_as_it_is_by_then(label):
    """MuJoCo with another mass and CoG for each row, in motion Newton and Euler."""
    scene = scene_of(label)
    tool, age = scene.tool, scene.t - scene.t[0]
    share = np.minimum(age / 200.0, 1.0)
    lost = 1e-4 * age + 5e-3 * np.sin(np.pi * share) - 1e-3 * np.sin(3.0 * np.pi * share)
    zero = np.zeros_like(age)
    moved = np.stack([1e-5 * age, 5e-4 * np.sin(2.0 * np.pi * share), -4e-6 * age], axis=1)
    for name, given, mass, cog in (
        ("tool.leak", LEAK, tool.mass - lost, tool.cog + zero[:, None]),
        ("tool.slide", SLIDE, tool.mass + zero, tool.cog + moved),
    ):
        found = change(name, label, given) + respond(scene)
        for i in range(0, len(age), 40):
            theta = scene.robot.theta_of_tool(scene.theta, float(mass[i]), cog[i].tolist())
            if scene.moving:
                whole = Scene(scene.robot, theta, scene.gravity, scene.q, scene.t, scene.held)
                expected = respond(whole)[i]
            else:
                expected = Simulation(scene.robot, theta).wrench(scene.joints[i : i + 1])[0]
            assert found[i] == pytest.approx(expected, abs=1e-9)
