"""A serial arm of seven joints, data alone: planned, recorded, calibrated and diagnosed."""

import json
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from test_file_arm import arm_of

from arm_files import CASES
from iiwa import IIWA
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.data.recording import Recording
from wrenchbed.effects.chain import active_effect, effects, respond
from wrenchbed.effects.scene import examples
from wrenchbed.twin.twin import nominal


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    """Another package's entry point brings the robot."""
    point = SimpleNamespace(load=lambda: IIWA)
    found = {"robots": {"iiwa14": point}}
    monkeypatch.setattr(registry, "_entry_points", lambda kind: found.get(kind, {}))


def recorded(tmp_path, poses, *more):
    """A recording of the arm as it was planned."""
    plan, recording = str(tmp_path / "plan.parquet"), str(tmp_path / "rec.parquet")
    assert main(["plan", "iiwa14", "--n", str(poses), "--out", plan]) == 0
    line = ["record", "--robot", "iiwa14", "--plan", plan, "--out", recording, "--samples", "20"]
    assert main([*line, "--effect", *more]) == 0
    return recording


def test_seven_joints_are_planned_recorded_and_calibrated(tmp_path):
    recording = recorded(tmp_path, 20, "tool.mass:mass=0.1", "--noise", "off")
    assert Recording.read(recording).q.shape[1] == 7
    assert main(["calibrate", recording, "--out", str(tmp_path / "fit.json")]) == 0
    fit = json.loads((tmp_path / "fit.json").read_text())
    assert fit["theta"]["tool.mass"] == pytest.approx(1.45, abs=1e-6)


@pytest.mark.sampled
@pytest.mark.parametrize("case", [CASES[5], CASES[0], None], ids=["urdf", "mjcf", "iiwa14"])
def test_every_effect_of_an_arm_is_simulated_as_fitted(case, tmp_path):
    robot = IIWA if case is None else arm_of(case, tmp_path)
    (still, _), applied = examples(robot), 0
    for name, effect in effects().items():
        if not effect.between_rows and effect.acts(still) and effect.variants(still):
            active = [active_effect(robot, name)]
            closed = respond(still, active)
            change = np.abs(closed - respond(still)).max()
            assert (
                np.abs(nominal(robot, active).wrench(still) - closed).max() < 0.05 * change + 1e-9
            )
            applied += 1
    assert applied > 20


def test_the_file_of_an_arm_is_written_from_its_data():
    ours = IIWA.drawn().compile()
    other = mujoco.MjModel.from_xml_path(str(IIWA.mjcf))
    for name in ("body_pos", "body_mass", "body_ipos", "qpos0", "jnt_range", "key_qpos"):
        mine, its = (getattr(model, name) for model in (ours, other))
        behind = 2 if name.startswith("body_") else 0  # the base's own inertial means nothing
        assert np.allclose(mine[behind:], its[behind:], rtol=0.0, atol=1e-8), name
    turn = np.abs((ours.body_quat * other.body_quat).sum(axis=1))
    assert np.abs(turn - 1.0).max() < 1e-12
