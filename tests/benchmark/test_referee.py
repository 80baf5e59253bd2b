"""The referee: its machine as closed forms say, its laws as other integrators say."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wrenchbed import registry
from wrenchbed.benchmark import fault as common
from wrenchbed.benchmark.fault import EFFECTS, KINDS, NEEDED, ROWS_NEEDED, STATED
from wrenchbed.benchmark.referee import case
from wrenchbed.benchmark.referee import scenario as settings
from wrenchbed.benchmark.referee.case import DRAWS, FAMILIES, FaultyRobot, possible
from wrenchbed.benchmark.referee.lags_friction_and_noise import after, bouc_wen, lowpass
from wrenchbed.benchmark.referee.signatures import SAME, bench
from wrenchbed.effects.chain import ActiveEffect, respond
from wrenchbed.effects.scene import Scene


def test_bouc_wen_and_lags_agree_with_a_general_integrator():
    t = np.linspace(0.0, 3.0, 301)
    x = 1.4 * np.sin(4.0 * t) * np.exp(-0.2 * t)
    shape = 0.7
    rate = lambda s: 1.4 * np.exp(-0.2 * s) * (4.0 * np.cos(4.0 * s) - 0.2 * np.sin(4.0 * s))  # noqa: E731

    def slope(s, z):
        v = rate(s)
        return v * (1.0 - (shape * np.sign(v * z) + 1.0 - shape) * np.abs(z))

    (wanted,) = solve_ivp(slope, (0, 3), [0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.01).y
    assert bouc_wen(x[:, None], shape)[:, 0] == pytest.approx(wanted, abs=2e-3)
    t = np.arange(0.0, 4.0, 0.004)
    ramp = np.stack([t, 2.0 * t], axis=1)
    for late in (after(t, ramp, 0.3), lowpass(ramp, 0.004, 0.3, 2)):
        assert ramp[-1] - late[-1] == pytest.approx([0.3, 0.6], rel=1e-3)


@pytest.mark.sampled
@pytest.mark.parametrize("name", [
    "base.tilt", "mount.rotation", "joint.offset", "joint.compliance", "tool.mass", "tool.cog",
    "sensor.bias", "sensor.gain", "sensor.crosstalk", "sensor.drift",
])  # fmt: skip
def test_true_numbers_mean_what_the_library_publishes(world, name):
    """The library's formula with the referee's numbers gives what the referee's machine reads."""
    setting = world.setting
    joint = (2,) if name == "joint.compliance" else ()
    fault = DRAWS[name](setting, np.random.default_rng(3), 4.0, *joint)
    found = world.measured(fault).signature
    q, t = setting.mean(setting.path.q), setting.mean(setting.path.t)
    held = np.ones(len(q), dtype=bool)
    gravity = np.array(setting.robot.gravity)
    scene = Scene(setting.robot, setting.theta, gravity, q, t - setting.path.t[0], held)
    there = [ActiveEffect.of(setting.robot, name, dict(fault.true))]
    wanted = respond(scene, there) - respond(scene)
    configured = name in STATED or name == "sensor.drift"
    size = setting.usual.gap(found, configured)
    assert size > 0.1
    assert setting.usual.gap(found - wanted, configured) < 0.02 * size


