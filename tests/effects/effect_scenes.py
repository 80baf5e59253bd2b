"""Scenes in which effects are tried, and what effects do there."""

from functools import cache

import numpy as np

from wrenchbed import registry
from wrenchbed.effects.chain import ActiveEffect, EffectChain, respond
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.taylor_jets import Jet

NAMES = [n for n in registry.names("effects") if registry.load("effects", n).stage != "effort"]
"""Those that the wrench may show."""
SCENES = ("ur5 static", "ur5 motion", "medrue static", "oriented static")
NOISE = np.array([0.05, 0.05, 0.05, 2e-3, 2e-3, 2e-3])
SEEN = 1e-9
"""A change of a reading beyond rounding [N, N·m]."""
BLIND = {
    ("ur5 static", "q1"): "joint 1 turns about gravity",
    ("ur5 motion", "q1"): "joint 1 turns about gravity, and a constant turn moves nothing else",
    ("medrue static", "q1"): "a slide turns nothing",
}
"""Scene and the last part of a parameter's name → why no reading may change there."""


def static(robot_name, poses=60, between=3, warmth=None, seed=5):
    """Random poses 5 s apart with rows on the ways between them that the robot can take."""
    robot = registry.load("robots", robot_name)
    theta = robot.parameters.nominal
    if not robot.joints:
        theta = robot.theta_of_tool(theta, 1.2, (0.004, -0.006, 0.07))
    q = robot.sample(poses, np.random.default_rng(seed))
    share = np.arange((poses - 1) * (between + 1) + 1) / (between + 1)
    path = np.stack([np.interp(share, np.arange(poses), column) for column in q.T], axis=1)
    held = np.arange(len(share)) % (between + 1) == 0
    good = np.ones(len(share), dtype=bool)
    good[list(robot.infeasible(path, theta))] = False
    assert good[held].all()
    t = 10.0 + 5.0 * share
    warm = None if warmth is None else warmth * (1.0 - np.exp(-(t - t[0]) / 100.0))
    gravity = np.array(robot.gravity)
    return Scene(
        robot, theta, gravity, path[good], t[good], held[good], None if warm is None else warm[good]
    )


def motion(robot_name, seconds=5.0, rate=125.0):
    """A smooth multisine about the home pose that turns the tool well about."""
    robot = registry.load("robots", robot_name)
    rng = np.random.default_rng(8)
    t = np.arange(int(seconds * rate)) / rate
    shape = (3, 1, len(robot.joints))
    omega = 2.0 * np.pi * np.array([0.4, 0.8, 1.4])[:, None, None] * np.ones(shape)
    size = np.array([0.5, 0.12, 0.04])[:, None, None]
    phase = rng.uniform(0.0, 2.0 * np.pi, shape)
    angle = omega * t[None, :, None] + phase
    q = Jet(
        robot.home + (size * np.sin(angle)).sum(axis=0),
        (size * omega * np.cos(angle)).sum(axis=0),
        -(size * omega**2 * np.sin(angle)).sum(axis=0),
    )
    theta, gravity = robot.parameters.nominal, np.array(robot.gravity)
    return Scene(robot, theta, gravity, q, t, np.ones(len(t), dtype=bool))


def at(robot_name, q):
    """A robot at rest at some joint values or quaternions."""
    robot, q = registry.load("robots", robot_name), np.atleast_2d(np.asarray(q, dtype=float))
    rows, gravity = np.arange(len(q)), np.array(robot.gravity)
    return Scene(robot, robot.parameters.nominal, gravity, q, 1.0 * rows, rows >= 0)


def added(scene, name, **given):
    """What an effect adds to the readings (M, 6); dots of names are written __."""
    values = {k.replace("__", "."): v for k, v in given.items()}
    return respond(scene, [ActiveEffect.of(scene.robot, name, values)]) - respond(scene)


def displacement(scene, name, **given):
    """What an effect adds to the joint values (M, J)."""
    return EffectChain([ActiveEffect.of(scene.robot, name, given)]).displacement(scene)


@cache
def scene_of(label):
    robot, _, kind = label.partition(" ")
    if kind == "motion":
        return motion(robot)
    return static(robot, warmth=8.0 if robot == "medrue" else None)


@cache
def plain(label):
    return respond(scene_of(label))


def variants(name, label):
    effect, scene = registry.load("effects", name), scene_of(label)
    mode = "dynamic" if scene.moving else "static"
    return effect.variants(scene) if mode in effect.modes else ()


def columns(name, label):
    """Every free amplitude of every variant once: (amplitude, what its shape is there)."""
    found = {}
    for v in variants(name, label):
        for n in v.free:
            found[n, tuple(sorted(v.at.items()))] = (n, dict(v.at))
    return list(found.values())


def change(name, label, given):
    """What an effect with the given values adds to the readings (M, 6)."""
    scene = scene_of(label)
    return respond(scene, [ActiveEffect.of(scene.robot, name, given)]) - plain(label)


def typical(name, label, parameter):
    known = registry.load("effects", name).parameters(scene_of(label).robot)
    return known[known.index(parameter)].tolerance
