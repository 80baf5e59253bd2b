"""A twin: MuJoCo with effects, held against the closed form; its file."""

import json
from typing import Any

import mujoco
import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.effects.base import Effect, Variant
from wrenchbed.effects.chain import ActiveEffect, active_effect, effects, respond
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import NotFoundError, ParameterError, TwinError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.twin.export import export
from wrenchbed.twin.twin import Twin, nominal

SECOND_ORDER = {
    "joint.compliance": 0.02, "base.compliance": 0.003, "tool.flexure": 0.005,
    "joint.clearance": 1e-4, "environment.contact": 1e-4, "cable.pull": 2e-6,
}  # fmt: skip
"""Relative differences of what the closed form takes to first order, or a tendon from afar."""
IN_MOTION = {
    "joint.compliance": 0.1, "base.compliance": 0.05,
    "joint.backlash": 0.15, "joint.clearance": 0.02,
}  # fmt: skip
"""The same in motion: the closed form leaves moments of inertia about the links' centres out."""
SWINGS = ("tool.flexure", "tool.loose")
"""In motion a mass that has moved in the tool is also swung: the closed form leaves that out,
and a grip is a constant friction, not a share of the load: what sticks lets go a little apart."""


def still(name: str, n: int = 24) -> Scene:
    """Random poses at rest, ten seconds apart, warming up by 5 K."""
    robot = registry.load("robots", name)
    q = robot.sample(n, np.random.default_rng(3))
    rows = np.ones(n, dtype=bool)
    warmth = np.linspace(0.0, 5.0, n)
    return Scene(
        robot,
        robot.parameters.nominal,
        np.array(robot.gravity),
        q,
        10.0 * np.arange(n),
        rows,
        warmth,
    )


def moving(rows: int = 251, rate: float = 125.0) -> Scene:
    """A multisine of the UR5, exact jets."""
    robot, t = registry.load("robots", "ur5"), np.arange(rows) / rate
    rng = np.random.default_rng(1)
    v = np.tile([0.0, -1.2, 1.4, -1.6, 1.5, 0.0], (rows, 1))
    d, dd = np.zeros((rows, 6)), np.zeros((rows, 6))
    for k in (1, 2, 3):
        w, size = np.pi * k, rng.uniform(-0.25, 0.25, 6) / k
        angle = w * t[:, None] + rng.uniform(0.0, 6.0, 6)
        v, d = v + size * np.sin(angle), d + size * w * np.cos(angle)
        dd = dd - size * w * w * np.sin(angle)
    held, warmth = np.ones(rows, dtype=bool), np.linspace(0.0, 5.0, rows)
    gravity = np.array(robot.gravity)
    return Scene(robot, robot.parameters.nominal, gravity, Jet(v, d, dd), t, held, warmth)


def sized(effect: Effect, scene: Scene, variant: Variant, times: float = 2.0) -> ActiveEffect:
    """A variant with its amplitudes at several times their typical size."""
    known = effect.parameters(scene.robot)
    values: dict[str, Any] = dict(variant.at)
    values |= {n: times * known[known.index(n)].tolerance for n in variant.free}
    return ActiveEffect.of(scene.robot, effect.name, values)


SCENES = {"ur5": still("ur5"), "medrue": still("medrue"), "moving": moving()}


def difference(scene, active) -> tuple[float, float]:
    """rms of twin against closed form, and of the effect itself."""
    closed = respond(scene, active)
    changed = closed - respond(scene)
    apart = nominal(scene.robot, active).wrench(scene) - closed
    if scene.moving and active[0].effect.name in SWINGS:
        apart, changed = apart[:, 3:], changed[:, 3:]
    return float(np.sqrt(np.mean(apart**2))), float(np.sqrt(np.mean(changed**2)))


