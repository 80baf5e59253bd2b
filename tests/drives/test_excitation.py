"""The exciting motion: within limits, free, and with smaller standard errors than a multi-sine."""

import numpy as np
import pytest

from wrenchbed import Plan, Recording, excite, multisine, record, registry
from wrenchbed.cli import main
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.errors import PlanError
from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
from wrenchbed.planning.clearance import Clearance
from wrenchbed.robots.motion_limits import Limits

UR5 = registry.load("robots", "ur5")
SECONDS, RATE = 30.0, 125.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "p.parquet"
    words = f"plan ur5 --motion excite --for dynamics --seconds {SECONDS:g} --seed 1 --out {out}"
    assert main(words.split()) == 0
    return Plan.read(out)


@pytest.mark.slow
def test_it_is_within_limits_and_touches_nothing(plan):
    assert len(plan) == SECONDS * RATE
    q, clearance = plan.q, Clearance(UR5)
    assert not UR5.infeasible(q, UR5.parameters.nominal)
    speed, acceleration = np.gradient(q, 1 / RATE, axis=0), np.diff(q, 2, axis=0) * RATE**2
    assert (np.abs(speed).max(axis=0) <= 0.61 * np.array([j.speed for j in UR5.joints])).all()
    assert np.abs(acceleration).max() < 4.1
    assert np.abs(speed[[0, -1]]).max() < 0.02
    assert not any(clearance.hit(place) for place in q[::10])


@pytest.mark.slow
def test_its_standard_errors_are_smaller_than_a_multisines(plan, tmp_path):
    stds = []
    for k, way in enumerate((plan, multisine(UR5, SECONDS, RATE, 1))):
        out = tmp_path / f"{k}.parquet"
        limits = Limits(speed=0.5, tracking=1.0)
        with SimDriver(SimOptions("ur5", seed=2, effort="torque", limits=limits)) as link:
            record(link, way, out)
        fit = calibrate_efforts(Recording.read(out))
        stds.append({p.name: p.std for p in fit.identified if p.std is not None})
    ratio = [stds[1][n] / stds[0][n] for n in stds[0] if n in stds[1]]
    assert np.median(ratio) > 1.5


def test_refusals(tmp_path, capsys):
    with pytest.raises(PlanError, match="no serial arm"):
        excite(registry.load("robots", "medrue"), 30.0, 125.0, 0)
    with pytest.raises(PlanError, match="at least 5 s"):
        excite(UR5, 3.0, 125.0, 0)
    out = str(tmp_path / "p.parquet")
    assert main(["plan", "ur5", "--motion", "excite", "--out", out]) == 1
    assert "--for dynamics" in capsys.readouterr().err
