"""What causes of the whole arm add to the torques of all joints: links, tool, tilt of the base."""

from dataclasses import replace

import numpy as np

from wrenchbed import registry
from wrenchbed.channels.held import LINK_CENTRE, LINK_MASS
from wrenchbed.diagnosis.efforts.scene import EffortScene
from wrenchbed.diagnosis.prepare.baseline import COG_M, MASS_SHARE
from wrenchbed.drives.identify import carrier_columns, load_columns, of_mass, of_moment
from wrenchbed.effects.drives.base import Block, Column
from wrenchbed.effects.drives.operators import late, slow
from wrenchbed.physics.newton_euler import INERTIAL
from wrenchbed.robots.base import INERTIA_AXES

_TILT = np.deg2rad(0.1)
"""Ordinary tilt of a base [rad]; estimate: a bubble level."""
_LINK_INERTIA = 0.05
"""Ordinary error of a link's inertia over the mean principal one; estimate."""
_GYRATION = 0.02
"""Least radius of gyration of a link [m]; estimate: files leave inertias out."""
_STEP = 0.01
"""Steps in mass [kg] and first moment [kg·m] at which the wrench's columns are made; estimate: the
wrench is linear in both but for the square of the centre of gravity."""
LIGHT = 0.01
"""Least mass of a tool whose centre of gravity moves [kg]; estimate."""
_COMMON = 4e-3
"""Delay at which the column of a common one is made [s]; estimate."""
_NOTHING = 1e-9
"""Largest value of a column, over that of the largest column, up to which it is rounding: a larger
limit drops small but real causes, a smaller one than 1e-15 keeps rounding of doubles as a cause."""
_LAST = -2.0
"""Log odds of the link that carries the tool against the tool that hangs on it; estimate."""


def of_arm(scene: EffortScene) -> tuple[list[Column], list[Block]]:
    """Columns (N, C) of the links and the load of an arm, and the causes made of them."""
    columns, blocks = _links(scene)
    columns += _lag(scene)
    unseen = np.zeros((len(scene.signals.t), len(scene.channels) - scene.joints))
    columns = [replace(c, data=np.hstack([c.data, unseen])) for c in columns]
    for more, causes in (_tool(scene), _tilt(scene)):
        columns += more
        blocks += causes
    largest = {c.name: float(np.abs(c.data).max()) for c in columns}
    seen = {name for name, size in largest.items() if size > _NOTHING * max(largest.values())}
    visible = [replace(b, columns=tuple(n for n in b.columns if n in seen)) for b in blocks]
    return [c for c in columns if c.name in seen], [b for b in visible if b.columns]


def _links(scene: EffortScene) -> tuple[list[Column], list[Block]]:
    columns, blocks = list[Column](), list[Block]()
    for k in np.flatnonzero(scene.inertias.phi[:, 0] > 0.0).tolist():
        phi, y = scene.inertias.phi[k], scene.regressor[..., INERTIAL * k : INERTIAL * (k + 1)]
        mass, cog = phi[0], phi[1:4] / max(phi[0], 1e-9)
        inertia = _LINK_INERTIA * mean_inertia(phi)
        last = k == scene.robot.carrier  # the tool hangs on it, and is the more likely cause
        for kind, ends, forms, std in (
            ("mass", ("mass",), [of_mass(cog)], LINK_MASS * mass),
            ("cog", "xyz", [of_moment(cog, axis) for axis in np.eye(3)], LINK_CENTRE * mass),
            ("inertia", INERTIA_AXES, np.eye(INERTIAL)[4:], inertia),
        ):
            names = tuple(f"link.{kind}.{k + 1}.{end}" for end in ends)
            columns += [Column(n, y @ form, std) for n, form in zip(names, forms, strict=True)]
            blocks.append(Block(f"link.{kind}", k + 1, False, names, prior=_LAST * last))
    return columns, blocks


