"""Simulated UR5 whose joint torques are known: what `study_drives` and its test fit.

MuJoCo's inverse dynamics of links that differ from the model, friction written here, noise that
remembers. None of it is code of a fit that it judges.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import parse
from wrenchbed.data.recording import Recording

UR5 = registry.load("robots", "ur5")
RATE, BASE, HARMONICS, SPREAD = 125.0, 0.1, 5, 0.28
"""Rows a second [Hz], lowest frequency of the motion [Hz], how many multiples of it, and the
standard deviation of an amplitude [rad], less for higher ones; estimates."""
NOISE = np.array([0.6, 0.9, 0.5, 0.12, 0.1, 0.08])
"""Standard deviation of a row's torque [N·m]; estimate, a UR5's currents times 10 N·m/A."""
MEMORY = 0.7
"""Correlation of a row's noise with that of the row before [1]; estimate."""
ENCODER = 1e-5
"""Standard deviation of a joint value [rad]; estimate."""
COULOMB = np.array([8.0, 9.0, 7.0, 2.0, 1.5, 1.2])
"""Typical Coulomb friction [N·m]; estimate."""
VISCOUS = np.array([5.0, 6.0, 4.0, 1.0, 0.8, 0.7])
"""Typical viscous friction [N·m·s/rad]; estimate."""
LINKS = (0.01, 0.03)
"""How far masses, centres of gravity and inertias of links are from the model [1]."""
SPAN, OFFSET, ROTOR = (0.6, 1.4), 0.1, (0.05, 0.15)
"""Friction over its typical value, offset over Coulomb friction, rotors [kg·m²]; estimates."""
HEAVY, LIGHT = (1.0, 3.0), (0.3, 0.6)
"""Mass of the tool with and without the payload [kg]; estimates."""
PLACE = (-0.04, -0.04, 0.03), (0.04, 0.04, 0.12)
"""Where its centre of gravity may be [m], least and most; estimate."""
STIFFNESS, DIP, STATIC, SUBSTEPS = 1e4, 0.05, 1.3, 10
"""LuGre: of the bristles [N·m/rad], speed of the Stribeck dip [rad/s], static over Coulomb friction
[1], steps a row; estimates."""
STREAMS = {"robot": 0, "fit": 1, "held out": 2, "noise": 3}


