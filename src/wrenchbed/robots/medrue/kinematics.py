"""MedRUE in closed form, and its 49 parameters: Joubair et al. 2016, doi 10.3390/s16060798.

Equations 1–16 in metres; parameters of Section 3 and Table 1 in SI. The printed equations lost
signs and subscripts; `docs/explanation/medrue.md` states how each was resolved. Points of five-bar
i lie in a plane of constant x of the base; E is where its distal links meet.

The paper prints 46 parameters in its table; δq1, d31 and d32 are in its list only and have no
printed value (0 here). d31 and d32 appear in none of its equations: here they are the pins between
each five-bar's plane and its universal joint, which move neither the tool nor the wrench.
"""

from typing import NamedTuple

import numpy as np

from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.taylor_jets import Value, atan2, cos, jet_sqrt, sin, stack_jets, value
from wrenchbed.robots.base import Values, load_parameters

_LENGTH_ERROR = 2e-3
_ANGLE_ERROR = np.deg2rad(1.0)  # Section 5: ±2 mm, ±1°

_TABLE = {
    "A1y": -233.0, "A1z": 178.0, "C1y": -83.0, "C1z": 438.0,
    "A2y": -233.0, "A2z": 178.0, "C2y": -83.0, "C2z": 438.0,
    "L11": 400.0, "L12": 520.0, "L13": 400.0, "L14": 520.0,
    "L21": 400.0, "L22": 520.0, "L23": 400.0, "L24": 520.0,
    "d41": 41.5, "d42": 41.5, "d5": 0.0, "xT": 0.0, "yT": 0.0, "zT": 134.6,
    "alphaT": 67.512, "betaT": 0.0, "gammaT": 0.0, "x0": 109.0, "y0": 139.0, "z0": -31.0,
    "alpha0": 0.0, "beta0": 0.0, "gamma0": 0.0,
    "dq2": 0.0, "dq3": 0.0, "dq4": 0.0, "dq5": 0.0, "dq6": 0.0, "xS": 41.5, "yS": 0.0, "zS": 41.7,
    "alphaS": -67.512, "betaS": 0.0, "gammaS": 0.0, "xG": 0.0, "yG": 0.0, "zG": 152.4,
    "mTool": 0.365, "dq1": 0.0, "d31": 0.0, "d32": 0.0,
}  # fmt: skip
"""Nominal values of Table 1 [mm, °, kg]."""
_ANGLES = ("alpha", "beta", "gamma", "dq2", "dq3", "dq4", "dq5", "dq6")
_TEXT = {
    "A": "anchor of a five-bar's first proximal link, base frame",
    "C": "anchor of a five-bar's second proximal link, base frame",
    "L": "link length",
    "d4": "x offset of a universal joint",
    "d5": "wrist origin along the wrist's x",
    "d3": "pin between a five-bar's plane and its universal joint",
    "dq": "zero offset of an active joint",
    "T": "tool frame in the sensor frame",
    "0": "base frame in the world",
    "S": "sensor frame in the wrist frame",
    "G": "centre of gravity in the wrist frame",
}
PROBE_INERTIA = (7e-4, 7e-4, 2e-4, 0.0, 0.0, 0.0)
"""Estimate [kg·m²]: a 0.365 kg rod of 0.15 m; the paper, at rest, needs none."""
IDENTIFIED = (
    "A1z C1y A2y A2z C2z L11 L12 L13 L14 L21 L22 L24 d41 beta0 gamma0 dq2 dq3 dq4 dq5 dq6 "
    "alphaS betaS gammaS xG yG zG mTool"
).split()
"""Names of the 27 parameters that the paper's Table 1 identifies (A1y and C1z have no star, the
table's mark of fixed ones, but are constant in it)."""
MIN_HEIGHT = 0.05
"""Distance of E from the line through both elbows [m], below which a five-bar is near singular."""


