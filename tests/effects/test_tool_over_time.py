"""A tool that leaks or slides, against weights and levers by hand, and against MuJoCo."""

import numpy as np
import pytest
from effect_scenes import change, scene_of

from wrenchbed import registry
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.effects.scene import Scene
from wrenchbed.simulation.simulation import Simulation

G = 9.80665


def upright(t, mass=2.0, cog=(0.0, 0.0, 0.1)):
    """A sensor whose z points up for all t [s]: 2 kg weigh −19.6133 N along z."""
    robot = registry.load("robots", "oriented")
    theta = robot.theta_of_tool(robot.parameters.nominal, mass, cog)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    return Scene(
        robot, theta, np.array([0.0, 0.0, -G]), q, np.array(t), np.ones(len(t), dtype=bool)
    )


def added(scene, name, **given):
    values = {k.replace("_", "."): v for k, v in given.items()}
    return respond(scene, [ActiveEffect.of(scene.robot, name, values)]) - respond(scene)


def test_a_gram_a_second_is_a_tenth_of_a_kilogram_after_100_s():
    found = added(upright([7.0, 57.0, 107.0]), "tool.leak", rate=1e-3)
    assert found[:, 2] == pytest.approx([0.0, 0.05 * G, 0.1 * G])
    assert np.abs(np.delete(found, 2, axis=1)).max() < 1e-12


def test_mass_lost_beside_the_cog_takes_its_torque_along():
    found = added(upright([0.0, 100.0]), "tool.leak", rate=1e-3, place_x=0.05)
    # 0.1 kg at x = 50 mm turned the tool by +0.05·0.1·g about y
    assert found[1] == pytest.approx([0.0, 0.0, 0.1 * G, 0.0, -0.05 * 0.1 * G, 0.0])


def test_half_waves_last_as_long_as_stated_and_end_where_they_began():
    t = [0.0, 25.0, 50.0, 100.0, 250.0]
    one = added(upright(t), "tool.leak", wave_1=0.02, duration=100.0)[:, 2]
    assert one == pytest.approx(0.02 * G * np.array([0.0, 0.5**0.5, 1.0, 0.0, 0.0]), abs=1e-12)
    two = added(upright(t), "tool.leak", wave_2=0.02, duration=100.0)[:, 2]
    assert two == pytest.approx(0.02 * G * np.array([0.0, 1.0, 0.0, 0.0, 0.0]), abs=1e-12)


def test_a_cog_that_slides_by_a_millimetre_turns_2_kg_about_the_other_axis():
    found = added(upright([0.0, 50.0, 100.0]), "tool.slide", rate_x=1e-5)
    assert found[:, 4] == pytest.approx([0.0, 0.5e-3 * 2.0 * G, 1e-3 * 2.0 * G])
    assert np.abs(np.delete(found, 4, axis=1)).max() < 1e-12
    along = added(upright([0.0, 100.0]), "tool.slide", rate_z=1e-5)
    assert np.abs(along).max() < 1e-12  # along the weight nothing turns
    free = added(upright([0.0, 50.0]), "tool.slide", wave_y_1=1e-3, duration=100.0)
    assert free[1] == pytest.approx([0.0, 0.0, 0.0, -1e-3 * 2.0 * G, 0.0, 0.0], abs=1e-12)


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
