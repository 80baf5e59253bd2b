"""Models as a viewer opens them, and robots of the Menagerie by their names."""

import sys

import mujoco
import numpy as np
import pytest

import wrenchbed as wb
from servo_arm import JOINTS, Servos
from wrenchbed.cli import main
from wrenchbed.robots.base import models
from wrenchbed.robots.ur5 import ur_arm
from wrenchbed.twin.twin import nominal

NAMES = ("ur5", "medrue", "five_bar", "stewart")
SECONDS, STILL, CLOSED = 1.0, 0.05, 1e-4
PUSH = 20.0


def file_of(name):
    return models() / name / f"{name}.xml"


class Opened:
    """A model as ``python -m mujoco.viewer`` opens it, or from its first keyframe, and run."""

    def __init__(self, file, seconds, key=False, force=None):
        self.model = model = mujoco.MjModel.from_xml_path(str(file))
        self.data = data = mujoco.MjData(model)
        if key and model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        self.start = data.qpos.copy()
        self.fastest = self.gap = 0.0  # speed of a joint, width of a loop [m]
        names = [model.body(b).name for b in range(model.nbody)]
        tool = next(names.index(n) for n in ("tool", "probe", "gripper") if n in names)
        for _ in range(round(seconds / model.opt.timestep)):
            if force is not None:
                data.xfrc_applied[tool, :3] = force
            mujoco.mj_step(model, data)
            self.fastest = max(self.fastest, float(np.abs(data.qvel).max()))
            loops = data.efc_type[: data.nefc] == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
            gaps = np.abs(data.efc_pos[: data.nefc][loops])
            self.gap = max(self.gap, float(gaps.max(initial=0.0)))
        self.moved = float(np.abs(data.qpos - self.start).max())


@pytest.mark.parametrize("key", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_a_model_stays_as_it_opens_by_servos_with_limits(name, key):
    run = Opened(file_of(name), SECONDS, key)
    assert run.fastest < STILL and run.moved < 1e-6 and run.gap < CLOSED
    model = run.model
    assert model.actuator_forcelimited.all()
    assert (model.actuator_forcerange[:, 1] > 0.0).all()
    driven = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    assert (model.dof_damping[driven] > 0.0).all()
    assert (model.dof_frictionloss[driven] > 0.0).all()


@pytest.mark.parametrize("force", [[PUSH, 0.0, PUSH], [0.0, PUSH, -PUSH]])
@pytest.mark.parametrize("name", NAMES)
def test_loops_stay_closed_and_servos_hold_while_the_tool_is_pushed(name, force):
    run = Opened(file_of(name), SECONDS, force=force)
    assert run.gap < CLOSED and run.moved < 0.02
    assert np.abs(run.data.qvel).max() < STILL


@pytest.mark.parametrize(
    ("name", "point", "top"),
    [("ur5", (0.25, -0.109, -0.06), -0.016), ("medrue", (0.1505, 0.4393, -0.33), -0.286)],
    ids=["ur5", "medrue"],
)
def test_the_tool_does_not_pass_through_what_stands_there(name, point, top):
    """Driven down, the tip stops at bench or leg; without contact it arrives inside."""
    robot = wb.load("robots", name)
    inside = wb.Simulation(robot, robot.parameters.nominal).joints_touching(robot.home, point)
    heights = {}
    for touching in (True, False):
        model = mujoco.MjModel.from_xml_path(str(file_of(name)))
        if not touching:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        data = mujoco.MjData(model)
        for k in range(1500):
            data.ctrl[:] = (inside - robot.home) * min(1.0, k / 1000)
            mujoco.mj_step(model, data)
        bodies = {model.body(model.geom_bodyid[g]).name for c in data.contact for g in c.geom}
        assert ({"tool", "world"} <= bodies) is touching
        heights[touching] = float(data.site("tcp").xpos[2])
    assert heights[False] == pytest.approx(point[2], abs=1e-3)
    assert heights[True] > top - 0.02  # soft contact against stiff servos


@pytest.mark.sampled
@pytest.mark.parametrize(
    "make",
    [
        lambda folder: wb.load("robots", "ur5"),
        lambda folder: wb.load("robots", "medrue"),
        lambda folder: ur_arm("ur10e"),
        lambda folder: wb.describe_robot(file_of("stewart"), "sensor", folder / "s.toml").robot,
        lambda folder: wb.describe_robot(file_of("five_bar"), "sensor", folder / "f.toml").robot,
    ],
    ids=["ur5", "medrue", "ur10e", "stewart", "five_bar"],
)
def test_an_exported_model_stays_as_it_opens(make, tmp_path):
    robot = make(tmp_path)
    mjcf, _ = wb.export(nominal(robot), tmp_path / "out")
    run = Opened(mjcf, 0.5)
    at = [int(run.model.joint(j.name).qposadr[0]) for j in robot.joints]
    assert np.abs(run.start[at] - robot.home).max() < 1e-5  # MuJoCo writes six digits
    assert run.fastest < STILL and run.gap < CLOSED


NAME = "universal_robots_ur5e"


def by_name(folder, name=NAME):
    return main(["robot", name, "--frame", "tip", "--out", str(folder / "my.toml")])


@pytest.fixture
def menagerie(tmp_path, monkeypatch):
    """The installed package with an empty cache, and no network."""
    package = pytest.importorskip("mujoco_menagerie")
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MENAGERIE_BASE_URL", (tmp_path / "nowhere").as_uri())
    return package


def test_a_robot_of_the_cache_is_described_by_its_name(menagerie, tmp_path):
    robot = menagerie.get(NAME)
    folder = menagerie.Cache().model_path(robot)
    folder.mkdir(parents=True)
    (folder / robot.entry(robot.default_model).file).write_text(Servos().xml(), encoding="utf-8")
    (folder / ".complete").write_text("{}", encoding="utf-8")
    assert by_name(tmp_path) == 0
    assert wb.load("robots", str(tmp_path / "my.toml")).joint_names == JOINTS


def test_without_a_network_one_line_says_so(menagerie, tmp_path, capsys):
    assert by_name(tmp_path) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "network" in error and NAME in error


def test_a_name_that_nobody_knows_is_corrected(menagerie, tmp_path, capsys):
    assert by_name(tmp_path, "universal_robots_ur5") == 1
    assert f"did you mean '{NAME}'" in capsys.readouterr().err


def test_without_the_extra_its_name_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    assert by_name(tmp_path) == 1
    error = capsys.readouterr().err
    assert "menagerie]" in error and "is no file" in error and error.count("\n") == 1
    assert by_name(tmp_path, "arm.xml") == 1
    assert "menagerie" not in capsys.readouterr().err
