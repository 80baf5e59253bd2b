"""A diagnosis of recordings whose truth is known: made in MuJoCo, found in closed form."""

import json
from dataclasses import replace

import numpy as np
import pytest

import wrenchbed as wb
from wrenchbed import registry
from wrenchbed.campaigns.recording.run import record
from wrenchbed.cli import main
from wrenchbed.data.plan import Plan
from wrenchbed.diagnosis.diagnose import diagnose
from wrenchbed.diagnosis.gap.result import named_by
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions


def recorded(tmp_path, *effects, n=40, seed=1):
    robot = registry.load("robots", "ur5")
    plan = Plan.of("ur5", robot.sample(n, np.random.default_rng(seed)))
    options = SimOptions("ur5", noise="white", seed=seed, effects=effects)
    path = tmp_path / "rec.parquet"
    with SimDriver(options) as driver:
        record(driver, plan, path, samples=30)
    return wb.Recording.read(path)


@pytest.mark.slow
def test_the_library_writes_what_the_command_line_writes(tmp_path):
    path = tmp_path / "rec.parquet"
    recorded(tmp_path, "joint.offset:joint=6,offset=0.01")
    findings = wb.diagnose(wb.Recording.read(path))
    told = findings.diagnosis.to_json()
    (cause,) = told["which"]  # no data in free space tell these two apart
    assert set(named_by(cause)) == {"joint.offset", "mount.rotation"}
    assert told["verdict"] == "identified"
    plan = Plan.of("ur5", np.zeros((1, 6)))
    replace(findings, plans={"next.parquet": plan}).write(tmp_path / "library")
    main(["diagnose", str(path), "--out", str(tmp_path / "command")])
    for name in ("diagnosis.json", "twin.json"):
        one, other = (tmp_path / folder / name for folder in ("library", "command"))
        assert json.loads(one.read_text()) == json.loads(other.read_text()), name
    assert wb.Plan.read(tmp_path / "library" / "next.parquet").q.tolist() == plan.q.tolist()


@pytest.mark.slow
def test_a_jump_between_two_poses_may_have_come_at_any_time_between_them(tmp_path):
    t = recorded(tmp_path).t
    before, after = t[599], t[600]  # the last row of a pose, the first of the next
    moment = before + 0.8 * (after - before)
    told = diagnose(recorded(tmp_path, f"sensor.jump:time={moment},step.fz=0.6")).diagnosis
    (cause,) = told.to_json()["which"]
    assert cause["effect"] == "sensor.jump"
    time = cause["parameters"]["time"]
    step = np.diff(t).max()  # a pose on either side may be a sealed one
    assert abs(time["value"] - moment) < 2.0 * time["std"]
    assert (after - before) / 12.0**0.5 < time["std"] < step
