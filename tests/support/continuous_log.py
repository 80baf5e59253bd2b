"""A continuous log of a UR5 that MuJoCo moves: holds, moves, an uneven clock, encoder noise."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import wrenchbed as wb
from simulated import UR5_TRUTH, WHITE
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import QUATERNION, Recording
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS

TRUTH = {k: v for k, v in UR5_TRUTH.items() if not k.startswith("mount")}


@dataclass(frozen=True)
class How:
    """What a log is like: number of holds, mean rate of rows [Hz], standard deviation of an encoder
    [rad], half width of a time stamp over the step, share of lost frames, speed of the fastest
    joint [rad/s], whether it has orientations and no joints, vibration after a move [N]."""

    holds: int = 12
    rate: float = 125.0
    encoder: float = 3e-5
    jitter: float = 0.2
    lost: float = 0.002
    speed: float = 0.8
    oriented: bool = False
    shake: float = 0.0


def random_how(seed: int) -> How:
    """Holds, rate, noise … of a log by chance."""
    rng = np.random.default_rng([seed, 1])
    return How(
        holds=int(rng.integers(8, 16)),
        rate=float(rng.choice([50.0, 100.0, 125.0, 250.0])),
        encoder=float(10.0 ** rng.uniform(-5.5, -3.7)),
        jitter=float(rng.uniform(0.0, 0.35)),
        lost=float(rng.uniform(0.0, 0.01)),
        speed=float(rng.uniform(0.3, 1.5)),
        oriented=bool(rng.random() < 0.3),
        shake=float(rng.choice([0.0, 2.0])),
    )


def log(how: How, seed: int) -> tuple[Recording, np.ndarray]:
    """A recording in motion as a controller logs it, and the true length of each hold (H,) [s]."""
    rng = np.random.default_rng([seed, 2])
    arm = wb.load("robots", "ur5")
    q = np.clip(arm.sample(how.holds, rng), -3.0, 3.0)
    hold = rng.uniform(1.0, 10.0, how.holds)
    way = np.abs(np.diff(q, axis=0)).max(axis=1)
    move = np.append(np.maximum(1.875 * way / how.speed, 0.6), 0.0)
    knots = np.concatenate([[0.0], np.cumsum(hold + move)])
    n = int(knots[-1] * how.rate)
    even = np.arange(n) / how.rate
    t = even + rng.uniform(-how.jitter, how.jitter, n) / how.rate
    t = np.sort(t[rng.random(n) >= how.lost])
    k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, how.holds - 1)
    nearest = np.minimum(k + 1, how.holds - 1)
    length = np.where(move[k] > 0, move[k], 1.0)
    since = t - knots[k] - hold[k]
    s = np.clip(since / length, 0.0, 1.0)
    go = q[nearest] - q[k]
    rates = (s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2 / length,
             60 * s * (1 - 3 * s + 2 * s**2) / length**2)  # fmt: skip
    path = [r[:, None] * go for r in rates]
    model = wb.Model.of(arm)
    theta = model.parameters.vector(TRUTH)
    moving = Jet(q[k] + path[0], path[1], path[2])
    load = model.read(wb.Simulation(arm, theta[: len(arm.parameters)]).wrench(moving), theta)
    after = np.where(k > 0, t - knots[k], 9.9)  # since the arm came to rest
    shaking = how.shake * np.exp(-after / 0.08) * np.sin(2 * np.pi * 18.0 * after)
    load = load + shaking[:, None] * np.array([1.0, 0.6, 0.3, 0.05, 0.08, 0.0])
    load = load + WHITE * rng.standard_normal(load.shape)
    read = moving.v + how.encoder * rng.standard_normal(moving.v.shape)
    columns = {"t": t - t[0]}
    if how.oriented:
        turn = Rotation.from_matrix(arm.sensor_pose(read, theta[: len(arm.parameters)])[0])
        columns |= dict(zip(QUATERNION, turn.as_quat(scalar_first=True).T, strict=True))
    else:
        columns |= {f"q{j + 1}": read[:, j] for j in range(6)}
    columns |= dict(zip(CHANNELS, load.T, strict=True))
    name = "my-robot" if how.oriented else "ur5"
    return Recording(Metadata(name, "dynamic", "import"), columns), hold
