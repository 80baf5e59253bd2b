"""Effect ``joint.gear_error``: gears and encoders have a periodic error."""

import numpy as np

from wrenchbed.effects.base import JointEffect, Residual, Sizes, Values, Variant, each_joint, vector
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.taylor_jets import Value, cos, sin
from wrenchbed.robots.base import Robot

TYPICAL = 3e-4
"""Typical amplitude [rad]: 1 arcmin, as makers of strain wave gears state."""
ORDERS = np.arange(5.0, 221.0)
"""Waves a turn that a scan of a residual tries, besides those typical of gears: up to twice a ratio
of 110."""


class JointGearError(JointEffect):
    """δq = A sin(kq) + B cos(kq), order k: 1 an eccentric encoder, N and 2N the wave generator's.

    N is the gear ratio (Tuttle & Seering 1996, 10.1109/70.499819: orders 1 and 2 of the input).

    Seen in: dense poses along one joint.
    """

    name = "joint.gear_error"
    title = "gears and encoders have a periodic error"
    title_of_joint = "the gear or encoder of joint {joint} has a periodic error"
    shown = "angle"
    size_error = 0.1
    source = "0.3–2 arcmin of strain wave gears, 0.5–5 of eccentric encoders: estimate"
    amplitude = "sin"

    def parameters(self, robot: Robot) -> ParameterSet:
        items = [
            Parameter(f"{part}.q{k}", 0.0, "rad", TYPICAL, -1.0, 1.0, f"amplitude of the {name}")
            for part, name in (("sin", "sine"), ("cos", "cosine"))
            for k in rotary(robot)
        ]
        items.append(Parameter("order", 1.0, "1", 0.02, 0.01, 1e3, "waves per turn of the joint"))
        return ParameterSet(tuple(items))

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        ratios, orders = scene.robot.gear_ratio, (1.0, 2.0, 3.0, 4.0)
        return tuple(
            _wave(k, order)
            for k in rotary(scene.robot)
            for order in (*orders, *((ratios[k - 1], 2.0 * ratios[k - 1]) if ratios else ()))
        )

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Variants of all joints with the order k of the strongest wave found in a residual."""
        best, at = 0.0, (0, 0.0)
        value = residual.value.ravel()
        for k in rotary(scene.robot):
            slope = residual.tangent(f"cos.q{k}", {"order": 0.01})[residual.rows] / residual.noise
            angle = scene.joints[residual.rows, k - 1]
            moment, size = (slope * residual.value).sum(axis=1), (slope**2).sum(axis=1)
            wave = np.exp(1j * np.outer(ORDERS, angle))
            score = np.abs(wave @ moment) ** 2 / np.maximum(0.5 * size.sum(), 1e-12)
            if score.max() > best and size.sum() > 1e-6 * value.size:
                best, at = float(score.max()), (k, float(ORDERS[int(score.argmax())]))
        if not best:
            return ()
        weight = len(self.variants(scene)) / (len(ORDERS) * len(rotary(scene.robot)))
        return (_wave(*at, weight),)

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        amplitude = np.linalg.norm(vector(p, variant.free))
        return {"amplitude": (float(amplitude), "rad"), "waves_a_turn": (p["order"], "1")}

    def displace(self, scene: Scene, p: Values) -> Value:
        """Displacement of joints (M, J) [rad or m]; in motion a `Jet` with exact derivatives."""
        a, b = (
            np.array([p.get(n, 0.0) for n in each_joint(part, scene.robot)])
            for part in ("sin", "cos")
        )
        angle = p["order"] * scene.q
        return sin(angle) * a + cos(angle) * b


def _wave(joint: int, order: float, weight: float = 1.0) -> Variant:
    label = f"joint {joint}, {order:g} wave{'' if order == 1.0 else 's'} a turn"
    free = (f"sin.q{joint}", f"cos.q{joint}")
    return Variant(label, free, {"order": order}, ("order",), {"joint": joint}, weight)


def rotary(robot: Robot) -> list[int]:
    """Numbers of a robot's rotary joints, counted from 1."""
    return [k for k, joint in enumerate(robot.joints, start=1) if joint.unit == "rad"]


EFFECT = JointGearError()
