"""What is compiled of the reading at rest is what numpy computes, to the same bits anywhere."""

import importlib.util
import shutil
import sys
from importlib.machinery import ExtensionFileLoader
from pathlib import Path

import numpy as np
import pytest

import wrenchbed as wb
from iiwa import IIWA
from wrenchbed.robots.base import Robot, SimulatedRobot
from wrenchbed.robots.compiled import statics

SCRIPTS = Path(__file__).parents[2] / "scripts"
NAMES = [n for n in wb.names("robots") if wb.load("robots", n).compiled]
ROBOTS = [*(wb.load("robots", name) for name in NAMES), IIWA]
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: r.name)


def built(folder: Path, *more: str):
    """The library, compiled from the source as it is now."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler is on this machine")
    sys.path.insert(0, str(SCRIPTS))
    try:
        from build_kernel import build
    finally:
        sys.path.remove(str(SCRIPTS))
    loader = ExtensionFileLoader("_statics", str(build(folder, more)))
    spec = importlib.util.spec_from_loader("_statics", loader)
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def functions(library) -> dict:
    return {name: getattr(library, name) for name in ("chain", "medrue", "medrue_slopes")}


@pytest.fixture(scope="module")
def library():
    """As the package was built: `scripts/environment.sh` does so anew where the source changed."""
    return pytest.importorskip("wrenchbed.robots.compiled._statics")


@pytest.fixture(autouse=True)
def fresh(library, monkeypatch):
    monkeypatch.setattr(statics, "_FUNCTIONS", functions(library))


def thetas(model: wb.Model, count: int, seed: int = 5) -> np.ndarray:
    """Parameter vectors (count, P), all of robot and sensor off by up to their tolerances."""
    off = np.random.default_rng(seed).uniform(-1, 1, (count, len(model.parameters)))
    found = model.parameters.nominal + off * model.parameters.tolerance
    found[:, -9:] += 0.2 * off[:, -9:]  # unequal force gains
    return found


def feasible(robot: SimulatedRobot, count: int, vectors: np.ndarray) -> np.ndarray:
    q = robot.sample(count, np.random.default_rng(count))
    bad = {i for theta in vectors for i in robot.infeasible(q, theta[: len(robot.parameters)])}
    return np.delete(q, list(bad), axis=0)


def plain(model: wb.Model, q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    return model.read(model.plain_wrench(q, theta), theta)


def apart(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


@pytest.mark.sampled
@each_robot
def test_it_is_what_numpy_computes(robot):
    model = wb.Model.of(robot)
    vectors = thetas(model, 4)
    q = feasible(robot, 200, vectors)
    assert len(q) > 150
    for theta in vectors:
        assert apart(model.predict(q, theta), plain(model, q, theta)) < 1e-13
        assert apart(model.true_wrench(q, theta), model.plain_wrench(q, theta)) < 1e-13
        own, gravity = theta[: len(robot.parameters)], np.asarray(model.gravity)
        assert apart(model.gravity_seen(q, theta), robot.gravity_seen(q, own, gravity)) < 1e-13


GANTRY = """
<mujoco><worldbody>
  <body><joint name="x" type="slide" axis="1 0 0" range="-1 1"/><geom size="0.1"/>
    <body euler="20 30 40"><joint name="a" axis="0.6 0 0.8" range="-3 3"/><geom size="0.1"/>
      <body euler="0 50 0"><joint name="y" type="slide" axis="0 1 0" range="-1 1"/>
        <geom size="0.1"/>
        <body euler="70 0 0"><joint name="b" axis="0 1 0" range="-3 3"/><geom size="0.1"/>
          <body euler="0 15 5"><joint name="z" type="slide" range="-1 1"/><geom size="0.1"/>
            <site name="seat"/></body></body></body></body></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize("hinges", ["ab", ""])
def test_slides_of_a_users_arm(tmp_path, hinges):
    mjcf = GANTRY
    for name in () if hinges else ("a", "b"):
        mjcf = mjcf.replace(f'"{name}" axis', f'"{name}" type="slide" axis')
    (tmp_path / "gantry.xml").write_text(mjcf)
    tool = {"tool_mass": 1.2, "tool_cog": (0.01, -0.02, 0.05)}
    robot = wb.describe_robot(tmp_path / "gantry.xml", "seat", tmp_path / "my.toml", **tool).robot
    assert [j.unit for j in robot.joints].count("rad") == len(hinges)
    model = wb.Model.of(robot)
    for theta in thetas(model, 2):
        q = robot.sample(100, np.random.default_rng(1))
        assert apart(model.predict(q, theta), plain(model, q, theta)) < 1e-13


@each_robot
def test_a_pose_has_the_same_bits_alone_and_in_any_batch(robot):
    model = wb.Model.of(robot)
    vectors = thetas(model, 3)
    q = feasible(robot, 150, vectors)
    whole = model.predict(q, vectors[0])
    for some in (slice(0, 1), slice(3, 20), slice(64, 129), slice(0, None, 7)):
        assert np.array_equal(model.predict(q[some], vectors[0]), whole[some])
    assert np.array_equal(model.predict(np.asfortranarray(q), vectors[0]), whole)
    assert model.predict(q[:0], vectors[0]).shape == (0, 6)


@pytest.mark.slow
def test_bits_do_not_depend_on_the_processor(tmp_path, monkeypatch):
    for_all = built(tmp_path, "-U__gnu_linux__")  # for the default processor only
    for name in ("ur5", "medrue"):
        model = wb.Model.of(wb.load("robots", name))
        theta = thetas(model, 1)
        q = feasible(model.robot, 300, theta)
        wide = model.predict(q, theta[0])
        with monkeypatch.context() as patch:
            patch.setattr(statics, "_FUNCTIONS", functions(for_all))
            assert np.array_equal(model.predict(q, theta[0]), wide)