def _parameter(name: str) -> Parameter:
    value = _TABLE[name]
    if name == "mTool":
        return Parameter(name, value, "kg", 0.01, 0.001, 10.0, "mass on the sensor")
    text = next(_TEXT[key] for key in (name[:2], name[:1], name[-1:]) if key in _TEXT)
    if name.startswith(_ANGLES):
        return Parameter(name, np.deg2rad(value), "rad", _ANGLE_ERROR, -6.3, 6.3, text)
    lower = 0.05 if name.startswith("L") else -3.0
    return Parameter(name, value / 1e3, "m", _LENGTH_ERROR, lower, 3.0, text)


PAPER = ParameterSet(tuple(_parameter(name) for name in _TABLE))
"""The 49 parameters of the paper."""
PARAMETERS = PAPER + load_parameters(PROBE_INERTIA)


class FiveBar(NamedTuple):
    """Joints B, D, E of a five-bar in the base's y, z plane [m], unit vector C to A (…, N, 2)."""

    B: Value
    D: Value
    E: Value
    direction: Value


class Turn(NamedTuple):
    """Cosine and sine (…, N) of one rotation angle."""

    c: Value
    s: Value


class Solved(NamedTuple):
    """Solution of MedRUE's kinematics: both closed loops and the wrist, in the base frame.

    Attributes:
        bars: both five-bars.
        e1, e2: universal joints of the probe's support (…, N, 3) [m].
        u: unit vector from e1 to e2.
        origin: position of the wrist (…, N, 3) [m].
        gamma, beta, alpha: turns of the support about x, then y, then z.
    """

    bars: tuple[FiveBar, FiveBar]
    e1: Value
    e2: Value
    u: Value
    origin: Value
    gamma: Turn
    beta: Turn
    alpha: Turn

    @property
    def wrist(self) -> Value:
        """Rotation matrix of the wrist in the base (…, N, 3, 3): the three turns multiplied."""
        (cx, sx), (cy, sy), (cz, sz) = self.gamma, self.beta, self.alpha
        cxsy, sxsy = cx * sy, sx * sy
        x = stack_jets([cy * cz, cx * sz + sxsy * cz, sx * sz - cxsy * cz])
        y = stack_jets([-(cy * sz), cx * cz - sxsy * sz, sx * cz + cxsy * sz])
        return stack_jets([x, y, stack_jets([sy, -(sx * cy), cx * cy])])


def five_bar(p: Values, i: int, first: Value, second: Value) -> FiveBar:
    """Points of five-bar i (1, 2) at joint values at A and C [rad], elbows up (Equations 2–11)."""
    ay, az, cy, cz = p[f"A{i}y"], p[f"A{i}z"], p[f"C{i}y"], p[f"C{i}z"]
    l1, l2, l3, l4 = (p[f"L{i}{k}"] for k in (1, 2, 3, 4))
    a = first + p[f"dq{2 * i}"]
    c = second + p[f"dq{2 * i + 1}"]
    base = jet_sqrt((ay - cy) * (ay - cy) + (az - cz) * (az - cz))
    s_theta, c_theta, half = (ay - cy) / base, (cz - az) / base, base / 2
    bx, by = half + l1 * cos(a), l1 * sin(a)
    dx, dy = -half + l3 * cos(c), l3 * sin(c)
    ex, ey = bx - dx, by - dy  # from D to B
    square = ex * ex + ey * ey
    along = ((l4 * l4 - l2 * l2) / square + 1.0) / 2
    across = jet_sqrt(l4 * l4 / square - along * along)
    px, py = dx + along * ex - across * ey, dy + along * ey + across * ex

    def to_base(x: Value, y: Value) -> Value:
        return stack_jets(
            [s_theta * x + c_theta * y + (ay + cy) / 2, -c_theta * x + s_theta * y + (az + cz) / 2]
        )

    return FiveBar(
        to_base(bx, by), to_base(dx, dy), to_base(px, py), stack_jets([s_theta, -c_theta])
    )