@pytest.mark.sampled
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("name", registry.names("effects"))
def test_mujoco_and_the_closed_form_agree_on_every_effect(name, scene):
    scene, effect = SCENES[scene], effects()[name]
    variants = effect.variants(scene)
    some = variants if len(variants) <= 8 else [*variants[:4], *variants[-4:]]
    for variant in some:
        apart, own = difference(scene, [sized(effect, scene, variant)])
        share = SECOND_ORDER.get(name, 1e-8)
        share = IN_MOTION.get(name, share) if scene.moving else share
        if scene.moving and name in SWINGS:
            share = 0.5 if "sticks" in variant.label else 0.2
        assert apart <= share * own + 1e-12, variant.label


def test_tools_show_by_orientation_and_odd_inertias_are_simulated():
    scene = still("oriented")
    for name in ("tool.loose", "base.tilt", "mount.rotation", "tool.cog"):
        effect = effects()[name]
        apart, own = difference(scene, [sized(effect, scene, effect.variants(scene)[0])])
        assert apart < 1e-8 * own
    scene = SCENES["moving"]
    odd = ActiveEffect.of(scene.robot, "tool.inertia", {"inertia.xy": 5e-3})
    apart, own = difference(scene, [odd])
    assert own > 1e-4
    assert apart < 1e-8 * own


def test_several_effects_act_together_and_loose_parts_lean():
    scene = SCENES["ur5"]
    texts = ("joint.compliance:joint=2,stiffness=1.4e4", "cable.pull:pull.x=1.5", "sensor.gain",
             "tool.loose", "joint.backlash:joint=3,load=2e-4", "tool.flexure")  # fmt: skip
    active = tuple(active_effect(scene.robot, text) for text in texts)
    apart, own = difference(scene, active)
    assert apart < 0.01 * own
    for shift in (1e-3, -1e-3):
        loose = ActiveEffect.of(scene.robot, "tool.loose", {"shift": shift, "lean": 0.3})
        apart, own = difference(scene, [loose])
        assert apart < 1e-8 * own


def test_the_closed_form_is_not_called_for_mechanical_effects(monkeypatch):
    scene = SCENES["ur5"]
    names = ("joint.compliance", "joint.backlash", "base.compliance", "tool.flexure", "tool.loose",
             "cable.pull", "environment.contact", "joint.clearance")  # fmt: skip
    for name in names:
        effect = effects()[name]
        active = sized(effect, scene, effect.variants(scene)[0])
        before = nominal(scene.robot, [active]).wrench(scene)

        def refuse(*_):
            raise AssertionError("closed form")

        for method in ("displace", "pose", "load"):
            if hasattr(type(effect), method):
                monkeypatch.setattr(type(effect), method, refuse)
        assert np.array_equal(nominal(scene.robot, [active]).wrench(scene), before), name


def example() -> Twin:
    robot = registry.load("robots", "ur5")
    twin = nominal(robot, [active_effect(robot, "joint.compliance:joint=2,stiffness=1.4e4"),
                           active_effect(robot, "cable.pull")])  # fmt: skip
    theta = twin.model.parameters.vector({"tool.mass": 1.42, "sensor.bias.fx": 0.3})
    return Twin(twin.model, theta, twin.active, "rec.parquet")


def test_a_twin_comes_back_from_its_file(tmp_path):
    twin = example()
    twin.write(tmp_path / "twin.json")
    back = Twin.read(tmp_path / "twin.json")
    assert back.to_json() == twin.to_json()
    raw = json.loads((tmp_path / "twin.json").read_text())
    assert raw["format"] == 1
    assert raw["theta"] == {"tool.mass": 1.42, "sensor.bias.fx": 0.3}
    assert raw["tool"]["mass"] == 1.42
    assert raw["recording"] == "rec.parquet"
    assert [e["effect"] for e in raw["effects"]] == ["joint.compliance", "cable.pull"]
    scene = SCENES["ur5"]
    assert np.array_equal(back.wrench(scene), twin.wrench(scene))