@pytest.fixture(scope="module")
def small():
    """Robots with few poses and rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settings, "POSES", (24, 24))
        patch.setattr(settings, "SAMPLES", 10)
        yield


@pytest.fixture(scope="module")
def world(small):
    setting = settings.draw(registry.load("robots", "ur5"), "static", np.random.default_rng(5))
    return FaultyRobot.of(setting)


@pytest.mark.sampled
@pytest.mark.parametrize("name", common.possible(["joints", "warmth", "repeats"]))
def test_every_effect_changes_what_is_read(world, name):
    fault = DRAWS[name](world.setting, np.random.default_rng(6), 4.0)
    assert fault.name == name
    found = world.measured(fault)
    assert max(found.gap, found.rows) > 1e-3


@pytest.mark.sampled
@pytest.mark.parametrize("name", list(FAMILIES))
def test_every_family_outside_changes_what_is_read(world, name):
    found = world.measured(FAMILIES[name](world.setting, np.random.default_rng(2), 2.0))
    assert found.fault.name == name and name not in EFFECTS
    assert found.gap > 0.1


@pytest.mark.sampled
@pytest.mark.parametrize("mode", ["static", "dynamic"])
def test_every_effect_on_means_has_a_signature(small, mode):
    """What has none in referee/signatures.py is never named as a rival of another effect."""
    setting = settings.draw(registry.load("robots", "ur5"), mode, np.random.default_rng(5))
    world = FaultyRobot.of(setting)
    on_means = {n for n in possible(setting) if "repeats" not in EFFECTS[n].needs}
    assert on_means - set(STATED) <= set(bench(setting, world.way).columns)


def test_a_turned_last_joint_and_a_wrong_mass_are_what_they_look_like(world):
    found = world.measured(DRAWS["joint.offset"](world.setting, np.random.default_rng(1), 4.0, 5))
    signatures = bench(world.setting, world.way)
    left = signatures.imitated(found.signature, configured=False)
    assert found.gap > 1.0
    assert left["mount.rotation"] < 0.01 * found.gap
    assert left["sensor.drift"] > 0.5 * found.gap
    assert "mount.rotation" in signatures.alike("joint.offset", found.signature)
    assert left["mount.rotation"] <= SAME
    found = world.measured(DRAWS["tool.mass"](world.setting, np.random.default_rng(1), 1.0))
    signatures = bench(world.setting, world.way)
    assert "sensor.gain" in signatures.alike("tool.mass", found.signature)
    assert signatures.shows(found.signature, found.signature, configured=True)
    assert not signatures.shows(-found.signature, found.signature, configured=True)
    setting = world.setting
    theta = setting.robot.theta_of_tool(setting.theta, setting.mass + 0.1, setting.cog.tolist())
    other = setting.stated(theta) - setting.nominal + np.linspace(1.0, 2.0, 6)
    assert setting.usual.gap(other) < 1e-12 * setting.usual.gap(other, configured=True)


def test_the_background_has_many_families_and_grows_with_its_scale(world):
    rng = lambda: np.random.default_rng(8)  # noqa: E731
    faults = case.background(world.setting, rng(), 0.3)
    assert len({f.name for f in faults}) > 12
    readings = []
    for scale in (0.1, 0.4):
        around = case.background(world.setting, rng(), scale)
        readings.append(FaultyRobot.of(world.setting, around).base - world.base)
    gaps = [world.setting.usual.gap(r) for r in readings]
    assert 0.0 < gaps[0] < gaps[1]


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
def test_a_case_holds_what_its_kind_promises(small, kind):
    found = case.make("ur5", "static", kind, (3, 1))
    assert found.kind == kind
    assert found.minor <= case.LARGEST_MINOR
    assert len(found.causes) == {"none": 0, "single": 1, "pair": 2, "outside": 1}[kind]
    for cause in found.causes:
        between = kind != "outside" and "repeats" in EFFECTS[cause.fault.name].needs
        needed = ROWS_NEEDED if between else NEEDED
        assert (cause.rows if between else cause.gap) >= needed[kind]
        assert 0.5 <= cause.fault.size <= 4.0
    if kind == "pair":
        assert len({c.fault.name.split(".")[0] for c in found.causes}) == 2
    if kind == "outside":
        signature = found.causes[0].signature
        left = found.world.signatures.imitated(signature, configured=False, bounded=False)
        assert min(left.values()) >= case.LIBRARY_LEAVES
    again = case.make("ur5", "static", kind, (3, 1))
    for name, column in found.recording.columns.items():
        assert np.array_equal(column, again.recording.columns[name]), name
    assert found.recording.metadata == again.recording.metadata


def test_numbers_of_a_tenth_joint_are_compared():
    """Arms from files may have ten joints and more."""
    for name in ("joint.offset", "joint.compliance"):
        pattern = EFFECTS[name].compared
        parameter = name.partition(".")[2]
        assert all(re.fullmatch(pattern, f"{parameter}.{joint}") for joint in ("q3", "q12"))


@pytest.mark.parametrize("robot", ["ur5", "medrue"])
def test_a_minor_vibration_raises_no_channels_variance_by_a_fifth(robot):
    """MedRUE's torques are finer beside its forces than the tool's lever is short."""
    arm = registry.load("robots", robot)
    stated = common.as_stated(arm, "static", "sim", 100.0, arm.tool(arm.parameters.nominal))
    tool, noise = stated.tool, np.array(stated.sensor.noise_std)
    mass, cog = tool.mass, np.array(tool.cog)
    setting = SimpleNamespace(noise=noise, mass=mass, cog=cog, metadata=stated)
    for seed in range(30):
        shake = case.between_rows(setting, np.random.default_rng(seed)).rows.shake
        force = mass * shake(np.arange(0.0, 15.0, 0.01))
        load = np.concatenate([force, np.cross(cog, force)], axis=1)
        assert np.square(load / noise).mean(axis=0).max() < 0.2
