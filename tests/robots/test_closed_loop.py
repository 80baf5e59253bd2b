"""Robots with closed loops, from their files: judged by MedRUE's own formulas and by MuJoCo."""

import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
import test_robots
from test_file_arm import loads
from test_robots import random_theta

from wrenchbed.cli import main
from wrenchbed.effects.chain import active_effect
from wrenchbed.errors import ParameterError, PlanError
from wrenchbed.robots.base import models
from wrenchbed.robots.described import describe, read, rebuilt
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.twin.twin import nominal

_STRIDE = 0.02


class PlainLoops:
    """A file in MuJoCo, with a sensor between the frame and the tool's body.

    Args:
        path: MJCF.
        frame: site of the sensor; the tool's body stands there, unturned in its parent.
        tool: that body.
        driven: joints in the order of q.
    """

    def __init__(self, path: Path, frame: str, tool: str, driven: tuple[str, ...]) -> None:
        plain = mujoco.MjModel.from_xml_path(str(path))
        spec = mujoco.MjSpec.from_file(str(path))
        spec.body(tool).add_site(name="seat", quat=plain.site(frame).quat)
        for kind in ("FORCE", "TORQUE"):
            spec.add_sensor(
                name=kind.lower(), type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE, objname="seat",
            )  # fmt: skip
        self.model = spec.compile()
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)
        self.tool = tool
        self.at = [int(self.model.joint(n).qposadr[0]) for n in driven]
        self.passive = [k for k in range(self.model.nv) if k not in self.at]
        self.home = self.model.key_qpos[0].copy() if self.model.nkey else self.model.qpos0.copy()

    def wrench(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Load on the sensor (N, 6) [N, N·m], and its place in the world (N, 3) [m]."""
        model, data = self.model, self.data
        loads, places = np.empty((len(q), 6)), np.empty((len(q), 3))
        for i, goal in enumerate(q):
            data.qpos[:] = self.home
            start = self.home[self.at]
            steps = max(1, int(np.ceil(np.abs(goal - start).max() / _STRIDE)))
            for share in np.arange(0, steps + 1) / steps:
                data.qpos[self.at] = start + share * (goal - start)
                self._close(3)
            self._close(6)
            data.qvel[:] = data.qacc[:] = 0.0
            mujoco.mj_inverse(model, data)
            loads[i] = -np.concatenate([data.sensor("force").data, data.sensor("torque").data])
            places[i] = data.site("seat").xpos
        return loads, places

    def _close(self, times: int) -> None:
        model, data = self.model, self.data
        for _ in range(times):
            mujoco.mj_fwdPosition(model, data)
            rows = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
            slopes = data.efc_J.reshape(-1, model.nv)[: data.nefc][rows][:, self.passive]
            data.qpos[self.passive] -= (
                np.linalg.pinv(slopes, 1e-9) @ data.efc_pos[: data.nefc][rows]
            )


TOOLS = {"five_bar": "probe", "stewart": "gripper"}
NUMBER = r"-?\d+\.?\d*(?:e-?\d+)?"
each_model = pytest.mark.parametrize("name", TOOLS)


@cache
def loop_robot(name):
    return read(models() / name / f"{name}.toml")


@pytest.mark.sampled
@each_model
def test_parallel_robots_are_the_users_files_in_mujoco(name):
    """MuJoCo's own constraints close the loops there."""
    robot = loop_robot(name)
    driven = tuple(robot.arm_model.links[k].joint for k in robot.arm_model.driven)
    theta, q = robot.parameters.nominal, robot.sample(10, np.random.default_rng(6))
    plain = PlainLoops(models() / name / f"{name}.xml", "sensor", TOOLS[name], driven)
    plain.model.opt.gravity[:] = robot.gravity
    wrench, place = plain.wrench(q)
    assert np.abs(wrench).max() > 3.0
    assert np.abs(loads(robot, q, theta) - wrench).max() < 1e-9
    assert np.abs(robot.sensor_pose(q, theta)[1] - place).max() < 1e-9
    assert np.abs(Simulation(robot, theta).wrench(q) - wrench).max() < 1e-9


def test_a_point_of_a_loop_moves_by_the_parameter_of_its_body():
    robot = loop_robot("five_bar")
    (closure,) = robot.arm_model.closures
    for k, link in enumerate((closure.first, closure.second)):
        theta = robot.parameters.nominal
        theta[robot.parameters.index(f"loop.tip.{robot.arm_model.links[link].body}.x")] += 1e-3
        shift = robot.at(theta).closures[0].places - closure.places
        assert np.allclose(shift, np.outer(np.eye(2)[k], [1e-3, 0.0, 0.0]), atol=1e-12)


CONTRACT = {
    "stewart": (
        test_robots.test_the_wrench_in_motion_is_newton_eulers,
        test_robots.test_gravity_is_seen_as_the_sensor_is_turned,
        test_robots.test_the_sensor_stands_where_mujoco_puts_it,
        test_robots.test_an_inertia_of_no_body_is_refused,
    ),
    "five_bar": (
        test_robots.test_the_wrench_at_rest_is_the_same_in_mujoco_and_in_closed_form,
        test_robots.test_the_wrench_in_motion_is_newton_eulers,
        test_robots.test_gravity_is_seen_as_the_sensor_is_turned,
        test_robots.test_every_parameter_moves_something_or_is_listed_as_unobservable,
        test_robots.test_the_jacobian_is_that_of_complex_steps,
        test_robots.test_samples_are_feasible_seeded_and_turn_the_tool_about,
        test_robots.test_joints_outside_limits_are_refused_by_row,
    ),
}
"""What every robot keeps, but: a hexapod's legs are no angles and tilt it by 40° only; errors
across a five-bar's plane leave its loop open; a rod's turn about itself changes nothing at first.
All but the first of each robot take seconds.
"""


@pytest.mark.parametrize(
    ("name", "contract"),
    [
        pytest.param(name, one, marks=[pytest.mark.slow] * (k > 0))
        for name, some in CONTRACT.items()
        for k, one in enumerate(some)
    ],
    ids=lambda x: getattr(x, "__name__", x),
)
def test_the_contract_of_every_robot(name, contract):
    contract(loop_robot(name))


@pytest.mark.sampled
@each_model
def test_the_toml_beside_the_model_is_its_robot(name, tmp_path):
    """As `wrenchbed robot` writes it; and the same from what a recording carries, to the bit."""
    kept = models() / name / f"{name}.toml"
    shutil.copy(kept.with_suffix(".xml"), tmp_path)
    robot, copy = read(kept), tmp_path / f"{name}.toml"
    texts = describe(copy.with_suffix(".xml"), "sensor", copy).text, kept.read_text("utf-8")
    (words, numbers), (own, stated) = (
        (re.sub(NUMBER, "#", x), re.findall(NUMBER, x)) for x in texts
    )
    there, here = ([*map(float, some)] for some in (numbers, stated))
    assert words == own and there == pytest.approx(here, abs=1e-15)
    again = rebuilt(json.loads(json.dumps(robot.record)))
    q = robot.sample(5, np.random.default_rng(0))
    theta = random_theta(robot, np.random.default_rng(1))
    assert again.name == robot.name
    assert again.spec(theta).to_xml() == robot.spec(theta).to_xml()
    assert np.array_equal(loads(again, q, theta), loads(robot, q, theta))


@pytest.mark.parametrize(
    ("name", "pose"),
    [
        ("five_bar", [-1.56, 1.56, 0.0, 0.0]),  # its distal links nearly one line: singular
        ("stewart", [0.9, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_rows_out_of_reach_and_singular_are_named(name, pose):
    robot = loop_robot(name)
    links = [replace(x, lower=-4.0, upper=4.0) for x in robot.arm_model.links]
    arm = replace(robot.arm_model, links=tuple(links))
    robot = type(robot)(replace(robot.description, arm=arm))
    theta, q = robot.parameters.nominal, np.tile(robot.home, (3, 1))
    robot.check(q, theta, "plan")
    q[1] = pose
    with pytest.raises(PlanError, match="plan: row 1: the loops cannot close there"):
        robot.check(q, theta, "plan")
    lost = np.isnan(robot.sensor_pose(q, theta)[1]).any(axis=1)
    assert lost.tolist() == [False, True, False]


def test_a_passive_joint_has_limits_too(tmp_path):
    text = (models() / "five_bar" / "five_bar.xml").read_text()
    text = text.replace('name="elbow_left"', 'name="elbow_left" range="0.9 1.5"')
    (tmp_path / "a.xml").write_text(text)
    robot = describe(tmp_path / "a.xml", "sensor", tmp_path / "a.toml").robot
    q = np.tile(robot.home, (2, 1))
    q[1, 0] = -1.1
    with pytest.raises(PlanError, match=r"row 1: the passive joint elbow_left would be at .* 0\.9"):
        robot.check(q, robot.parameters.nominal, "plan")
    elbow = robot.qpos(robot.sample(50, np.random.default_rng(0)), robot.parameters.nominal)[:, 1]
    assert elbow.min() > 0.9
    assert elbow.max() < 1.5


FIVE_BAR = (models() / "five_bar" / "five_bar.xml").read_text(encoding="utf-8")
REFUSALS = {
    "past the sensor": (
        FIVE_BAR.replace(
            "</equality>", '<weld name="brace" body1="probe" body2="distal_right"/></equality>'
        ),
        r"closes a loop between 'probe' and 'distal_right', across the sensor",
    ),
    "coupled": (
        FIVE_BAR.replace(
            "</equality>", '<joint joint1="motor_left" joint2="elbow_left"/></equality>'
        ),
        r"couples joints 'motor_left' and 'elbow_left': only the equality constraint connect",
    ),
    "welded": (
        FIVE_BAR.replace(
            "</equality>", '<weld body1="distal_left" body2="distal_right"/></equality>'
        ),
        r"closes a loop between 'distal_left' and 'distal_right': only the .* connect",
    ),
    "no actuators": (
        re.sub(r"<actuator>.*</actuator>", "", FIVE_BAR, flags=re.DOTALL),
        r"no <actuator> says which joints are driven \(of motor_left, elbow_left",
    ),
    "too many": (
        FIVE_BAR.replace("</actuator>", '<position joint="elbow_left"/></actuator>'),
        r"driven joints motor_left, .*elbow_left.* cannot move by themselves",
    ),
    "too few": (
        re.sub(r'<general name="motor_right".*', "", FIVE_BAR),
        r"leave elbow_left, motor_right, elbow_right free",
    ),
    "ball": (
        re.sub(r'(name="elbow_right" )axis="0 1 0" ref="[^"]*"', r'\1type="ball"', FIVE_BAR),
        "three hinges",
    ),
    "open": (
        FIVE_BAR.replace(
            "</equality>", '</equality><keyframe><key qpos="0.3 0.3 0 0 0.9 0.3"/></keyframe>'
        )
        .replace('range="-0.4', 'range="-0.6').replace('range="-1.2 0.4"', 'range="-1.2 0.6"')
        .replace('anchor="0 0 0.35"', 'anchor="0 0 0.05"'),
        r"do not close at home .* 'tip' stays .* mm open",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSALS)
def test_loops_that_cannot_be_computed_are_refused_in_one_line(what, tmp_path, capsys):
    text, reason = REFUSALS[what]
    file = tmp_path / "a.xml"
    file.write_text(text)
    assert main(["robot", str(file), "--frame", "sensor", "--out", str(tmp_path / "a.toml")]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert re.search(reason, line) and "a." in line, line
    assert not (tmp_path / "a.toml").exists()


def test_an_older_recordings_loops_are_read_and_other_kinds_refused():
    """It states each closure's kind, and the numbers that welds and coupled joints had."""
    robot = loop_robot("five_bar")
    record = json.loads(json.dumps(robot.record))
    (closure,) = record["arm"]["loops"]["closures"]
    closure |= {"kind": "connect", "turn": np.eye(3).tolist(), "law": []}
    q = robot.sample(5, np.random.default_rng(0))
    theta = robot.parameters.nominal
    assert np.array_equal(loads(rebuilt(record), q, theta), loads(robot, q, theta))
    closure["kind"] = "weld"
    with pytest.raises(ParameterError, match="robot_model: .* tip is a weld"):
        rebuilt(record)


def test_a_base_gives_without_the_floor_that_it_stands_on():
    robot = loop_robot("five_bar")
    model = nominal(robot, [active_effect(robot, "base.compliance")]).mechanism.model
    assert model.geom_bodyid[model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE].tolist() == [0]
