"""Limits of live robots before they move: worked out where nobody gave them, and always kept."""

from dataclasses import replace

import numpy as np
import pytest
from test_run_live import PLAN, UR5, Arm, run

from wrenchbed.campaigns.moves import MARGIN_M, live_limits
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.errors import LimitError, PlanError

WEIGHT = 1.35 * 9.80665
"""Of the nominal tool [N]."""


@pytest.fixture
def arm():
    with Arm() as one:
        yield one


def test_without_limits_the_box_is_around_the_way_and_the_load_within_the_range(arm):
    found = live_limits(arm, PLAN)
    poses = np.vstack([UR5.home, PLAN.q])
    _, at = UR5.sensor_pose(poses, UR5.parameters.nominal)
    lower, upper = np.asarray(found.limits.workspace)
    assert (at - lower >= MARGIN_M - 1e-9).all() and (upper - at >= MARGIN_M - 1e-9).all()
    assert (upper - lower < np.ptp(at, axis=0) + 0.3).all()
    assert found.limits.force == pytest.approx((WEIGHT + 65.0) / 2.0, abs=0.01)
    lever = float(np.linalg.norm(UR5.tool(UR5.parameters.nominal).cog))
    assert found.limits.torque == pytest.approx((WEIGHT * lever + 5.0) / 2.0, abs=0.01)
    assert found.limits.speed == arm.limits.speed
    assert found.to_json()["derived"] == ["workspace", "force", "torque"]


def test_the_sensors_zero_widens_the_limit_and_one_out_of_range_is_refused(arm):
    arm.push[:] = (0.0, 30.0, 0.0, 0.0, 0.0, 1.0)
    found = live_limits(arm, PLAN).limits
    assert found.force == pytest.approx((WEIGHT + 30.0 + 65.0) / 2.0, abs=0.1)
    arm.push[1] = 55.0
    with pytest.raises(LimitError, match="set its zero, or give --max-force"):
        live_limits(arm, PLAN)


def test_what_was_given_stays_and_nothing_is_worked_out(monkeypatch):
    box = ((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
    with Arm(workspace=box, force=20.0, torque=2.0, speed=0.1) as arm:
        monkeypatch.setattr(arm, "_read_wrench", None)
        found = live_limits(arm, PLAN)
        assert found.limits is arm.limits and found.to_json()["derived"] == []


def test_a_run_states_its_limits_and_keeps_to_them(tmp_path):
    arm = Arm()
    run(arm, tmp_path / "r.parquet")
    stated = Recording.read(tmp_path / "r.parquet").metadata.extra["limits"]
    assert stated["max_force"] == arm.limits.force < 65.0
    assert stated["workspace"] == [v for bound in arm.limits.workspace for v in bound]
    arm.push[:3] = 50.0
    with arm, pytest.raises(LimitError, match="measured force"):
        arm.guard()
    with arm, pytest.raises(PlanError, match="outside the workspace"):
        arm.move(UR5.home + np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_a_recording_holds_what_joints_report(tmp_path):
    class Telling(Arm):
        def _read(self):
            sample = super()._read()
            evidence = {"i": np.arange(6.0), "joint_temperature": np.full(6, 30.0)}
            return replace(sample, evidence=evidence)

    run(Telling(), tmp_path / "r.parquet")
    rec = Recording.read(tmp_path / "r.parquet")
    assert (rec.columns["i4"] == 3.0).all() and (rec.columns["joint_temperature6"] == 30.0).all()


def test_a_motion_stays_in_its_own_box(arm):
    share = np.linspace(0.0, 1.0, 200)[:, None]
    motion = Plan.of("ur5", UR5.home + 0.2 * share * np.ones(6), rate_hz=125.0)
    _, at = UR5.sensor_pose(motion.q, UR5.parameters.nominal)
    lower, upper = np.asarray(live_limits(arm, motion).limits.workspace)
    assert np.allclose(lower, at.min(axis=0) - MARGIN_M, atol=1e-3)
    assert np.allclose(upper, at.max(axis=0) + MARGIN_M, atol=1e-3)
