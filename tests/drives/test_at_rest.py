"""Fits of joint efforts at rest: loads recovered, intervals that hold, honest refusals."""

import json

import numpy as np
import pytest
from rest_torques import REAL, Imperfections, by_file, empty_and_loaded, random_load, recording, ur5

from wrenchbed.cli import main
from wrenchbed.drives.identify import calibrate_efforts
from wrenchbed.drives.identify_at_rest import added_load
from wrenchbed.errors import CalibrationError, ParameterError

CLEAN = Imperfections(*[0.0] * 7)
CONSTANTS = np.array([13.0, 13.0, 12.0, 9.0, 9.0, 9.0])
TOOL = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")


@pytest.fixture(scope="module")
def iiwa(tmp_path_factory):
    return by_file(tmp_path_factory.mktemp("iiwa"))


def errors(fit, load):
    """Errors of mass and centre in standard uncertainties (4,); 0 of what is not told."""
    true = dict(zip(TOOL, (load[0], *load[1]), strict=True))
    return np.array([(fit[n].value - x) / (fit[n].std or np.inf) for n, x in true.items()])


@pytest.mark.parametrize("arm", ["ur5", "iiwa"])
def test_without_imperfections_the_load_comes_out(arm, iiwa):
    robot, load = (ur5() if arm == "ur5" else iiwa), random_load(1)
    fit = calibrate_efforts(recording(robot, 1, load, wrong=CLEAN))
    assert [fit[n].value for n in TOOL] == pytest.approx([load[0], *load[1]], abs=1e-6)
    zeros = [p.value for p in fit.identified if p.name.startswith("drive.offset")]
    assert zeros == pytest.approx([0.0] * len(robot.joints), abs=1e-6)
    assert fit.refuted is None and fit.rest.poses == 50


def test_currents_tell_drive_constants_and_load():
    load = random_load(2)
    rec = recording(ur5(), 2, load, wrong=CLEAN, prefix="i", constants=CONSTANTS)
    fit = calibrate_efforts(rec)
    assert [fit[n].value for n in TOOL] == pytest.approx([load[0], *load[1]], abs=1e-5)
    told = [j for j in range(1, 7) if fit[f"drive.constant.{j}"].std is not None]
    assert told == [2, 3, 4, 5, 6]  # the first turns about gravity: no weight tells its constant
    found = [fit[f"drive.constant.{j}"].value for j in told]
    assert found == pytest.approx(CONSTANTS[1:], rel=1e-5) and fit.unit == "A"
    known = calibrate_efforts(rec, constants=CONSTANTS)
    assert known["tool.mass"].value == pytest.approx(load[0], abs=1e-6)
    assert known.constants == tuple(CONSTANTS) and known.unit == "N·m"


@pytest.mark.parametrize("arm", ["ur5", "iiwa"])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_carried_more_is_known_whatever_the_links_weigh(arm, seed, iiwa):
    robot = ur5() if arm == "ur5" else iiwa
    made, load = empty_and_loaded(robot, seed)
    more = {p.name: p for p in added_load(*made, robot)}
    assert more["tool.mass"].std < 0.06 < calibrate_efforts(made[1])["tool.mass"].std
    assert np.abs(errors(more, load)).max() < 3.0


@pytest.mark.parametrize("wrong", [Imperfections(), REAL], ids=["friction", "as real arms"])
@pytest.mark.parametrize("arm", ["ur5", "iiwa"])
def test_intervals_hold(arm, wrong, iiwa):
    held = cases(arm, wrong, iiwa, range(4))
    assert held.max() < 4.0 and np.sqrt(np.mean(held**2)) < 1.5


def cases(arm, wrong, iiwa, seeds):
    robot, result = (ur5() if arm == "ur5" else iiwa), []
    for seed in seeds:
        rec = recording(robot, seed, random_load(seed), wrong=wrong, rows=1 if seed % 2 else 8)
        result.append(errors(calibrate_efforts(rec), random_load(seed)))
    return np.abs(result)


