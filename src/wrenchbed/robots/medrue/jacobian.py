"""How gravity in the sensor's axes turns with MedRUE's parameters: the chain rule, written out.

With e from C to A of a five-bar, f across it and w the direction of a proximal link,
B = A + L1·w(a), D = C + L3·w(c); E follows from |E − B| = L2, |E − D| = L4, so that
(E − B)ᵀ dE = (E − B)ᵀ dB + L2 dL2 and likewise from D. The wrist's axes are u, y = z × u and
z ∝ u × n with n = (0, cos γ, sin γ) and γ the angle of the distal link plus q6.
"""

from collections.abc import Sequence

import numpy as np

from wrenchbed.physics.rotations import euler
from wrenchbed.robots.base import Values
from wrenchbed.robots.medrue.kinematics import five_bar

_STEP = 1e-30
_TURNS = {"base": ("alpha0", "beta0", "gamma0"), "mount": ("alphaS", "betaS", "gammaS")}


class _Bar:
    """One five-bar at joint values (N,): points (2, N) and what moves them."""

    def __init__(self, p: Values, i: int, first: np.ndarray, second: np.ndarray) -> None:
        self._p, self._i = p, i
        bar = five_bar(p, i, first, second)
        base = np.array([p[f"A{i}y"] - p[f"C{i}y"], p[f"A{i}z"] - p[f"C{i}z"]])
        self._length = float(np.hypot(*base))
        e = base / self._length
        self._across = np.array([-e[1], e[0]])
        a, c = first + p[f"dq{2 * i}"], second + p[f"dq{2 * i + 1}"]
        self._ways = [np.outer(e, np.cos(x)) + np.outer(self._across, np.sin(x)) for x in (a, c)]
        self.E, self.D = bar.E.T, bar.D.T
        self.from_B, self.from_D = (bar.E - bar.B).T, (bar.E - bar.D).T
        one, two = self.from_B, self.from_D
        det = one[0] * two[1] - one[1] * two[0]
        self._solved = (np.stack([two[1], -two[0]]) / det, np.stack([-one[1], one[0]]) / det)

    def slope(self, name: str) -> tuple[np.ndarray, np.ndarray] | None:
        """dE and dD (2, N) by a parameter; None if it moves neither."""
        p, i = self._p, self._i
        if name[:-1] not in (f"A{i}", f"C{i}", f"L{i}") and name not in (
            f"dq{2 * i}", f"dq{2 * i + 1}",
        ):  # fmt: skip
            return None
        dB, dD = np.zeros_like(self.E), np.zeros_like(self.E)
        turned = 0.0
        for point, moved, sign in (("A", dB, 1.0), ("C", dD, -1.0)):
            for axis, letter in enumerate("yz"):
                if name == f"{point}{i}{letter}":
                    moved[axis] += 1.0
                    turned = sign * self._across[axis] / self._length
        grown = [0.0, 0.0]
        for k, (moved, way, length, own, drive) in enumerate((
            (dB, self._ways[0], f"L{i}1", f"L{i}2", f"dq{2 * i}"),
            (dD, self._ways[1], f"L{i}3", f"L{i}4", f"dq{2 * i + 1}"),
        )):  # fmt: skip
            turn = turned + (1.0 if name == drive else 0.0)
            if turn:
                moved[0] -= p[length] * turn * way[1]
                moved[1] += p[length] * turn * way[0]
            if name == length:
                moved += way
            if name == own:
                grown[k] = p[own]
        right = (_dot(self.from_B, dB) + grown[0], _dot(self.from_D, dD) + grown[1])
        return self._solved[0] * right[0] + self._solved[1] * right[1], dD


def gravity_slopes(
    p: Values, q: np.ndarray, gravity: np.ndarray, names: Sequence[str]
) -> np.ndarray:
    """Derivative (N, 3, K) of R_world_sensorᵀ g [m/s²] by parameters, at joint values (N, 6)."""
    bars = [_Bar(p, i, q[:, 2 * i - 1], q[:, 2 * i]) for i in (1, 2)]
    left, right = bars
    span = np.stack([np.full(len(q), p["d41"] + p["d42"]), *(right.E - left.E)])
    length = np.sqrt(_dot(span, span))
    u = span / length
    base = euler(*(p[n] for n in _TURNS["base"]))
    mount = euler(*(p[n] for n in _TURNS["mount"]))
    link = left.from_D / p["L14"]
    q6 = q[:, 5] + p["dq6"]
    c = link[0] * np.cos(q6) - link[1] * np.sin(q6)
    s = link[1] * np.cos(q6) + link[0] * np.sin(q6)
    v = _across(u, c, s)
    size = np.sqrt(_dot(v, v))
    z = v / size
    axes = np.stack([u, _cross(z, u), z])
    down = gravity @ base
    by_dz, by_du = _cross(u, down), _cross(down, z)  # of downᵀ dy, as y = z × u
    result = np.zeros((len(names), len(q), 3))
    for k, name in enumerate(names):
        if name in _TURNS["base"]:
            turned = np.einsum("ain,i->na", axes, gravity @ _slope_of(p, "base", name))
            result[k] = turned @ mount
            continue
        if name in _TURNS["mount"]:
            result[k] = np.einsum("ain,i->na", axes, down) @ _slope_of(p, "mount", name)
            continue
        moved = [bar.slope(name) for bar in bars]
        if moved == [None, None] and name not in ("d41", "d42", "dq6"):
            continue
        du, turn = _span_and_roll(name, moved, link, p["L14"])
        du = (du - u * _dot(u, du)) / length
        dv = _across(du, c, s) + turn * _across(u, -s, c)
        dz = (dv - z * _dot(z, dv)) / size
        seen = [down @ du, _dot(by_dz, dz) + _dot(by_du, du), down @ dz]
        np.matmul(np.stack(seen, axis=1), mount, out=result[k])
    return np.moveaxis(result, 0, -1)


def _span_and_roll(
    name: str, moved: list[tuple[np.ndarray, np.ndarray] | None], link: np.ndarray, length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the span between the tips (3, N) and of the wrist's roll (N,)."""
    rows = link.shape[1]
    du, turn = np.zeros((3, rows)), np.full(rows, 1.0 if name == "dq6" else 0.0)
    du[0] = 1.0 if name in ("d41", "d42") else 0.0
    for tip, sign in zip(moved, (-1.0, 1.0), strict=True):
        if tip is not None:
            du[1:] += sign * tip[0]
    if moved[0] is not None:
        off = moved[0][0] - moved[0][1]
        turn += (link[0] * off[1] - link[1] * off[0]) / length
    return du, turn


def _slope_of(p: Values, which: str, name: str) -> np.ndarray:
    """Derivative (3, 3) of a fixed rotation by one of its angles."""
    angles = [complex(p[n], _STEP if n == name else 0.0) for n in _TURNS[which]]
    return np.asarray(euler(*angles)).imag / _STEP


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of vectors (3, N) or (2, N)."""
    return np.asarray(sum(x * y for x, y in zip(a, b, strict=True)))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _across(a: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """a × (0, y, z)."""
    return np.stack([a[1] * z - a[2] * y, -a[0] * z, a[0] * y])