def _tool(scene: EffortScene) -> tuple[list[Column], list[Block]]:
    """Mass and moments of the tool; free where they are not stated."""
    y = scene.regressor[..., carrier_columns(scene.robot)] @ load_columns(scene.robot, scene.theta)
    stated, tool = scene.recording.metadata.tool, scene.robot.tool(scene.theta)
    cog, mass = np.asarray(tool.cog, dtype=float), float(tool.mass)
    by_file = registry.record_of("robots", scene.robot.name) is not None  # its [tool] says so
    known = by_file or stated.mass is not None, by_file or stated.cog is not None
    gravity = np.asarray(scene.model.gravity, dtype=float)

    def seen(form: np.ndarray, moved: np.ndarray, more: float) -> np.ndarray:
        """Change of all channels (N, C) by a mass [kg] and a moment (3,) [kg·m]."""
        ends = list[np.ndarray]()
        for half in (0.5 * _STEP, -0.5 * _STEP):
            place = [float(c) for c in cog + half * moved / max(mass, LIGHT)]
            heavy = max(mass, _STEP * more) + half * more  # no tool weighs less than nothing
            theta = scene.robot.theta_of_tool(scene.theta, heavy, place)
            ends.append(scene.sensed(theta, gravity))
        return np.hstack([y @ form, (ends[0] - ends[1]) / _STEP])

    fit = scene.drives.load
    mass_std, *cog_std = (np.zeros(4) if fit is None else fit[1]).tolist()
    std = float(np.hypot(MASS_SHARE * mass, mass_std)) if known[0] else None
    columns = [Column("tool.mass", seen(of_mass(cog), np.zeros(3), 1.0), std, not known[0])]
    for name, axis, off in zip("xyz", np.eye(3), cog_std, strict=True):
        std = float(np.hypot(COG_M, off)) * max(mass, 1.0) if known[1] else None
        data = seen(of_moment(cog, axis), axis, 0.0)
        columns.append(Column(f"tool.cog.{name}", data, std, not known[1]))
    names = tuple(c.name for c in columns)
    causes = (Block("tool.mass", None, False, names[:1]), Block("tool.cog", None, False, names[1:]))
    return columns, [cause for cause, is_stated in zip(causes, known, strict=True) if is_stated]


def _lag(scene: EffortScene) -> list[Column]:
    """A delay and a filter that all joints share: a controller's clock is nobody's fault."""
    t, rate = scene.signals.t, scene.signals.rate
    delayed = np.stack([late(x, t, _COMMON) for x in scene.total.T], axis=-1)
    filtered = np.stack([slow(x, rate, _COMMON) for x in scene.total.T], axis=-1)
    return [Column("common.delay", delayed, free=True), Column("common.lag", filtered, free=True)]


def _tilt(scene: EffortScene) -> tuple[list[Column], list[Block]]:
    gravity = np.asarray(scene.model.gravity, dtype=float)
    down = gravity / np.linalg.norm(gravity)
    side = np.eye(3)[int(np.argmin(np.abs(down)))]
    columns = []
    for k, axis in enumerate((np.cross(down, side), np.cross(down, np.cross(down, side)))):
        axis = axis / np.linalg.norm(axis)
        more = np.cross(axis, gravity)  # for 1 rad, to first order
        held = -scene.robot.gravity_torque(scene.q.v, scene.theta, more)
        seen = scene.sensed(scene.theta, gravity + more) - scene.load
        columns.append(Column(f"base.tilt.{k}", np.hstack([held, seen]), _TILT))
    return columns, [Block("base.tilt", None, False, tuple(c.name for c in columns))]


def mean_inertia(phi: np.ndarray) -> float:
    """Mean principal inertia [kg·m²] about the centre of gravity of a link's parameters (10,)."""
    moment = phi[1:4]
    about = float(phi[4:7].sum()) - 2.0 * float(moment @ moment) / phi[0]
    return max(about / 3.0, phi[0] * _GYRATION**2)