@pytest.mark.study
@pytest.mark.parametrize("arm", ["ur5", "iiwa"])
def test_intervals_hold_in_200_cases(arm, iiwa):
    """Arms as they are; where links are exact, intervals are wider than needed."""
    held = cases(arm, REAL, iiwa, range(300, 500))
    assert (held < 3.0).mean() >= 0.99
    assert 0.87 <= (held < 1.645).mean() <= 0.95


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fault", ["zero", "gain", "joint"])
def test_one_fault_beside_the_load_widens_its_interval(fault, seed, iiwa):
    """A torque sensor's gain off by 10 %, its zero by 5 N·m, a joint's zero by 1°."""
    load, joint = random_load(seed), 1 + seed
    offset = np.deg2rad(1.0) * np.eye(7)[joint] if fault == "joint" else None
    rec = recording(iiwa, seed, load, wrong=REAL, offset=offset)
    columns = dict(rec.columns)
    effort = columns[f"tau{joint + 1}"]
    columns[f"tau{joint + 1}"] = {"gain": 1.1 * effort, "zero": effort + 5.0}.get(fault, effort)
    fit = calibrate_efforts(type(rec)(rec.metadata, columns, rec.name))
    assert np.abs(errors(fit, load)).max() < 4.0
    if fault == "zero":
        zero = fit[f"drive.offset.{joint + 1}"]
        assert zero.value == pytest.approx(5.0, abs=4.0 * zero.std)


def test_what_is_held_is_not_fitted():
    rec = recording(ur5(), 4, wrong=REAL)
    zeros = calibrate_efforts(rec, ("drive",))
    assert {p.name.rpartition(".")[0] for p in zeros.identified} == {"drive.offset"}
    assert [p.name for p in calibrate_efforts(rec, ("tool",)).identified] == list(TOOL)
    with pytest.raises(
        ParameterError, match=r"--free drive\.viscous: is none of drive, .* at rest"
    ):
        calibrate_efforts(rec, ("drive.viscous",))


def test_what_these_poses_do_not_tell_has_no_uncertainty():
    """Only the joint about gravity turns: no torque changes, zeros and load are told in sum."""
    q = np.tile(ur5().sample(1, np.random.default_rng(8)), (20, 1))
    q[:, 0] = np.linspace(-2.0, 2.0, 20)
    rec = recording(ur5(), 5, poses=20, at=q)
    fit = calibrate_efforts(rec, force=True)
    assert {p.name for p in fit.identified if p.std is not None} == {"drive.offset.1"}
    with pytest.raises(CalibrationError, match="the poses are too alike"):
        calibrate_efforts(rec)


def test_too_few_poses_and_efforts_of_the_other_sign_are_refused():
    with pytest.raises(CalibrationError, match="9 poses at rest: a fit of joint efforts needs 10"):
        calibrate_efforts(recording(ur5(), 6, poses=9))
    rec = recording(ur5(), 6)
    turned = {k: -v if k.startswith("tau") else v for k, v in rec.columns.items()}
    with pytest.raises(CalibrationError, match=r"tool\.mass comes out as -.* opposite sign"):
        calibrate_efforts(type(rec)(rec.metadata, turned, rec.name))
    late = {k: v[::-1] if k.startswith("tau") else v for k, v in rec.columns.items()}
    with pytest.raises(CalibrationError, match="did not see it leaves .* % of the efforts"):
        calibrate_efforts(type(rec)(rec.metadata, late, rec.name))


def test_the_command_prints_and_writes_it(tmp_path, capsys):
    recording(ur5(), 7, wrong=REAL, rows=1).write(tmp_path / "rest.parquet")
    out = tmp_path / "fit.json"
    assert main(["calibrate", str(tmp_path / "rest.parquet"), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert all(len(line) <= 80 for line in shown.splitlines() if "/" not in line)
    words = " ".join(shown.split())
    assert "50 poses at rest, 50 rows" in words and "friction of unknown sign" in words
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["cutoff_hz"] is None and written["poses"] == 50
    assert set(written["ordinary"]) == {"links", "joint zeros", "torque gains"}
    assert len(written["noise"]) == 6