@dataclass(frozen=True, eq=False)
class Motion:
    """What joints do and need: clock (N,), values, speeds, accelerations, torques (N, 6)."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    torque: np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    """One robot: exact motions with a payload, without, and held out; what its sensors gave.

    Attributes:
        heavy, light, unseen: exact.
        seen: heavy and light as measured, with noise.
        unseen_noisy: torque of the held-out motion with noise (N, 6) [N·m].
        friction: truth by name, ``drive.coulomb.1``….
        payload: heavy's mass less light's [kg].
    """

    heavy: Motion
    light: Motion
    unseen: Motion
    seen: tuple[Motion, Motion]
    unseen_noisy: np.ndarray
    friction: dict[str, float]
    payload: float

    def recording(self, k: int) -> Recording:
        """What was measured with the payload (0) or without (1)."""
        raw = {"format": 1, "robot": "ur5", "source": "study", "mode": "dynamic",
               "rate_hz": RATE, "gravity": list(UR5.gravity)}  # fmt: skip
        seen = self.seen[k]
        columns = {"t": seen.t} | {f"q{j + 1}": seen.q[:, j] for j in range(6)}
        columns |= {f"tau{j + 1}": seen.torque[:, j] for j in range(6)}
        return Recording(parse(raw, "study"), columns, f"payload {1 - k}")


def case(seed: int, seconds: float = 60.0, lugre: bool = False) -> Case:
    """A robot by its seed: links, friction, rotors, offsets, payload, two motions, noise."""
    rngs = {name: np.random.default_rng([seed, k]) for name, k in STREAMS.items()}
    rng, noise = rngs["robot"], rngs["noise"]
    coulomb, viscous = COULOMB * rng.uniform(*SPAN, 6), VISCOUS * rng.uniform(*SPAN, 6)
    offset, rotor = OFFSET * COULOMB * rng.normal(size=6), rng.uniform(*ROTOR, 6)
    masses = [float(rng.uniform(*span)) for span in (HEAVY, LIGHT)]
    places, links = rng.uniform(*PLACE, (2, 3)), int(rng.integers(2**31))

    def moved(fourier: tuple[np.ndarray, ...], tool: int) -> Motion:
        t, q, qd, qdd = fourier
        model = _model(masses[tool], places[tool], rotor, np.random.default_rng(links))
        resists = _bristles(qd, coulomb) if lugre else coulomb * np.sign(qd)
        return Motion(t, q, qd, qdd, _inverse(model, q, qd, qdd) + resists + viscous * qd + offset)

    way = _fourier(rngs["fit"], seconds)
    heavy, light = (moved(way, k) for k in (0, 1))
    unseen = moved(_fourier(rngs["held out"], seconds), 0)
    friction = {f"drive.{name}.{j + 1}": float(values[j]) for j in range(6) for name, values in
                (("coulomb", coulomb), ("viscous", viscous), ("offset", offset))}  # fmt: skip
    seen = tuple(_noisy(motion, noise) for motion in (heavy, light))
    spoilt = _noisy(unseen, noise).torque
    return Case(heavy, light, unseen, (seen[0], seen[1]), spoilt, friction, masses[0] - masses[1])


def _fourier(rng: np.random.Generator, seconds: float) -> tuple[np.ndarray, ...]:
    """A periodic motion about home: clock, values, speeds, accelerations."""
    t = np.arange(round(seconds * RATE)) / RATE
    q = np.tile(np.array(UR5.home), (len(t), 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for k in range(1, HARMONICS + 1):
        w = 2.0 * np.pi * BASE * k
        a, b = rng.normal(0.0, SPREAD, (2, 6)) / np.sqrt(k)
        sine, cosine = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q, qd = q + a * sine + b * cosine, qd + w * (a * cosine - b * sine)
        qdd = qdd - w * w * (a * sine + b * cosine)
    return t, q, qd, qdd


def _model(
    mass: float, cog: np.ndarray, rotor: np.ndarray, rng: np.random.Generator
) -> mujoco.MjModel:
    """The UR5 with links that differ from its model; the tool is exact."""
    theta = UR5.theta_of_tool(UR5.parameters.nominal.copy(), mass, cog.tolist())
    model = UR5.spec(theta).compile()
    for body in range(1, model.nbody):
        off = 1.0 + rng.uniform(*LINKS, 3) * rng.choice([-1.0, 1.0], 3)
        if model.body(body).name != "tool":
            model.body_mass[body] *= off[0]
            model.body_ipos[body] *= off[1]
            model.body_inertia[body] *= off[2]
    model.body_gravcomp[:], model.opt.integrator = 0.0, mujoco.mjtIntegrator.mjINT_EULER
    model.dof_armature[:] = rotor
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def _inverse(model: mujoco.MjModel, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques (N, 6) [N·m] without friction."""
    data, found = mujoco.MjData(model), np.zeros_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse
    return found


def _bristles(qd: np.ndarray, coulomb: np.ndarray) -> np.ndarray:
    """LuGre without its viscous part (N, 6): Canudas de Wit et al. 1995, doi 10.1109/9.376053."""
    z, found, damping = np.zeros(qd.shape[1]), np.zeros_like(qd), 2.0 * np.sqrt(STIFFNESS)
    step = 1.0 / RATE / SUBSTEPS
    for k, v in enumerate(qd):
        level = coulomb * (1.0 + (STATIC - 1.0) * np.exp(-((v / DIP) ** 2)))
        decay = STIFFNESS * np.abs(v) / level
        for _ in range(SUBSTEPS):
            z = (z + step * v) / (1.0 + step * decay)
        found[k] = STIFFNESS * z + damping * (v - decay * z)
    return found


def _noisy(motion: Motion, rng: np.random.Generator) -> Motion:
    """As measured: joint values and torques; speeds and accelerations are the truth's."""
    white = rng.normal(size=motion.q.shape)
    noise = white.copy()
    for k in range(1, len(noise)):
        noise[k] = MEMORY * noise[k - 1] + np.sqrt(1.0 - MEMORY**2) * white[k]
    q = motion.q + ENCODER * rng.normal(size=motion.q.shape)
    return Motion(motion.t, q, motion.qd, motion.qdd, motion.torque + NOISE * noise)
