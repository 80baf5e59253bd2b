"""MedRUE's inverse kinematics and its workspaces, nominal or any other parameters."""

import numpy as np

from wrenchbed.frames import apply, euler
from wrenchbed.robots.base import Values

_Q6_START = np.deg2rad(93.0)  # the pool's q6, 165°…382°, sits in the middle of the turn from here


def joints(p: Values, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Joint values (N, 6) that bring the tool to a pose; NaN rows where there are none.

    Args:
        p: parameter values, each a scalar.
        rotation: R_world_tool (N, 3, 3).
        position: of the tool in the world (N, 3) [m].

    Six joints for six degrees of freedom; elbows up, as in the paper.
    """
    base = euler(p["alpha0"], p["beta0"], p["gamma0"])
    mount = euler(p["alphaS"], p["betaS"], p["gammaS"])
    tip = euler(p["alphaT"], p["betaT"], p["gammaT"])
    to_tool = np.array([p["xS"], p["yS"], p["zS"]]) + mount @ [p["xT"], p["yT"], p["zT"]]
    wrist = base.T @ rotation @ (mount @ tip).T
    origin = (position - [p["x0"], p["y0"], p["z0"]]) @ base - apply(wrist, to_tool)
    u = wrist[:, :, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        e1 = origin - u * (p["d41"] + p["d5"])
        e2 = e1 + u * ((p["d41"] + p["d42"]) / u[:, :1])
        q1 = e1[:, 0] + p["d41"] - p["dq1"]
        q2, q3 = _five_bar(p, 1, e1[:, 1:])
        q4, q5 = _five_bar(p, 2, e2[:, 1:])
        d1 = _second_elbow(p, q3)
        link = np.arctan2(e1[:, 2] - d1[:, 1], e1[:, 1] - d1[:, 0])
        # R = Rx(γ) Ry(β) Rz(α): its third column is (sin β, −sin γ cos β, cos γ cos β), cos β > 0
        gamma = np.arctan2(-wrist[:, 1, 2], wrist[:, 2, 2])
        q6 = _Q6_START + np.mod(gamma - link - p["dq6"] - _Q6_START, 2 * np.pi)
    result = np.stack([q1, q2, q3, q4, q5, q6], axis=-1)
    result[u[:, 0] <= 0.1] = np.nan
    return result


def _frame(p: Values, i: int) -> tuple[np.ndarray, np.ndarray, float]:
    a = np.array([p[f"A{i}y"], p[f"A{i}z"]])
    c = np.array([p[f"C{i}y"], p[f"C{i}z"]])
    half = float(np.linalg.norm(a - c)) / 2
    x = (a - c) / (2 * half)
    return np.array([[x[0], -x[1]], [x[1], x[0]]]), (a + c) / 2, half


def _five_bar(p: Values, i: int, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both joint values of five-bar i from its tip (N, 2) in the base's y, z plane."""
    turn, middle, half = _frame(p, i)
    x, y = ((tip - middle) @ turn).T
    first = _reach(x - half, y, p[f"L{i}1"], p[f"L{i}2"]) - p[f"dq{2 * i}"]
    second = _reach(x + half, y, p[f"L{i}3"], p[f"L{i}4"]) - p[f"dq{2 * i + 1}"]
    return np.mod(first, 2 * np.pi), np.mod(second, 2 * np.pi)


def _reach(x: np.ndarray, y: np.ndarray, near: float, far: float) -> np.ndarray:
    r = np.hypot(x, y)
    opening = np.arccos((r**2 + near**2 - far**2) / (2 * r * near))
    return np.arctan2(y, x) + opening


def _second_elbow(p: Values, q3: np.ndarray) -> np.ndarray:
    turn, middle, half = _frame(p, 1)
    angle = q3 + p["dq3"]
    local = np.stack([-half + p["L13"] * np.cos(angle), p["L13"] * np.sin(angle)], axis=-1)
    return local @ turn.T + middle


def random_poses(
    n: int,
    rng: np.random.Generator,
    *,
    tilt: float = np.deg2rad(30.0),
    roll: float = np.deg2rad(60.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Random tool poses in the paper's whole workspace: rotations (n, 3, 3), positions (n, 3) [m].

    α, β within ±``tilt``, γ within 180° ± ``roll``; x 0…0.8, y 0.2…0.65, z −0.25…0.05 m.
    """
    alpha, beta = rng.uniform(-tilt, tilt, (2, n))
    gamma = np.pi + rng.uniform(-roll, roll, n)
    position = rng.uniform([0.0, 0.2, -0.25], [0.8, 0.65, 0.05], (n, 3))
    return euler(alpha, beta, gamma), position
