"""What changes with time in the tool is named as such, and never as a temperature."""

from dataclasses import replace

import numpy as np
import pytest

from simulated import WHITE, recording
from wrenchbed import registry
from wrenchbed.data.metadata import ToolInfo
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.simulation.simulation import Simulation

POSES, ROWS = 60, 20


def recorded(name, mass=None, cog=None):
    """60 poses at rest; mass [kg] and CoG [m] of each are the stated ones times and plus these."""
    robot, rng = registry.load("robots", name), np.random.default_rng(4)
    q, theta = robot.sample(POSES, rng), robot.parameters.nominal
    tool = robot.tool(theta)
    factor = np.ones(POSES) if mass is None else mass
    moved = np.zeros((POSES, 3)) if cog is None else cog
    load = np.empty((POSES, 6))
    for i in range(POSES):
        by_now = robot.theta_of_tool(theta, factor[i] * tool.mass, (tool.cog + moved[i]).tolist())
        load[i] = Simulation(robot, by_now).wrench(q[i : i + 1])[0]
    made = recording(name, q, load, ROWS, WHITE / 2.0, 0.0, rng)
    stated = ToolInfo(float(tool.mass), tuple(float(c) for c in tool.cog))
    return replace(made, metadata=replace(made.metadata, tool=stated))


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["ur5", "medrue"])
def test_a_payload_that_leaks_3_percent_steadily_is_a_leak(name):
    rec = recorded(name, mass=1.0 - 0.03 * np.linspace(0.0, 1.0, POSES))
    found = diagnose(rec).diagnosis
    lead = found.which[0]
    assert lead["effect"] == "tool.leak" and lead["probability"] > 0.8
    assert "sensor.temperature" not in found.probabilities
    robot = registry.load("robots", name)
    stated = 0.03 * float(robot.tool(robot.parameters.nominal).mass) / np.ptp(rec.t)
    rate = lead["parameters"]["rate"]
    assert rate["value"] == pytest.approx(stated, abs=4.0 * rate["std"])
    assert rate["value"] == pytest.approx(stated, rel=0.2)


@pytest.mark.slow
def test_the_place_from_which_mass_leaves_is_found():
    robot = registry.load("robots", "ur5")
    tool = robot.tool(robot.parameters.nominal)
    lost, aside = 0.03 * np.linspace(0.0, 1.0, POSES)[:, None] ** 2, np.array([0.03, -0.02, 0.02])
    left = 1.0 - lost  # of the mass; what is left lies on the other side of the place
    found = diagnose(recorded("ur5", mass=left[:, 0], cog=-lost * aside / left)).diagnosis
    assert [c["effect"] for c in found.which] == ["tool.leak"]
    told = found.which[0]["parameters"]
    for a, true in zip("xyz", aside, strict=True):
        place = told[f"place.{a}"]
        assert place["value"] == pytest.approx(true, abs=4.0 * place["std"])
        assert place["std"] < 5e-3
    # a course of s² is an even one and a wave: s − s(1 − s), 0.03 m in 20 rows a pose and moves
    even = 0.03 * float(tool.mass) / (POSES * ROWS / 100.0 + 2.0 * (POSES - 1))
    assert told["rate"]["value"] == pytest.approx(even, rel=0.5)


@pytest.mark.slow
def test_a_clamp_that_creeps_is_a_slide_of_any_course():
    share = np.linspace(0.0, 1.0, POSES)
    shift = np.outer(1.0 - np.exp(-6.0 * share), [3e-3, 0.0, -1e-3])
    found = diagnose(recorded("ur5", cog=shift)).diagnosis
    assert found.which[0]["effect"] == "tool.slide" and found.which[0]["probability"] > 0.8
    assert found.which[0]["parameters"]["form"]["value"] == "free"