BAD = {
    "format": (lambda r: r.update(format=2), "format = 2 must be 1"),
    "robot": (lambda r: r.update(robot="hal"), "robot: there is no robot 'hal'"),
    "theta name": (lambda r: r["theta"].update(mass=1.0), "theta: there is no parameter 'mass'"),
    "theta value": (lambda r: r["theta"].update({"tool.mass": -1.0}), "lies outside"),
    "theta list": (lambda r: r.update(theta=[]), "theta is not an object with fields"),
    "effect": (lambda r: r["effects"][1].update(effect="cable.pul"), "effects[1].effect: there is"),
    "parameter": (lambda r: r["effects"][0]["parameters"].update(k=1.0), "effects[0].effect"),
    "text": (lambda r: r["effects"][0]["parameters"].update({"compliance.q1": "a"}), "effects[0]"),
    "effects": (lambda r: r.update(effects={}), "effects = {} must be a list"),
    "gravity": (lambda r: r.update(gravity=[0.0, 1.0]), "gravity = [0.0, 1.0] must be 3 numbers"),
    "tool": (lambda r: r["tool"].update(mass=2.0), "tool.mass = 2.0 contradicts theta"),
    "unknown": (lambda r: r.update(efects=[]), "there is no field efects"),
    "recording": (lambda r: r.update(recording=3), "recording = 3 must be a name"),
}


@pytest.mark.parametrize("change", BAD)
def test_a_bad_file_gives_one_line_that_names_file_and_field(tmp_path, change):
    spoil, words = BAD[change]
    raw = example().to_json()
    spoil(raw)
    path = tmp_path / "twin.json"
    path.write_text(json.dumps(raw))
    with pytest.raises(TwinError) as caught:
        Twin.read(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_twin_follows_only_its_own_robot():
    with pytest.raises(TwinError, match="a twin of 'ur5' cannot do what 'medrue' did"):
        example().wrench(SCENES["medrue"])


def test_without_values_an_effect_has_its_typical_size():
    robot = registry.load("robots", "ur5")
    for name, effect in effects().items():
        known = effect.parameters(robot)
        values = active_effect(robot, name).values
        big = [p.name for p in known if p.nominal == 0 and values[p.name] == p.tolerance]
        assert big, name
    only = active_effect(robot, "joint.offset:joint=3").values
    assert [n for n, v in only.items() if v] == ["offset.q3"]
    with pytest.raises(NotFoundError, match="did you mean 'base.tilt'"):
        active_effect(robot, "base.tild")
    with pytest.raises(ParameterError, match="no parameter 'z'"):
        active_effect(robot, "base.tilt:z=1")


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("robot", "effect", "close"),
    [
        ("ur5", "joint.compliance:joint=2,stiffness=1.4e4", 1e-3),
        ("ur5", "cable.pull:stiffness=3,anchor.x=1,length=0.3,pull.x=0.5", 2e-3),
        ("ur5", "environment.contact:stiffness=200,depth=0.5", 0.3),
        ("ur5", "joint.offset:joint=3,offset=0.01", 1e-3),
        ("medrue", "base.compliance:compliance=1e-4", 5e-3),
        ("medrue", "joint.compliance", 1e-3),
    ],
)
def test_the_exported_model_settles_to_the_twins_wrench(tmp_path, robot, effect, close):
    """In time, with its servos: minus MuJoCo's own force and torque sensors."""
    robot = registry.load("robots", robot)
    twin = nominal(robot, [active_effect(robot, effect)])
    mjcf, rest = export(twin, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = 0.0
    mujoco.mj_step(model, data, 4000)
    read = -np.concatenate([data.sensor("force").data, data.sensor("torque").data])
    scene = still(robot.name, 1)
    object.__setattr__(scene, "q", robot.home[None])
    assert np.abs(read - twin.wrench(scene)[0]).max() < close
    assert np.abs(twin.wrench(scene) - respond(scene)).max() > close / 20
    assert json.loads(rest.read_text())["outside"] == []
    assert "minus" in (tmp_path / "README.md").read_text()
