"""Friction with a memory: LuGre bristles and Bouc–Wen's hysteresis, both stepped exactly enough.

LuGre: Canudas de Wit et al. 1995, doi 10.1109/9.376053, Eqs. 2 to 6. Bouc–Wen: Wen 1976,
doi 10.1061/JMCEA3.0002106.
"""

import numpy as np


def lugre(
    speed: np.ndarray, step: float, level: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> np.ndarray:
    """Friction (T, J) [N·m] of bristles, without the viscous part.

    ż = v − σ₀ |v| z / g(v), F = σ₀ z + σ₁ ż. Each step is exact for a speed that stays.

    Args:
        speed: v (T, J) [rad/s].
        step: from one instant to the next [s].
        level: g(v) (T, J) [N·m], friction in steady motion.
        stiffness: σ₀ (J,) [N·m/rad].
        damping: σ₁ (J,) [N·m·s/rad].
    """
    rate = stiffness * np.abs(speed) / level
    share = -np.expm1(-rate * step)
    target = np.sign(speed) * level / stiffness
    bristle, z = np.empty_like(speed), np.zeros(speed.shape[1])
    for k in range(len(speed)):
        z = z + share[k] * (target[k] - z)
        bristle[k] = z
    return np.asarray(stiffness * bristle + damping * (speed - rate * bristle))


def bouc_wen(
    speed: np.ndarray, step: float, width: float, sharpness: float = 1.0, loop: float = 0.6
) -> np.ndarray:
    """Hysteretic state (T,) in −1 … 1 of a spring that yields over ``width`` [rad].

    ż = v (1 − |z|ⁿ (γ + β sgn(v z))) / width with β + γ = 1, in Heun's steps.
    """
    beta, gamma = loop, 1.0 - loop

    def rate(v: float, z: float) -> float:
        turn = beta if v * z > 0.0 else -beta
        return v * (1.0 - abs(z) ** sharpness * (gamma + turn)) / width

    found, z = np.empty_like(speed), 0.0
    for k, v in enumerate(speed.tolist()):
        first = rate(v, z)
        z = z + 0.5 * step * (first + rate(v, z + step * first))
        found[k] = z
    return found