def solved(p: Values, q: Value) -> Solved:
    """Solve both closed loops at joint values q (N, 6), with parameter values p."""
    bars = (five_bar(p, i, q[..., 2 * i - 1], q[..., 2 * i]) for i in (1, 2))
    return carried(p, q, *bars)


def carried(p: Values, q: Value, left: FiveBar, right: FiveBar) -> Solved:
    """Solve for the probe's support and wrist that two solved five-bars carry (Equations 12–16)."""
    x = q[..., 0] + p["dq1"]
    e1 = stack_jets([x - p["d41"], left.E[..., 0], left.E[..., 1]])
    e2 = stack_jets([x + p["d42"], right.E[..., 0], right.E[..., 1]])
    span = e2 - e1
    u = span * (1.0 / jet_sqrt(dot(span, span)))[..., None]
    q6 = q[..., 5] + p["dq6"]
    link = (left.E - left.D) * (1.0 / p["L14"])[..., None]
    c, s = link[..., 0], link[..., 1]
    gamma = Turn(c * cos(q6) - s * sin(q6), s * cos(q6) + c * sin(q6))
    s_alpha = u[..., 1] * gamma.c + u[..., 2] * gamma.s
    alpha = Turn(jet_sqrt(1.0 - s_alpha * s_alpha), s_alpha)
    psi = u[..., 1] * gamma.s - u[..., 2] * gamma.c
    beta = Turn(jet_sqrt(alpha.c * alpha.c - psi * psi) / alpha.c, psi / alpha.c)
    origin = e1 + u * (p["d41"] + p["d5"])[..., None]
    return Solved((left, right), e1, e2, u, origin, gamma, beta, alpha)


def failures(p: Values, q: np.ndarray) -> dict[int, str]:
    """Row → reason, of the rows of q (N, 6) for which the loops have no solution."""
    bad: dict[int, str] = {}
    with np.errstate(invalid="ignore", divide="ignore"):
        loops = solved(p, q)
    for i, bar in enumerate(loops.bars, start=1):
        l2, l4 = p[f"L{i}2"], p[f"L{i}4"]
        gap = np.sqrt(dot(bar.B - bar.D, bar.B - bar.D))
        along = (l4**2 - l2**2 + gap**2) / (2 * np.maximum(gap, 1e-12))
        across = np.where(gap > 1e-6, np.sqrt(np.maximum(0.0, l4**2 - along**2)), 0.0)
        for row in np.flatnonzero(~np.isfinite(bar.E).all(axis=-1) | (across < MIN_HEIGHT)):
            bad.setdefault(
                int(row),
                f"five-bar {i} cannot close: its elbows are {1e3 * gap[row]:.1f} mm apart, the "
                f"distal links reach {1e3 * (l2 + l4):.1f} mm and must stay "
                f"{1e3 * MIN_HEIGHT:.0f} mm from straight",
            )
    lost = ~np.isfinite([loops.gamma, loops.beta, loops.alpha]).all(axis=(0, 1))
    for row in np.flatnonzero(lost):
        bad.setdefault(int(row), "the wrist cannot turn to where its two universal joints point")
    return dict(sorted(bad.items()))


def elbow(direction: Value, angle: Value, distal: Value) -> Value:
    """Angle [rad] of a passive elbow from the proximal link, at ``angle`` from the unit vector
    ``direction`` (…, N, 2), to the distal link, the vector ``distal`` (…, N, 2)."""
    c, s = cos(angle), sin(angle)
    py = direction[..., 0] * c - direction[..., 1] * s
    pz = direction[..., 1] * c + direction[..., 0] * s
    dy, dz = distal[..., 0], distal[..., 1]
    return atan2(py * dz - pz * dy, py * dy + pz * dz)


def dot(a: Value, b: Value) -> Value:
    total: Value = a[..., 0] * b[..., 0]
    for k in range(1, value(a).shape[-1]):
        total = total + a[..., k] * b[..., k]
    return total