def test_far_and_missing_joint_values_are_as_in_numpy():
    model = wb.Model.of(wb.load("robots", "ur5"))
    theta = thetas(model, 1)[0]
    q = np.random.default_rng(0).uniform(-6, 6, (40, 6))
    q[3, 2], q[7], q[20, 5], q[30, 0] = 1e9, 3.9e5, -1e300, np.nan
    wanted, found = plain(model, q, theta), model.predict(q, theta)
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [30]
    near = np.delete(np.arange(40), [3, 7, 20, 30])
    assert apart(found[near], wanted[near]) < 1e-13
    for row, digits in ((3, 1e-6), (7, 1e-9)):  # a zero is added to so many digits of an angle
        assert apart(found[row], wanted[row]) < digits
    right_angles = np.arange(-40, 40).reshape(-1, 1) * np.ones(6) * np.pi / 2
    off = np.abs(model.predict(right_angles, theta) - plain(model, right_angles, theta))
    assert off.max() < 1e-13 * np.abs(wanted[near]).max()


@pytest.mark.sampled
@pytest.mark.parametrize("column", ["L12", "L24"])
def test_a_loop_that_numpy_cannot_close_is_open(column):
    """Rounding differs; where it alone decides, the fit's Jacobian must still exist."""
    model = wb.Model.of(wb.load("robots", "medrue"))
    start, k = model.parameters.nominal, model.parameters.index(column)
    seen = set()

    def closes(length: float, q: np.ndarray) -> tuple[bool, bool]:
        theta = start.copy()
        theta[k] = length
        by_numpy, found = plain(model, q[None], theta), model.predict(q[None], theta)
        return bool(np.isfinite(by_numpy).all()), bool(np.isfinite(found).all())

    with np.errstate(invalid="ignore"):
        for q in model.robot.sample(12, np.random.default_rng(2)):
            closed, gone = start[k], -0.1
            if closes(gone, q)[0]:
                continue
            while abs(closed - gone) > 2 * np.spacing(closed):
                middle = 0.5 * (closed + gone)
                closed, gone = (middle, gone) if closes(middle, q)[0] else (closed, middle)
            near = [closes(closed + n * np.spacing(closed), q) for n in range(-20, 20)]
            seen |= {by_numpy for by_numpy, _ in near}
            assert not [n for n, (by_numpy, found) in enumerate(near) if found and not by_numpy]
            assert closes(closed + 1e-8, q) == (True, True)
    assert seen == {True, False}


def test_the_jacobian_is_numpys(monkeypatch):
    model = wb.Model.of(wb.load("robots", "medrue"))
    vectors = thetas(model, 3)
    q = feasible(model.robot, 60, vectors)
    columns = list(range(len(model.parameters)))
    found = [model.jacobian(q, theta, columns) for theta in vectors]
    some = model.jacobian(q[7:30], vectors[0], columns[3:40:4])
    monkeypatch.setattr(statics, "_FUNCTIONS", {})
    for one, theta in zip(found, vectors, strict=True):
        wanted = model.jacobian(q, theta, columns)
        size = np.abs(wanted).max(axis=(0, 1))
        assert (size > 1e-3).sum() > 50
        assert (np.abs(one - wanted).max(axis=(0, 1)) <= 1e-13 * np.maximum(size, 1.0)).all()
    assert np.array_equal(some, found[0][7:30, :, 3:40:4])


def test_without_the_library_and_of_other_numbers_numpy_does_the_work(monkeypatch):
    model = wb.Model.of(wb.load("robots", "ur5"))
    theta, q = thetas(model, 1)[0], np.random.default_rng(0).uniform(-3, 3, (5, 6))
    shifted = theta.astype(complex)
    shifted[0] += 1e-30j
    assert Robot.compiled == "" and not statics.available("")
    monkeypatch.setattr(statics, "_FUNCTIONS", {"chain": pytest.fail})
    assert np.iscomplexobj(model.predict(q, shifted))
    assert np.iscomplexobj(model.predict(q, np.stack([shifted, theta])[:, None]))
    assert np.array_equal(model.predict(q.astype(">f8"), theta), plain(model, q, theta))
    monkeypatch.setattr(statics, "_FUNCTIONS", {})
    assert np.array_equal(model.predict(q, theta), plain(model, q, theta))
    assert np.array_equal(model.true_wrench(q, theta), model.plain_wrench(q, theta))


def test_what_does_not_fit_is_refused(library):
    q, out, constants = np.zeros((4, 6)), np.zeros((4, 6)), {}
    for name in ("ur5", "medrue"):
        model = wb.Model.of(wb.load("robots", name))
        theta = model.parameters.nominal
        constants[name] = model._compiled.constants(theta, sensed=True).tobytes()
    ours, theirs = constants.values()
    library.chain(q, 6, ours, out)
    library.medrue_slopes(q, 6, theirs, out, theirs)
    for function, *bad in (
        (library.chain, q, 6, ours[:-8], out), (library.chain, q[:3], 6, ours, out),
        (library.chain, q, 5, ours, out), (library.chain, q, 0, ours, out),
        (library.chain, q, 6, b"", out), (library.medrue, q, 6, ours, out),
        *((library.medrue_slopes, q, 6, theirs, out, x) for x in (b"", theirs[:-1], 2 * theirs)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="do not fit"):
            function(*bad)
    with pytest.raises(TypeError):
        library.chain(q, 6)
